//! Smooth edges, and what is transparent.
//!
//! A surface is shaded once per pixel, at the pixel's centre. Where the samples around a centre show other surfaces, a
//! sample takes the colour of the neighbouring pixel whose centre shows its surface (Chajdas, McGuire and Luebke,
//! "Subpixel Reconstruction Antialiasing", 2011); only what no centre near by shows is shaded by itself.
//! Samples count by a tent two pixels wide.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::ops::Range;

use glam::{Vec2, Vec3A};
use multiversion::multiversion;

use crate::arrival::Arrival;
use crate::assets::{RenderAssets, TRIANGLE_BITS};
use crate::glass::Glass;
use crate::layers::TILE;
use crate::panes::{Pane, bent, refracted, seen_through};
use crate::raster::Target;
use crate::scene::Scene;
use crate::shade::{Shading, Spot};
use crate::texture::srgb8_from_linear;
use crate::view::{View, far_nearness, surface_of};

/// The samples around a pixel's centre with two per pixel along each axis, and their share of the pixel.
const BESIDE: [([isize; 2], f32); 8] = [
    ([-1, -1], 0.0625),
    ([0, -1], 0.125),
    ([1, -1], 0.0625),
    ([-1, 0], 0.125),
    ([1, 0], 0.125),
    ([-1, 1], 0.0625),
    ([0, 1], 0.125),
    ([1, 1], 0.0625),
];

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
    keys: TileKeys,
    directions: Directions,
}

/// Directions of all triangles, part by part.
#[derive(Debug, Default)]
struct Directions {
    /// By part plus one: where its triangles begin; those of nothing come first.
    first: Vec<u32>,
    codes: Vec<u8>,
}

/// By how much a transparent side must be nearer than what is opaque, as a share: glass stands on the table.
const APART: f32 = 1e-4;

impl Edges {
    /// Looks at all parts as they are seen; to be called before [`Edges::find`].
    pub fn begin(&mut self, assets: &RenderAssets, view: &View) {
        self.mixed.clear();
        self.extras.clear();
        self.panes.clear();
        let Directions { first, codes } = &mut self.directions;
        first.clear();
        codes.clear();
        first.push(0);
        codes.push(0);
        for (part, placed) in assets.parts.iter().zip(&view.parts) {
            first.push(codes.len() as u32);
            codes.extend_from_slice(&placed.mesh(part).directions);
        }
    }

    /// Finds the pixels of tiles that show several surfaces or something transparent; tiles are given in their order.
    pub fn find(
        &mut self,
        view: &View,
        opaque: &Target,
        glass: Option<&Glass>,
        arrival: &Arrival,
        tiles: &[usize],
        colors: &[Vec3A],
    ) {
        let n = opaque.scale as isize;
        let (mut keys, directions) = (std::mem::take(&mut self.keys), std::mem::take(&mut self.directions));
        let around = Around { view, opaque, directions: &directions, n };
        for &tile in tiles {
            let [columns, rows] = arrival.pixels_of(tile);
            let is_mixed = n > 1 && !arrival.shows_one(tile) && keys.load(&around, columns.start, rows.start);
            let glass = glass.filter(|glass| glass.reaches(tile)).map(|glass| &glass.layers);
            let glass = glass.filter(|layers| layers.iter().any(|layer| has_any(layer, &columns, &rows)));
            if !is_mixed && glass.is_none() {
                continue;
            }
            let mixed = if is_mixed { keys.mixed() } else { 0 };
            for row in rows.clone() {
                for column in columns.clone() {
                    let place = (row - rows.start) * TILE + (column - columns.start);
                    if mixed >> place & 1 == 0 && glass.is_none() {
                        continue;
                    }
                    let pixel = row * view.lens.width + column;
                    if mixed >> place & 1 == 1 {
                        self.mix(&around, &keys, arrival, [column, row], pixel, colors);
                    }
                    if let Some(glass) = glass {
                        self.find_panes(&around, glass, arrival, [column, row], pixel);
                    }
                }
            }
        }
        (self.keys, self.directions) = (keys, directions);
    }

