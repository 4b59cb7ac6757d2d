//! Search for the unknowns: coarse starts, then Levenberg–Marquardt on all of them.

use std::cell::RefCell;

use genmanip_core::RobotModel;
use genmanip_real::least_squares::{Effort, minimise_within};

use crate::parameters::{Parameter, Values};
use crate::problem::{Evaluation, Problem, Unknown};
use crate::recording::Recording;
use crate::uncertainty::{WIDEST, Z};

/// Distance, as a share of the value or of the typical size, beyond which a pass with fresh derivatives follows.
const MOVED: f64 = 0.1;

/// Settings of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchSettings {
    /// Latencies that are tried, s.
    pub latencies_s: Vec<f64>,
    /// Starts of the coarse search: factors of gains and of damping, and friction loss in typical sizes.
    pub starts: Vec<[f64; 3]>,
    /// Duration that the coarse search compares in each recording, s.
    pub coarse_s: f64,
    /// Effort of the coarse search from each start.
    pub coarse: Effort,
    /// Effort of each pass of the search for all parameters.
    pub fine: Effort,
    /// Maximum number of passes.
    pub passes: usize,
    /// Values of a friction coefficient that are tried, geometrically spaced between the first and the second.
    pub frictions: ([f64; 2], usize),
    /// Smallest noise that is assumed, rad or m: below it the simulator's own rounding counts.
    pub least_noise: f64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        Self {
            latencies_s: vec![0.004, 0.015, 0.03, 0.05, 0.075, 0.11, 0.16, 0.23, 0.33],
            starts: vec![[1.0, 1.0, 0.7], [0.7, 2.0, 2.0]],
            coarse_s: 1.0,
            coarse: Effort { iterations: 5, gain: 3e-2 },
            fine: Effort { iterations: 10, gain: 1e-5 },
            passes: 5,
            frictions: ([0.08, 2.0], 10),
            least_noise: 1e-6,
        }
    }
}

/// Solution of a search.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Unknowns, in typical sizes.
    pub point: Vec<f64>,
    /// Residuals and derivatives there.
    pub evaluation: Evaluation,
    /// Noise of each channel, estimated from the residuals, rad or m.
    pub noise: Vec<f64>,
    /// Root-mean-square residuals that the coarse search reached from each of its starts, rad or m.
    pub starts_rms: Vec<f64>,
}

