//! Irradiance grids on support surfaces: ambient occlusion and coloured bounce light of the bodies on them.
//!
//! Each body is an ellipsoid ([`super::proxies`]), lit by the sky and by the key light on its bright side. Irradiance
//! is computed at grid points and interpolated bilinearly: it varies slowly and does not depend on the viewing
//! direction.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use std::ops::Range;

use glam::{Vec2, Vec3A, Vec4};
use multiversion::multiversion;

use crate::ambient::proxies::{Proxy, form_factor, penumbra};
use crate::ambient::proxy_set::Proxies;
use crate::gbuffer::view::CameraView;
use crate::lights::lighting::Lighting;
use crate::scene::assets::RenderAssets;
use crate::scene::supports::SupportTop;
use crate::scene::variation::RenderVariation;
use crate::simd::{BatchColumn, CHUNK, Column, floor, nearest_integer, whole_registers, within};

/// Minimum grid spacing for large and for small images (m). Chosen by hand: a sixth of the width of a small object
/// (6 cm), and about the footprint of a pixel of a small image.
const STEP_M: [f32; 2] = [0.01, 0.02];
/// Grid points of a row that are computed in one SIMD batch.
const RUN: usize = 16;
/// Factor on a body's form factor that gives the share of ambient light it occludes. This constant and the following
/// ones marked as fitted were fitted to path-traced images.
const STRENGTH: f32 = 1.7;
/// Share of the ambient light that comes from the key light's side, from the direction `to_light + LAMP_UP * z`.
/// Fitted.
const LAMP: f32 = 0.32;
const LAMP_UP: f32 = 1.065;
/// Light that a white body reflects per form factor, as a multiple of the ambient irradiance (`AMBIENT_BACK`), and of
/// the key light on its bright side (`KEY_BACK`). Fitted.
const AMBIENT_BACK: f32 = 0.616;
const KEY_BACK: f32 = 1.8;
/// Key-light bounce as a share of `KEY_BACK`: `max(KEY_BESIDE - KEY_SIDE * h * cos φ, 0) * (1 - KEY_SHADED * form
/// factor)`, with the horizontal angle φ between the directions from the point to the light and to the body, and the
/// length h of the horizontal part of the unit vector to the light. Fitted.
const KEY_BESIDE: f32 = 0.625;
const KEY_SIDE: f32 = 0.45;
const KEY_SHADED: f32 = 0.156;
/// Height above the surface at which a body starts to count less for a fixed camera, and range over which it fades out
/// (m). Chosen by hand: carried objects have no effect, standing ones do.
const STANDING_M: f32 = 0.01;
const FADING_M: f32 = 0.03;
/// Weight of a body above that range for a wrist camera. Fitted.
const HANGING: f32 = 0.75;
/// Largest depth (m) at which a corner of a wrist camera's view may meet the surface; if a corner meets it farther away
/// or not at all, all grid points are updated.
const LONGEST_M: f32 = 10.0;

/// Irradiance grids of all support surfaces, with a counter of changes.
#[derive(Debug)]
pub(crate) struct IrradianceGrids {
    grids: Vec<IrradianceGrid>,
    version: u64,
}

/// Regular grid on one support surface, with a factor on the ambient irradiance at each grid point.
#[derive(Debug)]
pub(crate) struct IrradianceGrid {
    surface: u16,
    height: f32,
    /// World position of the first grid point (x, y; m).
    first: Vec2,
    step: f32,
    /// Grid points per row, a multiple of [`RUN`].
    columns: usize,
    /// Largest grid coordinates (column, row; in steps) that can be interpolated.
    last: Vec2,
    /// Factors on the ambient irradiance (red, green, blue, unused), row by row; 1 without bodies.
    points: Vec<Vec4>,
    bodies: Vec<Body>,
}

/// Proxy of a body with the light that it reflects onto the surface.
#[derive(Clone, Debug, PartialEq)]
struct Body {
    proxy: Proxy,
    /// Factor on the body's occlusion and bounce: 1 if it stands on the surface; if lifted, it falls to 0 (fixed
    /// camera) or `HANGING` (wrist camera).
    weight: f32,
    /// Reflected sky light and reflected key light, linear RGB relative to the ambient light on the support surface.
    ambient: [f32; 3],
    key: [f32; 3],
    /// Direction of the ambient light from the key light's side, in the space of [`Proxy::stretched`].
    lamp: [f32; 3],
}

impl IrradianceGrids {
    /// Grids of the support surfaces, coarser for small images; none without ambient occlusion.
    pub fn new(assets: &RenderAssets, variation: &RenderVariation, is_small: bool) -> Self {
        let is_on = variation.occlusion_radius_m > 0.0 && variation.occlusion_strength > 0.0;
        let supports = assets.supports().iter().filter(|_| is_on);
        Self { grids: supports.map(|top| IrradianceGrid::new(top, is_small)).collect(), version: 0 }
    }

