//! Collision-free motion planning: joint-space paths and straight TCP motions.

mod rrt;
mod settings;
mod smooth;
mod straight;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use genmanip_core::Seed;

use crate::collision::{Checker, CollisionReport};
use crate::path::{Path, distance};
pub use settings::PlanSettings;
pub use straight::StraightSettings;
pub(crate) use straight::straight_line;

/// Reason why no motion was planned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A configuration has the wrong length or is not finite.
    #[error("{which} configuration: expected {expected} finite joint positions, got {got:?}")]
    BadConfiguration {
        /// `start` or `goal`.
        which: &'static str,
        /// Number of arm joints.
        expected: usize,
        /// Values given.
        got: Vec<f64>,
    },
    /// A configuration lies outside the joint limits.
    #[error("{which} configuration is {beyond:.4} rad outside the joint limits")]
    OutsideLimits {
        /// `start` or `goal`.
        which: &'static str,
        /// Largest excess of a joint over its limit (rad or m).
        beyond: f64,
    },
    /// The start is in collision.
    #[error("the start is in collision: {}{}", .0, of_links(.0))]
    StartInCollision(CollisionReport),
    /// Every goal is in collision; the report is for the first.
    #[error("every goal is in collision; at the first, {}{}", .0, of_links(.0))]
    GoalInCollision(CollisionReport),
    /// No configuration reaches the target.
    #[error("out of reach: {what}")]
    Unreachable {
        /// The target and how far the arm got.
        what: String,
    },
    /// A straight motion is blocked.
    #[error("the straight line is blocked after {:.0} % of its length: {report}", fraction * 100.0)]
    Blocked {
        /// Free share of the line, 0-1.
        fraction: f64,
        /// The obstacle in the way and its distance.
        report: CollisionReport,
    },
    /// The search ended without a path.
    #[error("no path found in {iterations} iterations{}", straight_contact(straight_collision.as_ref()))]
    Exhausted {
        /// Nodes added by all searches together.
        iterations: usize,
        /// First collision of the straight joint-space path to the nearest goal; `None` if that path is free at the
        /// states checked.
        straight_collision: Option<CollisionReport>,
    },
}

/// Advice if two links of the robot block each other; empty otherwise.
fn of_links(report: &CollisionReport) -> &'static str {
    match report.between_links {
        true => {
            " (if these links cannot really meet: disable_collisions in an SRDF, or never_colliding of a robot file)"
        }
        false => "",
    }
}

fn straight_contact(straight_collision: Option<&CollisionReport>) -> String {
    straight_collision.map_or_else(String::new, |report| format!("; on the straight path {report}"))
}

/// Plans a path from `start` to the first goal found; start and goals are configurations.
///
/// Relaxes the clearances of `checker` for pairs that are too close at start or goal.
pub(crate) fn plan(
    checker: &mut Checker,
    settings: &PlanSettings,
    start: &[f64],
    goals: &[Vec<f64>],
    seed: Seed,
) -> Result<Path, PlanError> {
    let goals = free_goals(checker, settings, start, goals)?;
    let straight = |goal: &&Vec<f64>| checker.edges_are_free(vec![[start, goal]], settings.final_spacing);
    if let Some(goal) = goals.iter().find(straight) {
        return Ok(Path::polyline(vec![start.to_vec(), goal.clone()]));
    }
    let mut iterations = 0;
    for attempt in 0..=settings.retries {
        let spacing = (settings.search_spacing * 0.4_f64.powi(attempt as i32)).max(settings.final_spacing);
        let mut rng = seed.fork_index(attempt as u64).rng();
        let found = rrt::connect(checker, settings, spacing, start, &goals, &mut rng, &mut iterations);
        let Some(waypoints) = found else { return Err(exhausted(checker, start, &goals, iterations)) };
        if let Some(path) = smooth::smooth(checker, settings, waypoints, &mut rng) {
            return Ok(path);
        }
    }
    Err(exhausted(checker, start, &goals, iterations))
}

/// Error of an exhausted search; goals are sorted nearest first.
fn exhausted(checker: &Checker, start: &[f64], goals: &[Vec<f64>], iterations: usize) -> PlanError {
    let nearest = goals.first().map_or(start, Vec::as_slice);
    let straight = Path::polyline(vec![start.to_vec(), nearest.to_vec()]);
    let straight_collision = straight.states(0.02).iter().find_map(|state| checker.check(state));
    PlanError::Exhausted { iterations, straight_collision }
}

/// Checks start and goals; returns the free goals, nearest first.
fn free_goals(
    checker: &mut Checker,
    settings: &PlanSettings,
    start: &[f64],
    goals: &[Vec<f64>],
) -> Result<Vec<Vec<f64>>, PlanError> {
    within_limits(checker, "start", start)?;
    if goals.is_empty() {
        return Err(PlanError::Unreachable { what: "no goal configuration was given".into() });
    }
    checker.relax(start, settings.contact_tolerance).map_err(PlanError::StartInCollision)?;
    let mut free = Vec::new();
    let mut first_error = None;
    for goal in &goals.iter().flat_map(|goal| unwound(checker, start, goal)).collect::<Vec<_>>() {
        let tested = within_limits(checker, "goal", goal).and_then(|()| {
            let mut relaxed = checker.clone();
            relaxed.relax(goal, settings.contact_tolerance).map_err(PlanError::GoalInCollision)?;
            Ok(relaxed)
        });
        match tested {
            Ok(relaxed) => {
                *checker = relaxed;
                free.push(goal.clone());
            }
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    if let (true, Some(error)) = (free.is_empty(), first_error) {
        return Err(error);
    }
    free.sort_by(|a, b| distance(start, a).total_cmp(&distance(start, b)));
    Ok(free)
}

/// A goal with its continuous joints turned to within half a turn of the start, followed by variants in which one
/// continuous joint turns the other way round.
fn unwound(checker: &Checker, start: &[f64], goal: &[f64]) -> Vec<Vec<f64>> {
    let mut near = goal.to_vec();
    let mut around = Vec::new();
    for (index, joint) in checker.chain().joints().iter().enumerate().take(goal.len()) {
        if joint.continuous && near[index].is_finite() {
            near[index] -= TAU * ((near[index] - start[index]) / TAU).round();
            around.push(index);
        }
    }
    let other_way = |index: &usize| {
        let mut goal = near.clone();
        goal[*index] -= TAU.copysign(goal[*index] - start[*index]);
        goal
    };
    let others: Vec<Vec<f64>> = around.iter().map(other_way).collect();
    std::iter::once(near).chain(others).collect()
}

pub(crate) fn within_limits(checker: &Checker, which: &'static str, config: &[f64]) -> Result<(), PlanError> {
    let chain = checker.chain();
    if config.len() != chain.dof() || !config.iter().all(|q| q.is_finite()) {
        return Err(PlanError::BadConfiguration { which, expected: chain.dof(), got: config.to_vec() });
    }
    // Measured positions may be slightly beyond a limit.
    let margin = chain.limit_margin(config);
    if margin < -2e-3 {
        return Err(PlanError::OutsideLimits { which, beyond: -margin });
    }
    Ok(())
}
