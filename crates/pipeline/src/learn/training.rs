//! Training into a folder, with checkpoints, metrics and the finished policy.
//!
//! ```text
//! checkpoint.safetensors   state of an unfinished training run, from which the same call continues
//! metrics.csv              loss, gradient norm, learning rate and time over steps
//! training.html            curves, and predicted and recorded actions; written at the end
//! weights.safetensors      averaged weights of the finished policy
//! policy.json              description of the policy; written last
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_core::{Document, Seed};
use genmanip_data::files;
use genmanip_policy::{
    Checkpoint, Head, ModelSettings, Network, PolicyDescription, Precision, Preset, TrainError, Trainer, TrainingFacts,
    TrainingSettings, TrainingStep,
};
use genmanip_workspace::{Progress, WorkspaceError, documents};
use serde::{Deserialize, Serialize};

use super::options::{Length, TrainOptions, Trained};
use super::presets::{PresetSettings, settings};
use super::{demonstrations, images, page};
use crate::learned::policy::{DESCRIPTION, MAX_DESCRIPTION, MAX_WEIGHTS, WEIGHTS};

const CHECKPOINT: &str = "checkpoint.safetensors";
const METRICS: &str = "metrics.csv";
const PAGE: &str = "training.html";
/// Keys of the checkpoint's metadata: identity of the training run, and number of steps.
const IDENTITY: &str = "training";
const STEPS: &str = "steps";

/// Number of steps after which a time budget is converted to a number of steps, and number of these that are timed.
const TIMED_AFTER: u64 = 50;
const WARM_AFTER: u64 = 10;
/// Interval between checkpoints, s: the maximum time lost by a kill. Chosen by hand.
const CHECKPOINT_EVERY_S: f64 = 30.0;
/// Number of steps per line of the metrics.
const STEPS_PER_LINE: u64 = 20;
/// Number of batches on which the error of the final weights is measured.
const FINAL_BATCHES: u64 = 16;

/// Everything that determines the weights, except the number of steps within a time budget. A run continues only with
/// an equal identity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Identity {
    preset: Preset,
    run: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    sources: Vec<String>,
    demonstrations: usize,
    rows: usize,
    seed: Seed,
    length: Length,
    model: ModelSettings,
    settings: TrainingSettings,
    genmanip_version: String,
}