/// Coarse values of the arm's parameters: one factor per kind of parameter for all joints that have it among them, on
/// the beginning of the recordings, from several starts. Best first.
pub fn coarse(
    problem: &Problem,
    parameters: &[Parameter],
    nominal: &Values,
    robot: &RobotModel,
    settings: &SearchSettings,
) -> Option<(Values, Vec<f64>)> {
    let beginnings: Vec<Recording> =
        problem.recordings.iter().map(|(recording, _)| beginning(recording, settings.coarse_s)).collect();
    let joints = robot.arm_dof();
    let group = |kind: fn(usize) -> Parameter, start: f64| {
        let is_of_kind = |it: &&Parameter| it.joint().is_some_and(|joint| **it == kind(joint));
        let members = parameters.iter().filter(is_of_kind).map(|it| (*it, it.scale(nominal, robot))).collect();
        Unknown { bounds: kind(0).bounds(), members, start }
    };
    let single = |parameter: Parameter, start: f64| Unknown {
        members: vec![(parameter, parameter.scale(nominal, robot))],
        start,
        bounds: parameter.bounds(),
    };
    let has_payload = beginnings.iter().any(|recording| Parameter::PayloadMass.is_shown_by(recording.motion));
    let unknowns = |[gains, damping, friction]: [f64; 3], latency_s: f64| {
        let latency = single(Parameter::Latency, latency_s / Parameter::Latency.scale(nominal, robot));
        let mut all = vec![
            group(Parameter::Kp, gains),
            group(Parameter::Kv, gains),
            group(Parameter::Damping, damping),
            group(Parameter::FrictionLoss, friction),
            latency,
        ];
        all.extend(has_payload.then(|| single(Parameter::PayloadMass, 1.0)));
        all
    };
    let with = |unknowns: Vec<Unknown>| Problem {
        recordings: beginnings.iter().map(|recording| (recording, recording.settled()..recording.len())).collect(),
        unknowns,
        noise: vec![1e-3; joints],
        base: problem.base.clone(),
        held: problem.held.clone(),
        derivatives: RefCell::default(),
        ..*problem
    };
    let cost_of = |latency_s: &f64| {
        let problem = with(unknowns(*settings.starts.first()?, *latency_s));
        let start = problem.start();
        Some((problem.cost(&start, &problem.residuals(&start)?), *latency_s))
    };
    let mut latencies: Vec<(f64, f64)> = settings.latencies_s.iter().filter_map(cost_of).collect();
    latencies.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut starts: Vec<([f64; 3], f64)> = Vec::new();
    if let Some(&(_, best)) = latencies.first() {
        starts.extend(settings.starts.iter().map(|start| (*start, best)));
    }
    if let (Some(&(_, second)), Some(start)) = (latencies.get(1), settings.starts.first()) {
        starts.push((*start, second));
    }
    let solve = |(start, latency_s): ([f64; 3], f64)| {
        let problem = with(unknowns(start, latency_s));
        let (point, found) = minimise_within(
            problem.start(),
            settings.coarse,
            |point, highest| problem.evaluate(point, highest),
            |point, change| problem.moved(point, change),
        )?;
        let rms = (found.residuals.iter().map(|it| it * it).sum::<f64>() / found.residuals.len().max(1) as f64).sqrt();
        Some((rms, problem.values(&point)))
    };
    let mut solved: Vec<(f64, Values)> = starts.into_iter().filter_map(solve).collect();
    solved.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all = solved.iter().map(|(rms, _)| *rms).collect();
    solved.into_iter().next().map(|(_, values)| (values, all))
}

/// Minimum over all unknowns from their start, with the noise of the channels estimated on the way.
pub fn fine(problem: &mut Problem, settings: &SearchSettings, starts_rms: Vec<f64>) -> Option<Solution> {
    let start = problem.start();
    // The first residuals weigh the channels; the second, near the minimum, are noise alone if the model is right.
    let residuals = problem.residuals(&start)?;
    problem.estimate_noise(&residuals, settings.least_noise);
    let mut point = start;
    for pass in 1.. {
        // Every pass starts with derivatives of its own.
        problem.derivatives.take();
        let (next, found) = minimise_within(
            point.clone(),
            settings.fine,
            |point, highest| problem.evaluate(point, highest),
            |point, change| problem.moved(point, change),
        )?;
        problem.estimate_noise(&found.residuals, settings.least_noise);
        let evaluation = problem.weighed(&next, found);
        let is_settled = pass > 1 && !has_moved(&evaluation, &point, &next);
        point = next;
        if is_settled || pass >= settings.passes {
            return Some(Solution { point, evaluation, noise: problem.noise.clone(), starts_rms });
        }
    }
    None
}

/// True if an unknown that can be identified moved so far that derivatives from before no longer hold.
fn has_moved(evaluation: &Evaluation, from: &[f64], to: &[f64]) -> bool {
    let Some(factor) = evaluation.normal.hessian.cholesky() else { return false };
    let covariance = factor.inverse_block(to.len());
    let is_far = |index: usize| {
        let size = to[index].abs().max(1.0);
        let is_known = Z * covariance.get(index, index).sqrt() < WIDEST * size;
        is_known && (to[index] - from[index]).abs() > MOVED * size
    };
    (0..to.len()).any(is_far)
}

/// First seconds of a recording, counted from the first moment that is compared.
fn beginning(recording: &Recording, duration_s: f64) -> Recording {
    let mut cut = recording.clone();
    let start_s = cut.time_s.get(cut.settled()).copied().unwrap_or_default();
    let rows = cut.time_s.partition_point(|time| *time <= start_s + duration_s);
    cut.time_s.truncate(rows);
    cut.command_rad.truncate(rows);
    cut.joint_rad.truncate(rows);
    cut.width_m.truncate(rows);
    cut
}
