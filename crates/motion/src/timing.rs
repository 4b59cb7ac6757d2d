//! Time-optimal smooth time parametrisation of paths, sampled at the control rate.
//!
//! A backward and a forward pass over a grid compute the fastest speed along the path under joint velocity and
//! acceleration limits (H. Pham and Q.-C. Pham, *A New Approach to Time-Optimal Path Parameterization Based on
//! Reachability Analysis*, 2018). Then the joint motion is averaged over a short sliding window, which preserves
//! velocity and acceleration limits, straight edges and rest at both ends, and bounds the jerk by 2 · acceleration
//! limit / window.

use serde::{Deserialize, Serialize};

use crate::path::{CurvePoint, Path, Segment};

/// Settings of time parametrisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TimingSettings {
    /// Sample period (s).
    pub dt: f64,
    /// Usable share of the manufacturer's velocity limits at speed 1.
    pub velocity_fraction: f64,
    /// Usable share of the manufacturer's acceleration limits at speed 1.
    pub acceleration_fraction: f64,
    /// Length of the smoothing window (s); bounds the jerk.
    pub window: f64,
    /// Number of grid cells per straight edge (at least) and per rounded corner.
    pub cells: usize,
    /// Maximum length of a grid cell (rad).
    pub longest_cell: f64,
}

impl Default for TimingSettings {
    fn default() -> Self {
        Self {
            dt: 1.0 / 60.0,
            velocity_fraction: 0.9,
            acceleration_fraction: 0.6,
            window: 0.1,
            cells: 12,
            longest_cell: 0.02,
        }
    }
}

/// Joint positions at a fixed rate, starting and ending at rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// Sample period (s).
    pub dt: f64,
    /// Joint positions, the first at time 0.
    pub configs: Vec<Vec<f64>>,
}

impl Trajectory {
    /// Time of the last sample (s).
    pub fn duration(&self) -> f64 {
        self.dt * self.configs.len().saturating_sub(1) as f64
    }
}

/// Velocity and acceleration limits of each joint, rad/s and rad/s² (m/s, m/s²).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionLimits {
    /// Maximum velocity of each joint.
    pub velocity: Vec<f64>,
    /// Maximum acceleration of each joint.
    pub acceleration: Vec<f64>,
}

/// The fastest smooth trajectory along a path under `limits`.
pub fn parametrize(path: &Path, limits: &MotionLimits, settings: &TimingSettings) -> Trajectory {
    let profile = Profile::fastest(path.segments(), limits, settings);
    let trajectory = profile.sample(path, settings, 1.0);
    // Limits hold at grid nodes; scale time to remove small violations in between.
    let time_scale = time_scale(&trajectory, limits);
    if time_scale > 1.0 { profile.sample(path, settings, time_scale * (1.0 + 1e-9)) } else { trajectory }
}

/// Factor on the duration at which finite differences satisfy the limits; at most 1 if they do already.
fn time_scale(trajectory: &Trajectory, limits: &MotionLimits) -> f64 {
    let dt = trajectory.dt;
    let speed = trajectory.configs.windows(2).flat_map(|pair| {
        pair[0].iter().zip(&pair[1]).zip(&limits.velocity).map(move |((a, b), limit)| (b - a).abs() / dt / limit)
    });
    let acceleration = trajectory.configs.windows(3).flat_map(|triple| {
        (0..limits.acceleration.len()).map(move |joint| {
            let second = triple[0][joint] - 2.0 * triple[1][joint] + triple[2][joint];
            (second.abs() / (dt * dt) / limits.acceleration[joint]).sqrt()
        })
    });
    speed.chain(acceleration).fold(0.0, f64::max)
}

/// Speed along the path at the nodes of a grid.
struct Profile {
    segments: Vec<Segment>,
    nodes: Vec<Node>,
    /// Time at each node, s.
    times: Vec<f64>,
    /// Speed of the path parameter at each node, rad/s.
    speeds: Vec<f64>,
}

/// A grid node: segment, parameter, and parameter distance to the next node.
#[derive(Clone, Copy)]
struct Node {
    segment: usize,
    parameter: f64,
    cell: f64,
}

impl Profile {
    fn fastest(segments: Vec<Segment>, limits: &MotionLimits, settings: &TimingSettings) -> Self {
        let nodes = grid(&segments, settings);
        let mut rows = Vec::with_capacity(nodes.len());
        let mut point = CurvePoint::default();
        for node in &nodes {
            segments[node.segment].write(node.parameter, &mut point);
            rows.push(Row::new(&point, limits));
        }
        let count = nodes.len();
        let rests =
            |index: usize| index == 0 || index + 1 == count || matches!(segments[nodes[index].segment], Segment::Stop);
        // Backward pass: largest squared speed from which the rest of the path stays feasible.
        let mut squared = vec![0.0; count];
        for index in (0..count.saturating_sub(1)).rev() {
            if !rests(index) {
                squared[index] = rows[index].max_squared_speed_before(squared[index + 1], nodes[index].cell);
            }
        }
        // Forward pass: maximum acceleration from rest.
        for index in 0..count.saturating_sub(1) {
            let reachable = squared[index] + 2.0 * nodes[index].cell * rows[index].max_acceleration(squared[index]);
            squared[index + 1] = squared[index + 1].min(reachable.max(0.0));
        }
        let speeds: Vec<f64> = squared.iter().map(|value: &f64| value.max(0.0).sqrt()).collect();
        let mut times = Vec::with_capacity(count);
        let mut time = 0.0;
        for index in 0..count {
            times.push(time);
            if index + 1 < count {
                time += 2.0 * nodes[index].cell / (speeds[index] + speeds[index + 1]).max(1e-9);
            }
        }
        Self { segments, nodes, times, speeds }
    }

