//! Spatial labels of a pair of objects.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::contact::Contact;
use super::extent::{Extent, Extents};
use super::{PosedScene, RelationSettings};

/// Position of object A relative to object B.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Label {
    /// Most of A's surface is in B's cavity.
    In,
    /// B is in A.
    OutOf,
    /// A rests on B.
    On,
    /// B rests on A.
    Beneath,
    /// A is to the robot's left of B (+y).
    Left,
    /// A is to the robot's right of B (-y).
    Right,
    /// A is farther from the robot than B (+x).
    Front,
    /// A is nearer to the robot than B (-x).
    Back,
    /// A is close to B in the plane, and none of the above.
    Near,
}

impl Label {
    /// Label of B relative to A.
    #[must_use]
    pub fn inverse(self) -> Self {
        match self {
            Self::In => Self::OutOf,
            Self::OutOf => Self::In,
            Self::On => Self::Beneath,
            Self::Beneath => Self::On,
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Front => Self::Back,
            Self::Back => Self::Front,
            Self::Near => Self::Near,
        }
    }
}

/// The labels of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairVerdict {
    /// Label of A relative to B; `None` if they are not close in the plane.
    pub a_to_b: Option<Label>,
    /// Label of B relative to A; `None` if they are not close in the plane.
    pub b_to_a: Option<Label>,
    /// True if the upper object is also *supported by* the lower one: most of its footprint is over the other's, and it
    /// is not much larger.
    pub supporting: bool,
    /// Measured quantities on which the labels are based.
    pub geometry: PairGeometry,
}

/// Measured quantities of a pair, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairGeometry {
    /// Shortest distance between the projections onto the table.
    pub gap_m: f64,
    /// Overlap of the bounds along x; if negative, their distance.
    pub overlap_x_m: f64,
    /// Overlap of the bounds along y; if negative, their distance.
    pub overlap_y_m: f64,
    /// Share of A's surface points that are in B, 0-1.
    pub a_in_b: f64,
    /// Share of B's surface points that are in A, 0-1.
    pub b_in_a: f64,
    /// Contact of A falling onto B; `None` if their projections do not overlap.
    pub a_over_b: Option<Contact>,
    /// Contact of B falling onto A; `None` if their projections do not overlap.
    pub b_over_a: Option<Contact>,
    /// Centre of A minus centre of B, where the centre is the centroid of the surface.
    #[schemars(with = "[f64; 3]")]
    pub offset: DVec3,
}

/// Measures and labels two objects of a scene; `None` if an index is out of range.
pub fn label_pair(scene: &PosedScene, a: usize, b: usize, settings: &RelationSettings) -> Option<PairVerdict> {
    label_extents(scene, a, b, settings)
}

/// Measures two objects of a scene; `None` if an index is out of range.
pub fn measure_pair(scene: &PosedScene, a: usize, b: usize, settings: &RelationSettings) -> Option<PairGeometry> {
    Some(measure(scene.extent(a)?, scene.extent(b)?, settings))
}

/// Measures and labels two objects, for any representation; `None` if an index is out of range.
pub(super) fn label_extents(
    scene: &impl Extents,
    a: usize,
    b: usize,
    settings: &RelationSettings,
) -> Option<PairVerdict> {
    let (one, other) = (scene.extent(a)?, scene.extent(b)?);
    let geometry = measure(one, other, settings);
    let label = label(&geometry, settings);
    let supporting = match label {
        Some(Label::On) => other.supports(one, settings),
        Some(Label::Beneath) => one.supports(other, settings),
        _ => false,
    };
    Some(PairVerdict { a_to_b: label, b_to_a: label.map(Label::inverse), supporting, geometry })
}

/// True if the convex outlines of two objects on the table are certainly at least a distance apart; false if an index
/// is out of range. Much cheaper than measuring the pair, but sometimes slightly conservative.
pub fn outlines_apart(scene: &PosedScene, a: usize, b: usize, distance_m: f64) -> bool {
    let pair = scene.bodies.get(a).zip(scene.bodies.get(b));
    pair.is_some_and(|(one, other)| one.footprint().hull.is_apart(&other.footprint().hull, distance_m))
}

