//! The vertical gap between two convex bodies: how far one can fall until it touches the other.
//!
//! The gap is found where a vertical line enters the Minkowski difference A − B. The entry point is computed by portal
//! refinement (Snethen, "XenoCollide", Game Programming Gems 7): a triangle of support points around the line is moved
//! outwards until the body does not extend beyond it.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::RelationSettings;

/// First contact of an object that falls straight down onto another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contact {
    /// Vertical gap at the contact, metres; negative if the upper object is below the surface there.
    pub gap_m: f64,
    /// Height of the upper object's centre above the centre of the link that it would touch, metres.
    pub rise_m: f64,
}

impl Contact {
    /// True if the upper object rests on the lower one.
    pub fn rests(&self, settings: &RelationSettings) -> bool {
        (-settings.sinking_m..=settings.touching_gap_m).contains(&self.gap_m) && self.rise_m > 0.0
    }
}

/// Accuracy of the gap, metres.
const ACCURACY: f64 = 1e-6;

/// Offset of the line from the origin, so that no corner of a symmetric body lies exactly on it.
const OFFSET: DVec2 = DVec2::new(1.3e-7, 0.7e-7);

/// Maximum number of steps of each of the two searches, which normally end after about ten.
const MAX_STEPS: usize = 64;

/// Vertical gap at which A would first touch B; negative if A has to rise to clear B; `None` if the projections do not
/// overlap.
///
/// `support(direction)` returns the farthest point of A − B. Results below `give_up_below` are only upper bounds.
pub(super) fn vertical_gap(support: impl Fn(DVec3) -> DVec3, give_up_below: f64) -> Option<f64> {
    let support = |direction: DVec3| support(direction) - OFFSET.extend(0.0);
    let mut portal = surround_line(&support)?;
    for _ in 0..MAX_STEPS {
        let [a, b, c] = portal;
        let normal = (b - a).cross(c - a);
        if normal.z == 0.0 {
            return None;
        }
        // Scaled to a vertical component of -1, so that progress along it is progress along the line.
        let down = normal / -normal.z;
        let height = -down.dot(a);
        if height < give_up_below {
            return Some(height);
        }
        let point = support(down);
        if down.dot(point) - down.dot(a) <= ACCURACY {
            return Some(height);
        }
        let candidates = [[point, a, b], [point, b, c], [point, c, a]];
        portal = candidates.into_iter().max_by(|one, other| inside(one).total_cmp(&inside(other)))?;
    }
    let [a, b, c] = portal;
    let normal = (b - a).cross(c - a);
    Some(normal.dot(a) / normal.z)
}

/// Three points of the body around the line; `None` if the line misses the body.
fn surround_line(support: &impl Fn(DVec3) -> DVec3) -> Option<[DVec3; 3]> {
    let horizontal = |direction: DVec2| support(direction.extend(0.0));
    let mut a = horizontal(DVec2::X);
    let mut b = horizontal(-a.truncate());
    if b.truncate().dot(a.truncate()) > 0.0 {
        return None;
    }
    for _ in 0..MAX_STEPS {
        // Normal of the edge towards the side on which the line passes.
        let edge = b.truncate() - a.truncate();
        let mut toward = edge.perp();
        if toward.dot(-a.truncate()) < 0.0 {
            toward = -toward;
        }
        if toward == DVec2::ZERO {
            return None;
        }
        let c = horizontal(toward);
        if c.truncate().dot(toward) < 0.0 || (c - a).truncate().dot(toward) <= 0.0 {
            return None;
        }
        let triangle = [a, b, c];
        if inside(&triangle) >= 0.0 {
            return Some(triangle);
        }
        // Of the two edges through the new point, the one with the line beyond it is kept.
        let beyond = |p: DVec3, q: DVec3, other: DVec3| {
            let normal = (q - p).truncate().perp();
            (normal.dot(-p.truncate()) > 0.0) != (normal.dot((other - p).truncate()) > 0.0)
        };
        if beyond(a, c, b) {
            b = c;
        } else {
            a = c;
        }
    }
    None
}

/// Smallest barycentric coordinate of the line's foot in a triangle in the top view; negative outside.
fn inside([a, b, c]: &[DVec3; 3]) -> f64 {
    let [a, b, c] = [a.truncate(), b.truncate(), c.truncate()];
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 {
        return f64::NEG_INFINITY;
    }
    (a.perp_dot(b) / area).min(b.perp_dot(c) / area).min(c.perp_dot(a) / area)
}
