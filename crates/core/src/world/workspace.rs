//! Usable part of the table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Usable part of the table; the table top is at z = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Nearest and farthest x, metres.
    pub x: [f64; 2],
    /// Rightmost and leftmost y, metres.
    pub y: [f64; 2],
}

impl Workspace {
    /// Intersection with another area; `self` if they do not overlap.
    #[must_use]
    pub fn within(&self, x: [f64; 2], y: [f64; 2]) -> Self {
        let common = |[low, high]: [f64; 2], [least, most]: [f64; 2]| [low.max(least), high.min(most)];
        let both = Self { x: common(self.x, x), y: common(self.y, y) };
        if both.x[0] < both.x[1] && both.y[0] < both.y[1] { both } else { *self }
    }
}
