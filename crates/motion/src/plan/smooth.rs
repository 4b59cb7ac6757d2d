//! Path smoothing: random shortcuts, rounded corners, and the final collision check.

use rand::{Rng, RngExt};

use super::settings::PlanSettings;
use crate::collision::Checker;
use crate::path::{Path, distance, lerp};

/// Minimum clearance on rounded corners (m), also for relaxed pairs: the timed motion deviates from the path there by
/// fractions of a millimetre.
const CORNER_CLEARANCE: f64 = 0.001;

/// Shortens a path, checks the remaining edges and rounds its corners; `None` if an edge is not free.
pub(super) fn smooth(
    checker: &Checker,
    settings: &PlanSettings,
    waypoints: Vec<Vec<f64>>,
    rng: &mut impl Rng,
) -> Option<Path> {
    let spacing = settings.final_spacing;
    let mut route = Route { checked: vec![false; waypoints.len().saturating_sub(1)], waypoints };
    route.skip(checker, spacing);
    route.shorten(checker, settings, rng);
    route.skip(checker, spacing);
    if !route.is_free(checker, spacing) {
        return None;
    }
    let mut path = Path::polyline(route.waypoints);
    let stricter;
    let rounding = if checker.has_min_clearance(CORNER_CLEARANCE) {
        checker
    } else {
        stricter = checker.with_min_clearance(CORNER_CLEARANCE);
        &stricter
    };
    path.round_corners(settings.blend, settings.blend_halvings, |states| rounding.polyline_is_free(states, spacing));
    Some(path)
}

/// A polyline with a flag per edge that passed the final check.
struct Route {
    waypoints: Vec<Vec<f64>>,
    checked: Vec<bool>,
}

impl Route {
    /// Connects each waypoint by an edge to the farthest later one to which the straight edge is free.
    fn skip(&mut self, checker: &Checker, spacing: f64) {
        let mut index = 0;
        while index + 2 < self.waypoints.len() {
            let is_visible =
                |later: &usize| self.is_visible(checker, &self.waypoints[index], &self.waypoints[*later], spacing);
            if let Some(later) = (index + 2..self.waypoints.len()).rev().find(is_visible) {
                self.replace(index, later, []);
            }
            index += 1;
        }
    }

    /// Random shortcuts (Geraerts and Overmars, 2007).
    fn shorten(&mut self, checker: &Checker, settings: &PlanSettings, rng: &mut impl Rng) {
        let mut failures = 0;
        for _ in 0..settings.shortcuts {
            if self.waypoints.len() < 3 || failures >= settings.shortcut_failures {
                break;
            }
            let lengths: Vec<f64> = self.waypoints.windows(2).map(|edge| distance(&edge[0], &edge[1])).collect();
            let total: f64 = lengths.iter().sum();
            let (a, b) = (rng.random_range(0.0..=total), rng.random_range(0.0..=total));
            let (first_edge, first) = self.at_length(&lengths, a.min(b));
            let (last_edge, last) = self.at_length(&lengths, a.max(b));
            if first_edge == last_edge {
                continue;
            }
            let along: f64 = distance(&first, &self.waypoints[first_edge + 1])
                + lengths[first_edge + 1..last_edge].iter().sum::<f64>()
                + distance(&self.waypoints[last_edge], &last);
            if distance(&first, &last) < along - 1e-3 && self.is_visible(checker, &first, &last, settings.final_spacing)
            {
                self.replace(first_edge, last_edge + 1, [first, last]);
                failures = 0;
            } else {
                failures += 1;
            }
        }
    }

    /// Inserts a checked shortcut with its ends on the edges after `first` and before `last`; without ends it connects
    /// the two waypoints.
    fn replace<const ENDS: usize>(&mut self, first: usize, last: usize, ends: [Vec<f64>; ENDS]) {
        // Parts of edges that passed the final check passed it too.
        let (before, after) = (self.checked[first], self.checked[last - 1]);
        let checked: &[bool] = if ENDS == 0 { &[true] } else { &[before, true, after] };
        self.checked.splice(first..last, checked.iter().copied());
        self.waypoints.splice(first + 1..last, ends);
    }

    fn is_visible(&self, checker: &Checker, from: &[f64], to: &[f64], spacing: f64) -> bool {
        checker.edges_are_free(vec![[from, to]], spacing)
    }

    /// Final check of the remaining edges.
    fn is_free(&self, checker: &Checker, spacing: f64) -> bool {
        let edges = self.waypoints.windows(2).zip(&self.checked);
        let open = edges.filter(|(_, checked)| !**checked).map(|(edge, _)| [&*edge[0], &*edge[1]]).collect();
        checker.edges_are_free(open, spacing)
    }

    /// Edge and point at an arc length.
    fn at_length(&self, lengths: &[f64], mut length: f64) -> (usize, Vec<f64>) {
        for (edge, edge_length) in lengths.iter().enumerate() {
            if length <= *edge_length && *edge_length > 0.0 {
                return (edge, lerp(&self.waypoints[edge], &self.waypoints[edge + 1], length / edge_length));
            }
            length -= edge_length;
        }
        (lengths.len() - 1, self.waypoints[lengths.len()].clone())
    }
}
