//! How two objects stand to each other.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::contact::Contact;
use super::extent::{Extent, Extents};
use super::{PosedScene, RelationSettings};

/// How one object stands to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Label {
    /// Most of its surface is in the other's cavity.
    In,
    /// The other is in it.
    OutOf,
    /// It rests on the other.
    On,
    /// The other rests on it.
    Beneath,
    /// To the robot's left of it (+y).
    Left,
    /// To the robot's right of it (-y).
    Right,
    /// On the far side of it (+x).
    Front,
    /// On the robot's side of it (-x).
    Back,
    /// Close in the plane, none of the above.
    Near,
}

impl Label {
    /// The label seen from the other object.
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
    /// How A stands to B; `None` when they are not close in the plane.
    pub a_to_b: Option<Label>,
    /// How B stands to A.
    pub b_to_a: Option<Label>,
    /// Whether the one on top is also *supported by* the lower one: most of its footprint is over the other's, and it
    /// is not much larger.
    pub supporting: bool,
    /// What was measured.
    pub geometry: PairGeometry,
}

/// Measured quantities of a pair, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairGeometry {
    /// Shortest distance between the projections onto the table.
    pub gap_m: f64,
    /// Length along x that the two have in common; negative: how far apart they are.
    pub overlap_x_m: f64,
    /// Length along y that the two have in common; negative: how far apart they are.
    pub overlap_y_m: f64,
    /// Share of A's surface points in B.
    pub a_in_b: f64,
    /// Share of B's surface points in A.
    pub b_in_a: f64,
    /// A's pieces above B's, where their projections overlap.
    pub a_over_b: Option<Contact>,
    /// B's pieces above A's, where their projections overlap.
    pub b_over_a: Option<Contact>,
    /// Middle of A minus middle of B, the middle being the mean of the surface.
    #[schemars(with = "[f64; 3]")]
    pub offset: DVec3,
}

/// Measures and labels two objects of a scene; `None` for an index out of range.
pub fn label_pair(scene: &PosedScene, a: usize, b: usize, settings: &RelationSettings) -> Option<PairVerdict> {
    label_extents(scene, a, b, settings)
}

/// Measures two objects of a scene; `None` for an index out of range.
pub fn measure_pair(scene: &PosedScene, a: usize, b: usize, settings: &RelationSettings) -> Option<PairGeometry> {
    Some(measure(scene.extent(a)?, scene.extent(b)?, settings))
}

/// Measures and labels two objects, whatever their extents are known from.
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

/// Whether the convex outlines of two objects on the table are certainly at least a distance apart; false for an index
/// out of range. Much cheaper than measuring the pair, and now and then too careful by a little.
pub fn outlines_apart(scene: &PosedScene, a: usize, b: usize, distance_m: f64) -> bool {
    let pair = scene.bodies.get(a).zip(scene.bodies.get(b));
    pair.is_some_and(|(one, other)| one.footprint().hull.is_apart(&other.footprint().hull, distance_m))
}

/// Shortest distance of the projections of two objects onto the table, metres; `None` for an index out of range.
///
/// One of the quantities of [`measure_pair`], at a fraction of its cost.
pub fn planar_gap(scene: &PosedScene, a: usize, b: usize) -> Option<f64> {
    Some(scene.bodies.get(a)?.planar_gap(scene.bodies.get(b)?))
}

/// Where an object that comes straight down first touches another; `None` when it is not above it, or for an index out
/// of range.
///
/// One of the quantities of [`measure_pair`], at a fraction of its cost.
pub fn contact_below(scene: &PosedScene, upper: usize, lower: usize, settings: &RelationSettings) -> Option<Contact> {
    let (upper, lower) = (scene.bodies.get(upper)?, scene.bodies.get(lower)?);
    overlap(upper, lower).truncate().cmpgt(DVec2::ZERO).all().then(|| upper.contact_above(lower, settings))?
}

/// Extent that the bounds of two share along each axis, metres; negative where they are apart.
fn overlap<E: Extent>(a: &E, b: &E) -> DVec3 {
    let (a, b) = (a.bounds(), b.bounds());
    a.max.min(b.max) - a.min.max(b.min)
}

/// How A stands to B, in the order of the decision.
fn label(pair: &PairGeometry, settings: &RelationSettings) -> Option<Label> {
    if pair.gap_m > settings.close_m {
        return None;
    }
    // Flat things can share a bound; without an offset neither is on either side.
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
    /// Whether A rests on B; of two that are hooked into each other, the one with the closer contact is the upper one.
    pub fn a_rests_on_b(&self, settings: &RelationSettings) -> bool {
        let rests = |contact: Option<Contact>| contact.filter(|contact| contact.rests(settings));
        match (rests(self.a_over_b), rests(self.b_over_a)) {
            (Some(a), Some(b)) => a.gap_m < b.gap_m,
            (a, _) => a.is_some(),
        }
    }

    /// The same pair with the roles exchanged.
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

/// Every quantity of a pair.
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
