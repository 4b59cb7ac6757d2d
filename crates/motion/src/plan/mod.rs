//! Collision-free motions: joint-space planning between configurations and straight lines of the tcp.

mod rrt;
mod smooth;
mod straight;
#[cfg(test)]
mod tests;

use genmanip_core::Seed;
use serde::{Deserialize, Serialize};

use crate::collision::{Checker, CollisionReport};
use crate::path::{Path, distance};
pub use straight::StraightSettings;
pub(crate) use straight::straight_line;

/// How joint-space paths are searched and smoothed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanSettings {
    /// Distance kept from everything that may not be touched.
    pub padding: f64,
    /// Depth by which start and goal may already penetrate something (contacts in physics do, a little).
    pub contact_tolerance: f64,
    /// Longest edge of the search tree, rad (`rrt_range` of the paper's planner, which used 0.001).
    pub rrt_range: f64,
    /// Every second sample is drawn at most this far outside the box that start and goals span, rad:
    /// most ways lead through there, and shorter ones.
    pub sample_around: f64,
    /// Nodes the search may add before it gives up.
    pub max_iterations: usize,
    /// Largest motion of any robot point between states tested during the search, m.
    pub search_spacing: f64,
    /// Largest motion of any robot point between states tested in the returned path, m;
    /// up to twice the padding nothing can be touched in between.
    pub final_spacing: f64,
    /// Searches with denser tests when the final test finds a contact.
    pub retries: usize,
    /// Random shortcuts tried.
    pub shortcuts: usize,
    /// Shortcuts that may fail in a row before the path counts as short.
    pub shortcut_failures: usize,
    /// Widest rounding of a corner, rad on either edge.
    pub blend: f64,
    /// How often the rounding may be halved before the robot has to stop at the corner.
    pub blend_halvings: usize,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            padding: 0.003,
            contact_tolerance: 0.001,
            rrt_range: 0.7,
            max_iterations: 50_000,
            sample_around: 1.0,
            search_spacing: 0.05,
            final_spacing: 0.006,
            retries: 3,
            shortcuts: 30,
            shortcut_failures: 10,
            blend: 0.4,
            blend_halvings: 5,
        }
    }
}

/// Why there is no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// A configuration has the wrong length or holds a number that is not finite.
    #[error("{which} configuration: expected {expected} finite joint positions, got {got:?}")]
    BadConfiguration {
        /// `start` or `goal`.
        which: &'static str,
        /// Number of arm joints.
        expected: usize,
        /// What was given.
        got: Vec<f64>,
    },
    /// A configuration lies outside the joint limits.
    #[error("{which} configuration is {beyond:.4} rad outside the joint limits")]
    OutsideLimits {
        /// `start` or `goal`.
        which: &'static str,
        /// By how much.
        beyond: f64,
    },
    /// The robot touches something where it is.
    #[error("the start is in collision: {0}")]
    StartInCollision(CollisionReport),
    /// The robot would touch something at every goal; the report is for the first.
    #[error("every goal is in collision; at the first, {0}")]
    GoalInCollision(CollisionReport),
    /// No configuration reaches what was asked for.
    #[error("out of reach: {what}")]
    Unreachable {
        /// What was asked for and how far the arm got.
        what: String,
    },
    /// A straight line runs into something.
    #[error("the straight line is blocked after {:.0} % of its way: {report}", fraction * 100.0)]
    Blocked {
        /// Part of the line that is free, 0-1.
        fraction: f64,
        /// What is in the way.
        report: CollisionReport,
    },
    /// The search ended without a path.
    #[error("no path found in {iterations} iterations{}", told(in_the_way.as_ref()))]
    Exhausted {
        /// Nodes added by all searches together.
        iterations: usize,
        /// What the straight way in joint space runs into first.
        in_the_way: Option<CollisionReport>,
    },
}

fn told(in_the_way: Option<&CollisionReport>) -> String {
    in_the_way.map_or_else(String::new, |report| format!("; on the straight way {report}"))
}

/// A path from `start` to the goal that is found first, start and goals given as configurations.
///
/// `checker` is left with the distances of pairs relaxed that are too close at start or goal.
pub(crate) fn plan(
    checker: &mut Checker,
    settings: &PlanSettings,
    start: &[f64],
    goals: &[Vec<f64>],
    seed: Seed,
) -> Result<Path, PlanError> {
    let goals = admit(checker, settings, start, goals)?;
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

/// Nothing was found from `start` to any of the goals, the nearest first.
fn exhausted(checker: &Checker, start: &[f64], goals: &[Vec<f64>], iterations: usize) -> PlanError {
    let nearest = goals.first().map_or(start, Vec::as_slice);
    let straight = Path::polyline(vec![start.to_vec(), nearest.to_vec()]);
    let in_the_way = straight.states(0.02).iter().find_map(|state| checker.check(state));
    PlanError::Exhausted { iterations, in_the_way }
}

/// Tests start and goals; returns the goals that are free, nearest first.
fn admit(
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
    let mut first_problem = None;
    for goal in goals {
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
            Err(problem) => first_problem = first_problem.or(Some(problem)),
        }
    }
    if let (true, Some(problem)) = (free.is_empty(), first_problem) {
        return Err(problem);
    }
    free.sort_by(|a, b| distance(start, a).total_cmp(&distance(start, b)));
    Ok(free)
}

pub(crate) fn within_limits(checker: &Checker, which: &'static str, config: &[f64]) -> Result<(), PlanError> {
    let chain = checker.chain();
    if config.len() != chain.dof() || !config.iter().all(|q| q.is_finite()) {
        return Err(PlanError::BadConfiguration { which, expected: chain.dof(), got: config.to_vec() });
    }
    // Measured positions may lie a hair outside.
    let margin = chain.limit_margin(config);
    if margin < -2e-3 {
        return Err(PlanError::OutsideLimits { which, beyond: -margin });
    }
    Ok(())
}
