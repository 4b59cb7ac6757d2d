//! Levenberg–Marquardt minimisation, and the tangent space of poses.

use genmanip_core::Pose;
use genmanip_core::glam::{DQuat, DVec3};

use crate::linear::Square;

/// Bounds on the effort of [`minimise_within`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Maximum number of iterations, each of which evaluates the problem once.
    pub iterations: usize,
    /// Relative reduction of the cost by an iteration at which the search ends.
    pub gain: f64,
}

impl Default for Effort {
    /// For cheap problems: from closed-form starts five to ten iterations suffice.
    fn default() -> Self {
        Self { iterations: 60, gain: 1e-12 }
    }
}

/// Normal equations at a point: cost, half its gradient, and the Gauss–Newton approximation of half its Hessian.
#[derive(Clone, Debug, PartialEq)]
pub struct Normal {
    /// Sum of squared, weighted residuals.
    pub cost: f64,
    /// Half the gradient: Jᵀ r.
    pub gradient: Vec<f64>,
    /// Gauss–Newton approximation of half the Hessian: Jᵀ J.
    pub hessian: Square,
}

impl Normal {
    /// Normal equations of `size` unknowns without residuals.
    pub fn new(size: usize) -> Self {
        Self { cost: 0.0, gradient: vec![0.0; size], hessian: Square::zero(size) }
    }

    /// Adds a residual, given with the non-zero entries (column, value) of its row of the Jacobian.
    pub fn add(&mut self, residual: f64, row: &[(usize, f64)], weight: f64) {
        self.cost += weight * residual * residual;
        for &(i, a) in row {
            self.gradient[i] += weight * a * residual;
            for &(j, b) in row {
                self.hessian.add(i, j, weight * a * b);
            }
        }
    }
}

impl AsRef<Self> for Normal {
    fn as_ref(&self) -> &Self {
        self
    }
}

/// Minimum of a sum of squares from a start, with the normal equations there; `evaluate` returns `None` outside the
/// domain. `None` if the start lies outside.
pub fn minimise<S>(
    start: S,
    evaluate: impl Fn(&S) -> Option<Normal>,
    step: impl Fn(&S, &[f64]) -> S,
) -> Option<(S, Normal)> {
    minimise_within(start, Effort::default(), |state, _| evaluate(state), step)
}

/// As [`minimise`], with bounded effort, for problems whose derivatives cost much more than their cost: `evaluate`
/// also gets the lowest cost so far, and may return `None` without derivatives above it.
pub fn minimise_within<S, E: AsRef<Normal>>(
    start: S,
    effort: Effort,
    evaluate: impl Fn(&S, f64) -> Option<E>,
    step: impl Fn(&S, &[f64]) -> S,
) -> Option<(S, E)> {
    let mut state = start;
    let mut found = evaluate(&state, f64::INFINITY)?;
    let mut damping = 1e-4;
    for _ in 0..effort.iterations {
        let normal = found.as_ref();
        let mut damped = normal.hessian.clone();
        (0..damped.size())
            .for_each(|index| damped.add(index, index, damping * normal.hessian.get(index, index) + 1e-15));
        let proposal = damped.cholesky().map(|factor| {
            let change: Vec<f64> = factor.solve(&normal.gradient).iter().map(|change| -change).collect();
            step(&state, &change)
        });
        let lowest = normal.cost;
        let better = proposal.and_then(|state| evaluate(&state, lowest).map(|next| (state, next)));
        match better.filter(|(_, next)| next.as_ref().cost <= lowest) {
            Some((next_state, next)) => {
                let cost = next.as_ref().cost;
                (state, found) = (next_state, next);
                damping = (damping / 10.0).max(1e-12);
                if lowest - cost <= effort.gain * cost || cost < 1e-24 {
                    break;
                }
            }
            None => {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }
    Some((state, found))
}

/// Pose changed in its own frame by a rotation vector (rad), then a translation (m).
pub fn moved(pose: &Pose, change: &[f64]) -> Pose {
    let part = |at: usize| DVec3::new(change[at], change[at + 1], change[at + 2]);
    *pose * Pose::new(part(3), DQuat::from_scaled_axis(part(0)))
}

/// Inverse of [`moved`] from the identity: rotation vector (rad) and position (m) of a pose.
pub fn tangent(pose: &Pose) -> [f64; 6] {
    let rotation = rotation_vector(pose.rotation);
    let (r, p) = (rotation.to_array(), pose.position.to_array());
    [r[0], r[1], r[2], p[0], p[1], p[2]]
}

/// Rotation vector with an angle of at most half a turn, rad.
pub fn rotation_vector(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    rotation.to_scaled_axis()
}
