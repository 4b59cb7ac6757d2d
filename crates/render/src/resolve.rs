//! From visible samples to colours.
//!
//! Samples of a pixel that see the same smooth piece of surface are shaded once, so that only pixels on edges cost
//! more; the spots to shade of a row of pixels are then shaded by four, neighbours on one part together.

use std::ops::Range;

use glam::{Vec3A, Vec4};

use crate::assets::{RenderAssets, TRIANGLE_BITS};
use crate::hit::Hits;
use crate::lanes::{Vec3x4, each, gather};
use crate::occlusion::Arrival;
use crate::raster::Target;
use crate::shade::Lighting;
use crate::shadow::ShadowMap;
use crate::texture::{linear_from_srgb, linear_from_srgb8, srgb8_from_linear};
use crate::variation::RenderVariation;
use crate::view::{View, part_and_triangle};

/// Everything a pixel's colour depends on.
pub(crate) struct Resolve<'a> {
    pub assets: &'a RenderAssets,
    pub view: &'a View,
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub arrival: &'a Arrival,
    pub shadow: &'a ShadowMap,
    /// Opaque surfaces with `supersample`² samples per pixel.
    pub opaque: &'a Target,
    /// Sides of transparent surfaces facing away and facing the viewer, sampled alike; `None` without any.
    pub glass: Option<[&'a Target; 2]>,
    pub supersample: usize,
}

/// Largest number of samples per pixel.
const MAX_SAMPLES: usize = 16;

/// A place on the image where one surface is shaded: the mean of the samples of a pixel that see it.
#[derive(Clone, Copy, Debug, Default)]
struct Spot {
    /// Visibility id; 0 is the background.
    id: u32,
    /// Column of the pixel.
    column: u32,
    x: f32,
    y: f32,
    /// Share of the pixel's samples.
    share: f32,
}

/// What is found in a row of pixels; memory kept from row to row.
#[derive(Default)]
struct Row {
    spots: Vec<Spot>,
    /// Colour per pixel, linear.
    sums: Vec<Vec3A>,
    /// Pixels with transparent surfaces, their spots and the spot of each sample.
    behind_glass: Vec<(usize, Range<usize>, [usize; MAX_SAMPLES])>,
}

