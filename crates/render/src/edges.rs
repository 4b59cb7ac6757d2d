//! Smooth edges, and what is transparent.
//!
//! A surface is shaded once per pixel, at the pixel's centre. Where the samples around a centre show other surfaces, a
//! sample takes the colour of the neighbouring pixel whose centre shows its surface (Chajdas, McGuire and Luebke,
//! "Subpixel Reconstruction Antialiasing", 2011); only what no centre near by shows is shaded by itself.
//! Samples count by a tent two pixels wide.

use std::ops::Range;

use glam::Vec3A;

use crate::arrival::Arrival;
use crate::assets::{RenderAssets, TRIANGLE_BITS};
use crate::layers::TILE;
use crate::raster::Target;
use crate::scene::Scene;
use crate::shade::{Shading, Spot};
use crate::texture::srgb8_from_linear;
use crate::view::{View, part_and_triangle, surface_of};

/// What is found on the edges of a picture; memory kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Edges {
    /// Pixels with several surfaces, and the sum of their known colours.
    mixed: Vec<(u32, Vec3A)>,
    /// Surfaces that are shaded by themselves: which mixed pixel they belong to and their share of it.
    extras: Vec<(Spot, u32, f32)>,
    /// Sides of transparent surfaces, two per pixel at most, the farther one first.
    panes: Vec<Pane>,
    order: Vec<u32>,
}

/// A transparent surface in front of a pixel.
#[derive(Clone, Copy, Debug)]
struct Pane {
    pixel: u32,
    spot: Spot,
    /// Share of the pixel that it is in front of.
    coverage: f32,
    /// What leaves it towards the viewer, and the share of what is behind that passes.
    color: Vec3A,
    passes: Vec3A,
}

impl Edges {
    /// Rewrites the bytes of the pixels of marked tiles that show several surfaces or something transparent.
    #[expect(clippy::too_many_arguments, reason = "one stage of a pipeline: what it reads, and what it writes")]
    pub fn finish(
        &mut self,
        scene: &Scene<'_>,
        view: &View,
        opaque: &Target,
        glass: Option<&[Target; 2]>,
        arrival: &Arrival,
        marked: &[bool],
        colors: &[Vec3A],
        rgb: &mut [u8],
    ) {
        self.mixed.clear();
        self.extras.clear();
        self.panes.clear();
        let n = opaque.scale as isize;
        let around = Around { assets: scene.assets, view, opaque, n };
        let mut keys = TileKeys::default();
        for tile in (0..marked.len()).filter(|&tile| marked[tile]) {
            let [columns, rows] = arrival.pixels_of(tile);
            let is_mixed = n > 1 && keys.load(&around, columns.start, rows.start);
            let glass = glass.filter(|glass| glass.iter().any(|layer| has_any(layer, &columns, &rows)));
            if !is_mixed && glass.is_none() {
                continue;
            }
            for row in rows.clone() {
                for column in columns.clone() {
                    let pixel = row * view.lens.width + column;
                    if is_mixed && keys.differ([column - columns.start, row - rows.start]) {
                        self.mix(&around, &keys, arrival, [column, row], pixel, colors);
                    }
                    if let Some(glass) = glass {
                        self.find_panes(&around, glass, arrival, [column, row], pixel);
                    }
                }
            }
        }
        self.shade_extras(scene, view);
        self.shade_panes(scene, view);
        for &(pixel, color) in &self.mixed {
            rgb[pixel as usize * 3..][..3].copy_from_slice(&srgb8_from_linear(color));
        }
        // Both lists go through the pixels in the same order.
        let mut mixed = self.mixed.iter().peekable();
        for panes in self.panes.chunk_by(|a, b| a.pixel == b.pixel) {
            let pixel = panes[0].pixel;
            let order = |other: u32| arrival.order_of(other as usize);
            while mixed.next_if(|(other, _)| order(*other) < order(pixel)).is_some() {}
            let own = mixed.next_if(|(other, _)| *other == pixel).map(|(_, color)| *color);
            let behind = own.unwrap_or(colors[pixel as usize]);
            let color = panes
                .iter()
                .fold(behind, |behind, pane| behind + (pane.color + behind * pane.passes - behind) * pane.coverage);
            rgb[pixel as usize * 3..][..3].copy_from_slice(&srgb8_from_linear(color));
        }
    }