    /// Grid of a surface by its number (part index plus one); `None` if the surface has no grid.
    pub fn of(&self, surface: u16) -> Option<&IrradianceGrid> {
        self.grids.iter().find(|grid| grid.surface == surface)
    }

    /// Numbers of the surfaces that have a grid.
    pub fn surfaces(&self) -> impl Iterator<Item = u16> {
        self.grids.iter().map(|grid| grid.surface)
    }

    /// Number of changes of any grid so far; equal numbers mean equal grids.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Updates the grids for the bodies of a frame. For a fixed camera only bodies that stand on a surface count; for a
    /// wrist camera all count, but only grid points in its view are updated.
    pub fn update(&mut self, proxies: &Proxies, variation: &RenderVariation, lighting: &Lighting, camera: &CameraView) {
        for grid in &mut self.grids {
            self.version += u64::from(grid.update(proxies, variation, lighting, camera));
        }
    }
}

impl IrradianceGrid {
    fn new(top: &SupportTop, is_small: bool) -> Self {
        let size = top.high - top.low;
        // At most 256 steps per side, so that large surfaces have a coarser grid.
        let step = STEP_M[usize::from(is_small)].max(size.max_element() / 256.0);
        let [columns, rows] = (size / step).to_array().map(|steps| steps.ceil() as usize + 2);
        let columns = columns.next_multiple_of(RUN);
        Self {
            surface: top.part as u16 + 1,
            height: top.height,
            first: top.low,
            step,
            columns,
            last: Vec2::new((columns - 2) as f32, (rows - 2) as f32) + 0.999,
            points: vec![Vec4::ONE; columns * rows],
            bodies: Vec::new(),
        }
    }

    /// Updates the grid for the bodies of a frame; returns false if no grid point changes.
    fn update(
        &mut self,
        proxies: &Proxies,
        variation: &RenderVariation,
        lighting: &Lighting,
        camera: &CameraView,
    ) -> bool {
        let up = lighting.around(Vec3A::Z).max(Vec3A::splat(1e-3));
        let bodies = proxies.bodies().iter().filter_map(|proxy| {
            let height = (proxy.lowest() - self.height - STANDING_M) / FADING_M;
            let standing = 1.0 - height.clamp(0.0, 1.0);
            let weight = if proxies.count() { standing + (1.0 - standing) * HANGING } else { standing };
            let color = proxy.color();
            let key = (color * lighting.key / up * (KEY_BACK * proxy.lit())).to_array();
            let lamp = proxy.stretched(lighting.to_light + Vec3A::Z * LAMP_UP).to_array();
            (weight > 0.0).then(|| Body {
                proxy: proxy.clone(),
                weight,
                ambient: (color * AMBIENT_BACK).to_array(),
                key,
                lamp,
            })
        });
        let bodies: Vec<Body> = bodies.collect();
        if bodies == self.bodies && !proxies.count() {
            return false;
        }
        let seen = if proxies.count() { self.seen_by(camera) } else { None };
        let toward = lighting.to_light.truncate().to_array();
        // Relative to the default strength, to which the constants were fitted.
        let strength = STRENGTH * variation.occlusion_strength / RenderVariation::default().occlusion_strength;
        let per_row = self.columns / RUN;
        let [runs, rows] = seen.unwrap_or([0..per_row, 0..self.points.len() / self.columns]);
        let mut changes = false;
        for run in rows.flat_map(|row| runs.clone().map(move |run| row * per_row + run)) {
            let points = light_run(&bodies, self.place_of(run), toward, strength);
            let known = &mut self.points[run * RUN..][..RUN];
            if known != points {
                known.copy_from_slice(&points);
                changes = true;
            }
        }
        self.bodies = bodies;
        changes
    }

    /// Multiplies the ambient light at `count` positions (m) on the surface by the interpolated factors.
    #[inline(always)]
    pub fn apply(&self, count: usize, place: &[BatchColumn; 3], around: &mut [BatchColumn; 3]) {
        let (mut index, mut x, mut y) = (Column::<u32>::default(), BatchColumn::default(), BatchColumn::default());
        for i in 0..whole_registers(count) {
            let [column, row] = self.on_grid(Vec2::new(place[0][i], place[1][i]));
            let (left, top) = (floor(column), floor(row));
            (x[i], y[i]) = (column - left, row - top);
            index[i] = nearest_integer(top) * self.columns as u32 + nearest_integer(left);
        }
        let mut factors = [Vec4::ONE; CHUNK];
        for i in 0..count.min(CHUNK) {
            let index = index[i] as usize;
            if let ([a, b, ..], [c, d, ..]) = (&self.points[index..], &self.points[index + self.columns..]) {
                let (upper, lower) = (*a + (*b - *a) * x[i], *c + (*d - *c) * x[i]);
                factors[i] = upper + (lower - upper) * y[i];
            }
        }
        for channel in 0..3 {
            for i in 0..CHUNK {
                around[channel][i] *= factors[i][channel];
            }
        }
    }