impl Resolve<'_> {
    /// Writes 8-bit sRGB, three bytes per pixel.
    pub fn write_rgb(&self, rgb: &mut Vec<u8>) {
        let (width, height) = (self.view.lens.width, self.view.lens.height);
        rgb.clear();
        rgb.reserve(width * height * 3);
        let background = linear_from_srgb8(self.variation.background);
        let mut row = Row::default();
        let mut colors = Vec::new();
        for y in 0..height {
            match self.supersample {
                1 => self.find_spots::<1>(y, &mut row),
                2 => self.find_spots::<2>(y, &mut row),
                3 => self.find_spots::<3>(y, &mut row),
                _ => self.find_spots::<4>(y, &mut row),
            }
            self.shade(y, &row.spots, background, &mut colors);
            row.sums.clear();
            row.sums.resize(width, Vec3A::ZERO);
            for (spot, &color) in row.spots.iter().zip(&colors) {
                row.sums[spot.column as usize] += color * spot.share;
            }
            for (x, spots, spot_of_sample) in &row.behind_glass {
                row.sums[*x] = self.glass_over([*x, y], &colors[spots.clone()], spot_of_sample);
            }
            for &sum in &row.sums {
                rgb.extend_from_slice(&srgb8_from_linear(sum));
            }
        }
    }

    /// The spots of a row of pixels with `N`² samples each.
    fn find_spots<const N: usize>(&self, y: usize, row: &mut Row) {
        row.spots.clear();
        row.behind_glass.clear();
        let [from, to] = self.view.glass_bounds;
        let glass = self.glass.filter(|_| from[1] <= y && y <= to[1]);
        let [rows, far, near] = [Some(self.opaque), glass.map(|[far, _]| far), glass.map(|[_, near]| near)]
            .map(|target| target.map_or([[].as_slice(); N], |target| rows_of_samples(target, y)));
        for x in 0..self.view.lens.width {
            let id = rows[0][x * N];
            let is_before_glass = glass.is_some() && from[0] <= x && x <= to[0];
            let has_glass = is_before_glass && !(is_filled(&far, x, 0) && is_filled(&near, x, 0));
            if !has_glass && is_filled(&rows, x, id) {
                row.spots.push(Spot { id, column: x as u32, x: x as i32 as f32, y: y as i32 as f32, share: 1.0 });
                continue;
            }
            let first_spot = row.spots.len();
            let spot_of_sample = self.find_spots_of_pixel::<N>(x, y, &rows, &mut row.spots);
            if has_glass {
                row.behind_glass.push((x, first_spot..row.spots.len(), spot_of_sample));
            }
        }
    }

    /// Appends a spot per surface that a pixel's samples see; returns which one each sample belongs to.
    fn find_spots_of_pixel<const N: usize>(
        &self,
        x: usize,
        y: usize,
        rows: &[&[u32]; N],
        spots: &mut Vec<Spot>,
    ) -> [usize; MAX_SAMPLES] {
        let first_spot = spots.len();
        let mut spot_of_sample = [0; MAX_SAMPLES];
        let mut counts = [0.0; MAX_SAMPLES];
        for (index, spot_of_sample) in spot_of_sample.iter_mut().enumerate().take(N * N) {
            let id = rows[index / N][x * N + index % N];
            let known = spots[first_spot..].iter().position(|spot| self.is_same_surface(spot.id, id));
            let spot = known.unwrap_or(spots.len() - first_spot);
            if known.is_none() {
                spots.push(Spot { id, column: x as u32, ..Spot::default() });
            }
            let entry = &mut spots[first_spot + spot];
            if entry.id == id {
                let [x, y] = place(N, x, y, index);
                (entry.x, entry.y) = (entry.x + x, entry.y + y);
                counts[spot] += 1.0;
            }
            entry.share += 1.0 / (N * N) as f32;
            *spot_of_sample = spot;
        }
        for (spot, count) in spots[first_spot..].iter_mut().zip(counts) {
            (spot.x, spot.y) = (spot.x / count, spot.y / count);
        }
        spot_of_sample
    }

    /// Whether two visibility ids belong to one smooth piece of surface.
    fn is_same_surface(&self, a: u32, b: u32) -> bool {
        if a == b || a >> TRIANGLE_BITS != b >> TRIANGLE_BITS {
            return a == b;
        }
        let (Some((part, first)), Some((_, second))) = (part_and_triangle(a), part_and_triangle(b)) else {
            return false;
        };
        let faces = &self.assets.parts[part].faces;
        faces[first].normal.dot(faces[second].normal) > 0.94
    }

    /// Linear display colours of the spots of a row.
    fn shade(&self, y: usize, spots: &[Spot], background: Vec3A, colors: &mut Vec<Vec3A>) {
        let table_tint = linear_from_srgb(self.variation.table_color);
        colors.clear();
        colors.resize(spots.len(), background);
        let mut from = 0;
        while let Some(spot) = spots.get(from) {
            let code = spot.id >> TRIANGLE_BITS;
            let is_same = |spot: &&Spot| spot.id >> TRIANGLE_BITS == code;
            if code == 0 {
                from += 1;
                continue;
            }
            let count = spots[from..].iter().take(4).take_while(is_same).count();
            let four = each(|lane| spots[from + lane.min(count - 1)]);
            let shaded = self.shade_four(y, &four, table_tint).to_lanes();
            colors[from..from + count].copy_from_slice(&shaded[..count]);
            from += count;
        }
    }

    /// Linear display colours of four spots on one opaque part.
    #[inline]
    fn shade_four(&self, y: usize, spots: &[Spot; 4], table_tint: Vec3A) -> Vec3x4 {
        let at = [gather(|lane| spots[lane].x), gather(|lane| spots[lane].y)];
        let hits = self.hits(each(|lane| spots[lane].id), at, table_tint);
        let depth = hits.depth.to_array();
        let (mut key_share, mut ambient_share) = ([1.0; 4], [1.0; 4]);
        for (lane, spot) in spots.iter().enumerate() {
            match self.arrival.at(spot.column as usize, y, spot.id >> TRIANGLE_BITS, depth[lane]) {
                Some(shares) => [key_share[lane], ambient_share[lane]] = shares,
                None => key_share[lane] = self.key_share(&hits, lane, [spot.column as usize, y]),
            }
        }
        let points = hits.lit_by(gather(|lane| key_share[lane]), gather(|lane| ambient_share[lane]));
        let light = self.lighting.reflect(&hits.part.surface, &points);
        self.lighting.develop(light.diffuse + light.specular)
    }

    #[inline]
    fn hits(&self, ids: [u32; 4], at: [Vec4; 2], table_tint: Vec3A) -> Hits<'_> {
        let triangles = each(|lane| (ids[lane] & ((1 << TRIANGLE_BITS) - 1)) as usize);
        Hits::new(self.assets, self.view, (ids[0] >> TRIANGLE_BITS) as usize - 1, triangles, at, table_tint)
    }

    #[cold]
    fn key_share(&self, hits: &Hits<'_>, lane: usize, [x, y]: [usize; 2]) -> f32 {
        if !self.shadow.is_on() {
            return 1.0;
        }
        self.shadow.visibility(hits.point.to_lanes()[lane], hits.normal.to_lanes()[lane], (x % 4) * 4 + y % 4)
    }

    /// A pixel's colour when some of its samples are seen through transparent sides.
    fn glass_over(&self, [x, y]: [usize; 2], colors: &[Vec3A], spot_of_sample: &[usize; MAX_SAMPLES]) -> Vec3A {
        let n = self.supersample;
        let first = y * n * self.opaque.width + x * n;
        let sum = spot_of_sample.iter().take(n * n).enumerate().fold(Vec3A::ZERO, |sum, (index, &spot)| {
            let sample = first + index / n * self.opaque.width + index % n;
            sum + self.behind_glass(colors[spot], sample, [x, y], place(n, x, y, index))
        });
        sum / (n * n) as f32
    }

    /// A sample's colour seen through the transparent sides in front of it, the farther one first.
    fn behind_glass(&self, behind: Vec3A, sample: usize, pixel: [usize; 2], at: [f32; 2]) -> Vec3A {
        let Some([mut far, mut near]) = self.glass else { return behind };
        if far.nearness[sample] > near.nearness[sample] {
            std::mem::swap(&mut far, &mut near);
        }
        let opaque = self.opaque.nearness[sample];
        [far, near].into_iter().filter(|layer| layer.nearness[sample] > opaque).fold(behind, |behind, layer| {
            let hits = self.hits([layer.ids[sample]; 4], at.map(Vec4::splat), Vec3A::ONE);
            let key_share = self.key_share(&hits, 0, pixel);
            let surface = &hits.part.surface;
            let light = self.lighting.reflect(surface, &hits.lit_by(Vec4::splat(key_share), Vec4::ONE));
            // Most sights pass two sides: each covers so much that both together have the material's opacity.
            let side = 1.0 - (1.0 - surface.opacity).sqrt();
            let cover = side + (1.0 - side) * light.grazing.x;
            // What passes takes on some of the glass's colour.
            let [base, ..] = hits.base.to_lanes();
            let tint = Vec3A::ONE.lerp(base, 0.25);
            let [front, ..] = self.lighting.develop(light.diffuse * side + light.specular).to_lanes();
            front + behind * tint * (1.0 - cover)
        })
    }
}

/// Where a sample of a pixel with `n`² samples lies on the image.
#[inline]
fn place(n: usize, x: usize, y: usize, sample: usize) -> [f32; 2] {
    let along = |pixel: usize, step: usize| pixel as f32 + (step as f32 + 0.5) / n as f32 - 0.5;
    [along(x, sample % n), along(y, sample / n)]
}

/// Ids of the rows of samples of a row of pixels.
#[inline]
fn rows_of_samples<const N: usize>(target: &Target, y: usize) -> [&[u32]; N] {
    std::array::from_fn(|row| &target.ids[(y * N + row) * target.width..][..target.width])
}

/// Whether all samples of a pixel show one id.
#[inline]
fn is_filled<const N: usize>(rows: &[&[u32]; N], x: usize, id: u32) -> bool {
    rows.iter().all(|row| row[x * N..][..N].iter().all(|&other| other == id))
}