/// Shortest distance between the projections of two objects onto the table, metres; `None` if an index is out of range.
///
/// One of the quantities of [`measure_pair`], at a fraction of the cost.
pub fn planar_gap(scene: &PosedScene, a: usize, b: usize) -> Option<f64> {
    Some(scene.bodies.get(a)?.planar_gap(scene.bodies.get(b)?))
}

/// The contact of an object that falls straight down onto another; `None` if it is not above it or an index is out of
/// range.
///
/// One of the quantities of [`measure_pair`], at a fraction of the cost.
pub fn contact_below(scene: &PosedScene, upper: usize, lower: usize, settings: &RelationSettings) -> Option<Contact> {
    let (upper, lower) = (scene.bodies.get(upper)?, scene.bodies.get(lower)?);
    overlap(upper, lower).truncate().cmpgt(DVec2::ZERO).all().then(|| upper.contact_above(lower, settings))?
}

/// Overlap of the bounds along each axis, metres; negative where they are apart.
fn overlap<E: Extent>(a: &E, b: &E) -> DVec3 {
    let (a, b) = (a.bounds(), b.bounds());
    a.max.min(b.max) - a.min.max(b.min)
}

/// The first label that applies to A relative to B, in the order of precedence; `None` if none applies.
fn label(pair: &PairGeometry, settings: &RelationSettings) -> Option<Label> {
    if pair.gap_m > settings.close_m {
        return None;
    }
    // The bounds of flat objects can coincide; without an offset, neither is on a side of the other.
    let over_x_only = pair.overlap_x_m > 0.0 && pair.overlap_y_m <= 0.0 && pair.offset.y != 0.0;
    let over_y_only = pair.overlap_y_m > 0.0 && pair.overlap_x_m <= 0.0 && pair.offset.x != 0.0;
    let one_of = |condition: bool, yes: Label, no: Label| Some(if condition { yes } else { no });
    if pair.a_in_b > settings.inside_share || pair.b_in_a > settings.inside_share {
        one_of(pair.a_in_b >= pair.b_in_a, Label::In, Label::OutOf)
    } else if pair.a_rests_on_b(settings) {
        Some(Label::On)
    } else if pair.swapped().a_rests_on_b(settings) {
        Some(Label::Beneath)
    } else if over_x_only {
        one_of(pair.offset.y > 0.0, Label::Left, Label::Right)
    } else if over_y_only {
        one_of(pair.offset.x > 0.0, Label::Front, Label::Back)
    } else {
        Some(Label::Near)
    }
}

impl PairGeometry {
    /// True if A rests on B. If two objects interlock, the one with the smaller gap is the upper one.
    pub fn a_rests_on_b(&self, settings: &RelationSettings) -> bool {
        let rests = |contact: Option<Contact>| contact.filter(|contact| contact.rests(settings));
        match (rests(self.a_over_b), rests(self.b_over_a)) {
            (Some(a), Some(b)) => a.gap_m < b.gap_m,
            (a, _) => a.is_some(),
        }
    }

    /// The same pair with A and B exchanged.
    #[must_use]
    pub fn swapped(&self) -> Self {
        Self {
            a_in_b: self.b_in_a,
            b_in_a: self.a_in_b,
            a_over_b: self.b_over_a,
            b_over_a: self.a_over_b,
            offset: -self.offset,
            ..*self
        }
    }
}

/// All quantities of a pair.
pub(super) fn measure<E: Extent>(a: &E, b: &E, settings: &RelationSettings) -> PairGeometry {
    let overlap = overlap(a, b);
    let (a_in_b, b_in_a) =
        if overlap.min_element() > 0.0 { (a.share_inside(b), b.share_inside(a)) } else { (0.0, 0.0) };
    let (a_over_b, b_over_a) = if overlap.x > 0.0 && overlap.y > 0.0 {
        (a.contact_above(b, settings), b.contact_above(a, settings))
    } else {
        (None, None)
    };
    PairGeometry {
        gap_m: a.planar_gap(b),
        overlap_x_m: overlap.x,
        overlap_y_m: overlap.y,
        a_in_b,
        b_in_a,
        a_over_b,
        b_over_a,
        offset: a.center() - b.center(),
    }
}