    /// Sums the colours of a pixel's samples as far as they are known.
    fn mix(
        &mut self,
        around: &Around<'_>,
        keys: &TileKeys,
        arrival: &Arrival,
        [x, y]: [usize; 2],
        pixel: usize,
        colors: &[Vec3A],
    ) {
        let n = around.n;
        let own = keys.at(around, x as isize * n, y as isize * n);
        let (width, height) = (around.view.lens.width as isize, around.view.lens.height as isize);
        let (x, y) = (x as isize, y as isize);
        let mut sum = Vec3A::ZERO;
        for dy in 1 - n..n {
            for dx in 1 - n..n {
                let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                let (column, row) = around.cut(x * n + dx, y * n + dy);
                let key = keys.at(around, column, row);
                if key == own {
                    sum += colors[pixel] * weight;
                    continue;
                }
                let (sx, sy) = (dx.signum(), dy.signum());
                // The pixel that the sample leans to first, then the others.
                let near = [[sx, sy], [sx, 0], [0, sy], [-1, 0], [1, 0], [0, -1], [0, 1]];
                let corners = [[-1, -1], [1, -1], [-1, 1], [1, 1]];
                let neighbour = near.into_iter().chain(corners).find_map(|[sx, sy]| {
                    let (x, y) = (x + sx, y + sy);
                    let inside = x >= 0 && y >= 0 && x < width && y < height;
                    (inside && keys.at(around, x * n, y * n) == key).then(|| (y * width + x) as usize)
                });
                if let Some(neighbour) = neighbour {
                    sum += colors[neighbour] * weight;
                } else {
                    let sample = row as usize * around.opaque.width + column as usize;
                    let spot = Spot {
                        id: around.opaque.ids[sample],
                        x: column as f32 / n as f32,
                        y: row as f32 / n as f32,
                        depth: 1.0 / around.opaque.nearness[sample],
                        key: arrival.key[pixel].max(0.0),
                        ambient: arrival.ambient[pixel].max(0.0),
                    };
                    // Several samples of one surface are shaded together.
                    let mixed = self.mixed.len() as u32;
                    match self
                        .extras
                        .iter_mut()
                        .rev()
                        .take_while(|(_, of, _)| *of == mixed)
                        .find(|(known, ..)| around.key(known.id) == key)
                    {
                        Some((.., share)) => *share += weight,
                        None => self.extras.push((spot, mixed, weight)),
                    }
                }
            }
        }
        self.mixed.push((pixel as u32, sum));
    }

    fn shade_extras(&mut self, scene: &Scene<'_>, view: &View) {
        let background = crate::texture::linear_from_srgb8(scene.variation.background);
        for (_, mixed, share) in self.extras.iter().filter(|(spot, ..)| spot.id == 0) {
            self.mixed[*mixed as usize].1 += background * *share;
        }
        self.extras.retain(|(spot, ..)| spot.id != 0);
        self.order.clear();
        self.order.extend(0..self.extras.len() as u32);
        let extras = &self.extras;
        self.order.sort_by_key(|&extra| surface_of(extras[extra as usize].0.id));
        let mut shading = Shading::default();
        let surface = |extra: &u32| surface_of(extras[*extra as usize].0.id);
        for same in self.order.chunk_by(|a, b| surface(a) == surface(b)) {
            let part = surface(&same[0]) as usize - 1;
            for chunk in same.chunks(crate::points::CHUNK) {
                shading.clear();
                for &extra in chunk {
                    shading.push(extras[extra as usize].0);
                }
                shading.shade(&scene.assets.parts[part], &view.parts[part], &view.lens, scene.lighting);
                for (spot, &extra) in chunk.iter().enumerate() {
                    let (_, mixed, share) = extras[extra as usize];
                    self.mixed[mixed as usize].1 += shading.color_of(spot) * share;
                }
            }
        }
    }