    /// Shades what no pixel's centre shows and rewrites the bytes of all pixels that were found.
    pub fn finish(&mut self, scene: &Scene<'_>, view: &View, arrival: &Arrival, colors: &[Vec3A], rgb: &mut [u8]) {
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
            let straight = own.unwrap_or(colors[pixel as usize]);
            let behind = bent(panes, view, arrival, scene).map_or(straight, |bent| bent.seen(colors));
            let color = seen_through(panes, behind);
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
        let center = keys.center([x % TILE, y % TILE]);
        let own = keys.keys[center];
        let size = [around.view.lens.width as isize, around.view.lens.height as isize];
        let place = [x as isize, y as isize];
        let (mut sum, mut own_weight) = (Vec3A::ZERO, 0.0);
        let is_inside = x > 0 && y > 0 && place[0] + 1 < size[0] && place[1] + 1 < size[1];
        // Samples that are left for a closer look, in bits.
        let mut left = 0_u32;
        if n == 2 && is_inside {
            // Nearly all samples show what the pixel shows, or what the one shows that they lean to.
            let window = keys.window(center);
            let rows = [-1, 0, 1].map(|dy| &colors[((place[1] + dy) * size[0] + place[0] - 1) as usize..][..3]);
            for (index, &([dx, dy], weight)) in BESIDE.iter().enumerate() {
                let key = |reach: isize| window[((2 + reach * dy) * SIDE as isize + 2 + reach * dx) as usize];
                let (is_own, leans) = (key(1) == own, key(1) == key(2));
                own_weight += if is_own { weight } else { 0.0 };
                let weight = if leans & !is_own { weight } else { 0.0 };
                sum += rows[(dy + 1) as usize][(dx + 1) as usize] * weight;
                left |= u32::from(!is_own & !leans) << index;
            }
            own_weight += 0.25;
            while left != 0 {
                let (offset, weight) = BESIDE[left.trailing_zeros() as usize];
                left &= left - 1;
                sum += self.sample(around, keys, arrival, place, offset, weight, pixel, colors);
            }
        } else {
            for dy in 1 - n..n {
                for dx in 1 - n..n {
                    let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                    if keys.keys[keys.beside(center, dx, dy)] == own {
                        own_weight += weight;
                    } else {
                        sum += self.sample(around, keys, arrival, place, [dx, dy], weight, pixel, colors);
                    }
                }
            }
        }
        self.mixed.push((pixel as u32, sum + colors[pixel] * own_weight));
    }

