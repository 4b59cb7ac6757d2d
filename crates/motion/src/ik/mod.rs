//! Inverse kinematics: all solutions for a TCP pose, best first.

mod franka;
mod numeric;
mod reach;
#[cfg(test)]
mod tests;

use genmanip_core::{Pose, Seed};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::chain::Chain;
use crate::rigid::Rigid;
use franka::FrankaGeometry;
use numeric::{DescentSettings, FewJoints, Range, descend};
use reach::Reach;

/// Settings for the search and ranking of IK solutions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IkSettings {
    /// Number of values of the free joint (joint 7 of the Panda) in the analytic solver's sweep, evenly spread over its
    /// range.
    pub free_joint_values: usize,
    /// Number of values of the fine sweep if the coarse one finds nothing (poses at the reach limit).
    pub fine_free_joint_values: usize,
    /// Margin to the joint limits, at most a twentieth of a joint's range [rad or m].
    pub limit_margin: f64,
    /// Number of start configurations of the numeric solver.
    pub numeric_starts: usize,
    /// Maximum iterations of the numeric solver per start.
    pub numeric_iterations: usize,
    /// Maximum error of a solution [m and rad].
    pub tolerance: f64,
    /// Minimum distance of distinct solutions (largest joint difference) [rad or m].
    pub distinct: f64,
    /// Maximum number of solutions returned.
    pub max_solutions: usize,
    /// Weight of the distance to the reference configuration, per rad.
    pub reference_weight: f64,
    /// Weight of being near a joint limit (1 at the limit, 0 from 0.5 rad or a quarter of the range on), summed over the
    /// joints.
    pub limit_weight: f64,
    /// Weight of being near a singularity (1 at it, halved at manipulability 0.05).
    pub singularity_weight: f64,
}

/// Maximum limit margin of continued motions (rad); they may come closer than new ones.
const CONTINUED_MARGIN: f64 = 0.005;

/// Maximum number of iterations of [`InverseKinematics::follow_drifting`]. Chosen by hand.
const DRIFTING_ITERATIONS: usize = 30;

impl Default for IkSettings {
    fn default() -> Self {
        Self {
            free_joint_values: 64,
            fine_free_joint_values: 2048,
            limit_margin: 0.02,
            numeric_starts: 32,
            numeric_iterations: 100,
            tolerance: 1e-10,
            distinct: 0.05,
            max_solutions: 48,
            reference_weight: 1.0,
            limit_weight: 1.5,
            singularity_weight: 1.0,
        }
    }
}

/// Inverse kinematics of one arm: analytic for the Panda's geometry, numeric otherwise.
#[derive(Clone, Debug)]
pub struct InverseKinematics {
    chain: Chain,
    franka: Option<FrankaGeometry>,
    reach: Reach,
    settings: IkSettings,
}

impl InverseKinematics {
    /// Solver for an arm, closed-form if its geometry is that of the Panda.
    pub fn new(chain: Chain, settings: IkSettings) -> Self {
        Self { franka: FrankaGeometry::of(&chain), reach: Reach::of(&chain), chain, settings }
    }

    /// True if the closed-form solver is used.
    pub fn is_analytic(&self) -> bool {
        self.franka.is_some()
    }

    /// IK solutions for a TCP pose, best first; empty if it is unreachable.
    ///
    /// `reference` is the preferred configuration. Every solution keeps the limit margin and is exact to the tolerance.
    pub fn solve(&self, world_from_tcp: &Pose, reference: &[f64]) -> Vec<Vec<f64>> {
        self.solutions(world_from_tcp, reference).collect()
    }