    /// The sides of transparent surfaces before a pixel.
    fn find_panes(
        &mut self,
        around: &Around<'_>,
        glass: &[Target; 2],
        arrival: &Arrival,
        [x, y]: [usize; 2],
        pixel: usize,
    ) {
        let n = around.n;
        let (x, y) = (x as isize, y as isize);
        let first = self.panes.len();
        for layer in glass {
            let (mut coverage, mut best, mut best_weight) = (0.0, None, 0.0);
            for dy in 1 - n..n {
                for dx in 1 - n..n {
                    let (column, row) = around.cut(x * n + dx, y * n + dy);
                    let sample = row as usize * layer.width + column as usize;
                    if layer.nearness[sample] > around.opaque.nearness[sample] {
                        let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                        coverage += weight;
                        if weight > best_weight {
                            (best, best_weight) = (Some((sample, column, row)), weight);
                        }
                    }
                }
            }
            if let Some((sample, column, row)) = best {
                let spot = Spot {
                    id: layer.ids[sample],
                    x: column as f32 / n as f32,
                    y: row as f32 / n as f32,
                    depth: 1.0 / layer.nearness[sample],
                    key: arrival.key[pixel].max(0.0),
                    ambient: 1.0,
                };
                let (color, passes) = (Vec3A::ZERO, Vec3A::ZERO);
                self.panes.push(Pane { pixel: pixel as u32, spot, coverage, color, passes });
            }
        }
        if let [a, b] = &mut self.panes[first..]
            && a.spot.depth < b.spot.depth
        {
            std::mem::swap(a, b);
        }
    }

    fn shade_panes(&mut self, scene: &Scene<'_>, view: &View) {
        self.order.clear();
        self.order.extend(0..self.panes.len() as u32);
        let panes = &mut self.panes;
        self.order.sort_by_key(|&pane| surface_of(panes[pane as usize].spot.id));
        let mut shading = Shading::default();
        let mut from = 0;
        while from < self.order.len() {
            let surface = surface_of(panes[self.order[from] as usize].spot.id);
            let same = |pane: &&u32| surface_of(panes[**pane as usize].spot.id) == surface;
            let count = self.order[from..].iter().take(crate::points::CHUNK).take_while(same).count();
            let chunk = &self.order[from..from + count];
            shading.clear();
            for &pane in chunk {
                shading.push(panes[pane as usize].spot);
            }
            let part = surface as usize - 1;
            shading.shade(&scene.assets.parts[part], &view.parts[part], &view.lens, scene.lighting);
            for (spot, &pane) in chunk.iter().enumerate() {
                let pane = &mut panes[pane as usize];
                pane.color = shading.color_of(spot);
                // What passes takes on some of the glass's colour.
                pane.passes = Vec3A::ONE.lerp(shading.base_of(spot), 0.25) * (1.0 - shading.cover_of(spot));
            }
            from += count;
        }
    }
}

/// The samples around pixels.
struct Around<'a> {
    assets: &'a RenderAssets,
    view: &'a View,
    opaque: &'a Target,
    /// Samples per pixel along an axis.
    n: isize,
}

impl Around<'_> {
    /// The nearest sample within the image.
    #[inline(always)]
    fn cut(&self, column: isize, row: isize) -> (isize, isize) {
        (column.clamp(0, self.opaque.width as isize - 1), row.clamp(0, self.opaque.height as isize - 1))
    }

    #[inline(always)]
    fn id_at(&self, column: isize, row: isize) -> u32 {
        self.opaque.ids[row as usize * self.opaque.width + column as usize]
    }

    /// Equal for samples of one smooth piece of surface.
    #[inline(always)]
    fn key(&self, id: u32) -> u32 {
        let Some((part, triangle)) = part_and_triangle(id) else { return 0 };
        let mesh = self.view.parts[part].mesh(&self.assets.parts[part]);
        (id >> TRIANGLE_BITS) << 8 | u32::from(mesh.directions[triangle])
    }
}

