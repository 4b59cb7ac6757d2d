//! Logistic regression of the weights of the point-cloud grasp sampler's score on grasp trials, and calibration of the
//! predicted probabilities on other trials.

use std::path::{Path, PathBuf};

use genmanip_motion::grasp::cloud::Weights;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::LabError;
use crate::calibration::Calibration;
use genmanip_core::{json, limits};
use genmanip_workspace::documents;
use genmanip_workspace::text_table;

/// Ridge penalty of every weight but the constant, relative to the log-likelihood of one trial.
const RIDGE: f64 = 1.0;
/// Maximum number of Newton steps, and number of bisection steps for the constant. Since the log-likelihood is concave,
/// about ten Newton steps suffice.
const STEPS: usize = 50;
/// Bins of the reliability table.
const BINS: usize = 5;

/// Fitted weights and the reliability of their predictions.
#[derive(Serialize)]
pub struct Report {
    /// Number of trials that the weights were fitted to.
    pub trials: usize,
    /// Fitted weights, rounded to two decimals.
    pub weights: Weights,
    /// Reliability of the new weights on their training trials.
    pub fitted: Reliability,
    /// Reliability of the new weights on test trials; `None` without test trials.
    pub tested: Option<Reliability>,
    /// Reliability of the current weights on test trials; `None` without test trials.
    pub in_use: Option<Reliability>,
}

/// Reliability of predicted probabilities of success.
#[derive(Serialize)]
pub struct Reliability {
    /// Number of trials that the predictions are compared with.
    pub trials: usize,
    /// Share of trials whose grasp held.
    pub held: f64,
    /// Brier scores and reliability bins of the predictions.
    #[serde(flatten)]
    pub calibration: Calibration,
}

/// One trial: 1 for the constant, then its features in the order of the weights' names; and true if the grasp held.
pub(crate) type Sample = (Vec<f64>, bool);

/// Fits the weights to trials (with `constant` only the constant), and tests them on others.
///
/// # Errors
/// If a file does not hold trials, or the grasp held in all trials or in none.
pub fn measure(trials: &[PathBuf], test: &[PathBuf], constant: bool) -> Result<Report, LabError> {
    let names = names();
    let samples = read(trials, &names)?;
    let test = read(test, &names)?;
    if samples.iter().all(|(_, held)| *held) || samples.iter().all(|(_, held)| !held) {
        let files: Vec<String> = trials.iter().map(|path| path.display().to_string()).collect();
        return Err(LabError::input(format!(
            "{}: found {} trials that all ended alike",
            files.join(", "),
            samples.len()
        ))
        .with_hint("expected held and lost grasps; try `genmanip-lab grasp --pick any` with more trials"));
    }
    let old = vector(&Weights::default(), &names);
    let fitted = if constant { shifted(&old, &samples) } else { fit(&samples) };
    let tested = |weights: &[f64]| (!test.is_empty()).then(|| reliability(weights, &test));
    Ok(Report {
        trials: samples.len(),
        weights: weights(&fitted, &names),
        fitted: reliability(&fitted, &samples),
        tested: tested(&fitted),
        in_use: tested(&old),
    })
}

/// Names of the weights, without the constant.
fn names() -> Vec<String> {
    let fields = serde_json::to_value(Weights::default()).unwrap_or_default();
    let names = fields.as_object().map(|fields| fields.keys().cloned().collect()).unwrap_or_else(Vec::new);
    names.into_iter().filter(|name| name != "bias").collect()
}

fn vector(weights: &Weights, names: &[String]) -> Vec<f64> {
    let fields = serde_json::to_value(weights).unwrap_or_default();
    let value = |name: &str| fields[name].as_f64().unwrap_or(0.0);
    std::iter::once(value("bias")).chain(names.iter().map(|name| value(name))).collect()
}

fn weights(vector: &[f64], names: &[String]) -> Weights {
    let round = |value: f64| Value::from((value * 100.0).round() / 100.0);
    let all = std::iter::once("bias").chain(names.iter().map(String::as_str));
    let fields: Map<String, Value> = all.zip(vector).map(|(name, &value)| (name.to_owned(), round(value))).collect();
    serde_json::from_value(fields.into()).unwrap_or_default()
}

/// Executed grasps from files of `genmanip-lab grasp --out`.
fn read(paths: &[PathBuf], names: &[String]) -> Result<Vec<Sample>, LabError> {
    let mut samples = Vec::new();
    for path in paths {
        for (index, line) in documents::read_text(path, limits::TRIALS)?.lines().enumerate() {
            let trial = json::parse(line).map_err(|error| broken(path, index, &error.to_string()))?;
            if trial["grasp"].is_null() && !trial["ending"].is_null() {
                continue;
            }
            let feature = |name: &String| trial["grasp"]["features"][name.as_str()].as_f64();
            let features: Option<Vec<f64>> = names.iter().map(feature).collect();
            let (Some(features), Some(ending)) = (features, trial["ending"].as_str()) else {
                return Err(broken(path, index, "no ending, or a feature is missing"));
            };
            samples.push((std::iter::once(1.0).chain(features).collect(), ending == "held"));
        }
    }
    Ok(samples)
}

fn broken(path: &Path, index: usize, why: &str) -> LabError {
    LabError::input(format!("line {} of {} is not a trial: {why}", index + 1, path.display()))
        .with_hint("expected a file of `genmanip-lab grasp --out`")
}

pub(crate) fn chance(weights: &[f64], features: &[f64]) -> f64 {
    1.0 / (1.0 + (-weights.iter().zip(features).map(|(weight, feature)| weight * feature).sum::<f64>()).exp())
}