    /// Samples the smoothed motion, whose duration is multiplied by `segment`.
    fn sample(&self, path: &Path, settings: &TimingSettings, segment: f64) -> Trajectory {
        let dt = settings.dt;
        let end = self.times.last().copied().unwrap_or(0.0) * segment;
        if end <= 0.0 {
            return Trajectory { dt, configs: path.waypoints().first().cloned().into_iter().collect() };
        }
        // Fine samples: a whole number per control period and per window.
        let per_period = 8_usize;
        let fine = dt / per_period as f64;
        let half = ((settings.window / fine / 2.0).round() as usize).max(1);
        let width = 2 * half + 1;
        let samples = ((end + settings.window.max(2.0 * half as f64 * fine)) / dt).ceil() as usize + 1;
        let dof = path.start().len();
        let mut sums = vec![vec![0.0; dof]];
        let (mut cell, mut point) = (0, CurvePoint::default());
        for index in 0..(samples - 1) * per_period + width {
            // The window is delayed by half its length so that the motion starts at rest at time 0.
            let time = (index as f64 - 2.0 * half as f64) * fine / segment;
            self.write(time, &mut cell, &mut point);
            let next = sums[index].iter().zip(&point.position).map(|(sum, q)| sum + q).collect();
            sums.push(next);
        }
        let average = |sample: usize| {
            let first = sample * per_period;
            let pair = sums[first].iter().zip(&sums[first + width]);
            pair.map(|(before, after)| (after - before) / width as f64).collect()
        };
        let mut configs: Vec<Vec<f64>> = (0..samples).map(average).collect();
        // Remove rounding errors of the sums at both ends.
        configs[0] = path.start().to_vec();
        configs[samples - 1] = path.goal().to_vec();
        Trajectory { dt, configs }
    }

    /// Position at a time; `cell` caches the current grid cell.
    fn write(&self, time: f64, cell: &mut usize, point: &mut CurvePoint) {
        let last = self.times.len() - 1;
        while *cell + 1 < last && self.times[*cell + 1] <= time {
            *cell += 1;
        }
        let node = self.nodes[*cell];
        let duration = self.times[*cell + 1] - self.times[*cell];
        let t = (time - self.times[*cell]).clamp(0.0, duration);
        let acceleration = (self.speeds[*cell + 1] - self.speeds[*cell]) / duration.max(1e-12);
        let progress = (self.speeds[*cell] * t + 0.5 * acceleration * t * t).min(node.cell);
        self.segments[node.segment].write(node.parameter + progress, point);
    }
}

fn grid(segments: &[Segment], settings: &TimingSettings) -> Vec<Node> {
    let mut nodes = Vec::new();
    for (index, segment) in segments.iter().enumerate() {
        let length = segment.length();
        if matches!(segment, Segment::Stop) {
            nodes.push(Node { segment: index, parameter: 0.0, cell: 0.0 });
        } else if length > 1e-12 {
            let cells = settings.cells.max((length / settings.longest_cell).ceil() as usize);
            let cell = length / cells as f64;
            nodes.extend((0..cells).map(|k| Node { segment: index, parameter: cell * k as f64, cell }));
        }
    }
    if let Some(&Node { segment, parameter, cell }) = nodes.last() {
        nodes.push(Node { segment, parameter: parameter + cell, cell: 0.0 });
    }
    nodes
}

/// Limits at a node on squared speed x and acceleration u of the path parameter:
/// |first·u + second·x| ≤ acceleration for each joint, x ≤ fastest.
struct Row {
    fastest: f64,
    /// (lowest, highest u at x = 0; slope in x) of joints that move along the path.
    bands: Vec<(f64, f64, f64)>,
}

impl Row {
    fn new(point: &CurvePoint, limits: &MotionLimits) -> Self {
        let mut row = Self { fastest: f64::INFINITY, bands: Vec::with_capacity(point.first.len()) };
        let derivatives = point.first.iter().zip(&point.second);
        for ((first, second), (velocity, acceleration)) in
            derivatives.zip(limits.velocity.iter().zip(&limits.acceleration))
        {
            row.fastest = row.fastest.min((velocity / first.abs().max(1e-12)).powi(2));
            if first.abs() > 1e-9 {
                let half = acceleration / first.abs();
                row.bands.push((-half, half, -second / first));
            } else if second.abs() > 1e-12 {
                row.fastest = row.fastest.min(acceleration / second.abs());
            }
        }
        row
    }

    /// Maximum path acceleration at squared speed `x`.
    fn max_acceleration(&self, x: f64) -> f64 {
        self.bands.iter().map(|(_, high, slope)| high + slope * x).fold(f64::INFINITY, f64::min)
    }

    /// Maximum squared speed from which `next` (squared) or less is reachable over a cell.
    fn max_squared_speed_before(&self, next: f64, cell: f64) -> f64 {
        let mut x = self.fastest;
        // Every upper line must stay above every lower line; the last upper line is u ≤ (next - x) / 2·cell.
        let brake = (next / (2.0 * cell), -1.0 / (2.0 * cell));
        for (low, _, low_slope) in &self.bands {
            let uppers = self.bands.iter().map(|(_, high, slope)| (*high, *slope)).chain([brake]);
            for (high, slope) in uppers {
                let closing = low_slope - slope;
                if closing > 1e-12 {
                    x = x.min((high - low) / closing);
                }
            }
        }
        x.max(0.0)
    }
}
