//! What holds back ambient light and cannot be read from the depth of a picture: the hand behind its own camera, and the
//! walls of a hollow thing beyond the picture's border.
//!
//! Every body is an ellipsoid, whose share of the sky above a point has a closed form.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use genmanip_core::CameraMount;
use glam::{Vec3, Vec3A};
use multiversion::multiversion;

use crate::assets::{RenderAssets, Surface};
use crate::job::FrameState;
use crate::lanes::{Lane, whole_registers, within};
use crate::points::Points;
use crate::view::rotation;

/// Half axes of an ellipsoid over those of the box that it stands for. Fitted to traced pictures.
const FULLNESS: f32 = 0.875;
/// Share of the ambient light in its part of the sky that a body holds back: it throws back some itself. Fitted likewise.
const STRENGTH: f32 = 0.68;
/// The same of the walls of a hollow. Fitted likewise.
const WALLS: f32 = 0.85;
/// Key light that enters a hollow over that which arrives on a surface that faces the lamp. Fitted likewise.
const HOLLOW_KEY: f32 = 0.65;
/// Cosine to the vertical of the axis of a thing from which light from above enters it; and the share of the sky above its
/// opening at which nothing enters, and from which all does. Chosen.
const UPRIGHT: f32 = 0.5;
const COVERED: f32 = 0.5;
const HALF_OPEN: f32 = 0.75;
/// Thinnest half axis, metres. Chosen.
const THINNEST_M: f32 = 0.005;
/// Share of the sky above a point below which a body does not count. Chosen: a step that is not seen.
const LEAST: f32 = 0.006;

/// All bodies of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Occluders {
    bodies: Vec<Occluder>,
    /// Whether bodies hold back each other's light. Only for the hand's camera: it is near things, is covered by the hand,
    /// and has no picture before to continue, whose every tile would change with the arm.
    count: bool,
}

/// An ellipsoid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Occluder {
    /// Index into the frame's body poses.
    body: usize,
    /// World frame, metres.
    center: [f32; 3],
    /// Unit axes in the world, each over the length of the half axis.
    axes: [[f32; 3]; 3],
    /// Product of the half axes.
    volume: f32,
    /// Linear colour on average.
    color: [f32; 3],
    /// Distance of the centre beyond which it does not count, metres.
    reach: f32,
    /// Its centre in the body's frame, metres.
    middle: Vec3,
    /// How much of the light from above enters on the side of its third axis, 0-1.
    entering: f32,
}

/// The inside of a body that light enters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hollow {
    /// Its middle in the body's frame, metres.
    pub middle: Vec3,
    /// Share of the sky that is seen from its bottom.
    pub open: f32,
    /// Key light that enters, over that which arrives on a surface that faces the lamp.
    pub light: f32,
}

impl Occluders {
    /// Becomes the bodies of a frame that is seen by a camera; transparent ones hold nothing back.
    pub fn place(&mut self, assets: &RenderAssets, colors: &[Vec3A], frame: &FrameState, mount: CameraMount) {
        self.count = mount == CameraMount::Hand;
        self.bodies.clear();
        for (body, pose) in frame.body_poses.iter().enumerate() {
            let Some((low, high)) = assets.bounds_of(body) else { continue };
            let half = ((high - low) * (0.5 * FULLNESS)).max(Vec3::splat(THINNEST_M));
            let turn = rotation(pose);
            let center = turn * Vec3A::from((low + high) * 0.5) + pose.position.as_vec3a();
            let axes = [turn.x_axis / half.x, turn.y_axis / half.y, turn.z_axis / half.z].map(|axis| axis.to_array());
            let volume = half.x * half.y * half.z;
            // From far away it covers no more than its largest section does.
            let reach = (volume / half.min_element() / LEAST).sqrt();
            let color = colors.get(body).copied().unwrap_or(Vec3A::ZERO).to_array();
            let (center, middle) = (center.to_array(), (low + high) * 0.5);
            self.bodies.push(Occluder { body, center, axes, volume, color, reach, middle, entering: 0.0 });
        }
        for index in 0..self.bodies.len() {
            self.bodies[index].entering = self.entering(&self.bodies[index]);
        }
    }

    /// The hollow of a body, if light enters it.
    pub fn hollow_of(&self, body: usize) -> Option<Hollow> {
        let own = self.of_body(body)?;
        (own.entering > 0.0).then(|| {
            let [x, y, z] = own.axes[2];
            let half = 1.0 / (x * x + y * y + z * z).sqrt();
            Hollow { middle: own.middle, open: open_share(own.volume, half), light: own.entering * HOLLOW_KEY }
        })
    }

