//! Proxies: ellipsoids for bodies that the image does not show, such as the gripper above a wrist camera.
//!
//! Their form factors have a closed form.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use genmanip_core::Pose;
use glam::{Vec3, Vec3A};
use multiversion::multiversion;

use crate::gbuffer::points::Points;
use crate::gbuffer::view::rotation;
use crate::scene::body_shape::BodyShape;
use crate::simd::{BatchColumn, dot, smooth_step, whole_registers, within};

/// Half axes of the ellipsoid relative to the bounding box. Fitted to path-traced images.
pub(super) const FULLNESS: f32 = 0.875;
/// Share of the occluded ambient light that a body absorbs; the body reflects the rest. Fitted likewise.
const STRENGTH: f32 = 0.578;
/// Penumbra of a broad light: growth of its half width per half axis of distance behind the occluder. Fitted likewise.
const LAMP_WIDTH: f32 = 0.58;
/// Half width of that penumbra at the occluder, in half axes. Fitted likewise.
const LAMP_EDGE: f32 = 0.1;
/// Reduction of that shadow with the square of the penumbra's half width, since the light becomes wider than the body.
/// Fitted likewise.
const LAMP_BEYOND: f32 = 0.21;
/// Half width of the penumbra of a body's shadow at another body's centre, in half axes of the body that casts it.
/// Chosen by hand for bodies of about the same size.
const LAMP_BLUR: f32 = 0.3;
/// Smallest half axis (m). Chosen by hand.
const THINNEST_M: f32 = 0.005;
/// Smallest form factor that counts; it defines the reach of a proxy. Chosen by hand so that the cut-off is invisible.
const LEAST: f32 = 0.01;
/// Slope of the fade-out with squared distance / squared reach: 4 makes it begin at three quarters of the squared
/// reach. Chosen by hand.
const FADE: f32 = 4.0;

/// Stand-in for a body: an ellipsoid that occludes light, may have a cavity, and may be held.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Proxy {
    /// Index of the body among the frame's bodies.
    pub(super) body: usize,
    pub(super) shape: BodyShape,
    /// Centre in the world (m).
    pub(super) center: [f32; 3],
    /// Unit vectors of the axes in the world, divided by the half axes (1/m).
    pub(super) axes: [[f32; 3]; 3],
    /// Product of the half axes (m³).
    pub(super) volume: f32,
    /// Mean linear colour of the body.
    pub(super) color: [f32; 3],
    /// Distance from the centre beyond which the proxy has no effect (m).
    pub(super) reach: f32,
    /// Direction to the key light in the space where the ellipsoid is the unit sphere.
    pub(super) to_lamp: [f32; 3],
    /// Share of the key light that other bodies do not occlude at the centre, softened; also used for the surface
    /// around the body. 1 for the arm and a held body, and for all bodies unless the camera is on the wrist.
    pub(super) lit: f32,
    /// Share of key light and sky light that enters the body's cavity past other bodies, through the positive end of
    /// the third axis, where concave bodies are open; 0 without a cavity, or if the body does not stand upright.
    pub(super) entering: f32,
    /// Degree to which the body is held in the gripper, 0-1; 0 unless the camera is on the wrist.
    pub(super) held: f32,
}

impl Proxy {
    /// Proxy of a free, lit body without a cavity, from its shape, pose, mean linear colour and the direction to the
    /// key light.
    pub fn new(body: usize, shape: BodyShape, pose: &Pose, color: Vec3A, to_light: Vec3A) -> Self {
        let half = ((shape.high - shape.low) * (0.5 * FULLNESS)).max(Vec3::splat(THINNEST_M));
        let turn = rotation(pose);
        let center = turn * Vec3A::from(shape.middle()) + pose.position.as_vec3a();
        let axes = [turn.x_axis / half.x, turn.y_axis / half.y, turn.z_axis / half.z].map(|axis| axis.to_array());
        let volume = half.element_product();
        let own = Self {
            body,
            shape,
            center: center.to_array(),
            axes,
            volume,
            color: color.to_array(),
            // Distance at which the form factor falls below [`LEAST`], if the body shows its largest cross-section.
            reach: (volume / half.min_element() / LEAST).sqrt(),
            to_lamp: [0.0; 3],
            lit: 1.0,
            entering: 0.0,
            held: 0.0,
        };
        Self { to_lamp: own.stretched(to_light).to_array(), ..own }
    }

    /// Centre in the world (m).
    pub fn center(&self) -> Vec3A {
        Vec3A::from_array(self.center)
    }

