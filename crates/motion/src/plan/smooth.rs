//! Shorter and smoother: shortcuts between any two points of a path, rounded corners, and the final test.

use rand::{Rng, RngExt};

use super::PlanSettings;
use crate::collision::Checker;
use crate::path::{Path, distance, lerp};

/// Removes waypoints that can be skipped, then tries random shortcuts (Geraerts and Overmars, 2007).
pub(super) fn shortcut(
    checker: &Checker,
    settings: &PlanSettings,
    spacing: f64,
    waypoints: Vec<Vec<f64>>,
    rng: &mut impl Rng,
) -> Vec<Vec<f64>> {
    let mut waypoints = skip(checker, spacing, waypoints);
    let mut failures = 0;
    for _ in 0..settings.shortcuts {
        if waypoints.len() < 3 || failures >= settings.shortcut_failures {
            break;
        }
        let lengths: Vec<f64> = waypoints.windows(2).map(|edge| distance(&edge[0], &edge[1])).collect();
        let total: f64 = lengths.iter().sum();
        let (a, b) = (rng.random_range(0.0..=total), rng.random_range(0.0..=total));
        let (first_edge, first) = at_length(&waypoints, &lengths, a.min(b));
        let (last_edge, last) = at_length(&waypoints, &lengths, a.max(b));
        if first_edge == last_edge {
            continue;
        }
        let along: f64 = distance(&first, &waypoints[first_edge + 1])
            + lengths[first_edge + 1..last_edge].iter().sum::<f64>()
            + distance(&waypoints[last_edge], &last);
        if distance(&first, &last) < along - 1e-3 && checker.edge_is_free(&first, &last, spacing) {
            waypoints.splice(first_edge + 1..=last_edge, [first, last]);
            failures = 0;
        } else {
            failures += 1;
        }
    }
    skip(checker, spacing, waypoints)
}

/// Tests every edge at the final spacing and rounds the corners; `None` when an edge does not pass.
pub(super) fn finish(checker: &Checker, settings: &PlanSettings, waypoints: Vec<Vec<f64>>) -> Option<Path> {
    let spacing = settings.final_spacing;
    if !checker.polyline_is_free(&waypoints, spacing) {
        return None;
    }
    let mut path = Path::polyline(waypoints);
    path.round_corners(settings.blend, settings.blend_halvings, |states| checker.polyline_is_free(states, spacing));
    Some(path)
}

/// Goes from each waypoint straight to the farthest later one it can see.
fn skip(checker: &Checker, spacing: f64, waypoints: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut kept: Vec<Vec<f64>> = Vec::with_capacity(waypoints.len());
    let mut index = 0;
    while let Some(waypoint) = waypoints.get(index) {
        kept.push(waypoint.clone());
        let sees = |later: &usize| checker.edge_is_free(waypoint, &waypoints[*later], spacing);
        index = (index + 2..waypoints.len()).rev().find(sees).unwrap_or(index + 1);
    }
    kept
}

/// The edge and the point at a length along the path.
fn at_length(waypoints: &[Vec<f64>], lengths: &[f64], mut length: f64) -> (usize, Vec<f64>) {
    for (edge, edge_length) in lengths.iter().enumerate() {
        if length <= *edge_length && *edge_length > 0.0 {
            return (edge, lerp(&waypoints[edge], &waypoints[edge + 1], length / edge_length));
        }
        length -= edge_length;
    }
    (lengths.len() - 1, waypoints[lengths.len()].clone())
}