    /// Grid coordinates of a position (m), clamped to where they can be interpolated.
    #[inline(always)]
    fn on_grid(&self, place: Vec2) -> [f32; 2] {
        let at = (place - self.first) * (1.0 / self.step);
        [within(at.x, 0.0, self.last.x), within(at.y, 0.0, self.last.y)]
    }

    /// World position (x, y; m) at which a pixel's view ray meets the unbounded plane of the support surface; `None` if
    /// it misses the plane or meets it at a depth of [`LONGEST_M`] or more.
    fn seen_at(&self, camera: &CameraView, pixel: Vec2) -> Option<Vec2> {
        let ray = camera.point_at(pixel, 1.0) - camera.viewpoint;
        let distance = (self.height - camera.viewpoint.z) / ray.z;
        (0.0..LONGEST_M).contains(&distance).then(|| (camera.viewpoint + ray * distance).truncate())
    }

    /// Visible runs per row, and visible rows of grid points; `None` if the view ray of an image corner does not meet
    /// the surface's plane within a depth of [`LONGEST_M`].
    fn seen_by(&self, camera: &CameraView) -> Option<[Range<usize>; 2]> {
        let (width, height) = (camera.width as f32, camera.height as f32);
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for corner in [Vec2::splat(-1.0), Vec2::new(width, -1.0), Vec2::new(-1.0, height), Vec2::new(width, height)] {
            let place = self.seen_at(camera, corner)?;
            (low, high) = (low.min(place), high.max(place));
        }
        let ([left, top], [right, bottom]) = (self.on_grid(low), self.on_grid(high));
        let runs = left as usize / RUN..((right as usize + 1) / RUN + 1).min(self.columns / RUN);
        Some([runs, top as usize..bottom as usize + 2])
    }

    /// World position (m) of the first grid point of a run, and spacing along x (m).
    fn place_of(&self, run: usize) -> [f32; 4] {
        let per_row = self.columns / RUN;
        let (column, row) = (run % per_row * RUN, run / per_row);
        [self.first.x + column as f32 * self.step, self.first.y + row as f32 * self.step, self.height, self.step]
    }
}

