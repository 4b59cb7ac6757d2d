//! Shadows of the key light: a depth map seen from the light, read with contact-hardening soft edges
//! (Fernando, "Percentage-Closer Soft Shadows", 2005).

use genmanip_core::Pose;
use glam::{Mat3A, Vec2, Vec3A, Vec4};

use crate::assets::{Part, RenderAssets};
use crate::job::FrameState;
use crate::lanes::gather;
use crate::raster::{Corner, Target};
use crate::variation::RenderVariation;
use crate::view::rotation;

/// Texels per side of a tile whose extremes are kept to skip the search where nothing can cast a shadow.
const TILE: usize = 16;
/// Largest radius of a soft edge, texels; a tile's extremes cover its neighbours up to this distance.
const MAX_RADIUS: f32 = 30.0;
/// Taps of the search for blockers and of the filter.
const TAPS: usize = 8;
/// Groups of four taps.
const HALVES: usize = TAPS / 4;

/// What the key light sees.
#[derive(Debug, Default)]
pub(crate) struct ShadowMap {
    map: Target,
    corners: Vec<Corner>,
    /// Smallest and largest nearness within [`MAX_RADIUS`] of each tile.
    extremes: Vec<[f32; 2]>,
    tiles: usize,
    /// Rows: the light's right, down and forward axes in the world.
    light_from_world: Mat3A,
    center: Vec3A,
    radius: f32,
    texels_per_m: f32,
    spread: f32,
}

impl ShadowMap {
    /// Whether there is a map at all.
    pub fn is_on(&self) -> bool {
        self.map.width > 0
    }

    /// Draws everything that casts a shadow at a frame.
    pub fn draw(&mut self, assets: &RenderAssets, frame: &FrameState, variation: &RenderVariation) {
        let size = variation.shadow_resolution.min(8192) as usize / TILE * TILE;
        self.map.reset::<false>(size, size);
        if size == 0 {
            return;
        }
        let forward = -Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let hint = if forward.z.abs() > 0.99 { Vec3A::X } else { Vec3A::Z };
        let right = forward.cross(hint).normalize();
        self.light_from_world = Mat3A::from_cols(right, forward.cross(right), forward).transpose();
        self.center = self.light_from_world * Vec3A::from_array(variation.shadow_center);
        self.radius = variation.shadow_radius_m.max(0.01);
        self.texels_per_m = size as f32 / (2.0 * self.radius);
        self.spread = variation.light_angular_radius.clamp(0.0, 1.0).tan();
        for part in &assets.parts {
            if part.casts_shadow && part.surface.opacity >= 0.5 {
                let pose = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
                self.draw_part(part, &pose);
            }
        }
        self.summarise();
    }

    /// Share of the key light that reaches a surface point, 0-1. `pattern` 0-15 turns the taps.
    pub fn visibility(&self, point: Vec3A, normal: Vec3A, pattern: usize) -> f32 {
        let texel = 1.0 / self.texels_per_m;
        let slope = self.light_from_world * normal;
        let facing = (-slope.z).max(0.05);
        // A lift along the normal hides the steps of the map, more where the light grazes the surface.
        let lifted = point + normal * (texel * (0.6 + 1.4 * (1.0 - facing)));
        let place = self.on_map(self.light_from_world * lifted);
        let limit = self.map.width as f32 - 1.0;
        if !(place.x >= 0.0 && place.y >= 0.0 && place.x <= limit && place.y <= limit) {
            return 1.0;
        }
        // Nearness of the receiving plane changes by this much per texel of distance from the point.
        let tilt = (Vec2::new(slope.x, slope.y) / -facing * texel).clamp_length_max(2.0 * texel);
        let [low, high] = self.extremes[place.y as usize / TILE * self.tiles + place.x as usize / TILE];
        let reach = tilt.length() * MAX_RADIUS;
        if high <= place.nearness - reach {
            return 1.0;
        }
        if low >= place.nearness + reach {
            return 0.0;
        }
        let taps = &tap_table()[pattern % 16];
        // How much nearer to the light than the receiving plane the map is, at four taps.
        let ahead = |half: usize, radius: f32| {
            let (dx, dy) = (taps[half][0] * radius, taps[half][1] * radius);
            let within = |place: Vec4| (place.max(Vec4::ZERO).min(Vec4::splat(limit)) + 0.5).to_array();
            let (x, y) = (within(dx + place.x), within(dy + place.y));
            let stored =
                gather(|lane| self.map.nearness[y[lane] as i32 as usize * self.map.width + x[lane] as i32 as usize]);
            stored - (dx * tilt.x + dy * tilt.y + place.nearness)
        };
        let search = (self.spread * 0.5 * self.texels_per_m).clamp(2.0, MAX_RADIUS);
        let mut blockers = 0;
        let mut distance = Vec4::ZERO;
        for half in 0..HALVES {
            let ahead = ahead(half, search);
            blockers += ahead.cmpgt(Vec4::ZERO).bitmask().count_ones();
            distance += ahead.max(Vec4::ZERO);
        }
        if blockers == 0 {
            return 1.0;
        }
        let radius = distance.element_sum() / blockers as f32 * self.spread * self.texels_per_m;
        let radius = radius.clamp(1.2, MAX_RADIUS);
        let open: u32 = (0..HALVES).map(|half| ahead(half, radius).cmple(Vec4::ZERO).bitmask().count_ones()).sum();
        open as f32 / TAPS as f32
    }

