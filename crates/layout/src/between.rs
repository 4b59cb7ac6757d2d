//! Room for an object between two others.

use genmanip_core::Aabb;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_relations::PosedScene;

use crate::context::Context;
use crate::draft::Stance;

/// Of the distance between two objects, how far from halfway something between them may stand; chosen: half would be at
/// the objects themselves.
const OFF_HALFWAY: f64 = 0.3;

/// How far behind what is to stand between them the farther of two objects stands, and by how much that may differ,
/// metres; chosen, about two usual distances between neighbours.
const BEHIND_M: [f64; 2] = [0.22, 0.2];

/// Least freedom along an axis of something between two others, metres; chosen, so that rounding never empties it.
const LEAST_M: f64 = 0.005;

/// How far inside the largest bend something halfway between two others must be, radians; chosen: it is hardly ever put
/// exactly halfway.
const BEND_SPARE_RAD: f64 = 0.15;

/// Opposite corners of where the middle of `object` may be so that the subject can stand between the two;
/// `None` when nothing is known yet. Proposals only, to be judged.
pub(crate) fn window(
    object: usize,
    [subject, one, other]: [usize; 3],
    center: impl Fn(usize) -> Option<DVec2>,
) -> Option<[DVec2; 2]> {
    let around = |middle: DVec2, half: f64| [middle - DVec2::splat(half), middle + DVec2::splat(half)];
    if object == subject {
        let (from, to) = (center(one)?, center(other)?);
        return Some(around((from + to) * 0.5, OFF_HALFWAY * from.distance(to)));
    }
    let far = if object == one { other } else { one };
    let (from, through) = (center(far)?, center(subject)?);
    let onward = (through - from).normalize_or_zero();
    (object == one || object == other).then(|| around(through + onward * BEHIND_M[0], BEHIND_M[1]))
}

/// Opposite corners of where the middle of something of this size has a free place between two bounds;
/// where there is none, of where it is nearest to having one.
pub(crate) fn free_window(one: &Aabb, other: &Aabb, size: DVec3) -> [DVec2; 2] {
    let apart = (one.min - other.max).max(other.min - one.max).truncate();
    // The middle of the free strip along each axis on which they are apart, else of both.
    let strip = (one.max.min(other.max) + one.min.max(other.min)).truncate() * 0.5;
    let middle = (one.center() + other.center()).truncate() * 0.5;
    let spread = OFF_HALFWAY * one.center().truncate().distance(other.center().truncate());
    let axis = |apart: f64, size: f64, strip: f64, middle: f64| {
        if apart > 0.0 {
            (strip, ((apart - size) * 0.5).max(LEAST_M).min(spread.max(LEAST_M)))
        } else {
            (middle, spread)
        }
    };
    let (x, half_x) = axis(apart.x, size.x, strip.x, middle.x);
    let (y, half_y) = axis(apart.y, size.y, strip.y, middle.y);
    let (center, half) = (DVec2::new(x, y), DVec2::new(half_x, half_y));
    [center - half, center + half]
}

/// Whether the subject would stand between the two if it were put halfway, with a gap on both sides.
pub(crate) fn leaves_room(
    scene: &PosedScene,
    [one, other]: [usize; 2],
    subject: &Stance,
    gap: f64,
    context: &Context,
) -> bool {
    let (Some(a), Some(b)) = (scene.bounds(one), scene.bounds(other)) else { return true };
    let (Some(from), Some(to)) = (scene.center(one), scene.center(other)) else { return true };
    let size = subject.bounds.size();
    let apart = (a.min - b.max).max(b.min - a.max).truncate();
    let room = (apart.x >= size.x + 2.0 * gap) || (apart.y >= size.y + 2.0 * gap);
    let middle = ((from + to) * 0.5).truncate().extend(subject.bounds.center().z - subject.bounds.min.z);
    let bend = (middle - from).angle_between(to - middle);
    room && bend < context.relations.between_angle_rad - BEND_SPARE_RAD
}
