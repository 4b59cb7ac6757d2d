//! Edges between boxes: gently bent lines that avoid the other boxes, and labels that cover nothing.

use super::svg::{Area, Point, text_width};

/// Size of the labels, px.
pub(crate) const LABEL_SIZE: f64 = 12.0;

/// An edge to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wire {
    /// Index of the box it leaves.
    pub from: usize,
    /// Index of the box it points at.
    pub to: usize,
    /// What it says.
    pub label: String,
}

/// A drawn edge.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Routed {
    /// From the border of one box to the border of the other.
    pub points: Vec<Point>,
    /// Where the label goes.
    pub label: Area,
}

const BENDS: [f64; 11] = [0.0, 26.0, -26.0, 52.0, -52.0, 84.0, -84.0, 124.0, -124.0, 170.0, -170.0];
const FRACTIONS: [f64; 9] = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82];
const SAMPLES: usize = 64;

/// Draws the wires one after the other, each the best way given those before; also returns how many
/// labels or lines could not avoid a box or another label.
pub(crate) fn route(boxes: &[Area], wires: &[Wire]) -> (Vec<Routed>, usize) {
    let mut routed: Vec<Routed> = Vec::with_capacity(wires.len());
    let mut clashes = 0;
    for (index, wire) in wires.iter().enumerate() {
        let mut best: Option<(f64, usize, Routed)> = None;
        for bend in BENDS {
            // The bend is measured in a direction that does not depend on which end comes first.
            let bend = if wire.from < wire.to { bend } else { -bend };
            let points = bent_line(&boxes[wire.from], &boxes[wire.to], bend);
            let hits = boxes
                .iter()
                .enumerate()
                .filter(|(node, _)| *node != wire.from && *node != wire.to)
                .filter(|(_, area)| points.iter().any(|point| area.grown(5.0).contains(*point)))
                .count();
            let runs_over_label =
                routed.iter().filter(|other| points.iter().any(|point| other.label.contains(*point))).count();
            let beside = wires[..index]
                .iter()
                .zip(&routed)
                .filter(|(other, _)| same_pair(other, wire))
                .filter(|(_, drawn)| nearest(&drawn.points, points[points.len() / 2]) < 20.0)
                .count();
            let (label, overlaps) = place_label(boxes, &routed, &points, &wire.label);
            let hard = hits + overlaps + runs_over_label;
            let cost = 100.0 * hard as f64 + 60.0 * beside as f64 + 0.12 * bend.abs();
            if best.as_ref().is_none_or(|(lowest, ..)| cost < *lowest) {
                best = Some((cost, hard + beside, Routed { points, label }));
            }
        }
        if let Some((_, hard, drawn)) = best {
            clashes += hard;
            routed.push(drawn);
        }
    }
    (routed, clashes)
}

fn same_pair(a: &Wire, b: &Wire) -> bool {
    (a.from, a.to) == (b.from, b.to) || (a.from, a.to) == (b.to, b.from)
}

fn nearest(points: &[Point], to: Point) -> f64 {
    points.iter().map(|point| (point[0] - to[0]).hypot(point[1] - to[1])).fold(f64::INFINITY, f64::min)
}

/// A quadratic curve between the centres, without its parts inside the boxes.
fn bent_line(from: &Area, to: &Area, bend: f64) -> Vec<Point> {
    let (a, b) = (from.center(), to.center());
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy).max(1e-6);
    let control = [(a[0] + b[0]) / 2.0 - dy / length * bend * 2.0, (a[1] + b[1]) / 2.0 + dx / length * bend * 2.0];
    let at = |t: f64| {
        let (u, v) = (1.0 - t, t);
        [u * u * a[0] + 2.0 * u * v * control[0] + v * v * b[0], u * u * a[1] + 2.0 * u * v * control[1] + v * v * b[1]]
    };
    let outside: Vec<Point> = (0..=SAMPLES)
        .map(|step| at(step as f64 / SAMPLES as f64))
        .filter(|point| !from.grown(2.0).contains(*point) && !to.grown(3.0).contains(*point))
        .collect();
    if outside.len() >= 2 { outside } else { vec![a, b] }
}

/// The best place for a label along a line, and how many boxes and labels it covers there.
fn place_label(boxes: &[Area], routed: &[Routed], points: &[Point], label: &str) -> (Area, usize) {
    let (width, height) = label_size(label);
    let length: f64 = points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum();
    let mut best = (usize::MAX, f64::INFINITY, Area::around([0.0; 2], width, height));
    for (rank, fraction) in FRACTIONS.into_iter().enumerate() {
        let at = ((points.len() - 1) as f64 * fraction).round() as usize;
        let (before, point, after) = (points[at.saturating_sub(1)], points[at], points[(at + 1).min(points.len() - 1)]);
        let (dx, dy) = (after[0] - before[0], after[1] - before[1]);
        let norm = dx.hypot(dy).max(1e-6);
        let (ux, uy) = (dx / norm, dy / norm);
        // How much of the line the plate would hide when it sits on it.
        let hidden = (width / ux.abs().max(1e-6)).min(height / uy.abs().max(1e-6));
        for side in [0.0, 1.0, -1.0] {
            let off = (width / 2.0 * uy.abs() + height / 2.0 * ux.abs() + 4.0) * side;
            let area = Area::around([point[0] - uy * off, point[1] + ux * off], width, height);
            let boxes_hit = boxes.iter().filter(|other| area.grown(1.0).overlaps(other)).count();
            let labels_hit = routed.iter().filter(|other| area.grown(1.0).overlaps(&other.label)).count();
            let lines_hit =
                routed.iter().filter(|other| other.points.iter().any(|point| area.contains(*point))).count();
            let squeezed = side == 0.0 && length < hidden + 26.0;
            let cost = rank as f64
                + if side == 0.0 { 0.0 } else { 6.0 }
                + if squeezed { 40.0 } else { 0.0 }
                + 12.0 * lines_hit as f64;
            if (boxes_hit + labels_hit, cost) < (best.0, best.1) {
                best = (boxes_hit + labels_hit, cost, area);
            }
        }
    }
    (best.2, best.0)
}

/// Width and height of a label with its margin.
pub(crate) fn label_size(label: &str) -> (f64, f64) {
    (text_width(label, LABEL_SIZE) + 8.0, LABEL_SIZE + 5.0)
}
