//! Paths in joint space: straight edges with rounded corners, twice continuously differentiable.

/// A path from rest to rest: straight edges between waypoints with corners rounded by quintic blends.
///
/// The blend at waypoint `i` starts `blends[i]` (rad) before it and ends as far behind it. The robot stops at a corner
/// without blend (0).
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    waypoints: Vec<Vec<f64>>,
    blends: Vec<f64>,
}

/// A point of a path: position and its first two derivatives with respect to the path parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CurvePoint {
    pub(crate) position: Vec<f64>,
    pub(crate) first: Vec<f64>,
    pub(crate) second: Vec<f64>,
}

/// A segment of a path.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Segment {
    /// Straight segment from a point along a unit direction.
    Line { from: Vec<f64>, direction: Vec<f64>, length: f64 },
    /// Blend around a corner: unit directions in and out, distance of either end from the corner.
    Blend { corner: Vec<f64>, incoming: Vec<f64>, outgoing: Vec<f64>, radius: f64 },
    /// Stop at a sharp corner.
    Stop,
}

impl Path {
    /// Straight edges with sharp corners; consecutive equal waypoints are merged.
    pub fn polyline(waypoints: Vec<Vec<f64>>) -> Self {
        let mut distinct: Vec<Vec<f64>> = Vec::with_capacity(waypoints.len());
        for waypoint in waypoints {
            if distinct.last().is_none_or(|last| distance(last, &waypoint) > 1e-9) {
                distinct.push(waypoint);
            }
        }
        Self { blends: vec![0.0; distinct.len()], waypoints: distinct }
    }

    /// The same path with start and goal exchanged.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.waypoints.reverse();
        self.blends.reverse();
        self
    }

    /// Corners of the path, start and goal included.
    pub fn waypoints(&self) -> &[Vec<f64>] {
        &self.waypoints
    }

    /// First configuration; empty for an empty path.
    pub fn start(&self) -> &[f64] {
        self.waypoints.first().map_or(&[], Vec::as_slice)
    }

    /// Last configuration; empty for an empty path.
    pub fn goal(&self) -> &[f64] {
        self.waypoints.last().map_or(&[], Vec::as_slice)
    }

    /// Euclidean joint-space length (rad).
    pub fn length(&self) -> f64 {
        self.waypoints.windows(2).map(|edge| distance(&edge[0], &edge[1])).sum()
    }

    /// Densely sampled states, neighbours at most `max_step` apart in every joint.
    pub fn states(&self, max_step: f64) -> Vec<Vec<f64>> {
        let mut states: Vec<Vec<f64>> = self.waypoints.first().cloned().into_iter().collect();
        for segment in self.segments() {
            let length = segment.length();
            let steps = (length / max_step.max(1e-6)).ceil() as usize;
            states.extend((1..=steps).map(|k| segment.at(length * k as f64 / steps as f64).position));
        }
        states
    }

    /// Rounds each corner as widely as `allowed` permits, starting at `widest` and halving up to `halvings` times.
    ///
    /// `allowed` receives the states of a blend, including its ends.
    pub(crate) fn round_corners(&mut self, widest: f64, halvings: usize, mut allowed: impl FnMut(&[Vec<f64>]) -> bool) {
        for index in 1..self.waypoints.len().saturating_sub(1) {
            let before = distance(&self.waypoints[index - 1], &self.waypoints[index]);
            let after = distance(&self.waypoints[index], &self.waypoints[index + 1]);
            let mut radius = widest.min(0.499 * before).min(0.499 * after);
            self.blends[index] = 0.0;
            for _ in 0..=halvings {
                let blend = self.blend(index, radius);
                let states: Vec<_> = (0..=8).map(|k| blend.at(blend.length() * f64::from(k) / 8.0).position).collect();
                if allowed(&states) {
                    self.blends[index] = radius;
                    break;
                }
                radius *= 0.5;
            }
        }
    }

    /// All segments, from start to goal: lines, blends and stops.
    pub(crate) fn segments(&self) -> Vec<Segment> {
        let mut segments = Vec::new();
        for index in 1..self.waypoints.len() {
            let (from, to) = (&self.waypoints[index - 1], &self.waypoints[index]);
            let direction = direction(from, to);
            let length = distance(from, to) - self.blends[index - 1] - self.blends[index];
            let from = along(from, &direction, self.blends[index - 1]);
            segments.push(Segment::Line { from, direction, length });
            if index + 1 < self.waypoints.len() {
                let radius = self.blends[index];
                segments.push(if radius > 0.0 { self.blend(index, radius) } else { Segment::Stop });
            }
        }
        segments
    }

    fn blend(&self, index: usize, radius: f64) -> Segment {
        Segment::Blend {
            corner: self.waypoints[index].clone(),
            incoming: direction(&self.waypoints[index - 1], &self.waypoints[index]),
            outgoing: direction(&self.waypoints[index], &self.waypoints[index + 1]),
            radius,
        }
    }
}

impl Segment {
    /// Parameter length; arc length for lines.
    pub(crate) fn length(&self) -> f64 {
        match self {
            Self::Line { length, .. } => *length,
            Self::Blend { radius, .. } => 2.0 * radius,
            Self::Stop => 0.0,
        }
    }

    /// Position and derivatives at a parameter in [0, length].
    pub(crate) fn at(&self, parameter: f64) -> CurvePoint {
        let mut point = CurvePoint::default();
        self.write(parameter, &mut point);
        point
    }

    /// Like `at`, into reused storage.
    pub(crate) fn write(&self, parameter: f64, point: &mut CurvePoint) {
        point.position.clear();
        point.first.clear();
        point.second.clear();
        match self {
            Self::Line { from, direction, .. } => {
                point.position.extend(from.iter().zip(direction).map(|(q, d)| q + d * parameter));
                point.first.extend_from_slice(direction);
                point.second.resize(from.len(), 0.0);
            }
            Self::Blend { corner, incoming, outgoing, radius } => {
                // Bézier curve of degree five; control points on the two edges at 1, 0.6 and 0.2 radii from the
                // corner: unit speed and no curvature at the ends, and exactly linear when the corner is straight.
                let t = (parameter / (2.0 * radius)).clamp(0.0, 1.0);
                let (leave, join) = (weights(1.0 - t), weights(t));
                for ((q, u), v) in corner.iter().zip(incoming).zip(outgoing) {
                    point.position.push(q + radius * (v * join[0] - u * leave[0]));
                    point.first.push((v * join[1] + u * leave[1]) * 0.5);
                    point.second.push((v * join[2] - u * leave[2]) * 0.25 / radius);
                }
            }
            Self::Stop => {}
        }
    }
}

/// Weight of one edge of a blend, and its first two derivatives in t.
fn weights(t: f64) -> [f64; 3] {
    // Expanded: 2t³ - 4t⁴ + 2t⁵ + 3t⁴ - 3t⁵ + t⁵ = 2t³ - t⁴.
    [2.0 * t.powi(3) - t.powi(4), 6.0 * t * t - 4.0 * t.powi(3), 12.0 * t - 12.0 * t * t]
}

/// Euclidean distance of two configurations (rad).
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

pub(crate) fn lerp(a: &[f64], b: &[f64], t: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + (b - a) * t).collect()
}

fn direction(from: &[f64], to: &[f64]) -> Vec<f64> {
    let length = distance(from, to).max(1e-300);
    from.iter().zip(to).map(|(a, b)| (b - a) / length).collect()
}

fn along(from: &[f64], direction: &[f64], length: f64) -> Vec<f64> {
    from.iter().zip(direction).map(|(q, d)| q + d * length).collect()
}
