//! Numeric inverse kinematics for any arm: damped least squares (Nakamura and Hanafusa, 1986).

use glam::DVec3;

use crate::chain::Chain;
use crate::linear;
use crate::rigid::Rigid;

/// Position (m) and rotation (rad) error from the current to the desired TCP pose, world axes.
pub(crate) fn tcp_error(current: &Rigid, desired: &Rigid) -> [f64; 6] {
    let linear = desired.translation - current.translation;
    let angular = rotation_vector(current, desired);
    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
}

/// Settings of the iterative solver.
pub(crate) struct DescentSettings {
    /// Allowed range of each joint [rad or m].
    pub ranges: Vec<Range>,
    /// Convergence tolerance [m and rad].
    pub tolerance: f64,
    /// Maximum number of iterations.
    pub iterations: usize,
    /// True to hold joints at the ends of their ranges and let the others compensate; mere clamping would converge
    /// short of the pose.
    pub hold_at_limits: bool,
    /// Null-space displacement of each joint in the first step [rad or m]; `None` for none.
    pub drift: Option<Vec<f64>>,
    /// Orientation of arms with fewer than six joints.
    pub few: FewJoints,
}

/// Orientation that an arm with fewer than six joints has to meet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FewJoints {
    /// Weight of orientation against position (m/rad): low, so that the arm meets the position, and the orientation as
    /// well as it can.
    weight: f64,
    /// Maximum error of the orientation (rad).
    pub max_error: f64,
}

impl FewJoints {
    /// Orientation met within 3.4 degrees.
    pub const MET: Self = Self { weight: 0.01, max_error: 0.06 };

    /// Orientation met within `max_error` (rad). The lower weight keeps the position exact despite a large error.
    pub fn turned_by_up_to(max_error: f64) -> Self {
        Self { weight: 0.004, max_error }
    }
}

/// Interval of joint positions [rad or m].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    pub lower: f64,
    pub upper: f64,
}

impl Range {
    /// Interval between two ends; their midpoint if they are reversed.
    pub fn new(lower: f64, upper: f64) -> Self {
        let middle = (lower + upper) / 2.0;
        if lower <= upper { Self { lower, upper } } else { Self { lower: middle, upper: middle } }
    }

    /// Intersection with `reach` around a value; the nearest end if empty.
    pub fn around(self, value: f64, reach: f64) -> Self {
        Self {
            lower: (value - reach).clamp(self.lower, self.upper),
            upper: (value + reach).clamp(self.lower, self.upper),
        }
    }
}

/// Maximum position error of a solution of an arm with fewer than six joints, m.
pub(crate) const FEW_POSITION: f64 = 2e-4;
/// Relative decrease of the error per iteration below which such an arm counts as converged to its nearest pose.
const FEW_STALLED: f64 = 1e-3;

/// Number of iterations within which the error of a followed pose must fall to [`PROGRESS`] of its value; otherwise the
/// limits keep the arm from the pose. Chosen: over 36,000 random tool motions, none that took longer converged within a
/// hundred iterations.
const PROGRESS_ITERATIONS: usize = 6;
const PROGRESS: f64 = 0.9;

/// Iterates from `config` towards the desired TCP pose within the ranges; `None` if it does not converge.
///
/// An arm with fewer than six joints meets the position, and the orientation as [`FewJoints`] says.
pub(crate) fn descend(chain: &Chain, desired: &Rigid, config: &[f64], settings: &DescentSettings) -> Option<Vec<f64>> {
    let mut config = config.to_vec();
    let mut frames = Vec::new();
    let mut drift = settings.drift.clone().filter(|drift| drift.len() == config.len());
    let (has_few, few) = (chain.tool_dof() < 6, settings.few);
    let mut before = f64::INFINITY;
    let mut checkpoint = f64::INFINITY;
    for iteration in 0..=settings.iterations {
        chain.frames_into(&config, &mut frames);
        let mut error = tcp_error(&chain.tcp(&frames), desired);
        if has_few {
            let length = |part: &[f64]| part.iter().map(|value| value * value).sum::<f64>().sqrt();
            let (position, orientation) = (length(&error[..3]), length(&error[3..]));
            let whole = position.hypot(few.weight * orientation);
            if before - whole < FEW_STALLED * whole && position < FEW_POSITION {
                return (orientation < few.max_error).then_some(config);
            }
            before = whole;
            error[3..].iter_mut().for_each(|value| *value *= few.weight);
        }
        let size = error.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        if size < settings.tolerance {
            return Some(config);
        }
        if settings.hold_at_limits && iteration.is_multiple_of(PROGRESS_ITERATIONS) {
            if size > PROGRESS * checkpoint {
                return None;
            }
            checkpoint = size;
        }
        let mut jacobian = chain.jacobian_at(&frames);
        if has_few {
            jacobian.iter_mut().flat_map(|column| &mut column[3..]).for_each(|value| *value *= few.weight);
        }
        let damping = (0.1 * size).min(0.05).powi(2);
        let mut drift = drift.take().unwrap_or_else(|| vec![0.0; config.len()]);
        let mut step = drifting_step(&jacobian, &error, damping, &drift)?;
        if settings.hold_at_limits {
            while let Some(joint) = pushed_beyond(&config, &step, &settings.ranges) {
                (jacobian[joint], drift[joint]) = ([0.0; 6], 0.0);
                step = drifting_step(&jacobian, &error, damping, &drift)?;
            }
        }
        let largest = step.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        let shorten = (0.3 / largest.max(1e-12)).min(1.0);
        for ((q, step), range) in config.iter_mut().zip(&step).zip(&settings.ranges) {
            *q = (*q + step * shorten).clamp(range.lower, range.upper);
        }
    }
    None
}

/// First joint at an end of its range that a step would move beyond it; `None` if there is none.
fn pushed_beyond(config: &[f64], step: &[f64], ranges: &[Range]) -> Option<usize> {
    config
        .iter()
        .zip(step)
        .zip(ranges)
        .position(|((&q, &step), range)| (step > 0.0 && q >= range.upper) || (step < 0.0 && q <= range.lower))
}

/// Step towards the pose with null-space drift: drift + Jᵀ(J·Jᵀ + damping·1)⁻¹ · (error − J·drift).
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

/// Damped least-squares step Jᵀ(J·Jᵀ + damping·1)⁻¹ · error; `None` if the matrix is singular.
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

/// Rotation vector (axis times angle) from one orientation to the other, world axes.
fn rotation_vector(current: &Rigid, desired: &Rigid) -> DVec3 {
    let (a, b) = (&current.rotation, &desired.rotation);
    let sine = (a.x_axis.cross(b.x_axis) + a.y_axis.cross(b.y_axis) + a.z_axis.cross(b.z_axis)) * 0.5;
    let cosine = (a.x_axis.dot(b.x_axis) + a.y_axis.dot(b.y_axis) + a.z_axis.dot(b.z_axis) - 1.0) * 0.5;
    let angle = sine.length().atan2(cosine);
    match sine.try_normalize() {
        Some(axis) => axis * angle,
        // Half turn: any axis that makes progress works.
        None if cosine < 0.0 => a.x_axis * std::f64::consts::PI,
        None => DVec3::ZERO,
    }
}
