//! Per pixel of the opaque surfaces: share of the key light and of the ambient light that arrives.
//!
//! Both are estimated at every other pixel, like the black fields of a chess board, and only where coarser neighbours
//! do not agree already; with few taps whose pattern repeats every 4×4 pixels, then averaged over such a block without
//! crossing from one surface to another.
//! Ambient occlusion after McGuire et al., "Scalable Ambient Obscurance", 2012.

use glam::{Vec2, Vec3A, Vec4};

use crate::assets::{RenderAssets, TRIANGLE_BITS};
use crate::lanes::{Vec3x4, each, gather};
use crate::raster::Target;
use crate::shadow::ShadowMap;
use crate::variation::RenderVariation;
use crate::view::{View, part_and_triangle};

/// Groups of four taps.
const HALVES: usize = 2;
/// Largest radius of the ambient occlusion on the image, pixels.
const MAX_REACH: f32 = 64.0;
/// Pixels per side of a tile.
const TILE: usize = 16;

/// Arriving light per pixel.
#[derive(Debug, Default)]
pub(crate) struct Arrival {
    width: usize,
    height: usize,
    /// Share of the key light, negative where it is not known.
    key: Vec<f32>,
    /// Share of the ambient light.
    ambient: Vec<f32>,
    blurred_key: Vec<f32>,
    blurred_ambient: Vec<f32>,
    /// Depth per pixel, 0 where nothing is seen.
    depth: Vec<f32>,
    /// Part of the visibility id per pixel.
    surface: Vec<u32>,
    /// Per tile: whether nothing there can be darkened.
    plain: Vec<bool>,
}

impl Arrival {
    /// Estimates both shares for all pixels of `visible`, which has one sample per pixel.
    pub fn estimate(
        &mut self,
        assets: &RenderAssets,
        view: &View,
        visible: &Target,
        shadow: &ShadowMap,
        variation: &RenderVariation,
    ) {
        (self.width, self.height) = (visible.width, visible.height);
        self.depth.clear();
        self.depth.extend(visible.nearness.iter().map(|&nearness| if nearness > 0.0 { 1.0 / nearness } else { 0.0 }));
        self.surface.clear();
        self.surface.extend(visible.ids.iter().map(|id| id >> TRIANGLE_BITS));
        for shares in [&mut self.key, &mut self.ambient] {
            shares.clear();
            shares.resize(visible.ids.len(), UNKNOWN);
        }
        let light = Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let focal = view.lens.focal.x;
        let nearest = visible.nearness.iter().copied().fold(0.0, f32::max);
        let reach = (variation.occlusion_radius_m * focal * nearest).clamp(3.0, MAX_REACH);
        self.find_plain_tiles(assets, reach as usize + 1);
        let from_world = view.lens.turn.transpose();
        let columns = self.width.div_ceil(TILE);
        for (x, y, around) in passes(self.width, self.height) {
            let pixel = y * self.width + x;
            let [known_key, known_ambient] = around.map_or([None; 2], |step| self.agreed_around(x, y, step));
            if let (Some(key), Some(ambient)) = (known_key, known_ambient) {
                (self.key[pixel], self.ambient[pixel]) = (key, ambient);
                continue;
            }
            let Some((part, triangle)) = part_and_triangle(visible.ids[pixel]) else { continue };
            let ray = view.lens.ray(x as f32, y as f32);
            let point = ray * self.depth[pixel];
            let normal = view.parts[part].world_from_body * Vec3A::from(assets.parts[part].faces[triangle].normal);
            let in_camera = from_world * normal;
            let flip = if in_camera.dot(ray) > 0.0 { -1.0 } else { 1.0 };
            let pattern = PATTERN[y % 4][x % 4];
            let key = if let Some(key) = known_key {
                key
            } else if shadow.is_on() && flip * normal.dot(light) > -0.2 {
                shadow.visibility(view.lens.turn * point + view.lens.eye, normal * flip, pattern)
            } else {
                1.0
            };
            let is_plain = self.plain[y / TILE * columns + x / TILE];
            let ambient = if let Some(ambient) = known_ambient {
                ambient
            } else if variation.occlusion_radius_m > 0.0 && !is_plain {
                self.ambient_at([x, y], point, in_camera * flip, focal, pattern, variation)
            } else {
                1.0
            };
            (self.key[pixel], self.ambient[pixel]) = (key, ambient);
        }
        self.blur();
    }

