//! Areas in which an object meets a relation: proposals for the layout and the expert, to be verified afterwards.

use genmanip_core::{Aabb, HorizontalAxis, Relation, RelationKind};
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::RelationSettings;

/// A rectangle on the table, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Window {
    /// Smallest and largest x, metres.
    pub x: [f64; 2],
    /// Smallest and largest y, metres.
    pub y: [f64; 2],
}

impl Window {
    /// Common part of two windows; `None` if they do not overlap.
    pub fn intersection(&self, other: &Self) -> Option<Self> {
        let clip = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        let window = Self { x: clip(self.x, other.x), y: clip(self.y, other.y) };
        window.is_real().then_some(window)
    }

    /// True if the point is in the window.
    pub fn contains(&self, point: DVec2) -> bool {
        (self.x[0]..=self.x[1]).contains(&point.x) && (self.y[0]..=self.y[1]).contains(&point.y)
    }

    /// Point at a share of each side (`u` along x, `v` along y, 0 to 1), for sampling.
    pub fn at(&self, u: f64, v: f64) -> DVec2 {
        DVec2::new(self.x[0] + (self.x[1] - self.x[0]) * u, self.y[0] + (self.y[1] - self.y[0]) * v)
    }

    fn is_real(&self) -> bool {
        self.x[0] <= self.x[1] && self.y[0] <= self.y[1]
    }
}

/// Positions for the centre of the subject's bounds at which a relation to an anchor holds, with the margin of the
/// settings; `None` if there are none or the relation has no single anchor.
///
/// `subject_size` is the size of the subject's bounds in the world. The window is exact for boxes. Round objects can be
/// slightly farther apart than their bounds, and `near` includes the anchor itself, so every proposal has to be
/// verified.
pub fn placement_window(
    relation: Relation,
    anchor_bounds: &Aabb,
    subject_size: DVec3,
    settings: &RelationSettings,
) -> Option<Window> {
    let margin = settings.window_margin_m;
    let half = subject_size * 0.5;
    let (low, high) = (anchor_bounds.min, anchor_bounds.max);
    let beyond = |is_positive: bool, low: f64, high: f64, half: f64| match is_positive {
        true => [high + half + margin, high + half + settings.close_m - margin],
        false => [low - half - settings.close_m + margin, low - half - margin],
    };
    // At least a third of the narrower object must overlap the other one sideways, so that the relation is obvious.
    let beside = |low: f64, high: f64, half: f64| {
        let common = ((high - low).min(2.0 * half) / 3.0).max(margin);
        [low - half + common, high + half - common]
    };
    let within = |low: f64, high: f64| [low, high];
    let around = |low: f64, high: f64, half: f64| {
        let reach = half + settings.close_m - margin;
        [low - reach, high + reach]
    };
    let (x, y) = match relation.kind() {
        RelationKind::Side(side) => match side.axis {
            HorizontalAxis::Depth => (beyond(side.is_positive, low.x, high.x, half.x), beside(low.y, high.y, half.y)),
            HorizontalAxis::Width => (beside(low.x, high.x, half.x), beyond(side.is_positive, low.y, high.y, half.y)),
        },
        RelationKind::Around => (around(low.x, high.x, half.x), around(low.y, high.y, half.y)),
        RelationKind::Support(_) => (within(low.x, high.x), within(low.y, high.y)),
        RelationKind::Between => return None,
    };
    let window = Window { x, y };
    window.is_real().then_some(window)
}