/// Trains a policy on the verified episodes of a run, or continues from a checkpoint. `None` if interrupted, after
/// writing a checkpoint.
///
/// # Errors
/// When the run cannot be read, the folder holds another training run, the loss is no longer finite, or a file cannot
/// be written; the last checkpoint is kept.
pub fn train(
    options: &TrainOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Trained>, WorkspaceError> {
    let preset = settings(options.preset, options.labels);
    let TrainOptions { run, sources, threads, .. } = options;
    let Some(read) = demonstrations::read(run, sources, &preset, *threads, progress, stop)? else {
        return Ok(None);
    };
    let PresetSettings { model, execute, training, privileged, .. } = preset;
    let arrays = &read.arrays;
    // The noise of a flow takes the place of the latent style.
    let latent = if options.head == Head::Flow { 0 } else { model.latent };
    let model = ModelSettings { head: options.head, latent, ..model };
    let identity = Identity {
        preset: options.preset,
        run: read.run.clone(),
        sources: sources.iter().map(|source| source.name().to_owned()).collect(),
        demonstrations: arrays.episodes.len(),
        rows: arrays.total_rows(),
        seed: options.seed,
        length: options.length,
        model,
        settings: training,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    };
    let out = options.out.as_path();
    std::fs::create_dir_all(out).map_err(|error| WorkspaceError::file("create", out, error))?;
    documents::sweep(out)?;
    if let Some(known) = finished(out)? {
        return known.of(&identity, out).map(Some);
    }
    let Some(images) = images::of_rows(&read, options.threads, progress, stop)? else { return Ok(None) };
    let cannot = |error: TrainError| cannot_train(error, out);
    let trainer = Trainer::new(arrays, &*images, &identity.model, &identity.settings, options.seed, options.threads);
    let mut course = Course::open(trainer.map_err(cannot)?, &identity, out)?;
    let Some(steps) = course.run(progress, stop)? else { return Ok(None) };
    let Course { mut trainer, resumed_from, started, metrics, .. } = course;
    let seconds = started.elapsed().as_secs_f64();
    let weights = trainer.average();
    let description = PolicyDescription {
        preset: identity.preset,
        privileged,
        model: identity.model.clone(),
        inputs: arrays.inputs.clone(),
        contract: read.contract.clone(),
        execute,
        normalisation: trainer.normalisation().clone(),
        training: TrainingFacts {
            run: identity.run.clone(),
            sources: identity.sources.clone(),
            demonstrations: identity.demonstrations,
            rows: identity.rows,
            seed: identity.seed,
            steps,
            settings: identity.settings.clone(),
            final_l1: trainer.error_of_average(FINAL_BATCHES).map_err(cannot)?,
            parameters: weights.count(),
            genmanip_version: identity.genmanip_version.clone(),
        },
        tensors_sha256: weights.sha256(),
    };
    let bytes = weights.to_bytes(Precision::Half, &BTreeMap::new());
    let network = Network::new(description.clone(), &bytes)
        .map_err(|error| WorkspaceError::broken("the trained network cannot be loaded", error))?;
    let trained = trained(&description, out, resumed_from, seconds);
    let html = page::html(&trained, &metrics, &read, &*images, &network)?;
    documents::write_file(&out.join(WEIGHTS), &bytes)?;
    documents::write_file(&out.join(PAGE), html.as_bytes())?;
    documents::write_file(&out.join(DESCRIPTION), description.to_json().as_bytes())?;
    let checkpoint = out.join(CHECKPOINT);
    if checkpoint.exists() {
        files::remove(&checkpoint).map_err(|error| WorkspaceError::of_file("remove", &checkpoint, error))?;
    }
    Ok(Some(trained))
}

/// A training run in progress.
struct Course<'a> {
    trainer: Trainer<'a>,
    out: PathBuf,
    /// Identity of the run, as JSON.
    training: String,
    length: Length,
    /// Number of steps; `None` until a time budget is converted.
    steps: Option<u64>,
    /// Lines of the metrics file, without the header.
    metrics: Vec<String>,
    /// Measurements since the last line of the metrics.
    recent: Vec<TrainingStep>,
    resumed_from: Option<u64>,
    started: Instant,
    saved: Instant,
}

impl<'a> Course<'a> {
    /// Begins a training run, or continues from the checkpoint of one with an equal identity.
    fn open(mut trainer: Trainer<'a>, identity: &Identity, out: &Path) -> Result<Self, WorkspaceError> {
        let training = serde_json::to_string(identity).unwrap_or_default();
        let mut steps = match identity.length {
            Length::Steps(steps) => Some(steps),
            Length::BudgetS(_) => None,
        };
        let (path, mut metrics, mut resumed_from) = (out.join(CHECKPOINT), Vec::new(), None);
        if path.exists() {
            let checkpoint = Checkpoint { bytes: documents::read_bytes(&path, MAX_WEIGHTS)? };
            let damaged = |error: TrainError| {
                WorkspaceError::file("read", &path, error).or_hint("remove it; the training then starts again")
            };
            let metadata = checkpoint.metadata().map_err(|error| damaged(error.into()))?;
            let known = metadata.get(IDENTITY).map(String::as_str).unwrap_or_default();
            if known != training {
                return Err(another(out, known, &training));
            }
            trainer.resume(&checkpoint).map_err(damaged)?;
            steps = metadata.get(STEPS).and_then(|steps| steps.parse().ok());
            metrics = lines(out, trainer.finished());
            resumed_from = Some(trainer.finished());
        }
        let (out, length, now) = (out.to_owned(), identity.length, Instant::now());
        Ok(Self {
            trainer,
            out,
            training,
            length,
            steps,
            metrics,
            recent: Vec::new(),
            resumed_from,
            started: now,
            saved: now,
        })
    }

