//! Labels and verdicts of the released evaluators.

use std::collections::BTreeMap;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::tree::Tree;
use super::{Cloud, CloudLabel, Profile};

/// Largest distance in the plane of close objects (m), including the originals' tolerance of 1 %.
const CLOSE_M: f64 = 0.15 * 1.01;
/// Largest distance and height gap of touching objects (m), including the same tolerance.
const TOUCHING_M: f64 = 0.1 * 1.01;
/// Distance by which the target's outline is widened before the anchor is cropped to it (m).
const CROP_M: f64 = 0.05;
/// Largest angle at the middle object for `between`, degrees.
const BETWEEN_DEG: f64 = 45.0;

/// A goal of the released evaluators: a disjunction of conjunctions.
pub type CloudGoal = Vec<Vec<Subgoal>>;

/// One relation of a goal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Subgoal {
    /// Uid of the target.
    pub obj1_uid: String,
    /// Uid of the anchor.
    pub obj2_uid: String,
    /// Relation word, e.g. `on`, `top`, `out of`.
    pub position: String,
    /// Uid of the second anchor of `between`; `None` for all other relations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub another_obj2_uid: Option<String>,
}

impl Profile {
    /// Lower limit of the share of the target's bounds that is over the anchor's.
    fn supported_ratio(self) -> f64 {
        match self {
            Self::GenManip09 => 0.7,
            Self::Suite023 => 0.4,
        }
    }

    /// Upper limit of the area of the target's bounds relative to the anchor's.
    fn area_ratio(self) -> f64 {
        match self {
            Self::GenManip09 => 1.5,
            Self::Suite023 => 1.8,
        }
    }

    /// Number of points that must be in the hull for `in`.
    fn needed(self, points: usize) -> usize {
        match self {
            Self::GenManip09 => points / 2 + 1,
            Self::Suite023 => points.div_ceil(2),
        }
    }
}

/// Labels of a target and an anchor. With a second anchor, only `between` is tested.
pub fn labels(profile: Profile, target: &Cloud, anchor: &Cloud, second_anchor: Option<&Cloud>) -> Vec<CloudLabel> {
    if let Some(second) = second_anchor {
        return if between(profile, target, anchor, second) { vec![CloudLabel::Between] } else { Vec::new() };
    }
    let mut found = Vec::new();
    if !close(target, anchor) {
        return found;
    }
    if touching(target, anchor) {
        if contains(profile, anchor, target) {
            found.push(CloudLabel::In);
        } else if contains(profile, target, anchor) {
            found.push(CloudLabel::OutOf);
        }
        if profile == Profile::GenManip09 || found.is_empty() {
            found.push(if supported(profile, target, anchor) {
                CloudLabel::On
            } else if supported(profile, anchor, target) {
                CloudLabel::Below
            } else {
                CloudLabel::Near
            });
        }
    }
    if let Some(label) = direction(target, anchor)
        && !found.contains(&label)
    {
        found.push(label);
    }
    found
}

/// True if the relation that a word names holds.
pub fn subgoal(
    profile: Profile,
    position: &str,
    target: &Cloud,
    anchor: &Cloud,
    second_anchor: Option<&Cloud>,
) -> bool {
    let found = || labels(profile, target, anchor, second_anchor);
    if matches!(position, "top" | "on") {
        let found = found();
        return found.contains(&CloudLabel::On)
            || found.contains(&CloudLabel::In)
            || on_cropped(profile, target, anchor);
    }
    found().iter().any(|label| label.name() == position)
}

/// Fraction of true relations in the best conjunction. A relation with a uid that has no cloud is false.
pub fn goal_score(profile: Profile, goal: &CloudGoal, clouds: &BTreeMap<String, Cloud>) -> f64 {
    let holds = |part: &Subgoal| {
        let (Some(target), Some(anchor)) = (clouds.get(&part.obj1_uid), clouds.get(&part.obj2_uid)) else {
            return false;
        };
        match &part.another_obj2_uid {
            Some(uid) => {
                clouds.get(uid).is_some_and(|second| subgoal(profile, &part.position, target, anchor, Some(second)))
            }
            None => subgoal(profile, &part.position, target, anchor, None),
        }
    };
    goal.iter()
        .map(|conjunction| {
            // Summed in the same order as the originals, for identical rounding.
            let part = 1.0 / conjunction.len() as f64;
            conjunction.iter().filter(|part| holds(part)).fold(0.0, |sum, _| sum + part)
        })
        .fold(0.0, f64::max)
}

/// True if the joint positions (one list per instance) lie in the closed intervals of a status.
pub fn articulation(positions: &[Vec<f64>], status: &[Vec<[f64; 2]>]) -> bool {
    positions.len() == status.len()
        && positions.iter().zip(status).all(|(positions, intervals)| {
            positions.len() == intervals.len()
                && positions.iter().zip(intervals).all(|(position, [low, high])| (*low..=*high).contains(position))
        })
}