    /// Shares at a pixel for a sample of surface `part_code` (part index + 1) at a depth;
    /// from the nearest neighbour of the same surface when the pixel's centre shows another one; `None` without any.
    #[inline]
    pub fn at(&self, x: usize, y: usize, part_code: u32, depth: f32) -> Option<[f32; 2]> {
        let own = y * self.width + x;
        let is_known = |pixel: usize| self.surface[pixel] == part_code && self.key[pixel] >= 0.0;
        if is_known(own) {
            return Some([self.key[own], self.ambient[own]]);
        }
        let mut best = None;
        let mut best_distance = 0.05 * depth;
        for row in y.saturating_sub(1)..=(y + 1).min(self.height - 1) {
            for column in x.saturating_sub(1)..=(x + 1).min(self.width - 1) {
                let pixel = row * self.width + column;
                let distance = (self.depth[pixel] - depth).abs();
                if is_known(pixel) && distance < best_distance {
                    (best, best_distance) = (Some([self.key[pixel], self.ambient[pixel]]), distance);
                }
            }
        }
        best
    }

    /// Shares of the key and of the ambient light on which four neighbours on the same surface agree.
    #[inline]
    fn agreed_around(&self, x: usize, y: usize, steps: [[isize; 2]; 4]) -> [Option<f32>; 2] {
        if x < 2 || y < 2 || x + 2 >= self.width || y + 2 >= self.height {
            return [None; 2];
        }
        let pixel = y * self.width + x;
        let around = steps.map(|[dx, dy]| pixel.wrapping_add_signed(dy * self.width as isize + dx));
        if around.iter().any(|&other| self.surface[other] != self.surface[pixel]) {
            return [None; 2];
        }
        let [a, b, c, d] = around.map(|other| self.key[other]);
        let key = (a == b && b == c && c == d && (a == 0.0 || a == 1.0)).then_some(a);
        let [a, b, c, d] = around.map(|other| self.ambient[other]);
        let spread = a.max(b).max(c.max(d)) - a.min(b).min(c.min(d));
        let ambient = (spread < 0.04).then_some((a + b + c + d) * 0.25);
        [key, ambient]
    }

    fn ambient_at(
        &self,
        [x, y]: [usize; 2],
        point: Vec3A,
        normal: Vec3A,
        focal: f32,
        pattern: usize,
        variation: &RenderVariation,
    ) -> f32 {
        let radius = variation.occlusion_radius_m;
        let reach = (radius * focal / point.z).clamp(3.0, MAX_REACH);
        let (last_column, last_row) = (self.width as i32 - 1, self.height as i32 - 1);
        let inverse_focal = 1.0 / focal;
        let bias = 0.001 + 0.002 * point.z;
        let inverse_depth = 1.0 / point.z;
        let mut darkening = Vec4::ZERO;
        for [columns, rows] in &tap_table()[pattern] {
            let (columns, rows) = ((columns * reach).to_array(), (rows * reach).to_array());
            let column = each(|lane| (x as i32 + nearest_integer(columns[lane])).max(0).min(last_column));
            let row = each(|lane| (y as i32 + nearest_integer(rows[lane])).max(0).min(last_row));
            let depth = gather(|lane| self.depth[row[lane] as usize * self.width + column[lane] as usize]);
            let dx = gather(|lane| (column[lane] - x as i32) as f32);
            let dy = gather(|lane| (row[lane] - y as i32) as f32);
            // The tap's ray is the pixel's ray moved by whole pixels; nothing (depth 0) lies outside the radius.
            let stretch = depth * inverse_depth - 1.0;
            let step = depth * inverse_focal;
            let toward =
                Vec3x4 { x: stretch * point.x + dx * step, y: stretch * point.y + dy * step, z: depth - point.z };
            let square = toward.dot(toward);
            let near = (radius * radius - square).max(Vec4::ZERO);
            let above = (toward.x * normal.x + toward.y * normal.y + toward.z * normal.z - bias).max(Vec4::ZERO);
            darkening += near * near * near * above / (square + 1e-5);
        }
        let scale = 2.5 * variation.occlusion_strength / (radius.powi(5) * (4 * HALVES) as f32);
        (1.0 - darkening.element_sum() * scale).max(0.15)
    }