    /// Unit vector of a world direction in the space where the ellipsoid is the unit sphere.
    pub fn stretched(&self, direction: Vec3A) -> Vec3A {
        Vec3A::from_array(self.axes.map(|axis| Vec3A::from_array(axis).dot(direction))).normalize_or(Vec3A::Z)
    }

    /// World z of the ellipsoid's lowest point (m).
    pub fn lowest(&self) -> f32 {
        let half = |[x, y, z]: [f32; 3]| z / (x * x + y * y + z * z);
        self.center[2] - self.axes.into_iter().map(|axis| half(axis) * half(axis)).sum::<f32>().sqrt()
    }

    /// Mean linear colour of the body.
    pub fn color(&self) -> Vec3A {
        Vec3A::from_array(self.color)
    }

    /// Share of the key light that other bodies do not occlude at the centre, softened.
    pub fn lit(&self) -> f32 {
        self.lit
    }

    /// True if the proxy has an effect at a squared distance (m²) from its centre.
    pub fn reaches(&self, square: f32) -> bool {
        square < self.reach * self.reach
    }
}

/// Multiplies each point's ambient light by the share that an ellipsoid does not occlude.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn occlude(proxy: &Proxy, points: &Points, share: &mut BatchColumn) {
    let (center, per_reach) = (proxy.center, 1.0 / (proxy.reach * proxy.reach));
    for i in 0..whole_registers(points.count) {
        let toward = [center[0] - points.place[0][i], center[1] - points.place[1][i], center[2] - points.place[2][i]];
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        // The effect ends at the reach: beyond it a proxy is skipped for whole batches, and a point's result must not
        // depend on the others of its batch.
        let near = within(dot(toward, toward).mul_add(-FADE * per_reach, FADE), 0.0, 1.0);
        share[i] *= (form_factor(proxy, toward, normal) * near).mul_add(-STRENGTH, 1.0);
    }
}

/// Share of the sky above a point that no body except `but` occludes; bodies occlude independently of each other.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn unoccluded_sky(bodies: &[Proxy], but: usize, place: [f32; 3], normal: [f32; 3]) -> f32 {
    let mut left = 1.0;
    for other in bodies {
        let [x, y, z] = other.center;
        if other.body != but {
            left *= 1.0 - form_factor(other, [x - place[0], y - place[1], z - place[2]], normal);
        }
    }
    left
}

/// Share of the key light at a position that no body except `but` occludes, with a soft shadow border.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn unoccluded_lamp(bodies: &[Proxy], but: usize, [x, y, z]: [f32; 3]) -> f32 {
    let mut left = 1.0;
    for other in bodies {
        let toward = [other.center[0] - x, other.center[1] - y, other.center[2] - z];
        // In the space where the ellipsoid is the unit sphere.
        let along = other.axes.map(|axis| dot(axis, toward));
        let nearest = dot(along, other.to_lamp);
        if nearest > 0.0 && other.body != but {
            let square = nearest.mul_add(-nearest, dot(along, along));
            let beside = (if square > 0.0 { square } else { 0.0 }).sqrt();
            left *= smooth_step((beside - 1.0) * (0.5 / LAMP_BLUR) + 0.5);
        }
    }
    left
}

/// Share of a broad light that an ellipsoid covers; `toward` points to its centre, `lamp` to the light in the space
/// where the ellipsoid is the unit sphere.
#[inline(always)]
pub(crate) fn penumbra(proxy: &Proxy, toward: [f32; 3], lamp: [f32; 3]) -> f32 {
    let along = proxy.axes.map(|axis| dot(axis, toward));
    let (square, nearest) = (dot(along, along), dot(along, lamp));
    let beside = nearest.mul_add(-nearest, square);
    let beside = (if beside > 0.0 { beside } else { 0.0 }).sqrt();
    let spread = (if nearest > 0.0 { nearest } else { 0.0 }).mul_add(LAMP_WIDTH, LAMP_EDGE);
    // Far behind the ellipsoid, the light is wider than the ellipsoid.
    let full = 1.0 / (spread * spread).mul_add(LAMP_BEYOND, 1.0);
    smooth_step(((1.0 - beside) / spread).mul_add(0.5, 0.5)) * full * within(nearest + 0.5, 0.0, 1.0)
}