/// Keys of the samples of a tile and of those around it that its pixels reach.
struct TileKeys {
    /// Column and row of the first sample.
    first: [isize; 2],
    n: usize,
    side: usize,
    keys: Vec<u32>,
}

impl Default for TileKeys {
    fn default() -> Self {
        Self { first: [0; 2], n: 1, side: 0, keys: Vec::new() }
    }
}

impl TileKeys {
    /// Reads a tile; says whether its samples differ at all.
    fn load(&mut self, around: &Around<'_>, column: usize, row: usize) -> bool {
        let n = around.n;
        let reach = n - 1;
        (self.n, self.side) = (n as usize, TILE * n as usize + reach as usize);
        self.keys.clear();
        let (first_column, first_row) = (column as isize * n - reach, row as isize * n - reach);
        self.first = [first_column, first_row];
        let (last_column, last_row) =
            around.cut(first_column + self.side as isize - 1, first_row + self.side as isize - 1);
        let (cut_column, cut_row) = around.cut(first_column, first_row);
        let first = around.id_at(cut_column, cut_row);
        let is_one_triangle = (cut_row..=last_row).all(|row| {
            let line = &around.opaque.ids[row as usize * around.opaque.width..][..around.opaque.width];
            line[cut_column as usize..=last_column as usize].iter().fold(0, |differ, &id| differ | (id ^ first)) == 0
        });
        if is_one_triangle {
            return false;
        }
        let (mut id, mut key) = (u32::MAX, 0);
        let mut differ = false;
        for step in 0..self.side as isize {
            let (_, row) = around.cut(0, first_row + step);
            let line = &around.opaque.ids[row as usize * around.opaque.width..][..around.opaque.width];
            for step in 0..self.side as isize {
                let (column, _) = around.cut(first_column + step, 0);
                let here = line[column as usize];
                if here != id {
                    let other = around.key(here);
                    differ |= !self.keys.is_empty() && other != key;
                    (id, key) = (here, other);
                }
                self.keys.push(key);
            }
        }
        differ
    }

    /// The key of a sample within the image.
    #[inline(always)]
    fn at(&self, around: &Around<'_>, column: isize, row: isize) -> u32 {
        let (x, y) = ((column - self.first[0]) as usize, (row - self.first[1]) as usize);
        if x < self.side && y < self.side {
            self.keys[y * self.side + x]
        } else {
            around.key(around.id_at(column, row))
        }
    }

    /// Whether the samples around the centre of a pixel of the tile show several surfaces.
    #[inline(always)]
    fn differ(&self, [x, y]: [usize; 2]) -> bool {
        let (first, side) = (x * self.n, 2 * self.n - 1);
        let own = self.keys[(y * self.n + self.n - 1) * self.side + first + self.n - 1];
        let line = |step: usize| &self.keys[(y * self.n + step) * self.side + first..][..side];
        (0..side).any(|step| line(step).iter().fold(false, |differ, &key| differ | (key != own)))
    }
}

/// Whether a layer shows anything at the samples of some pixels or next to them.
fn has_any(layer: &Target, columns: &Range<usize>, rows: &Range<usize>) -> bool {
    let n = layer.scale;
    let span = |range: &Range<usize>, limit: usize| (range.start * n).saturating_sub(n - 1)..(range.end * n).min(limit);
    let columns = span(columns, layer.width);
    let mut rows = span(rows, layer.height);
    rows.any(|row| layer.ids[row * layer.width..][columns.clone()].iter().fold(0, |any, &id| any | id) != 0)
}