/// Factors on the ambient irradiance at the grid points of a run; `to_light` is the horizontal part of the direction to
/// the key light.
fn light_run(bodies: &[Body], [x, y, z, step]: [f32; 4], to_light: [f32; 2], strength: f32) -> [Vec4; RUN] {
    let (mut share, mut back) = ([1.0; RUN], [[0.0; RUN]; 3]);
    for body in bodies {
        let [to_x, to_y, to_z] = body.proxy.center().to_array();
        let beside = within(to_x, x, x + (RUN - 1) as f32 * step) - to_x;
        let square = beside * beside + (to_y - y) * (to_y - y) + (to_z - z) * (to_z - z);
        if body.proxy.reaches(square) {
            add_body(body, [x, y, z, step], to_light, strength, &mut share, &mut back);
        }
    }
    std::array::from_fn(|i| Vec4::new(share[i] + back[0][i], share[i] + back[1][i], share[i] + back[2][i], 0.0))
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_body(
    body: &Body,
    [x, y, z, step]: [f32; 4],
    to_light: [f32; 2],
    strength: f32,
    share: &mut [f32; RUN],
    back: &mut [[f32; RUN]; 3],
) {
    let center = body.proxy.center().to_array();
    for i in 0..RUN {
        let toward = [center[0] - (x + i as i32 as f32 * step), center[1] - y, center[2] - z];
        let cover = body.weight * form_factor(&body.proxy, toward, [0.0, 0.0, 1.0]);
        // The key-light bounce depends only on the horizontal angle, since the sides of most objects are vertical. It
        // is strongest where the body shows its lit side.
        let flat = 1.0 / toward[0].mul_add(toward[0], toward[1].mul_add(toward[1], 1e-12)).sqrt();
        let across = to_light[0].mul_add(toward[0], to_light[1] * toward[1]);
        let lit = (across * flat).mul_add(-KEY_SIDE, KEY_BESIDE);
        let lit = if lit > 0.0 { lit } else { 0.0 };
        // Close to a body, part of its visible side is in shadow: the bounce decreases with the form factor.
        let lit = lit * cover.mul_add(-KEY_SHADED, 1.0);
        let arriving = share[i] * cover;
        for channel in 0..3 {
            let light = body.key[channel].mul_add(lit, body.ambient[channel]);
            back[channel][i] = arriving.mul_add(light, back[channel][i]);
        }
        let left = cover.mul_add(-strength, 1.0);
        share[i] *= if left > 0.0 { left } else { 0.0 };
    }
    // A separate loop, since the compiler does not vectorise a longer one.
    for i in 0..RUN {
        let toward = [center[0] - (x + i as i32 as f32 * step), center[1] - y, center[2] - z];
        share[i] *= 1.0 - LAMP * body.weight * penumbra(&body.proxy, toward, body.lamp);
    }
}

#[cfg(test)]
mod tests {
    use genmanip_assets::worlds::default_world;
    use genmanip_core::glam::{DVec3, Vec3};
    use genmanip_core::{CameraMount, Material, Pose, SupportSurface};

    use super::*;
    use crate::ambient::proxy_set::colors_of;
    use crate::gbuffer::view::View;
    use crate::job::FrameState;
    use crate::tests::fixture;

    /// Scene of a red and a white block above two support surfaces with nothing else on them.
    struct Scene {
        assets: std::sync::Arc<RenderAssets>,
        variation: RenderVariation,
        lighting: Lighting,
        colors: Vec<Vec3A>,
    }

    impl Scene {
        fn new() -> Self {
            let block =
                |color| fixture::object("block", fixture::block(Vec3::splat(0.03)), Material::plain(color, 0.6));
            let objects = [block([0.9, 0.1, 0.1]), block([0.9; 3])];
            let mut world = (*default_world()).clone();
            world.surfaces.push(SupportSurface { top_center_m: SIDE, ..world.surfaces[0].clone() });
            let assets = RenderAssets::without_robot(&objects, Some(&world)).unwrap();
            let variation = RenderVariation::default();
            let surfaces = variation.materials(&assets);
            let (lighting, colors) =
                (Lighting::new(&variation, assets.ground_color(&surfaces)), colors_of(&assets, &surfaces));
            Self { assets, variation, lighting, colors }
        }

        fn follow(&self, grids: &mut IrradianceGrids, mount: CameraMount, places: [DVec3; 2]) {
            let mut proxies = Proxies::default();
            let frame = FrameState { body_poses: places.map(Pose::from_position).to_vec() };
            proxies.place(&self.assets, &self.colors, &frame, mount, self.lighting.to_light);
            grids.update(&proxies, &self.variation, &self.lighting, &View::default().camera);
        }

        fn anew(&self, mount: CameraMount, places: [DVec3; 2]) -> IrradianceGrids {
            let mut grids = IrradianceGrids::new(&self.assets, &self.variation, false);
            self.follow(&mut grids, mount, places);
            grids
        }
    }

    const FAR: DVec3 = DVec3::new(0.9, -0.4, 0.03);
    /// Centre of the second support surface (m).
    const SIDE: DVec3 = DVec3::new(0.5, 2.5, -0.2);

    /// A red block makes its surroundings on any surface redder and darker, less so farther away; a hanging block only
    /// for the wrist camera.
    #[test]
    fn bodies_darken_and_colour_the_surface_around_them() {
        let scene = Scene::new();
        for (grid, center) in [DVec3::X * 0.5, SIDE].into_iter().enumerate() {
            let light = |mount, block, y| {
                let place = [0.5, center.y as f32 + y, 0.0].map(BatchColumn::of);
                let mut around = [BatchColumn::of(1.0); 3];
                scene.anew(mount, [block, FAR]).grids[grid].apply(1, &place, &mut around);
                Vec3A::from_array(around.map(|channel| channel[0]))
            };
            let at = |height, mount, y| light(mount, center + DVec3::Z * height, y);
            let near = at(0.03, CameraMount::World, 0.05);
            assert!(near.x > near.y && near.y < 0.9, "{near} on surface {grid}");
            let away = at(0.03, CameraMount::World, 0.3);
            assert!((away - Vec3A::ONE).abs().max_element() < 0.05, "{away} on surface {grid}");
            assert_eq!(at(0.13, CameraMount::World, 0.05), light(CameraMount::World, DVec3::Z, 0.05));
            assert!(at(0.13, CameraMount::Hand, 0.05).y < 0.97);
        }
    }

    /// The version changes if and only if a grid does; an updated grid equals a new one.
    #[test]
    fn following_is_lighting_anew() {
        let scene = Scene::new();
        let start = [DVec3::new(0.3, 0.0, 0.03), FAR];
        let mut followed = scene.anew(CameraMount::World, start);
        let version = followed.version();
        scene.follow(&mut followed, CameraMount::World, start);
        assert_eq!(followed.version(), version);
        let moved = [DVec3::new(0.35, 0.02, 0.03), FAR];
        scene.follow(&mut followed, CameraMount::World, moved);
        assert!(followed.version() > version);
        let anew = scene.anew(CameraMount::World, moved);
        assert_eq!(followed.grids[0].points, anew.grids[0].points);
    }
}