    /// Does all remaining steps; returns the total number of steps, or `None` if interrupted.
    fn run(&mut self, progress: &dyn Progress, stop: &AtomicBool) -> Result<Option<u64>, WorkspaceError> {
        let before = self.metrics.last().and_then(|line| line.split(',').nth(1)?.parse::<f64>().ok()).unwrap_or(0.0);
        let mut warm = None;
        if self.steps.is_none() {
            progress.begin("timing the training", TIMED_AFTER as usize);
        }
        let mut is_shown = false;
        loop {
            let finished = self.trainer.finished();
            if self.steps.is_none() && finished == WARM_AFTER {
                warm = Some(Instant::now());
            }
            if let (None, TIMED_AFTER, Length::BudgetS(budget)) = (self.steps, finished, self.length) {
                let timed = warm.map_or(1.0, |warm: Instant| warm.elapsed().as_secs_f64());
                let per_step = (timed / (TIMED_AFTER - WARM_AFTER) as f64).max(1e-6);
                let left = (budget as f64 - self.started.elapsed().as_secs_f64()).max(0.0);
                self.steps = Some(TIMED_AFTER + (left / per_step) as u64);
                progress.end();
                self.save()?;
            }
            if let (Some(steps), false) = (self.steps, is_shown) {
                progress.begin(super::TRAINING, steps.saturating_sub(finished) as usize);
                is_shown = true;
            }
            if let Some(steps) = self.steps.filter(|steps| finished >= *steps) {
                progress.end();
                self.write_metrics()?;
                return Ok(Some(steps));
            }
            if stop.load(Ordering::Relaxed) {
                progress.end();
                if self.steps.is_some() {
                    self.save()?;
                }
                return Ok(None);
            }
            // Before the number of steps is known, the learning rate is still in its warm-up, which does not depend on
            // it.
            let measured = self.trainer.step(self.steps.unwrap_or(u64::MAX));
            let measured = measured.map_err(|error| cannot_train(error, &self.out))?;
            self.recent.push(measured);
            progress.advance();
            let is_last = self.steps == Some(self.trainer.finished());
            if is_last || self.trainer.finished().is_multiple_of(STEPS_PER_LINE) {
                self.line(before, progress);
            }
            if self.saved.elapsed().as_secs_f64() > CHECKPOINT_EVERY_S && self.steps.is_some() {
                self.save()?;
            }
        }
    }

    /// Appends a line to the metrics, with means over the measurements since the last line.
    fn line(&mut self, before_s: f64, progress: &dyn Progress) {
        let count = self.recent.len().max(1) as f64;
        let mean = |of: fn(&TrainingStep) -> f64| self.recent.iter().map(of).sum::<f64>() / count;
        let (l1, end_loss, labels) = (mean(|step| step.l1), mean(|step| step.end_loss), mean(|step| step.label_loss));
        let (norm, rate) = (mean(|step| step.gradient_norm), mean(|step| step.learning_rate));
        let seconds = before_s + self.started.elapsed().as_secs_f64();
        let finished = self.trainer.finished();
        self.metrics.push(format!("{finished},{seconds:.1},{l1:.6},{end_loss:.6},{labels:.6},{norm:.4},{rate:.3e}"));
        let since = finished - self.resumed_from.unwrap_or(0);
        let speed = (since * self.trainer.batch_size() as u64) as f64 / self.started.elapsed().as_secs_f64().max(1e-6);
        progress.tell(&format!("L1 {l1:.4}, {speed:.0} samples/s"));
        self.recent.clear();
    }

    fn save(&mut self) -> Result<(), WorkspaceError> {
        let mut metadata = BTreeMap::from([(IDENTITY.to_owned(), self.training.clone())]);
        metadata.extend(self.steps.map(|steps| (STEPS.to_owned(), steps.to_string())));
        self.write_metrics()?;
        documents::write_file(&self.out.join(CHECKPOINT), &self.trainer.checkpoint(&metadata).bytes)?;
        self.saved = Instant::now();
        Ok(())
    }