    /// What a sample beside a pixel's centre adds to it: the colour of a pixel near by that shows the same, or nothing
    /// and the sample is listed to be shaded.
    #[expect(clippy::too_many_arguments, reason = "part of a loop that is written twice")]
    fn sample(
        &mut self,
        around: &Around<'_>,
        keys: &TileKeys,
        arrival: &Arrival,
        [x, y]: [isize; 2],
        [dx, dy]: [isize; 2],
        weight: f32,
        pixel: usize,
        colors: &[Vec3A],
    ) -> Vec3A {
        let (width, height, n) = (around.view.lens.width as isize, around.view.lens.height as isize, around.n);
        let center = keys.center([x as usize % TILE, y as usize % TILE]);
        let key = keys.keys[keys.beside(center, dx, dy)];
        let (sx, sy) = (dx.signum(), dy.signum());
        let shows = |[sx, sy]: [isize; 2]| {
            let (x, y) = (x + sx, y + sy);
            let inside = x >= 0 && y >= 0 && x < width && y < height;
            (inside && keys.keys[keys.beside(center, sx * n, sy * n)] == key).then(|| (y * width + x) as usize)
        };
        // The pixel that the sample leans to first, then the others.
        let neighbour = shows([sx, sy]).or_else(|| {
            const OTHERS: [[isize; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];
            shows([sx, 0]).or_else(|| shows([0, sy])).or_else(|| OTHERS.into_iter().find_map(shows))
        });
        if let Some(neighbour) = neighbour {
            return colors[neighbour] * weight;
        }
        self.add_extra(around, arrival, around.cut(x * n + dx, y * n + dy), pixel, key, weight);
        Vec3A::ZERO
    }

    /// A sample of a surface that no centre near by shows; several of one surface are shaded together.
    #[cold]
    fn add_extra(
        &mut self,
        around: &Around<'_>,
        arrival: &Arrival,
        (column, row): (isize, isize),
        pixel: usize,
        key: u32,
        weight: f32,
    ) {
        let mixed = self.mixed.len() as u32;
        let mut same = self.extras.iter_mut().rev().take_while(|(_, of, _)| *of == mixed);
        if let Some((.., share)) = same.find(|(known, ..)| around.key(known.id) == key) {
            *share += weight;
            return;
        }
        let sample = row as usize * around.opaque.width + column as usize;
        let spot = Spot {
            id: around.opaque.ids[sample],
            x: column as f32 / around.n as f32,
            y: row as f32 / around.n as f32,
            depth: 1.0 / around.opaque.nearness[sample],
            key: arrival.key[pixel].max(0.0),
            ambient: arrival.ambient[pixel].max(0.0),
        };
        self.extras.push((spot, mixed, weight));
    }

    fn shade_extras(&mut self, scene: &Scene<'_>, view: &View) {
        let lens = &view.lens;
        for (spot, mixed, share) in self.extras.iter().filter(|(spot, ..)| spot.id == 0) {
            let ray = lens.point_at(Vec2::new(spot.x, spot.y), 1.0) - lens.eye;
            self.mixed[*mixed as usize].1 += scene.backdrop.color(lens.eye, ray) * *share;
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
            for chunk in same.chunks(crate::lanes::CHUNK) {
                shading.clear();
                for &extra in chunk {
                    shading.push(extras[extra as usize].0);
                }
                shading.shade(
                    &scene.assets.parts[part],
                    &scene.surfaces[part],
                    &view.parts[part],
                    &view.lens,
                    scene.lighting,
                );
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
        for (index, layer) in glass.iter().enumerate() {
            let nearness = |sample: usize| {
                let stored = layer.nearness[sample];
                if index == 0 && stored > 0.0 { far_nearness(stored) } else { stored }
            };
            let (mut coverage, mut best, mut best_weight) = (0.0, None, 0.0);
            for dy in 1 - n..n {
                for dx in 1 - n..n {
                    let (column, row) = around.cut(x * n + dx, y * n + dy);
                    let sample = row as usize * layer.width + column as usize;
                    if nearness(sample) > around.opaque.nearness[sample] * (1.0 + APART) {
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
                    depth: 1.0 / nearness(sample),
                    key: arrival.key[pixel].max(0.0),
                    ambient: 1.0,
                };
                let [color, passes, normal, inside] = [Vec3A::ZERO; 4];
                let pixel = pixel as u32;
                self.panes.push(Pane { pixel, spot, coverage, color, passes, normal, inside, is_solid: false });
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
            let count = self.order[from..].iter().take(crate::lanes::CHUNK).take_while(same).count();
            let chunk = &self.order[from..from + count];
            shading.clear();
            for &pane in chunk {
                shading.push(panes[pane as usize].spot);
            }
            let index = surface as usize - 1;
            let (part, material) = (&scene.assets.parts[index], &scene.surfaces[index]);
            shading.shade(part, material, &view.parts[index], &view.lens, scene.lighting);
            let ratio = 1.0 / material.index_of_refraction();
            for (spot, &pane) in chunk.iter().enumerate() {
                let pane = &mut panes[pane as usize];
                let (normal, facing) = shading.facing_of(spot);
                pane.is_solid = part.mesh.closed;
                pane.color = shading.color_of(spot);
                pane.passes = material.passes(shading.base_of(spot), facing, !pane.is_solid);
                let sight = (view.lens.point_at(pane.place(), pane.spot.depth) - view.lens.eye).normalize_or(Vec3A::Z);
                (pane.normal, pane.inside) = (normal, refracted(sight, normal, ratio));
            }
            from += count;
        }
    }
}

/// The samples around pixels.
struct Around<'a> {
    view: &'a View,
    opaque: &'a Target,
    directions: &'a Directions,
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

    fn key(&self, id: u32) -> u32 {
        self.directions.key(id)
    }
}

impl Directions {
    /// Equal for samples of one smooth piece of surface.
    #[inline(always)]
    fn key(&self, id: u32) -> u32 {
        let (surface, triangle) = (surface_of(id), id & ((1 << TRIANGLE_BITS) - 1));
        surface << 8 | u32::from(self.codes[(self.first[surface as usize] + triangle) as usize])
    }
}

/// Keys of the samples of a tile, and of those around it up to the centres of the pixels next to it.
#[derive(Debug, Default)]
struct TileKeys {
    /// Samples per pixel along an axis.
    n: usize,
    side: usize,
    keys: Vec<u32>,
}

impl TileKeys {
    /// Reads a tile; says whether its samples differ at all.
    fn load(&mut self, around: &Around<'_>, column: usize, row: usize) -> bool {
        let n = around.n;
        (self.n, self.side) = (n as usize, (TILE + 1) * n as usize + 1);
        let (first_column, first_row) = ((column as isize - 1) * n, (row as isize - 1) * n);
        let (from, top) = around.cut(first_column, first_row);
        let (to, bottom) = around.cut(first_column + self.side as isize - 1, first_row + self.side as isize - 1);
        let line = |row: isize| &around.opaque.ids[row as usize * around.opaque.width..][from as usize..=to as usize];
        let first = around.id_at(from, top);
        if (top..=bottom).all(|row| line(row).iter().fold(0, |differ, &id| differ | (id ^ first)) == 0) {
            return false;
        }
        self.keys.resize(self.side * self.side, 0);
        let first_key = around.key(first);
        let mut differ = 0;
        // Samples beyond the image's border are those next to it.
        let before = (from - first_column) as usize;
        for (step, out) in self.keys.chunks_exact_mut(self.side).enumerate() {
            let (_, row) = around.cut(0, first_row + step as isize);
            let line = line(row);
            // Triangles are so small on the image that guessing when the next one comes does not pay.
            for (out, &id) in out[before..].iter_mut().zip(line) {
                *out = around.key(id);
            }
            let (left, right) = (out[before], out[before + line.len() - 1]);
            out[..before].fill(left);
            out[before + line.len()..].fill(right);
            differ |= out.iter().fold(0, |differ, key| differ | (key ^ first_key));
        }
        differ != 0
    }

    /// Index of the key at the centre of a pixel of the tile.
    #[inline(always)]
    fn center(&self, [x, y]: [usize; 2]) -> usize {
        (y + 1) * self.n * self.side + (x + 1) * self.n
    }

    /// Index of the key so many samples beside another.
    #[inline(always)]
    fn beside(&self, index: usize, dx: isize, dy: isize) -> usize {
        (index as isize + dy * self.side as isize + dx) as usize
    }

    /// Keys from two rows above and two columns to the left of one on, with two samples per pixel along each axis.
    #[inline(always)]
    fn window(&self, center: usize) -> &[u32; 4 * SIDE + 5] {
        const WINDOW: usize = 4 * SIDE + 5;
        self.keys[center - 2 * SIDE - 2..].first_chunk::<WINDOW>().expect("a tile's keys reach two samples beyond it")
    }

    /// The pixels of the tile around whose centres the samples show several surfaces, in bits, row by row.
    fn mixed(&self) -> u64 {
        if let (2, Some(keys)) = (self.n, self.keys.first_chunk()) {
            return mixed_of_two(keys);
        }
        (0..TILE * TILE).fold(0, |bits, place| bits | u64::from(self.differ([place % TILE, place / TILE])) << place)
    }

    /// Whether the samples around the centre of a pixel of the tile show several surfaces.
    #[inline(always)]
    fn differ(&self, place: [usize; 2]) -> bool {
        let center = self.center(place);
        let reach = self.n - 1;
        let (first, own) = (center - reach * self.side - reach, self.keys[center]);
        let line = |step: usize| &self.keys[first + step * self.side..][..2 * reach + 1];
        (0..=2 * reach).any(|step| line(step).iter().fold(false, |differ, &key| differ | (key != own)))
    }
}

/// Samples along the side of a tile with its surroundings, with two per pixel along each axis.
const SIDE: usize = 2 * (TILE + 1) + 1;

/// [`TileKeys::mixed`] for two samples per pixel along each axis.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn mixed_of_two(keys: &[u32; SIDE * SIDE]) -> u64 {
    let mut bits = 0;
    for y in 0..TILE {
        // The columns first: they run in vectors.
        let mut columns = [0_u32; SIDE];
        let mut own = [0_u32; SIDE];
        for column in 0..SIDE {
            let row = |dy: usize| keys[(2 * y + 1 + dy) * SIDE + column];
            own[column] = row(1);
            columns[column] = (row(0) ^ row(1)) | (row(2) ^ row(1));
        }
        let mut differs = [0_u32; TILE];
        for x in 0..TILE {
            let at = 2 * x + 2;
            differs[x] =
                columns[at] | columns[at - 1] | columns[at + 1] | (own[at - 1] ^ own[at]) | (own[at + 1] ^ own[at]);
        }
        for (x, differ) in differs.into_iter().enumerate() {
            bits |= u64::from(differ != 0) << (y * TILE + x);
        }
    }
    bits
}

/// Whether a layer shows anything at the samples of some pixels or next to them.
fn has_any(layer: &Target, columns: &Range<usize>, rows: &Range<usize>) -> bool {
    let n = layer.scale;
    let span = |range: &Range<usize>, limit: usize| (range.start * n).saturating_sub(n - 1)..(range.end * n).min(limit);
    let columns = span(columns, layer.width);
    let mut rows = span(rows, layer.height);
    rows.any(|row| layer.ids[row * layer.width..][columns.clone()].iter().fold(0, |any, &id| any | id) != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pixels of a tile at once give what one after the other gives.
    #[test]
    fn mixed_pixels_are_found_at_once() {
        let mut state = 1_u32;
        for share in [0, 1, 20, 255] {
            let mut draw = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                u32::from(state >> 24 < share)
            };
            let keys = TileKeys { n: 2, side: SIDE, keys: (0..SIDE * SIDE).map(|_| draw()).collect() };
            let single = |place: usize| u64::from(keys.differ([place % TILE, place / TILE])) << place;
            assert_eq!(keys.mixed(), (0..TILE * TILE).fold(0, |bits, place| bits | single(place)), "share {share}");
        }
    }
}
