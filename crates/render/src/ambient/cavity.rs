//! Cavity occlusion: ambient and key light on the inner walls of concave bodies.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec3, Vec3A};
use multiversion::multiversion;

use super::proxies::{Proxy, unoccluded_lamp, unoccluded_sky};
use crate::gbuffer::points::Points;
use crate::simd::{BatchColumn, dot, smooth_step, whole_registers};

/// Share of the occluded ambient light that the walls of a cavity absorb. Fitted to path-traced images.
const WALLS: f32 = 0.7;
/// Key light entering a cavity, relative to a surface that faces the light. Fitted likewise.
const CAVITY_KEY: f32 = 0.65;
/// Smallest cosine between a body's third axis and the vertical at which light enters its cavity from above. Then the
/// unoccluded shares of the sky above the opening at which no light enters and from which all of it does. Chosen by
/// hand.
const UPRIGHT: f32 = 0.5;
const COVERED: f32 = 0.5;
const HALF_OPEN: f32 = 0.75;

impl Proxy {
    /// Centre of the bounding box in the body's frame (m).
    pub fn middle(&self) -> Vec3 {
        self.shape.middle()
    }

    /// Share of the sky visible from the bottom of the body's cavity.
    pub fn cavity_opening(&self) -> f32 {
        open_share(self.volume, Vec3A::from_array(self.axes[2]).length_recip())
    }

    /// Key light entering the body's cavity, relative to a surface that faces the light.
    pub fn cavity_light(&self) -> f32 {
        self.entering * CAVITY_KEY
    }
}

/// Share of key light and sky light that enters a body from above through the positive end of its third axis, where
/// concave bodies are open, past the proxies of `others`; 0 without a cavity, or if the body does not stand upright.
pub(super) fn entering(own: &Proxy, others: &[Proxy]) -> f32 {
    let axis = Vec3A::from_array(own.axes[2]);
    let (up, half) = (axis.normalize(), axis.length_recip());
    if up.z < UPRIGHT || !own.shape.has_inside {
        return 0.0;
    }
    let place = own.center() + up * half;
    let share = unoccluded_sky(others, own.body, place.to_array(), up.to_array());
    unoccluded_lamp(others, own.body, place.to_array()) * ((share - COVERED) / (HALF_OPEN - COVERED)).clamp(0.0, 1.0)
}

/// Share of the sky visible from the bottom centre of a round cavity; `volume` is the product of its half axes (m³),
/// `half` its half axis along the height (m).
#[inline(always)]
fn open_share(volume: f32, half: f32) -> f32 {
    let section = volume / half;
    section / (section + 4.0 * half * half)
}

/// Weight of a surface point as part of a cavity's wall, from the cosine between its normal and the direction to the
/// cavity's centre.
#[inline(always)]
pub(crate) fn facing_middle(cosine: f32) -> f32 {
    smooth_step((cosine - 0.2) * (1.0 / 0.6))
}

/// Limits the ambient light at points that face the body's centre to the share that enters an open box; convex bodies
/// have no such points.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn enclose(own: &Proxy, points: &Points, share: &mut BatchColumn) {
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
        let cosine = dot(normal, toward) / (dot(toward, toward) + 1e-12).sqrt();
        let along = axes.map(|axis| dot(axis, normal));
        let open = open_share(volume, 1.0 / (dot(along, along).sqrt() + 1e-6));
        let passes = 1.0 - (1.0 - open) * facing_middle(cosine) * WALLS;
        share[i] = if share[i] < passes { share[i] } else { passes };
    }
}

#[cfg(test)]
mod tests {
    use super::super::proxies::tests::{ball, looking_up};
    use super::*;

    /// The bottom of a mug is darker than that of a plate; outer walls are unaffected.
    #[test]
    fn deep_hollows_are_darker() {
        let bottom = |half: [f32; 3], turned: bool| {
            let mut points = looking_up([0.0, 0.0, 0.0]);
            if turned {
                points.normal[2][0] = -1.0;
            }
            let mut share = BatchColumn::of(1.0);
            enclose(&ball([0.0, 0.0, half[2]], half), &points, &mut share);
            share[0]
        };
        let (mug, plate) = ([0.04, 0.04, 0.045], [0.1, 0.1, 0.01]);
        assert!(bottom(mug, false) < 0.55, "{}", bottom(mug, false));
        assert!(bottom(plate, false) > 0.9, "{}", bottom(plate, false));
        assert_eq!(bottom(mug, true), 1.0);
    }
}
