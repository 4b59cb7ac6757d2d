//! Random motions of an arm: pairs of collision-free configurations, connected by the planner or by plain RRT-Connect.

use std::sync::Arc;

use genmanip_core::{RobotModel, Seed};
use genmanip_motion::{AllowedCollisions, CollisionWorld, Planner, PlannerSettings, PlanningScene};
use rand::{Rng, RngExt};
use serde::Serialize;

use crate::clock::cpu_clock;

/// Joint distance between checked states, rad: half a degree.
const STEP_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// CPU time limit of the plain search per pair, s.
const PLAIN_S: f64 = 20.0;
/// Maximum edge length of the plain search (Euclidean distance in joint space), rad.
const PLAIN_EDGE: f64 = 0.3;
/// Maximum samples for one free configuration before the robot counts as always in collision.
const DRAWS: usize = 200;

/// Success, validity and cost of random motions of one arm.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Planned {
    /// Number of pairs of free configurations.
    pub pairs: usize,
    /// Number of pairs that the planner or the plain search connected.
    pub solvable: usize,
    /// Number of pairs that the planner connected.
    pub solved: usize,
    /// Number of the planner's paths with a state in collision, checked every half degree.
    pub touching: usize,
    /// Median CPU time of a call of the planner, failed calls included, s.
    pub plan_s: f64,
    /// Reason that a pair could not be sampled; no further pairs were tried. `None` if all were.
    pub refused: Option<String>,
    /// Errors of the planner on pairs that it did not connect.
    pub failures: Vec<String>,
}

/// Samples pairs of free configurations in an empty world and plans each motion.
///
/// # Errors
/// If the planner refuses the robot's model; the error is a description.
pub fn plan(model: RobotModel, pairs: usize, seed: Seed) -> Result<Planned, String> {
    let planner = Planner::new(Arc::new(model), PlannerSettings::default()).map_err(|error| error.to_string())?;
    let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
    let around = PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width: 0.0 };
    let checker = planner.checker(&around, 0.0);
    let is_free = |config: &[f64]| checker.is_free(config);
    let ranges = planner.ranges();
    let mut rng = seed.fork("strangers").rng();
    let draw = |rng: &mut dyn Rng| -> Vec<f64> { ranges.iter().map(|range| rng.random_range(range.clone())).collect() };
    let mut planned = Planned::default();
    let mut times = Vec::new();
    for pair in 0..pairs {
        let mut free = || (0..DRAWS).map(|_| draw(&mut rng)).find(|config| is_free(config));
        let (Some(start), Some(goal)) = (free(), free()) else {
            let contact = planner.check(&around, &planner.robot().home);
            planned.refused = Some(contact.map_or("no free configuration".into(), |contact| contact.to_string()));
            break;
        };
        planned.pairs += 1;
        let mut clock = cpu_clock();
        let found = planner.plan_joint(&around, &start, std::slice::from_ref(&goal), seed.fork_index(pair as u64));
        times.push(clock());
        match found {
            Ok(path) => {
                planned.solved += 1;
                planned.solvable += 1;
                let corners = path.states(STEP_RAD);
                let touches = corners.windows(2).any(|edge| !edge_is_free(&is_free, &edge[0], &edge[1]));
                planned.touching += usize::from(touches);
            }
            Err(error) => {
                let joined = plain(&is_free, &mut |rng| draw(rng), &start, &goal, &mut rng_of(seed, pair));
                planned.solvable += usize::from(joined);
                planned.failures.push(format!("{}{error}", if joined { "" } else { "(also by a plain search) " }));
            }
        }
    }
    times.sort_by(f64::total_cmp);
    planned.plan_s = times.get(times.len() / 2).copied().unwrap_or(0.0);
    Ok(planned)
}

fn rng_of(seed: Seed, pair: usize) -> impl Rng {
    seed.fork("plain search").fork_index(pair as u64).rng()
}

fn edge_is_free(is_free: &dyn Fn(&[f64]) -> bool, from: &[f64], to: &[f64]) -> bool {
    let largest = from.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let steps = (largest / STEP_RAD).ceil().max(1.0) as usize;
    (1..=steps).all(|step| is_free(&between(from, to, step as f64 / steps as f64)))
}

fn between(from: &[f64], to: &[f64], share: f64) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect()
}

/// True if RRT-Connect without shortcutting or smoothing connects two configurations within [`PLAIN_S`].
fn plain<R: Rng>(
    is_free: &dyn Fn(&[f64]) -> bool,
    draw: &mut dyn FnMut(&mut dyn Rng) -> Vec<f64>,
    start: &[f64],
    goal: &[f64],
    rng: &mut R,
) -> bool {
    let mut clock = cpu_clock();
    let mut trees = [vec![start.to_vec()], vec![goal.to_vec()]];
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let extend = |tree: &mut Vec<Vec<f64>>, target: &[f64]| -> Option<bool> {
        let near = tree.iter().min_by(|a, b| distance(a, target).total_cmp(&distance(b, target)))?.clone();
        let length = distance(&near, target);
        let next = if length <= PLAIN_EDGE { target.to_vec() } else { between(&near, target, PLAIN_EDGE / length) };
        if !edge_is_free(is_free, &near, &next) {
            return None;
        }
        tree.push(next);
        Some(length <= PLAIN_EDGE)
    };
    let mut growing = 0;
    while clock() < PLAIN_S {
        let sample = draw(rng);
        let [first, second] = &mut trees;
        let (active, other) = if growing == 0 { (first, second) } else { (second, first) };
        if extend(active, &sample).is_some() {
            let target = active[active.len() - 1].clone();
            loop {
                match extend(other, &target) {
                    Some(true) => return true,
                    Some(false) if clock() < PLAIN_S => {}
                    Some(false) | None => break,
                }
            }
        }
        growing = 1 - growing;
    }
    false
}