impl CloudLabel {
    /// Name of the label in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::In => "in",
            Self::OutOf => "out of",
            Self::On => "on",
            Self::Below => "below",
            Self::Near => "near",
            Self::Left => "left",
            Self::Right => "right",
            Self::Front => "front",
            Self::Back => "back",
            Self::Between => "between",
        }
    }
}

fn close(target: &Cloud, anchor: &Cloud) -> bool {
    let apart = (target.min - anchor.max).max(anchor.min - target.max).max(DVec3::ZERO).truncate();
    apart.length() <= CLOSE_M && target.tree().has_pair_within(anchor.tree(), CLOSE_M, false)
}

fn touching(target: &Cloud, anchor: &Cloud) -> bool {
    target.tree().has_pair_within(anchor.tree(), TOUCHING_M, true)
}

fn contains(profile: Profile, outer: &Cloud, inner: &Cloud) -> bool {
    outer.enclosure().holds(inner.tree(), &outer.points, profile.needed(inner.points.len()))
}

/// True if the bounds overlap enough and the heights match for the upper cloud to be on the lower one.
fn supported(profile: Profile, upper: &Cloud, lower: &Cloud) -> bool {
    let area = |cloud: &Cloud| (cloud.max.x - cloud.min.x) * (cloud.max.y - cloud.min.y);
    let common = (upper.max.min(lower.max) - upper.min.max(lower.min)).max(DVec3::ZERO);
    let (upper_area, lower_area) = (area(upper), area(lower));
    if upper_area == 0.0 || lower_area == 0.0 {
        return false;
    }
    common.x * common.y / upper_area > profile.supported_ratio()
        && (upper.min.z - lower.max.z).abs() <= TOUCHING_M
        && upper_area / lower_area < profile.area_ratio()
}

fn direction(target: &Cloud, anchor: &Cloud) -> Option<CloudLabel> {
    let overlaps = |axis: usize| target.min[axis] <= anchor.max[axis] && anchor.min[axis] <= target.max[axis];
    match (overlaps(0), overlaps(1)) {
        (true, true) => Some(CloudLabel::Near),
        (true, false) => Some(if target.max.y < anchor.min.y { CloudLabel::Left } else { CloudLabel::Right }),
        (false, true) => Some(if target.max.x < anchor.min.x { CloudLabel::Front } else { CloudLabel::Back }),
        (false, false) => None,
    }
}

fn between(profile: Profile, target: &Cloud, anchor: &Cloud, second: &Cloud) -> bool {
    let (there, onward) = (target.mean - anchor.mean, second.mean - target.mean);
    let mut cosine = (there / there.length()).dot(onward / onward.length());
    if profile == Profile::Suite023 {
        cosine = cosine.clamp(-1.0, 1.0);
    }
    // For coincident positions, and in V0.9 for a cosine rounded above 1, the angle is NaN and there is no label.
    cosine.acos().to_degrees() < BETWEEN_DEG
}

/// Fallback of the originals for `on`: tests the part of the anchor under the target's widened outline.
fn on_cropped(profile: Profile, target: &Cloud, anchor: &Cloud) -> bool {
    // The cropped part has smaller bounds than the whole anchor, so it cannot support the target if the anchor cannot.
    let area = |size: DVec3| size.x.max(0.0) * size.y.max(0.0);
    let common = |reach: f64| (target.max + reach).min(anchor.max) - (target.min - reach).max(anchor.min);
    let target_area = area(target.max - target.min);
    if target_area == 0.0
        || area(common(0.0)) / target_area <= profile.supported_ratio()
        || target_area / area(common(CROP_M)) >= profile.area_ratio()
        || target.min.z - anchor.max.z > TOUCHING_M
        || rises_too_high(target, anchor)
    {
        return false;
    }
    let Some(part) = crop(target, anchor) else { return false };
    close(target, &part)
        && touching(target, &part)
        && supported(profile, target, &part)
        && (profile == Profile::GenManip09 || !(contains(profile, &part, target) || contains(profile, target, &part)))
}

/// True if a point of the anchor that is too high for the target to rest on it is certainly under the widened outline.
fn rises_too_high(target: &Cloud, anchor: &Cloud) -> bool {
    let high: Vec<DVec3> =
        anchor.points.iter().copied().filter(|point| point.z > target.min.z + TOUCHING_M + 1e-9).collect();
    !high.is_empty() && target.tree().has_pair_within(&Tree::new(&high), CROP_M * 0.99, false)
}

/// The points of the anchor under the target's outline widened by 5 cm; `None` if there are none.
///
/// The originals approximate the widened corners by polygons of 64 sides; here they are round (0.06 mm larger), and
/// points equally far from an edge may be processed in another order. 9 of 10 crops of the recorded cases have the same
/// size, and all lead to the same verdict.
fn crop(target: &Cloud, anchor: &Cloud) -> Option<Cloud> {
    let kept = target.contour()?.crop(anchor.tree(), CROP_M);
    (!kept.is_empty()).then(|| Cloud::from_finite(kept))
}
