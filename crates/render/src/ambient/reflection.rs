//! Reflections of proxies for wrist cameras: the metal fingers reflect the held object and their pads, and the dark gripper
//! bounces no light onto it.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over axes and components by index are compiled for wide registers"
)]

use super::proxies::{FULLNESS, Proxy, unoccluded_sky};
use crate::simd::{dot, within};

/// Share of the sky above a body's centre covered by the robot from which it counts as held, and at which it fully
/// does. Chosen: objects beside the gripper have less than 0.15, objects between the fingers more than 0.4.
const BESIDE: f32 = 0.2;
const BETWEEN: f32 = 0.4;
/// Ambient and key light on a held object in the gripper's shade, relative to a free one. Fitted to path-traced images.
const AROUND: f32 = 0.32;
const KEY: f32 = 0.35;
/// Width of a reflected edge relative to the length of the ray: fingers are of brushed metal. Fitted likewise.
const BLUR: f32 = 0.425;
/// Added ray length (m), and added edge width of an ellipsoid relative to its radius. Chosen: reflections of touching
/// objects are sharp, but smooth.
const NEAR_M: f32 = 0.01;
const EDGE: f32 = 0.05;

/// Degree to which a body is held by a robot with some bodies.
pub(super) fn held(own: &Proxy, robot: &[Proxy]) -> f32 {
    let above = 1.0 - unoccluded_sky(robot, own.body, own.center, [0.0, 0.0, 1.0]);
    ((above - BESIDE) / (BETWEEN - BESIDE)).clamp(0.0, 1.0)
}

impl Proxy {
    /// Share of a ray bundle from a position in a unit direction that hits the proxy, 0-1, and the unit normal there.
    #[inline(always)]
    pub fn meet(&self, place: [f32; 3], direction: [f32; 3]) -> (f32, [f32; 3]) {
        let from = [place[0] - self.center[0], place[1] - self.center[1], place[2] - self.center[2]];
        // In the space where the bounding box is the unit cube.
        let start = self.axes.map(|axis| dot(axis, from) * FULLNESS);
        let step = self.axes.map(|axis| dot(axis, direction) * FULLNESS);
        let (share, normal) =
            if self.shape.is_box { self.meet_box(start, step) } else { self.meet_ellipsoid(start, step) };
        (share * self.held, normal)
    }

    /// Reflected light of a share of the proxy; `around` is the ambient light on a white surface with that normal,
    /// followed by the key light's direction and colour.
    #[inline(always)]
    pub fn light(&self, share: f32, normal: [f32; 3], around: [f32; 3], [to_light, key]: [[f32; 3]; 2]) -> [f32; 3] {
        let lit = dot(normal, to_light);
        let lit = if lit > 0.0 { lit * KEY } else { 0.0 };
        let light = |channel: usize| share * self.color[channel] * around[channel].mul_add(AROUND, key[channel] * lit);
        [light(0), light(1), light(2)]
    }

    /// Share of a ray bundle that hits the box, and the normal of the side that is hit.
    #[inline(always)]
    fn meet_box(&self, start: [f32; 3], step: [f32; 3]) -> (f32, [f32; 3]) {
        let (mut entry, mut exit, mut normal) = (f32::NEG_INFINITY, f32::INFINITY, [0.0; 3]);
        for axis in 0..3 {
            let along = if step[axis].abs() > 1e-6 { step[axis] } else { 1e-6 };
            let side = if along > 0.0 { -1.0 } else { 1.0 };
            let (first, last) = ((side - start[axis]) / along, (-side - start[axis]) / along);
            let is_later = first > entry;
            entry = if is_later { first } else { entry };
            for component in 0..3 {
                normal[component] = if is_later { self.axes[axis][component] * side } else { normal[component] };
            }
            exit = if last < exit { last } else { exit };
        }
        let entry = if entry > 0.0 { entry } else { 0.0 };
        (within((exit - entry) / (BLUR * (entry + NEAR_M)), 0.0, 1.0), unit(normal))
    }

    /// Share of a ray bundle that hits the ellipsoid in the box, and the normal.
    #[inline(always)]
    fn meet_ellipsoid(&self, start: [f32; 3], step: [f32; 3]) -> (f32, [f32; 3]) {
        // In the space where the ellipsoid is the unit sphere.
        let (along, square) = (dot(start, step), dot(step, step) + 1e-12);
        let beside = (along / square).mul_add(-along, dot(start, start));
        let beside = if beside > 0.0 { beside } else { 0.0 };
        let length = square.sqrt();
        let nearest = -along / length;
        let spread = (if nearest > 0.0 { nearest } else { 0.0 }).mul_add(BLUR, EDGE);
        let share = within((1.0 - beside.sqrt()) / spread * 0.5 + 0.5, 0.0, 1.0) * within(nearest + 0.5, 0.0, 1.0);
        let inside = if beside < 1.0 { (1.0 - beside).sqrt() } else { 0.0 };
        let distance = nearest - inside;
        let distance = (if distance > 0.0 { distance } else { 0.0 }) / length;
        let mut normal = [0.0; 3];
        for axis in 0..3 {
            let at = distance.mul_add(step[axis], start[axis]);
            for component in 0..3 {
                normal[component] = self.axes[axis][component].mul_add(at, normal[component]);
            }
        }
        (share, unit(normal))
    }
}

