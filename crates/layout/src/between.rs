//! Free space for an object between two others.

use genmanip_core::Aabb;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_relations::{PosedScene, between_bend_rad};

use crate::context::Context;
use crate::sampled_layout::OrientedObject;

/// Maximum distance of an object from the midpoint of its two references, as a share of their distance. Chosen: 0.5
/// would be at the references themselves.
const MIDPOINT_SHARE: f64 = 0.3;

/// Distance of a reference beyond the object between, as seen from the other reference, and the tolerance of that
/// distance (m). Chosen: about twice the usual distance between neighbours.
const BEHIND_M: [f64; 2] = [0.22, 0.2];

/// Minimum half-width of a window's free strip (m). Chosen so that rounding never empties it.
const MIN_HALF_WIDTH_M: f64 = 0.005;

/// Margin to the maximum angle of `between` (rad). Chosen: the object is rarely placed exactly at the midpoint.
const ANGLE_MARGIN_RAD: f64 = 0.15;

/// Window for the centre of `object` (the subject or a reference of a `between` relation) in which the subject can
/// stand between the references, as opposite corners; `None` while too few of the other centres are known. Proposals
/// only, to be judged.
pub(crate) fn window(
    object: usize,
    [subject, one, other]: [usize; 3],
    center: impl Fn(usize) -> Option<DVec2>,
) -> Option<[DVec2; 2]> {
    let around = |middle: DVec2, half: f64| [middle - DVec2::splat(half), middle + DVec2::splat(half)];
    if object == subject {
        let (from, to) = (center(one)?, center(other)?);
        return Some(around((from + to) * 0.5, MIDPOINT_SHARE * from.distance(to)));
    }
    let far = if object == one { other } else { one };
    let (from, through) = (center(far)?, center(subject)?);
    let onward = (through - from).normalize_or_zero();
    (object == one || object == other).then(|| around(through + onward * BEHIND_M[0], BEHIND_M[1]))
}

/// Region of the centre of an object of this size with free space between two bounds, as opposite corners; if there is
/// no free space, the region closest to it.
pub(crate) fn free_window(one: &Aabb, other: &Aabb, size: DVec3) -> [DVec2; 2] {
    let apart = (one.min - other.max).max(other.min - one.max).truncate();
    // Centre of the free strip along an axis on which the bounds are apart; otherwise the centre of both bounds is
    // used.
    let strip = (one.max.min(other.max) + one.min.max(other.min)).truncate() * 0.5;
    let middle = (one.center() + other.center()).truncate() * 0.5;
    let spread = MIDPOINT_SHARE * one.center().truncate().distance(other.center().truncate());
    let axis = |apart: f64, size: f64, strip: f64, middle: f64| {
        if apart > 0.0 {
            (strip, ((apart - size) * 0.5).max(MIN_HALF_WIDTH_M).min(spread.max(MIN_HALF_WIDTH_M)))
        } else {
            (middle, spread)
        }
    };
    let (x, half_x) = axis(apart.x, size.x, strip.x, middle.x);
    let (y, half_y) = axis(apart.y, size.y, strip.y, middle.y);
    let (center, half) = (DVec2::new(x, y), DVec2::new(half_x, half_y));
    [center - half, center + half]
}

/// True if the subject fits at the midpoint of the references with a gap on both sides.
pub(crate) fn leaves_space(
    scene: &PosedScene,
    [one, other]: [usize; 2],
    subject: &OrientedObject,
    gap: f64,
    context: &Context,
) -> bool {
    let (Some(a), Some(b)) = (scene.bounds(one), scene.bounds(other)) else { return true };
    let (Some(from), Some(to)) = (scene.center(one), scene.center(other)) else { return true };
    let size = subject.bounds.size();
    let apart = (a.min - b.max).max(b.min - a.max).truncate();
    let has_gap = (apart.x >= size.x + 2.0 * gap) || (apart.y >= size.y + 2.0 * gap);
    let middle = ((from + to) * 0.5).truncate().extend(subject.bounds.center().z - subject.bounds.min.z);
    let bend_rad = between_bend_rad([from, middle, to], context.relations.between).unwrap_or(f64::INFINITY);
    has_gap && bend_rad < context.relations.between_angle_rad - ANGLE_MARGIN_RAD
}
