//! Edge routing: curves that avoid shapes which they do not connect, and labels without overlaps.

use super::svg::{Area, BOLD, Point, text_width};

/// Font size of the labels, px.
pub const LABEL_SIZE: f64 = 12.0;

/// Shape that lines and labels avoid.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Bounding box, px.
    pub area: Area,
    /// Polygons that outline the shape; empty for the whole bounding box.
    pub outlines: Vec<Vec<Point>>,
    /// True if no label may cover the shape; false for one that a label may cover where there is no other space, such
    /// as a footprint.
    pub solid: bool,
    /// Index of the shape of which this one is the label; edges of that shape may run under the label.
    pub owner: Option<usize>,
}

/// Labelled edge between two shapes, as input of [`route`].
#[derive(Clone, Debug, PartialEq)]
pub struct UnroutedEdge {
    /// Index of the source shape.
    pub from: usize,
    /// Index of the target shape.
    pub to: usize,
    /// Text written at the edge.
    pub label: String,
}

/// Edge with its curve and the place of its label.
#[derive(Clone, Debug, PartialEq)]
pub struct RoutedEdge {
    /// Points of the curve, px, from the source to the target, clipped as asked of [`route`]; the two centres if
    /// nothing is left between the shapes.
    pub points: Vec<Point>,
    /// Bounding box of the label, px.
    pub label: Area,
}

const BENDS: [f64; 11] = [0.0, 26.0, -26.0, 52.0, -52.0, 84.0, -84.0, 124.0, -124.0, 170.0, -170.0];
const FRACTIONS: [f64; 9] = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82];
/// Offsets of label candidates: side of the line (0 on it, 1 or -1 beside it) and extra distance from it, px.
const ASIDE: [(f64, f64); 9] = [
    (0.0, 0.0),
    (1.0, 0.0),
    (-1.0, 0.0),
    (1.0, 10.0),
    (-1.0, 10.0),
    (1.0, 22.0),
    (-1.0, 22.0),
    (1.0, 36.0),
    (-1.0, 36.0),
];
const SAMPLES: usize = 64;

impl Shape {
    /// Shape of a rectangle that must not be covered.
    pub fn solid(area: Area) -> Self {
        Self { area, outlines: Vec::new(), solid: true, owner: None }
    }

    /// True if a point is inside the shape scaled about its centre. A shape without outlines is grown by `grown` px
    /// before it is scaled.
    fn contains(&self, point: Point, scale: f64, grown: f64) -> bool {
        let center = self.area.center();
        let at = [center[0] + (point[0] - center[0]) / scale, center[1] + (point[1] - center[1]) / scale];
        self.area.grown(grown).contains(at)
            && (self.outlines.is_empty() || self.outlines.iter().any(|outline| inside(outline, at)))
    }

    fn overlaps(&self, area: &Area) -> bool {
        if !self.area.overlaps(area) || self.outlines.is_empty() {
            return self.area.overlaps(area);
        }
        let at = |column: i32, row: i32| {
            [area.x + area.width * f64::from(column) / 6.0, area.y + area.height * f64::from(row) / 2.0]
        };
        (0..=6).any(|column| (0..=2).any(|row| self.contains(at(column, row), 1.0, 0.0)))
            || self.outlines.iter().flatten().any(|point| area.contains(*point))
    }
}