    fn on_map(&self, in_light: Vec3A) -> Corner {
        let local = in_light - self.center;
        Corner {
            x: (local.x + self.radius) * self.texels_per_m - 0.5,
            y: (local.y + self.radius) * self.texels_per_m - 0.5,
            nearness: 3.0 * self.radius - local.z,
        }
    }

    fn draw_part(&mut self, part: &Part, world_from_body: &Pose) {
        let turn = self.light_from_world * rotation(world_from_body);
        let shift = self.light_from_world * world_from_body.position.as_vec3a();
        let center = turn * Vec3A::from(part.bounds_center) + shift - self.center;
        if center.x.abs().max(center.y.abs()) > self.radius + part.bounds_radius {
            return;
        }
        self.corners.clear();
        for &position in &part.positions {
            let corner = self.on_map(turn * Vec3A::from(position) + shift);
            self.corners.push(corner);
        }
        for &triangle in &part.triangles {
            let corners = triangle.map(|index| self.corners[index as usize]);
            let [a, b, c] = corners;
            let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
            if area < 0.0 || !part.closed {
                self.map.draw::<false>(corners, area, 0);
            }
        }
    }

    /// Extremes per tile, then of each tile with its neighbours.
    fn summarise(&mut self) {
        let width = self.map.width;
        let tiles = width / TILE;
        let join = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let mut own = vec![[f32::INFINITY, 0.0]; tiles * tiles];
        for (row, extremes) in self.map.nearness.chunks_exact(width * TILE).zip(own.chunks_exact_mut(tiles)) {
            for (tile, extremes) in extremes.iter_mut().enumerate() {
                // One pair of extremes per column of the tile: columns are independent, so this runs in vectors.
                let (mut low, mut high) = ([f32::INFINITY; TILE], [0.0; TILE]);
                for texels in row.chunks_exact(width).map(|row| &row[tile * TILE..][..TILE]) {
                    for (column, &value) in texels.iter().enumerate() {
                        low[column] = if value < low[column] { value } else { low[column] };
                        high[column] = if value > high[column] { value } else { high[column] };
                    }
                }
                *extremes = low.iter().zip(high).fold(*extremes, |all, (&low, high)| join(all, [low, high]));
            }
        }
        let reach = (MAX_RADIUS as usize).div_ceil(TILE);
        let spread = |source: &[[f32; 2]], step: usize, position: &dyn Fn(usize) -> usize| -> Vec<[f32; 2]> {
            (0..source.len())
                .map(|tile| {
                    let at = position(tile);
                    let (from, to) = (at.saturating_sub(reach), (at + reach).min(tiles - 1));
                    (from..=to)
                        .fold([f32::INFINITY, 0.0], |all, other| join(all, source[tile + other * step - at * step]))
                })
                .collect()
        };
        let rows = spread(&own, 1, &|tile| tile % tiles);
        self.extremes = spread(&rows, tiles, &|tile| tile / tiles);
        self.tiles = tiles;
    }
}

/// Sixteen turned copies of a sunflower pattern on the unit disc: columns and rows of each four taps.
fn tap_table() -> &'static [[[Vec4; 2]; HALVES]; 16] {
    static TABLE: std::sync::OnceLock<[[[Vec4; 2]; HALVES]; 16]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        let offset = |pattern: usize, tap: usize| {
            let angle = tap as f32 * 2.399_963 + pattern as f32 * std::f32::consts::TAU / 16.0;
            Vec2::from_angle(angle) * ((tap as f32 + 0.5) / TAPS as f32).sqrt()
        };
        std::array::from_fn(|pattern| {
            std::array::from_fn(|half| {
                [gather(|lane| offset(pattern, half * 4 + lane).x), gather(|lane| offset(pattern, half * 4 + lane).y)]
            })
        })
    })
}