/// Logistic regression by Newton's method (iteratively reweighted least squares) with a ridge; the constant is
/// unpenalised.
pub(crate) fn fit(samples: &[Sample]) -> Vec<f64> {
    let size = samples.first().map_or(0, |(features, _)| features.len());
    let mut weights = vec![0.0; size];
    for _ in 0..STEPS {
        let mut gradient: Vec<f64> = (0..size).map(|i| if i == 0 { 0.0 } else { -RIDGE * weights[i] }).collect();
        let mut hessian = vec![vec![0.0; size]; size];
        for (i, row) in hessian.iter_mut().enumerate() {
            row[i] = if i == 0 { 1e-9 } else { RIDGE };
        }
        for (features, held) in samples {
            let p = chance(&weights, features);
            for i in 0..size {
                gradient[i] += (f64::from(u8::from(*held)) - p) * features[i];
                for j in 0..size {
                    hessian[i][j] += p * (1.0 - p) * features[i] * features[j];
                }
            }
        }
        let step = solve(hessian, gradient);
        // The first steps are damped: far from the optimum the curvature is small, and a full Newton step overshoots.
        let longest = step.iter().fold(0.0_f64, |longest, value| longest.max(value.abs()));
        let share = (2.0 / longest.max(1e-12)).min(1.0);
        for (weight, step) in weights.iter_mut().zip(&step) {
            *weight += share * step;
        }
        if longest < 1e-9 {
            break;
        }
    }
    weights
}

/// The same weights with a new constant, so that the expected number of held grasps is the observed one; the ranking of
/// grasps does not change.
fn shifted(known: &[f64], samples: &[Sample]) -> Vec<f64> {
    let with =
        |shift: f64| known.iter().enumerate().map(|(i, w)| if i == 0 { w + shift } else { *w }).collect::<Vec<_>>();
    let missing = |shift: f64| {
        let weights = with(shift);
        samples.iter().map(|(features, held)| f64::from(u8::from(*held)) - chance(&weights, features)).sum::<f64>()
    };
    let (mut low, mut high) = (-30.0, 30.0);
    for _ in 0..STEPS {
        let middle = (low + high) / 2.0;
        if missing(middle) > 0.0 { low = middle } else { high = middle }
    }
    with((low + high) / 2.0)
}

/// Solves a symmetric positive definite system by Gaussian elimination, which needs no pivoting here.
fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let size = right.len();
    for pivot in 0..size {
        let above = matrix[pivot].clone();
        for row in pivot + 1..size {
            let factor = matrix[row][pivot] / above[pivot];
            for (entry, above) in matrix[row].iter_mut().zip(&above) {
                *entry -= factor * above;
            }
            right[row] -= factor * right[pivot];
        }
    }
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|column| matrix[row][column] * right[column]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    right
}

fn reliability(weights: &[f64], samples: &[Sample]) -> Reliability {
    let outcomes: Vec<(f64, bool)> =
        samples.iter().map(|(features, held)| (chance(weights, features), *held)).collect();
    let held = outcomes.iter().filter(|(_, held)| *held).count() as f64 / outcomes.len().max(1) as f64;
    Reliability { trials: outcomes.len(), held, calibration: Calibration::of(&outcomes, BINS) }
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let mut text = format!("fitted to {} trials\n", report.trials);
    for (name, value) in names().iter().zip(vector(&report.weights, &names()).iter().skip(1)) {
        text += &format!("  {name:<8} {value:6.2}\n");
    }
    text += &format!("  {:<8} {:6.2}\n", "constant", report.weights.bias);
    let parts =
        [("fitted", Some(&report.fitted)), ("tested", report.tested.as_ref()), ("in use", report.in_use.as_ref())];
    for (what, reliability) in parts {
        let Some(reliability) = reliability else { continue };
        text += &format!(
            "\n{what}: {} trials, {:.3} held, Brier score {:.4}, {:.4} for a constant\n",
            reliability.trials,
            reliability.held,
            reliability.calibration.brier,
            reliability.calibration.brier_of_base_rate
        );
        let mut rows = vec![["chance", "trials", "mean chance", "held"].map(String::from).to_vec()];
        for bin in &reliability.calibration.bins {
            rows.push(vec![
                format!("{:.1}-{:.1}", bin.from, bin.from + 1.0 / BINS as f64),
                bin.count.to_string(),
                format!("{:.3}", bin.mean_score),
                format!("{:.3}", bin.held),
            ]);
        }
        text += &text_table(&rows);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Outcomes sampled from known weights recover these weights, and calibrated probabilities.
    #[test]
    fn known_weights_are_found_again() {
        let truth = [0.5, 2.0, -3.0];
        let mut state = 1_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let samples: Vec<Sample> = (0..20_000)
            .map(|_| {
                let features = vec![1.0, draw(), draw()];
                let held = draw() < chance(&truth, &features);
                (features, held)
            })
            .collect();
        let found = fit(&samples);
        for (found, truth) in found.iter().zip(truth) {
            assert!((found - truth).abs() < 0.2, "{found} for {truth}");
        }
        let off = [-4.0, 2.0, -3.0];
        let back = shifted(&off, &samples);
        assert!((back[0] - truth[0]).abs() < 0.2 && back[1..] == truth[1..], "{back:?}");
        let Calibration { brier, brier_of_base_rate, bins } = reliability(&found, &samples).calibration;
        assert!(brier < brier_of_base_rate);
        for bin in bins.iter().filter(|bin| bin.count > 500) {
            assert!((bin.mean_score - bin.held).abs() < 0.04, "{} {}", bin.mean_score, bin.held);
        }
    }

    #[test]
    fn weights_and_vectors_are_two_sides_of_one_thing() {
        let names = names();
        assert_eq!(weights(&vector(&Weights::default(), &names), &names), Weights::default());
    }
}