/// Cosine-weighted share of the sky above a point that an ellipsoid covers: exact for small, distant ellipsoids above
/// the horizon, and at most 0.95, as for one that touches the point from above.
#[inline(always)]
pub(crate) fn form_factor(proxy: &Proxy, toward: [f32; 3], normal: [f32; 3]) -> f32 {
    let square = dot(toward, toward) + 1e-12;
    let inverse = 1.0 / square.sqrt();
    let cosine = dot(normal, toward) * inverse;
    // In the space where the ellipsoid is the unit sphere.
    let along = proxy.axes.map(|axis| dot(axis, toward));
    let stretched = dot(along, along);
    let away = stretched.sqrt();
    // An ellipsoid partly below the horizon: `rise` goes smoothly from 0 (all below) to 1 (all above).
    let rise = within((cosine * away).mul_add(0.5, 0.5), 0.0, 1.0);
    let around = away + 1.0;
    let (above, edge) = (cosine * around, rise * rise);
    let facing = if above > edge { above } else { edge };
    // Solid angle over π, times the squared distance to the unit sphere's centre.
    let per_radius = away * inverse;
    let section = proxy.volume * per_radius * per_radius * per_radius;
    let beyond = if stretched > 1.0 { stretched - 1.0 } else { 0.0 };
    let cover = facing * section / ((beyond + section) * around);
    // No occlusion inside the ellipsoid, since bodies may be concave, and boxes exceed their ellipsoids.
    let outside = within(stretched.mul_add(2.0, -1.0), 0.0, 1.0);
    within(cover * outside, 0.0, 0.95)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::ambient) fn ball(place: [f32; 3], half: [f32; 3]) -> Proxy {
        let high = Vec3::from_array(half) / FULLNESS;
        let pose = Pose::from_position(Vec3::from_array(place).as_dvec3());
        let own = Proxy::new(0, BodyShape { low: -high, high, ..BodyShape::default() }, &pose, Vec3A::ZERO, Vec3A::Z);
        Proxy { reach: f32::INFINITY, ..own }
    }

    /// Batch of one point with an upward normal.
    pub(in crate::ambient) fn looking_up(place: [f32; 3]) -> Points {
        let mut points = Points::default();
        points.count = 1;
        for axis in 0..3 {
            (points.place[axis][0], points.normal[axis][0]) = (place[axis], f32::from(u8::from(axis == 2)));
        }
        points
    }

    /// Occlusion of a broad overhead light at a point by a ball above it, far above it, below it and beside it.
    #[test]
    fn balls_veil_a_broad_lamp() {
        let up = [0.0, 0.0, 1.0];
        for (center, low, high) in [
            ([0.0, 0.0, 0.2], 0.7, 0.9),
            ([0.0, 0.0, 3.0], 0.002, 0.02),
            ([0.0, 0.0, -0.2], 0.0, 1e-6),
            ([0.5, 0.0, 0.1], 0.0, 1e-6),
        ] {
            let got = penumbra(&ball(center, [0.1; 3]), center, up);
            assert!((low..=high).contains(&got), "{got}, expected {low} to {high} at {center:?}");
        }
    }

    /// Unoccluded share of a small overhead light: 0, 0.5 and 1, depending on the place of a ball.
    #[test]
    fn balls_hold_back_a_small_lamp() {
        for (center, expected) in
            [([0.0, 0.0, 0.5], 0.0), ([0.1, 0.0, 0.5], 0.5), ([0.0, 0.0, -0.5], 1.0), ([0.2, 0.0, 0.5], 1.0)]
        {
            let got = unoccluded_lamp(&[ball(center, [0.1; 3])], usize::MAX, [0.0; 3]);
            assert!((got - expected).abs() < 1e-5, "{got}, expected {expected} at {center:?}");
        }
    }

    /// Occlusion by ellipsoids above, beside and below a point, against closed forms.
    #[test]
    fn ellipsoids_cover_their_share_of_the_sky() {
        for (center, half, expected, tolerance) in [
            ([0.0, 0.0, 1.0], [0.1; 3], 0.01, 0.001),
            ([0.6, 0.0, 0.8], [0.1; 3], 0.008, 0.001),
            ([0.0, 0.0, 1.0], [0.2, 0.1, 0.05], 0.02, 0.002),
            ([0.0, 0.0, 0.1], [0.1; 3], 0.95, 0.01),
            ([0.0, 0.0, -1.0], [0.1; 3], 0.0, 1e-6),
            ([5.0, 0.0, 0.0], [0.1; 3], 0.0, 1e-4),
        ] {
            let mut share = BatchColumn::of(1.0);
            occlude(&ball(center, half), &looking_up([0.0; 3]), &mut share);
            let got = (1.0 - share[0]) / STRENGTH;
            assert!((got - expected).abs() < tolerance, "{got}, expected {expected}: {half:?} at {center:?}");
        }
    }
}
