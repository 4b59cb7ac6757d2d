//! Room for an object between two others.

use genmanip_core::glam::DVec2;
use genmanip_scene::relations::PosedScene;

use crate::draft::Stance;
use crate::placement::Context;

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
        return Some(around((from + to) * 0.5, 0.3 * from.distance(to)));
    }
    let far = if object == one { other } else { one };
    let (from, through) = (center(far)?, center(subject)?);
    let onward = (through - from).normalize_or_zero();
    (object == one || object == other).then(|| around(through + onward * 0.22, 0.2))
}

/// Whether the subject would stand between the two if it were put halfway, with room on both sides.
pub(crate) fn leaves_room(scene: &PosedScene, [one, other]: [usize; 2], subject: &Stance, context: &Context) -> bool {
    let (Some(a), Some(b)) = (scene.bounds(one), scene.bounds(other)) else { return true };
    let (Some(from), Some(to)) = (scene.center(one), scene.center(other)) else { return true };
    let size = subject.bounds.size();
    let gap = context.settings.min_gap_m + 0.005;
    let apart = (a.min - b.max).max(b.min - a.max).truncate();
    let room = (apart.x >= size.x + 2.0 * gap) || (apart.y >= size.y + 2.0 * gap);
    let middle = ((from + to) * 0.5).truncate().extend(subject.bounds.center().z - subject.bounds.min.z);
    let bend = (middle - from).angle_between(to - middle);
    room && bend < context.relations.between_angle_rad - 0.15
}
