//! Numeric inverse kinematics for any arm: damped least squares (Nakamura and Hanafusa, 1986).

use glam::DVec3;

use crate::chain::Chain;
use crate::linear;
use crate::rigid::Rigid;

/// Position (m) and rotation (rad) error from the current to the wanted tcp, world axes.
pub(crate) fn tcp_error(current: &Rigid, wanted: &Rigid) -> [f64; 6] {
    let linear = wanted.translation - current.translation;
    let angular = rotation_vector(current, wanted);
    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
}

/// How to walk towards a pose.
pub(crate) struct Descent {
    /// Range of each joint, rad or m.
    pub ranges: Vec<Range>,
    /// Largest error of an arrival, m and rad.
    pub tolerance: f64,
    /// Steps at most.
    pub iterations: usize,
    /// Whether a joint at an end of its range stays there while the others do its part; merely clamped, a walk along a
    /// limit ends short of the pose.
    pub holds_at_limits: bool,
    /// How far the first step would like to move each joint, rad or m, as far as that leaves the tool alone.
    pub drift: Option<Vec<f64>>,
}

/// What a joint may take on, rad or m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    pub lower: f64,
    pub upper: f64,
}

impl Range {
    /// All between two ends; their middle alone when they have changed sides.
    pub fn new(lower: f64, upper: f64) -> Self {
        let middle = (lower + upper) / 2.0;
        if lower <= upper { Self { lower, upper } } else { Self { lower: middle, upper: middle } }
    }

    /// What of it lies within `reach` of a value; the end next to it when nothing does.
    pub fn around(self, value: f64, reach: f64) -> Self {
        Self {
            lower: (value - reach).clamp(self.lower, self.upper),
            upper: (value + reach).clamp(self.lower, self.upper),
        }
    }
}

/// Walks from `config` towards the wanted tcp pose, never leaving the ranges; `None` when it does not arrive.
pub(crate) fn descend(chain: &Chain, wanted: &Rigid, config: &[f64], how: &Descent) -> Option<Vec<f64>> {
    let mut config = config.to_vec();
    let mut frames = Vec::new();
    let mut drift = how.drift.clone().filter(|drift| drift.len() == config.len());
    for _ in 0..=how.iterations {
        chain.frames_into(&config, &mut frames);
        let error = tcp_error(&chain.tcp(&frames), wanted);
        let size = error.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        if size < how.tolerance {
            return Some(config);
        }
        let mut jacobian = chain.jacobian_at(&frames);
        let damping = (0.1 * size).min(0.05).powi(2);
        let mut drift = drift.take().unwrap_or_else(|| vec![0.0; config.len()]);
        let mut step = drifting_step(&jacobian, &error, damping, &drift)?;
        if how.holds_at_limits {
            while let Some(joint) = pushed_beyond(&config, &step, &how.ranges) {
                (jacobian[joint], drift[joint]) = ([0.0; 6], 0.0);
                step = drifting_step(&jacobian, &error, damping, &drift)?;
            }
        }
        let largest = step.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        let shorten = (0.3 / largest.max(1e-12)).min(1.0);
        for ((q, step), range) in config.iter_mut().zip(&step).zip(&how.ranges) {
            *q = (*q + step * shorten).clamp(range.lower, range.upper);
        }
    }
    None
}

/// The first joint at an end of its range that a step would move beyond it.
fn pushed_beyond(config: &[f64], step: &[f64], ranges: &[Range]) -> Option<usize> {
    config
        .iter()
        .zip(step)
        .zip(ranges)
        .position(|((&q, &step), range)| (step > 0.0 && q >= range.upper) || (step < 0.0 && q <= range.lower))
}

/// What the tool leaves of `drift`, and the step towards the pose: drift + Jᵀ(J·Jᵀ + damping·1)⁻¹ · (error − J·drift).
fn drifting_step(jacobian: &[[f64; 6]], error: &[f64; 6], damping: f64, drift: &[f64]) -> Option<Vec<f64>> {
    let mut left = *error;
    for (column, drift) in jacobian.iter().zip(drift) {
        for (left, column) in left.iter_mut().zip(column) {
            *left -= column * drift;
        }
    }
    let step = damped_step(jacobian, &left, damping)?;
    Some(step.iter().zip(drift).map(|(step, drift)| step + drift).collect())
}

/// Jᵀ(J·Jᵀ + damping·1)⁻¹ · error.
fn damped_step(jacobian: &[[f64; 6]], error: &[f64; 6], damping: f64) -> Option<Vec<f64>> {
    let mut gram = [[0.0; 6]; 6];
    for column in jacobian {
        for (row, a) in gram.iter_mut().zip(column) {
            for (cell, b) in row.iter_mut().zip(column) {
                *cell += a * b;
            }
        }
    }
    for (index, row) in gram.iter_mut().enumerate() {
        row[index] += damping + 1e-12;
    }
    let weights = linear::solve(gram, *error)?;
    Some(jacobian.iter().map(|column| column.iter().zip(&weights).map(|(a, b)| a * b).sum()).collect())
}

/// Axis times angle of the turn that leads from one orientation to the other, world axes.
fn rotation_vector(current: &Rigid, wanted: &Rigid) -> DVec3 {
    let (a, b) = (&current.rotation, &wanted.rotation);
    let sine = (a.x_axis.cross(b.x_axis) + a.y_axis.cross(b.y_axis) + a.z_axis.cross(b.z_axis)) * 0.5;
    let cosine = (a.x_axis.dot(b.x_axis) + a.y_axis.dot(b.y_axis) + a.z_axis.dot(b.z_axis) - 1.0) * 0.5;
    let angle = sine.length().atan2(cosine);
    match sine.try_normalize() {
        Some(axis) => axis * angle,
        // A turn by half a circle: any axis that makes progress will do.
        None if cosine < 0.0 => a.x_axis * std::f64::consts::PI,
        None => DVec3::ZERO,
    }
}