#[inline(always)]
fn unit(vector: [f32; 3]) -> [f32; 3] {
    let inverse = 1.0 / (dot(vector, vector) + 1e-12).sqrt();
    vector.map(|value| value * inverse)
}

/// A fully held red cube of 0.2 m at the origin, or the ball in it.
#[cfg(test)]
pub(crate) fn held_cube(is_box: bool) -> Proxy {
    use crate::scene::body_shape::BodyShape;
    use glam::{Vec3, Vec3A};
    let shape = BodyShape { low: Vec3::splat(-0.1), high: Vec3::splat(0.1), is_box, ..BodyShape::default() };
    Proxy { held: 1.0, ..Proxy::new(0, shape, &genmanip_core::Pose::IDENTITY, Vec3A::X * 0.8, Vec3A::Z) }
}

#[cfg(test)]
mod tests {
    use genmanip_assets::panda;
    use genmanip_core::Pose;
    use glam::{Vec3, Vec3A};

    use super::*;
    use crate::scene::assets::RenderAssets;

    /// Each finger has one dark pad, hit by rays from the metal beside it.
    #[test]
    fn fingers_mirror_their_pads() {
        let assets = RenderAssets::new(panda(), &[], None).unwrap();
        assert_eq!(assets.pads().len(), 2);
        for pad in assets.pads() {
            assert!(pad.color.max_element() < 0.1, "{}", pad.color);
            let (low, high) = (pad.shape.low, pad.shape.high);
            let below = (low + high) * 0.5 - Vec3::Z * (high - low).z;
            let proxy = Proxy { held: 1.0, ..Proxy::new(pad.body, pad.shape, &Pose::IDENTITY, pad.color, Vec3A::Z) };
            let (share, normal) = proxy.meet(below.to_array(), [0.0, 0.0, 1.0]);
            assert_eq!((share, normal), (1.0, [0.0, 0.0, -1.0]));
        }
    }

    /// Rays that hit a cube or its ball, miss it, or point away: share and normal.
    #[test]
    fn rays_meet_what_is_held() {
        let diagonal = [std::f32::consts::FRAC_1_SQRT_2, 0.0, std::f32::consts::FRAC_1_SQRT_2];
        let (right, left) = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        for (is_box, from, direction, expected, normal) in [
            (true, [-0.3, 0.0, 0.0], right, 1.0, Some(left)),
            (false, [-0.12, 0.0, 0.0], right, 1.0, Some(left)),
            // Farther away the reflection is blurred.
            (false, [-0.3, 0.0, 0.0], right, 0.877, None),
            (true, [-0.3, 0.0, 0.0], left, 0.0, None),
            (false, [-0.3, 0.0, 0.0], left, 0.0, None),
            (true, [-0.3, 0.3, 0.0], right, 0.0, None),
            (false, [-0.15, 0.5, 0.0], right, 0.0, None),
            // An upper corner of the cube, at the blurred edge of the ball.
            (true, [-0.101, 0.09, 0.09], right, 1.0, Some(left)),
            (false, [-0.101, 0.09, 0.09], right, 0.215, None),
            // The edge of the ball is blurred.
            (false, [-0.3, 0.1, 0.0], right, 0.5, None),
            (true, [-0.2, 0.0, -0.2], diagonal, 1.0, None),
        ] {
            let held = held_cube(is_box);
            let (share, met) = held.meet(from, direction);
            assert!((share - expected).abs() < 1e-3, "{share} is met, {is_box} {from:?} {direction:?}");
            if let Some(normal) = normal {
                let apart: f32 = (0..3).map(|axis| (met[axis] - normal[axis]).abs()).sum();
                assert!(apart < 1e-3, "{met:?}, expected {normal:?}");
            }
            let light = held.light(share, met, [0.5; 3], [[0.0, 0.0, 1.0], [0.0; 3]]);
            assert!((light[0] - share * 0.8 * 0.5 * AROUND).abs() < 1e-6, "{light:?}");
            assert_eq!([light[1], light[2]], [0.0; 2], "it is red");
        }
    }
}