    /// Tiles in whose surroundings only one convex part, or nothing, is seen: nothing can darken it there.
    fn find_plain_tiles(&mut self, assets: &RenderAssets, reach: usize) {
        let (columns, rows) = (self.width.div_ceil(TILE), self.height.div_ceil(TILE));
        // The part code that fills a tile; `u32::MAX` when there are several or one that is not convex.
        let join = |a: u32, b: u32| {
            if a == b || b == 0 {
                a
            } else if a == 0 {
                b
            } else {
                u32::MAX
            }
        };
        let mut codes = vec![0; columns * rows];
        for (y, row) in self.surface.chunks_exact(self.width).enumerate() {
            for (tile, pixels) in codes[y / TILE * columns..][..columns].iter_mut().zip(row.chunks(TILE)) {
                *tile = pixels.iter().fold(*tile, |code, &part| join(code, part));
            }
        }
        let is_convex = |code: u32| code == 0 || assets.parts.get(code as usize - 1).is_some_and(|part| part.convex);
        let around = reach.div_ceil(TILE);
        self.plain.clear();
        self.plain.extend((0..columns * rows).map(|tile| {
            let (column, row) = (tile % columns, tile / columns);
            let mut code = 0;
            for row in row.saturating_sub(around)..=(row + around).min(rows - 1) {
                for column in column.saturating_sub(around)..=(column + around).min(columns - 1) {
                    code = join(code, codes[row * columns + column]);
                }
            }
            is_convex(code)
        }));
    }

    /// Box over 4×4 pixels (five taps, half weight at the ends) in both directions, within one surface.
    fn blur(&mut self) {
        let (width, height) = (self.width, self.height);
        self.blurred_key.resize(width * height, UNKNOWN);
        self.blurred_ambient.resize(width * height, UNKNOWN);
        // A row with two pixels of nothing on either side, and a row of nothing.
        let mut padded = Line { surface: vec![0; width + 4], values: [(); 3].map(|()| vec![0.0; width + 4]) };
        for y in 0..height {
            let row = y * width..(y + 1) * width;
            padded.surface[2..width + 2].copy_from_slice(&self.surface[row.clone()]);
            for (to, from) in padded.values.iter_mut().zip([&self.depth, &self.key, &self.ambient]) {
                to[2..width + 2].copy_from_slice(&from[row.clone()]);
            }
            let taps = [0, 1, 2, 3, 4].map(|first| padded.tap(first..first + width));
            mean_of_lines(&taps, &mut self.blurred_key[row.clone()], &mut self.blurred_ambient[row]);
        }
        std::mem::swap(&mut self.key, &mut self.blurred_key);
        std::mem::swap(&mut self.ambient, &mut self.blurred_ambient);
        padded.surface.fill(0);
        for y in 0..height {
            let taps = [-2, -1, 0, 1, 2].map(|step| match y.checked_add_signed(step) {
                Some(y) if y < height => {
                    let row = y * width..(y + 1) * width;
                    Tap {
                        surface: &self.surface[row.clone()],
                        depth: &self.depth[row.clone()],
                        key: &self.key[row.clone()],
                        ambient: &self.ambient[row],
                    }
                }
                _ => padded.tap(0..width),
            });
            let row = y * width..(y + 1) * width;
            mean_of_lines(&taps, &mut self.blurred_key[row.clone()], &mut self.blurred_ambient[row]);
        }
        std::mem::swap(&mut self.key, &mut self.blurred_key);
        std::mem::swap(&mut self.ambient, &mut self.blurred_ambient);
    }
}

/// A line of pixels: surface, then depth, key and ambient share.
struct Line {
    surface: Vec<u32>,
    values: [Vec<f32>; 3],
}