    /// Lazy version of [`InverseKinematics::solve`]: solutions are refined on demand.
    pub fn solutions(&self, world_from_tcp: &Pose, reference: &[f64]) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.refined(world_from_tcp, reference, Self::unrefined)
    }

    /// Like [`InverseKinematics::solutions`] without the fine sweep at the reach limit, which makes the closed form
    /// thirty times faster for unreachable poses. Makes no difference for other arms.
    pub fn coarse_solutions(
        &self,
        world_from_tcp: &Pose,
        reference: &[f64],
    ) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.refined(world_from_tcp, reference, |ik, wanted, reference| match &ik.franka {
            Some(franka) => ik.sweep(franka, wanted, reference, ik.settings.free_joint_values),
            None => ik.unrefined(wanted, reference),
        })
    }

    fn refined(
        &self,
        world_from_tcp: &Pose,
        reference: &[f64],
        search: fn(&Self, &Rigid, &[f64]) -> Vec<Vec<f64>>,
    ) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        let finite = world_from_tcp.position.is_finite() && world_from_tcp.rotation.is_finite();
        let wanted = Rigid::from(world_from_tcp);
        let mut solutions = Vec::new();
        if finite && reference.len() == self.chain.dof() && self.reach.may_contain(&wanted) {
            solutions = self.ranked(search(self, &wanted, reference), reference);
        }
        // Refinement restores the digits that the closed form loses near singularities.
        let how = DescentSettings { iterations: 10, ..self.descent() };
        solutions.into_iter().filter_map(move |config| descend(&self.chain, &wanted, &config, &how))
    }

    /// Solutions before refinement, in no order.
    fn unrefined(&self, wanted: &Rigid, reference: &[f64]) -> Vec<Vec<f64>> {
        let mut solutions = Vec::new();
        if let Some(franka) = &self.franka {
            solutions = self.sweep(franka, wanted, reference, self.settings.free_joint_values);
            if solutions.is_empty() {
                solutions = self.sweep(franka, wanted, reference, self.settings.fine_free_joint_values);
            }
        }
        if solutions.is_empty() {
            solutions = self.descend_from_random_starts(wanted, reference);
        }
        solutions
    }

    /// Solution that continues a motion from `previous`.
    ///
    /// `None` if no solution is within `max_step` (largest joint difference) of `previous`.
    pub fn continue_from(&self, world_from_tcp: &Pose, previous: &[f64], max_step: f64) -> Option<Vec<f64>> {
        let how = DescentSettings { ranges: self.ranges(self.continued_margin()).collect(), ..self.descent() };
        let solution = descend(&self.chain, &Rigid::from(world_from_tcp), previous, &how)?;
        (largest_difference(&solution, previous) <= max_step).then_some(solution)
    }

    /// Like [`InverseKinematics::continue_from`], except that an arm with fewer than six joints may turn the tool away
    /// from the wanted orientation by up to `max_turn` (rad) where its limits require it.
    pub fn continue_line(
        &self,
        world_from_tcp: &Pose,
        previous: &[f64],
        max_step: f64,
        max_turn: f64,
    ) -> Option<Vec<f64>> {
        let turned = || {
            let how = DescentSettings {
                ranges: self.ranges(self.continued_margin()).collect(),
                hold_at_limits: true,
                few: FewJoints::turned_by_up_to(max_turn),
                ..self.descent()
            };
            let solution = descend(&self.chain, &Rigid::from(world_from_tcp), previous, &how)?;
            (largest_difference(&solution, previous) <= max_step).then_some(solution)
        };
        let kept = self.continue_from(world_from_tcp, previous, max_step);
        if self.chain.tool_dof() < 6 { kept.or_else(turned) } else { kept }
    }

    /// Solution that follows a tool pose. A joint at its limit, or at the end of its `reach` around `previous` (rad or
    /// m, base to hand), is held while the others continue.
    ///
    /// `None` if the pose is unreachable that way; an infinite reach means no bound.
    pub fn follow(&self, world_from_tcp: &Pose, previous: &[f64], reach: &[f64]) -> Option<Vec<f64>> {
        let how = self.following(previous, reach);
        descend(&self.chain, &Rigid::from(world_from_tcp), previous, &how)
    }

    /// Like [`InverseKinematics::follow`] with null-space motion: each joint moves by `drift` (rad or m, base to hand)
    /// as far as this does not change the tool pose. `None` if it does not converge, even if it would without drift.
    pub fn follow_drifting(
        &self,
        world_from_tcp: &Pose,
        previous: &[f64],
        reach: &[f64],
        drift: Vec<f64>,
    ) -> Option<Vec<f64>> {
        let how =
            DescentSettings { drift: Some(drift), iterations: DRIFTING_ITERATIONS, ..self.following(previous, reach) };
        descend(&self.chain, &Rigid::from(world_from_tcp), previous, &how)
    }

    fn following(&self, previous: &[f64], reach: &[f64]) -> DescentSettings {
        let near = previous.iter().zip(reach);
        let ranges = self.ranges(self.continued_margin()).zip(near).map(|(range, (&q, &reach))| range.around(q, reach));
        DescentSettings { ranges: ranges.collect(), hold_at_limits: true, ..self.descent() }
    }

    fn descent(&self) -> DescentSettings {
        let IkSettings { limit_margin, tolerance, numeric_iterations, .. } = self.settings;
        let ranges = self.ranges(limit_margin).collect();
        DescentSettings {
            ranges,
            tolerance,
            iterations: numeric_iterations,
            hold_at_limits: false,
            drift: None,
            few: FewJoints::MET,
        }
    }

    fn continued_margin(&self) -> f64 {
        self.settings.limit_margin.min(CONTINUED_MARGIN)
    }

    /// Joint ranges reduced by a margin at either end.
    fn ranges(&self, margin: f64) -> impl Iterator<Item = Range> + use<'_> {
        self.chain.joints().iter().map(move |joint| {
            let margin = joint.margin(margin);
            Range::new(joint.lower + margin, joint.upper - margin)
        })
    }

    /// Range per joint that contains all solutions: the limits less the margin, or one turn of a continuous joint.
    pub fn solved_ranges(&self) -> Vec<std::ops::RangeInclusive<f64>> {
        let margin = |joint: &crate::chain::ChainJoint| joint.margin(self.settings.limit_margin);
        let range = |joint: &crate::chain::ChainJoint| match joint.continuous {
            true => joint.sampled(),
            false => joint.lower + margin(joint)..=joint.upper - margin(joint),
        };
        self.chain.joints().iter().map(range).collect()
    }

    /// All closed-form branches for one value of the free joint (joint 7), inside the joint limits, unrefined; empty
    /// without a closed form.
    pub fn branches(&self, world_from_tcp: &Pose, free_joint: f64, reference: &[f64]) -> Vec<Vec<f64>> {
        let Some(franka) = &self.franka else { return Vec::new() };
        let mut found = Vec::new();
        let joint1 = reference.first().copied().unwrap_or(0.0);
        for config in franka.solve(&Rigid::from(world_from_tcp), free_joint, joint1).iter() {
            found.extend(self.within_limits(config, self.settings.limit_margin));
        }
        found
    }

    fn sweep(&self, franka: &FrankaGeometry, wanted: &Rigid, reference: &[f64], values: usize) -> Vec<Vec<f64>> {
        let Some(free) = self.chain.joints().last() else { return Vec::new() };
        let margin = self.settings.limit_margin;
        let (lower, upper) = (free.lower + free.margin(margin), free.upper - free.margin(margin));
        let grid = (0..values).map(|k| lower + (upper - lower) * (k as f64 + 0.5) / values as f64);
        let near = reference[reference.len() - 1].clamp(lower, upper.max(lower));
        let mut solutions = Vec::new();
        for joint7 in std::iter::once(near).chain(grid) {
            for config in franka.solve(wanted, joint7, reference[0]).iter() {
                solutions.extend(self.within_limits(config, margin));
            }
        }
        solutions
    }

    fn descend_from_random_starts(&self, wanted: &Rigid, reference: &[f64]) -> Vec<Vec<f64>> {
        let s = &self.settings;
        let mut rng = Seed::new(0).fork("inverse kinematics").rng();
        let starts = (0..s.numeric_starts).map(|start| {
            let draw = |joint: &crate::chain::ChainJoint| rng.random_range(joint.sampled());
            if start == 0 { reference.to_vec() } else { self.chain.joints().iter().map(draw).collect() }
        });
        let how = self.descent();
        let solutions = starts.filter_map(|start| descend(&self.chain, wanted, &start, &how));
        solutions.map(|solution| self.unwound(solution, reference)).collect()
    }

    /// The same posture, with each joint whose range exceeds a full turn moved as near to the reference as its limits
    /// allow; other joints have one position only.
    fn unwound(&self, mut config: Vec<f64>, reference: &[f64]) -> Vec<f64> {
        let turn = std::f64::consts::TAU;
        for ((q, near), joint) in config.iter_mut().zip(reference).zip(self.chain.joints()) {
            let margin = joint.margin(self.settings.limit_margin);
            let (lower, upper) = (joint.lower + margin, joint.upper - margin);
            if joint.is_prismatic || joint.upper - joint.lower <= turn {
                continue;
            }
            let turns = ((near - *q) / turn).round();
            let moved = *q + turns * turn;
            // One turn back where the nearest position is beyond a limit.
            *q = [moved, moved + turn, moved - turn].into_iter().find(|q| (lower..=upper).contains(q)).unwrap_or(*q);
        }
        config
    }

    /// Configuration with each angle moved by full turns into its limits; `None` if one of them cannot be.
    fn within_limits(&self, config: &[f64], margin: f64) -> Option<Vec<f64>> {
        let turn = std::f64::consts::TAU;
        let mut inside = Vec::with_capacity(config.len());
        for (q, joint) in config.iter().zip(self.chain.joints()) {
            let (lower, upper) = (joint.lower + joint.margin(margin), joint.upper - joint.margin(margin));
            let q = q + ((lower - q) / turn).ceil() * turn;
            if q.is_nan() || q > upper {
                return None;
            }
            inside.push(q);
        }
        Some(inside)
    }

    fn ranked(&self, solutions: Vec<Vec<f64>>, reference: &[f64]) -> Vec<Vec<f64>> {
        let mut scored: Vec<(f64, Vec<f64>)> =
            solutions.into_iter().map(|config| (self.cost(&config, reference), config)).collect();
        scored.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut kept: Vec<Vec<f64>> = Vec::new();
        for (_, config) in scored {
            if kept.len() >= self.settings.max_solutions {
                break;
            }
            if kept.iter().all(|other| largest_difference(other, &config) >= self.settings.distinct) {
                kept.push(config);
            }
        }
        kept
    }

    fn cost(&self, config: &[f64], reference: &[f64]) -> f64 {
        let s = &self.settings;
        let distance = crate::path::distance(config, reference);
        let near_limits: f64 = config
            .iter()
            .zip(self.chain.joints())
            .map(|(q, joint)| {
                let near = 0.5_f64.min(0.25 * (joint.upper - joint.lower));
                (1.0 - (q - joint.lower).min(joint.upper - q) / near).max(0.0).powi(2)
            })
            .sum();
        let singular = 0.05 / (0.05 + self.chain.manipulability(config));
        s.reference_weight * distance + s.limit_weight * near_limits + s.singularity_weight * singular
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
