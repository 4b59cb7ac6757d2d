//! Quadrilaterals among contours: corners as intersections of lines fitted to the edges in the image.

use genmanip_core::glam::DVec2;

use super::grey::GreyImage;
use super::tags::CELLS;

/// Maximum distance of a contour from its sides: the larger of this many pixels and this share of the shortest side.
const STRAIGHT: [f64; 2] = [1.6, 0.04];
/// Maximum share of contour points that are farther from the sides. Chosen by hand.
const MOST_ASTRAY: f64 = 0.05;
/// Minimum length of a side, pixels: more than one pixel per cell of a tag.
const MIN_SIDE: f64 = 10.0;
/// Share of a side at each end that is not fitted: adjacent edges blur into it.
const ENDS: f64 = 0.1;
/// Number of refinements of the lines, each starting from the previous corners. Chosen by hand.
const ROUNDS: usize = 2;

/// Corners of a dark quadrilateral, clockwise in the image; `None` for another shape.
pub fn corners(image: &GreyImage, outline: &[DVec2]) -> Option<[DVec2; 4]> {
    let mut corners = coarse(outline)?;
    for _ in 0..ROUNDS {
        let lines = [0, 1, 2, 3].map(|side| edge(image, corners[side], corners[(side + 1) % 4]));
        let lines = [lines[0]?, lines[1]?, lines[2]?, lines[3]?];
        let mut fitted = corners;
        for corner in 0..4 {
            fitted[corner] = lines[(corner + 3) % 4].meets(&lines[corner])?;
            // A corner that moves by more than 3 pixels was fitted to another edge.
            if fitted[corner].distance(corners[corner]) > 3.0 {
                return None;
            }
        }
        corners = fitted;
    }
    Some(corners)
}

/// Corners of a contour to a pixel: the point farthest from the centroid, the point farthest from that one, and the
/// farthest on either side of this diagonal. `None` unless they form a convex quadrilateral with straight sides.
fn coarse(outline: &[DVec2]) -> Option<[DVec2; 4]> {
    let middle = outline.iter().sum::<DVec2>() / outline.len() as f64;
    let farthest =
        |measure: &dyn Fn(DVec2) -> f64| outline.iter().copied().max_by(|a, b| measure(*a).total_cmp(&measure(*b)));
    let a = farthest(&|point| point.distance_squared(middle))?;
    let c = farthest(&|point| point.distance_squared(a))?;
    let diagonal = c - a;
    // Clockwise in an image, whose y points down: b is where the cross product is negative.
    let b = farthest(&|point| -diagonal.perp_dot(point - a))?;
    let d = farthest(&|point| diagonal.perp_dot(point - a))?;
    let corners = [a, b, c, d];
    let sides = [0, 1, 2, 3].map(|side| (corners[side], corners[(side + 1) % 4]));
    let shortest = sides.iter().map(|(from, to)| from.distance(*to)).fold(f64::INFINITY, f64::min);
    let is_convex = (0..4).all(|at| {
        let (before, here, after) = (corners[(at + 3) % 4], corners[at], corners[(at + 1) % 4]);
        (here - before).perp_dot(after - here) > 0.15 * here.distance(before) * here.distance(after)
    });
    if shortest < MIN_SIDE || !is_convex {
        return None;
    }
    let limit = STRAIGHT[0].max(STRAIGHT[1] * shortest);
    let off = |point: DVec2| {
        let distance = |(from, to): &(DVec2, DVec2)| (*to - *from).normalize().perp_dot(point - *from).abs();
        sides.iter().map(distance).fold(f64::INFINITY, f64::min)
    };
    let astray = outline.iter().filter(|point| off(**point) > limit).count();
    (astray as f64 <= MOST_ASTRAY * outline.len() as f64).then_some(corners)
}

/// A line, given by a point and its direction.
#[derive(Clone, Copy)]
struct Line {
    point: DVec2,
    direction: DVec2,
}

impl Line {
    fn meets(&self, other: &Self) -> Option<DVec2> {
        let along = (other.point - self.point).perp_dot(other.direction) / self.direction.perp_dot(other.direction);
        let point = self.point + self.direction * along;
        point.is_finite().then_some(point)
    }
}

/// Line along the edge between two corners, with the bright side on its left: total least squares over the points of
/// steepest gradient across the edge. `None` if the samples cross the image border or no edge is found.
fn edge(image: &GreyImage, from: DVec2, to: DVec2) -> Option<Line> {
    /// Sample spacing across the edge, pixels. Chosen by hand.
    const STEP: f64 = 0.25;
    let length = from.distance(to);
    let direction = (to - from) / length;
    let inwards = direction.perp();
    // Samples do not reach beyond the black border of a tag.
    let reach = (0.7 * length / f64::from(CELLS)).clamp(1.0, 3.0);
    let count = (length.ceil() as usize).clamp(8, 80);
    let steps = (reach / STEP) as i32;
    let mut places = Vec::with_capacity(count);
    for index in 0..count {
        let along = ENDS + (1.0 - 2.0 * ENDS) * (index as f64 + 0.5) / count as f64;
        let at = from + direction * (along * length);
        let (mut sum, mut weights) = (0.0, 0.0);
        for step in -steps..steps {
            let across = f64::from(step) * STEP;
            let value = |across: f64| image.sampled(at + inwards * across);
            let fall = (value(across)? - value(across + STEP)?).max(0.0);
            sum += fall * fall * (across + 0.5 * STEP);
            weights += fall * fall;
        }
        if weights > 0.0 {
            places.push((at + inwards * (sum / weights), weights.sqrt()));
        }
    }
    let total: f64 = places.iter().map(|(_, weight)| weight).sum();
    let point = places.iter().map(|(place, weight)| *place * *weight).sum::<DVec2>() / total;
    let [mut xx, mut xy, mut yy] = [0.0; 3];
    for (place, weight) in &places {
        let off = *place - point;
        (xx, xy, yy) = (xx + weight * off.x * off.x, xy + weight * off.x * off.y, yy + weight * off.y * off.y);
    }
    let direction = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
    (point.is_finite() && direction.is_finite()).then_some(Line { point, direction })
}