    /// How much of the light from above enters a body on the side of its third axis, on which things are open.
    fn entering(&self, own: &Occluder) -> f32 {
        let axis = Vec3A::from_array(own.axes[2]);
        let (up, half) = (axis.normalize(), axis.length_recip());
        if up.z < UPRIGHT {
            return 0.0;
        }
        let place = own.center() + up * half;
        let others = self.bodies.iter().filter(|other| self.count && other.body != own.body);
        let pass = |other: &Occluder| 1.0 - covered(other, (other.center() - place).to_array(), up.to_array());
        let share = others.map(pass).product::<f32>();
        ((share - COVERED) / (HALF_OPEN - COVERED)).clamp(0.0, 1.0)
    }

    fn of_body(&self, body: usize) -> Option<&Occluder> {
        // They are in the order of the bodies.
        let index = self.bodies.binary_search_by_key(&body, |occluder| occluder.body).ok()?;
        Some(&self.bodies[index])
    }

    /// All of them.
    pub fn bodies(&self) -> &[Occluder] {
        &self.bodies
    }

    /// Whether bodies hold back each other's light.
    pub fn count(&self) -> bool {
        self.count
    }

    /// Whether the light that reaches points at rest may differ from what it was among others.
    pub fn differ(&self, before: &Self) -> bool {
        (self.count || before.count) && self != before
    }

    /// Lowers shares of the ambient light that reach points of a body to what comes past the others, and out of its own
    /// hollow.
    pub fn darken(&self, points: &Points, of_body: Option<usize>, share: &mut Lane) {
        if let Some(own) = of_body.and_then(|body| self.of_body(body)) {
            enclose(own, points, share);
        }
        if !self.count {
            return;
        }
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for i in 0..points.count {
            let place = Vec3A::new(points.place[0][i], points.place[1][i], points.place[2][i]);
            (low, high) = (low.min(place), high.max(place));
        }
        for occluder in self.bodies.iter().filter(|occluder| Some(occluder.body) != of_body) {
            let center = occluder.center();
            if occluder.reaches(center.distance_squared(center.clamp(low, high))) {
                hold_back(occluder, points, share);
            }
        }
    }
}

impl Occluder {
    /// World frame, metres.
    pub fn center(&self) -> Vec3A {
        Vec3A::from_array(self.center)
    }

    /// Height of its lowest point, metres.
    pub fn lowest(&self) -> f32 {
        let half = |[x, y, z]: [f32; 3]| z / (x * x + y * y + z * z);
        self.center[2] - self.axes.into_iter().map(|axis| half(axis) * half(axis)).sum::<f32>().sqrt()
    }

    /// Linear colour on average.
    pub fn color(&self) -> Vec3A {
        Vec3A::from_array(self.color)
    }

    /// Whether it counts at a distance, square metres, of its centre.
    pub fn reaches(&self, square: f32) -> bool {
        square < self.reach * self.reach
    }
}

/// Linear colours of bodies on average over the surfaces of their opaque parts.
pub(crate) fn colors_of(assets: &RenderAssets, surfaces: &[Surface]) -> Vec<Vec3A> {
    let mut sums = vec![(Vec3A::ZERO, 1e-12); assets.body_count()];
    for (part, surface) in assets.parts.iter().zip(surfaces) {
        let Some((color, area)) = part.body.and_then(|body| sums.get_mut(body)) else { continue };
        if surface.opacity >= 1.0 {
            let own = part.mesh.area();
            *color += surface.mean_color() * own;
            *area += own;
        }
    }
    sums.into_iter().map(|(color, area)| color / area).collect()
}

/// What ellipsoids let pass to points.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn hold_back(occluder: &Occluder, points: &Points, share: &mut Lane) {
    let center = occluder.center;
    for i in 0..whole_registers(points.count) {
        let toward = [center[0] - points.place[0][i], center[1] - points.place[1][i], center[2] - points.place[2][i]];
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        share[i] *= 1.0 - STRENGTH * covered(occluder, toward, normal);
    }
}

/// The share of the sky above a point, weighted with the cosine to its normal, that an ellipsoid in a direction covers:
/// exact for small and distant ones above the horizon, and nearly all of it where one touches the point from above.
#[inline(always)]
pub(crate) fn covered(occluder: &Occluder, toward: [f32; 3], normal: [f32; 3]) -> f32 {
    let square = toward[0] * toward[0] + toward[1] * toward[1] + toward[2] * toward[2] + 1e-12;
    let inverse = 1.0 / square.sqrt();
    let cosine = (normal[0] * toward[0] + normal[1] * toward[1] + normal[2] * toward[2]) * inverse;
    // Where the ellipsoid is the unit sphere.
    let mut stretched = 0.0;
    for axis in occluder.axes {
        let along = axis[0] * toward[0] + axis[1] * toward[1] + axis[2] * toward[2];
        stretched += along * along;
    }
    let away = stretched.sqrt();
    // Partly below the horizon: a smooth step between none and all of it.
    let rise = within(cosine * away * 0.5 + 0.5, 0.0, 1.0);
    let around = away + 1.0;
    let (above, edge) = (cosine * around, rise * rise);
    let facing = if above > edge { above } else { edge };
    // Area over π of its outline seen from the point, over the square distance to the unit sphere's centre.
    let per_radius = away * inverse;
    let section = occluder.volume * per_radius * per_radius * per_radius;
    let beyond = if stretched > 1.0 { stretched - 1.0 } else { 0.0 };
    let cover = facing * section / ((beyond + section) * around);
    // Boxes are fuller than ellipsoids, and hollow: inside one nothing is known.
    let outside = within(stretched * 2.0 - 1.0, 0.0, 1.0);
    within(cover * outside, 0.0, 0.95)
}