/// True if a point is inside a polygon (even-odd rule).
fn inside(outline: &[Point], point: Point) -> bool {
    let mut inside = false;
    for (index, a) in outline.iter().enumerate() {
        let b = outline[(index + 1) % outline.len()];
        if (a[1] > point[1]) != (b[1] > point[1]) && point[0] < a[0] + (point[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        {
            inside = !inside;
        }
    }
    inside
}

/// Routes the edges one after the other, each with the best curve given the previous ones.
///
/// `clip` scales the source and the target shape about their centres; the line starts and ends at the borders of the
/// scaled shapes: 1 for the border itself, less for a point inside.
/// Also returns the number of clashes: solid shapes and labels that a line or label covers, and edges of the same pair
/// of shapes that are too close to each other.
pub fn route(shapes: &[Shape], wires: &[UnroutedEdge], clip: [f64; 2]) -> (Vec<RoutedEdge>, usize) {
    let mut routed: Vec<RoutedEdge> = Vec::with_capacity(wires.len());
    let mut clashes = 0;
    for (index, wire) in wires.iter().enumerate() {
        let mut best: Option<(f64, usize, RoutedEdge)> = None;
        for bend in BENDS {
            // The side of a bend does not depend on which end is the source.
            let bend = if wire.from < wire.to { bend } else { -bend };
            let points = bent_line(&shapes[wire.from], &shapes[wire.to], bend, clip);
            let ends = [Some(wire.from), Some(wire.to)];
            let others: Vec<&Shape> = shapes
                .iter()
                .enumerate()
                .filter(|(at, shape)| !ends.contains(&Some(*at)) && !ends.contains(&shape.owner))
                .map(|(_, shape)| shape)
                .collect();
            let hits = |solid: bool| {
                let hit = |shape: &&&Shape| points.iter().any(|point| shape.contains(*point, 1.0, 5.0));
                others.iter().filter(|shape| shape.solid == solid).filter(hit).count()
            };
            let over_labels =
                routed.iter().filter(|other| points.iter().any(|point| other.label.contains(*point))).count();
            let beside = wires[..index]
                .iter()
                .zip(&routed)
                .filter(|(other, _)| same_pair(other, wire))
                .filter(|(_, drawn)| nearest(&drawn.points, points[points.len() / 2]) < 20.0)
                .count();
            let place = place_label(shapes, &routed, &points, &wire.label);
            let hard = hits(true) + place.overlaps + over_labels + beside;
            let cost = 100.0 * hard as f64 + 25.0 * hits(false) as f64 + 0.4 * bend.abs() + 0.5 * place.cost;
            if best.as_ref().is_none_or(|(lowest, ..)| cost < *lowest) {
                best = Some((cost, hard, RoutedEdge { points, label: place.area }));
            }
        }
        if let Some((_, hard, drawn)) = best {
            clashes += hard;
            routed.push(drawn);
        }
    }
    (routed, clashes)
}

fn same_pair(a: &UnroutedEdge, b: &UnroutedEdge) -> bool {
    (a.from, a.to) == (b.from, b.to) || (a.from, a.to) == (b.to, b.from)
}

fn nearest(points: &[Point], to: Point) -> f64 {
    points.iter().map(|point| (point[0] - to[0]).hypot(point[1] - to[1])).fold(f64::INFINITY, f64::min)
}

/// Quadratic curve between the centres of two shapes, clipped at both shapes; `bend` is the offset of its middle, px.
fn bent_line(from: &Shape, to: &Shape, bend: f64, clip: [f64; 2]) -> Vec<Point> {
    let (a, b) = (from.area.center(), to.area.center());
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy).max(1e-6);
    let control = [(a[0] + b[0]) / 2.0 - dy / length * bend * 2.0, (a[1] + b[1]) / 2.0 + dx / length * bend * 2.0];
    let at = |t: f64| {
        let (u, v) = (1.0 - t, t);
        [u * u * a[0] + 2.0 * u * v * control[0] + v * v * b[0], u * u * a[1] + 2.0 * u * v * control[1] + v * v * b[1]]
    };
    let line: Vec<Point> = (0..=SAMPLES).map(|step| at(step as f64 / SAMPLES as f64)).collect();
    let start = line.iter().rposition(|point| from.contains(*point, clip[0], 2.0)).map_or(0, |last| last + 1);
    let end = line.iter().position(|point| to.contains(*point, clip[1], 3.0)).unwrap_or(line.len());
    if start + 2 <= end { line[start..end].to_vec() } else { vec![a, b] }
}

struct LabelPlace {
    area: Area,
    /// Number of solid shapes and labels that the label overlaps; compared before `cost`.
    overlaps: usize,
    /// Cost (no unit) of the position, of covered lines and non-solid shapes, and of a label that leaves too little of
    /// its own line visible.
    cost: f64,
}

/// Best position of a label along a line.
fn place_label(shapes: &[Shape], routed: &[RoutedEdge], points: &[Point], label: &str) -> LabelPlace {
    let (width, height) = label_size(label);
    let length: f64 = points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum();
    let mut best =
        LabelPlace { area: Area::around(points[0], width, height), overlaps: usize::MAX, cost: f64::INFINITY };
    for (rank, fraction) in FRACTIONS.into_iter().enumerate() {
        let at = ((points.len() - 1) as f64 * fraction).round() as usize;
        let (before, point, after) = (points[at.saturating_sub(1)], points[at], points[(at + 1).min(points.len() - 1)]);
        let (dx, dy) = (after[0] - before[0], after[1] - before[1]);
        let norm = dx.hypot(dy).max(1e-6);
        let (ux, uy) = (dx / norm, dy / norm);
        // Length of the line that the label hides if it is centred on the line.
        let hidden = (width / ux.abs().max(1e-6)).min(height / uy.abs().max(1e-6));
        for (side, farther) in ASIDE {
            let off = (width / 2.0 * uy.abs() + height / 2.0 * ux.abs() + 4.0 + farther) * side;
            let area = Area::around([point[0] - uy * off, point[1] + ux * off], width, height);
            let covered = |solid: bool| {
                shapes.iter().filter(|shape| shape.solid == solid && shape.overlaps(&area.grown(1.0))).count()
            };
            let labels = routed.iter().filter(|other| area.grown(5.0).overlaps(&other.label)).count();
            let lines = routed.iter().filter(|other| other.points.iter().any(|point| area.contains(*point))).count();
            let squeezed = side == 0.0 && length < hidden + 26.0;
            let cost = rank as f64
                + 6.0 * side.abs()
                + 0.7 * farther
                + if squeezed { 40.0 } else { 0.0 }
                + 12.0 * lines as f64
                + 18.0 * covered(false) as f64;
            let overlaps = covered(true) + labels;
            if (overlaps, cost) < (best.overlaps, best.cost) {
                best = LabelPlace { area, overlaps, cost };
            }
        }
    }
    best
}

/// Width and height of a label including its margin, px.
pub fn label_size(label: &str) -> (f64, f64) {
    (text_width(label, LABEL_SIZE) * BOLD + 6.0, LABEL_SIZE + 5.0)
}