    fn write_metrics(&self) -> Result<(), WorkspaceError> {
        let head = "step,seconds,l1,end_loss,label_loss,gradient_norm,learning_rate";
        let text = std::iter::once(head).chain(self.metrics.iter().map(String::as_str)).map(|line| format!("{line}\n"));
        documents::write_file(&self.out.join(METRICS), text.collect::<String>().as_bytes())
    }
}

/// Lines of the metrics file up to a step, without the header; later ones were written after the last checkpoint.
fn lines(out: &Path, step: u64) -> Vec<String> {
    let text = std::fs::read_to_string(out.join(METRICS)).unwrap_or_default();
    let is_known =
        |line: &&str| line.split(',').next().and_then(|number| number.parse().ok()).is_some_and(|n: u64| n <= step);
    text.lines().skip(1).filter(is_known).map(str::to_owned).collect()
}

/// A policy whose training run is finished.
struct Finished(PolicyDescription);

fn finished(out: &Path) -> Result<Option<Finished>, WorkspaceError> {
    let path = out.join(DESCRIPTION);
    path.exists().then(|| documents::read_document(&path, MAX_DESCRIPTION).map(Finished)).transpose()
}

impl Finished {
    /// Result of the finished run, if its identity is the requested one; otherwise an error.
    fn of(self, identity: &Identity, out: &Path) -> Result<Trained, WorkspaceError> {
        let Self(description) = self;
        let TrainingFacts { steps, .. } = description.training;
        let known = Identity {
            preset: description.preset,
            run: description.training.run.clone(),
            sources: description.training.sources.clone(),
            demonstrations: description.training.demonstrations,
            rows: description.training.rows,
            seed: description.training.seed,
            // A finished policy records its number of steps, not a requested time, so any time budget is accepted.
            length: match identity.length {
                Length::Steps(_) => Length::Steps(steps),
                Length::BudgetS(budget) => Length::BudgetS(budget),
            },
            model: description.model.clone(),
            settings: description.training.settings.clone(),
            genmanip_version: description.training.genmanip_version.clone(),
        };
        if known != *identity {
            let text = |identity: &Identity| serde_json::to_string(identity).unwrap_or_default();
            return Err(another(out, &text(&known), &text(identity)));
        }
        Ok(trained(&description, out, Some(steps), 0.0))
    }
}

fn trained(description: &PolicyDescription, out: &Path, resumed_from: Option<u64>, seconds: f64) -> Trained {
    let TrainingFacts { demonstrations, rows, steps, parameters, final_l1, ref settings, .. } = description.training;
    Trained {
        policy: out.to_owned(),
        preset: description.preset,
        privileged: description.privileged,
        labels: description.model.labelled_points > 0,
        demonstrations,
        rows,
        samples: steps * settings.batch as u64,
        steps,
        parameters,
        final_l1,
        tensors_sha256: description.tensors_sha256.clone(),
        resumed_from,
        seconds,
    }
}

fn another(out: &Path, known: &str, asked: &str) -> WorkspaceError {
    let difference = match (serde_json::from_str::<serde_json::Value>(known), serde_json::from_str(asked)) {
        (Ok(serde_json::Value::Object(known)), Ok(serde_json::Value::Object(asked))) => {
            let differs = known.iter().find(|(key, value)| asked.get(*key) != Some(*value));
            differs.map(|(key, value)| {
                let asked = asked.get(key).map_or_else(|| "nothing".into(), ToString::to_string);
                format!("{key} is {value} there, {asked} here")
            })
        }
        _ => None,
    };
    let difference = difference.unwrap_or_else(|| "it was begun by another version".into());
    WorkspaceError::input(format!("{} holds another training: {difference}", out.display()))
        .with_hint("choose an empty --out folder, or repeat the call that began it")
}

fn cannot_train(error: TrainError, out: &Path) -> WorkspaceError {
    let checkpoint = out.join(CHECKPOINT);
    let kept = match checkpoint.exists() {
        true => format!("the last checkpoint is {}", checkpoint.display()),
        false => "nothing was written".into(),
    };
    WorkspaceError::broken("the training stopped", error).with_hint(kept)
}