/// The share of the sky that is seen from the middle of the bottom of a round hollow, from the product of its half axes and
/// the half axis along its height.
#[inline(always)]
fn open_share(volume: f32, half: f32) -> f32 {
    let section = volume / half;
    section / (section + 4.0 * half * half)
}

/// How far inside a hollow a point is whose normal has a cosine to the direction of the hollow's middle.
#[inline(always)]
pub(crate) fn facing_middle(cosine: f32) -> f32 {
    let t = within((cosine - 0.2) * (1.0 / 0.6), 0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What a body's own walls let pass of the light of the sky to points that face its middle, as into a box that is open
/// on that side; no point of a convex body does.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn enclose(own: &Occluder, points: &Points, share: &mut Lane) {
    let (center, axes, volume) = (own.center, own.axes, own.volume);
    let end = whole_registers(points.count);
    let mut faces_middle = false;
    for i in 0..end {
        let along = |axis: usize| points.normal[axis][i] * (center[axis] - points.place[axis][i]);
        faces_middle |= along(0) + along(1) + along(2) > 0.0;
    }
    if !faces_middle {
        return;
    }
    for i in 0..end {
        let toward = [center[0] - points.place[0][i], center[1] - points.place[1][i], center[2] - points.place[2][i]];
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let square = toward[0] * toward[0] + toward[1] * toward[1] + toward[2] * toward[2] + 1e-12;
        let cosine = (normal[0] * toward[0] + normal[1] * toward[1] + normal[2] * toward[2]) / square.sqrt();
        let mut stretched = 0.0;
        for axis in axes {
            let along = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2];
            stretched += along * along;
        }
        let open = open_share(volume, 1.0 / (stretched.sqrt() + 1e-6));
        let passes = 1.0 - (1.0 - open) * facing_middle(cosine) * WALLS;
        share[i] = if share[i] < passes { share[i] } else { passes };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::CHUNK;

    fn ball(place: [f32; 3], half: [f32; 3]) -> Occluder {
        let axes = std::array::from_fn(|row| std::array::from_fn(|axis| f32::from(u8::from(row == axis)) / half[row]));
        Occluder {
            body: 0,
            color: [0.0; 3],
            middle: Vec3::ZERO,
            entering: 0.0,
            center: place,
            axes,
            volume: half.iter().product(),
            reach: f32::INFINITY,
        }
    }

    /// A point of the plane z = 0 that looks up.
    fn looking_up(place: [f32; 3]) -> Points {
        let mut points = Points::default();
        points.count = 1;
        for axis in 0..3 {
            (points.place[axis][0], points.normal[axis][0]) = (place[axis], f32::from(u8::from(axis == 2)));
        }
        points
    }

    /// What is above, beside and below a point: shares of the sky in closed form.
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
            let mut share = [1.0; CHUNK];
            hold_back(&ball(center, half), &looking_up([0.0; 3]), &mut share);
            let got = (1.0 - share[0]) / STRENGTH;
            assert!((got - expected).abs() < tolerance, "{got}, expected {expected}: {half:?} at {center:?}");
        }
    }

    /// The bottom of a mug is darker than that of a plate; the outside of either is as open as it was.
    #[test]
    fn deep_hollows_are_darker() {
        let bottom = |half: [f32; 3], turned: bool| {
            let mut points = looking_up([0.0, 0.0, 0.0]);
            if turned {
                points.normal[2][0] = -1.0;
            }
            let mut share = [1.0; CHUNK];
            enclose(&ball([0.0, 0.0, half[2]], half), &points, &mut share);
            share[0]
        };
        let (mug, plate) = ([0.04, 0.04, 0.045], [0.1, 0.1, 0.01]);
        assert!(bottom(mug, false) < 0.5, "{}", bottom(mug, false));
        assert!(bottom(plate, false) > 0.9, "{}", bottom(plate, false));
        assert_eq!(bottom(mug, true), 1.0);
    }
}