/// A part of a line.
struct Tap<'a> {
    surface: &'a [u32],
    depth: &'a [f32],
    key: &'a [f32],
    ambient: &'a [f32],
}

impl Line {
    fn tap(&self, range: std::ops::Range<usize>) -> Tap<'_> {
        let [depth, key, ambient] = self.values.each_ref().map(|values| &values[range.clone()]);
        Tap { surface: &self.surface[range], depth, key, ambient }
    }
}

/// Weighted means of the known shares of five lines where they show the middle one's surface.
///
/// Written without branches, so that it runs in vectors.
fn mean_of_lines(taps: &[Tap<'_>; 5], key_out: &mut [f32], ambient_out: &mut [f32]) {
    let width = key_out.len();
    let ambient_out = &mut ambient_out[..width];
    let taps = taps
        .each_ref()
        .map(|tap| (&tap.surface[..width], &tap.depth[..width], &tap.key[..width], &tap.ambient[..width]));
    let (surfaces, depths, ..) = taps[2];
    for x in 0..width {
        let (surface, depth) = (surfaces[x], depths[x]);
        let limit = 0.02 * depth;
        let (mut key, mut ambient, mut total) = (0.0, 0.0, 0.0);
        for ((surfaces, depths, keys, ambients), weight) in taps.into_iter().zip([0.5_f32, 1.0, 1.0, 1.0, 0.5]) {
            let is_same = (surfaces[x] == surface) & ((depths[x] - depth).abs() < limit) & (keys[x] >= 0.0);
            let weight = if is_same { weight } else { 0.0 };
            key += weight * keys[x];
            ambient += weight * ambients[x];
            total += weight;
        }
        let inverse = 1.0 / total;
        key_out[x] = if total > 0.0 { key * inverse } else { UNKNOWN };
        ambient_out[x] = if total > 0.0 { ambient * inverse } else { UNKNOWN };
    }
}

/// The pixels to estimate, coarse ones first, and where their estimated neighbours are:
/// every other field of a chess board in three passes.
fn passes(width: usize, height: usize) -> impl Iterator<Item = (usize, usize, Option<[[isize; 2]; 4]>)> {
    const STRAIGHT: [[isize; 2]; 4] = [[-2, 0], [2, 0], [0, -2], [0, 2]];
    const DIAGONAL: [[isize; 2]; 4] = [[-1, -1], [1, -1], [-1, 1], [1, 1]];
    let row =
        move |y: usize, first: usize, step: usize, around| (first..width).step_by(step).map(move |x| (x, y, around));
    let coarse = (0..height).step_by(2).flat_map(move |y| row(y, y % 4, 4, None));
    let middle = (0..height).step_by(2).flat_map(move |y| row(y, 2 - y % 4, 4, Some(STRAIGHT)));
    let fine = (1..height).step_by(2).flat_map(move |y| row(y, 1, 2, Some(DIAGONAL)));
    coarse.chain(middle).chain(fine)
}

/// Share of a pixel that was not estimated.
const UNKNOWN: f32 = -1.0;

/// Order of the sixteen turns of the taps within a block: neighbours get far-apart turns.
const PATTERN: [[usize; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// Sixteen turned copies of a spiral on the unit disc: columns and rows of each four taps.
fn tap_table() -> &'static [[[Vec4; 2]; HALVES]; 16] {
    static TABLE: std::sync::OnceLock<[[[Vec4; 2]; HALVES]; 16]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        let offset = |pattern: usize, tap: usize| {
            let share = (tap as f32 + 0.5) / (4 * HALVES) as f32;
            Vec2::from_angle(std::f32::consts::TAU * (share * 3.0 + pattern as f32 / 16.0)) * share
        };
        std::array::from_fn(|pattern| {
            std::array::from_fn(|half| {
                [gather(|lane| offset(pattern, half * 4 + lane).x), gather(|lane| offset(pattern, half * 4 + lane).y)]
            })
        })
    })
}

/// Nearest integer of a small number without a call to the mathematics library.
#[inline]
fn nearest_integer(value: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    (value + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}
