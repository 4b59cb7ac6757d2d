//! Learned policies from scratch: demonstrations of a distribution of genmanip-learn-10 are collected, a policy is
//! trained on them, and evaluated on unseen layouts.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use genmanip_benchmark::distributions::{Distributions, Split, SplitChoice};
use genmanip_benchmark::statistics::{Rate, StatisticsSettings};
use genmanip_benchmark::suites;
use genmanip_core::Seed;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_pipeline::learn::{
    CheckOptions, Head, Length, Preset, SuiteDemonstrations, TRAINING, TrainOptions, check, demonstrate, train,
};
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;
use crate::clock::process_clock;

/// Settings of [`measure`].
#[derive(Clone, Debug)]
pub struct LearnArguments {
    /// Name of the distribution in the suite.
    pub distribution: String,
    /// Preset of inputs and network size.
    pub preset: Preset,
    /// Output of the network, with its loss.
    pub head: Head,
    /// Number of verified demonstrations to collect.
    pub demos: usize,
    /// Length of training: number of steps, or time.
    pub length: Length,
    /// True for an auxiliary loss on simulator labels; only for presets whose inputs contain no simulator truth.
    pub labels: bool,
    /// Number of unseen layouts to evaluate on.
    pub layouts: usize,
    /// Number of worker threads.
    pub workers: usize,
}

/// Cost and success of the learned policy.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of demonstrations trained on.
    pub demos: usize,
    /// Number of samples processed in training, repetitions included.
    pub samples: u64,
    /// CPU time of collecting the demonstrations, s.
    pub cpu_s_collect: f64,
    /// CPU time of training, including reading the demonstrations, s.
    pub cpu_s_train: f64,
    /// Wall-clock time of everything, evaluation included, s.
    pub wall_s: f64,
    /// Number of trainable scalars of the network.
    pub parameters: usize,
    /// Success rate at the end of the episode on unseen layouts, 0 to 1.
    pub success: f64,
    /// Lower end of the success rate's 95 % interval.
    pub low: f64,
    /// Upper end of the success rate's 95 % interval.
    pub high: f64,
    /// Mean L1 error of normalised actions on training samples after the last step.
    pub final_l1: f64,
    /// True if a short training run that is interrupted and resumed gives the same weights as an uninterrupted one.
    pub resumed_identical: bool,
    /// Success rate on training layouts when the recorded rows are executed like predictions of a learned policy.
    pub replay_success: f64,
}

/// Suite of the demonstrations and of the unseen layouts.
const SUITE: &str = "genmanip-learn-10";
/// Maximum number of demonstrations that are replayed.
const REPLAYED: usize = 60;
/// Steps of the short training run that is interrupted and resumed.
const SHORT: u64 = 60;

/// Collects, trains and evaluates in a new folder; `seed` is that of training.
///
/// # Errors
/// When a stage fails, or the distribution has fewer layouts than requested.
pub fn measure(
    arguments: &LearnArguments,
    seed: Seed,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let LearnArguments { distribution, preset, head, demos, length, labels, layouts, workers } = arguments.clone();
    let (started, stop, run) = (Instant::now(), AtomicBool::new(false), folder.join("run"));
    let place = suites::folder_of(Path::new(SUITE));
    let suite = Distributions::open(&place)?;
    let test =
        SplitChoice { split: Split::Familiar, distribution: Some(distribution.clone()), first: Some(layouts as u64) };
    // Fails before anything is collected if the split has too few layouts.
    suite.draw(&test)?;
    fs::create_dir(folder).map_err(|error| LabError::file("create", folder, error))?;
    let mut clock = process_clock();
    let demonstrations =
        SuiteDemonstrations { suite: place, distribution: Some(distribution), count: demos, run: run.clone(), workers };
    demonstrate(&demonstrations, progress, &stop)?;
    let cpu_s_collect = clock();
    let checked =
        check(&CheckOptions { run: run.clone(), preset, demonstrations: REPLAYED, workers }, progress, &stop)?;
    let stopped = || LabError::input("the measurement was stopped");
    let replay_success = checked.ok_or_else(stopped)?.replay_success.value;
    let training = |out: &str, length| TrainOptions {
        sources: Vec::new(),
        run: run.clone(),
        preset,
        head,
        length,
        seed: seed.fork("training"),
        labels,
        out: folder.join(out),
        threads: workers,
    };
    let resumed_identical = resumed_identical(&training, progress)?;
    let mut clock = process_clock();
    let trained = train(&training("policy", length), progress, &stop)?.ok_or_else(stopped)?;
    let cpu_s_train = clock();
    let success = evaluated(&trained.policy, (&suite, &test), workers, progress)?;
    Ok(Measured {
        demos: trained.demonstrations,
        samples: trained.samples,
        cpu_s_collect,
        cpu_s_train,
        wall_s: started.elapsed().as_secs_f64(),
        parameters: trained.parameters,
        success: success.value,
        low: success.low,
        high: success.high,
        final_l1: trained.final_l1,
        resumed_identical,
        replay_success,
    })
}

/// True if a short training run, interrupted half-way and resumed, gives the same weights as an uninterrupted one.
fn resumed_identical(
    training: &impl Fn(&str, Length) -> TrainOptions,
    progress: &dyn Progress,
) -> Result<bool, LabError> {
    let stopped = || LabError::input("the measurement was stopped");
    let stop = AtomicBool::new(false);
    let length = Length::Steps(SHORT);
    let whole = train(&training("short", length), progress, &stop)?.ok_or_else(stopped)?;
    let halves = StopAfter { inner: progress, steps: SHORT / 2, seen: Mutex::new(None), stop: AtomicBool::new(false) };
    let first = train(&training("halves", length), &halves, &halves.stop)?;
    let second = train(&training("halves", length), progress, &stop)?.ok_or_else(stopped)?;
    let was_stopped = first.is_none() && second.resumed_from.is_some_and(|from| (1..SHORT).contains(&from));
    Ok(was_stopped && second.tensors_sha256 == whole.tensors_sha256)
}

/// Progress that interrupts training after a number of steps.
struct StopAfter<'a> {
    inner: &'a dyn Progress,
    steps: u64,
    /// Number of finished steps; `None` before training, since reading the demonstrations reports units of its own.
    seen: Mutex<Option<u64>>,
    stop: AtomicBool,
}

impl StopAfter<'_> {
    fn seen(&self) -> MutexGuard<'_, Option<u64>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for StopAfter<'_> {
    fn begin(&self, what: &str, total: usize) {
        *self.seen() = (what == TRAINING).then_some(0);
        self.inner.begin(what, total);
    }

    fn advance(&self) {
        let mut seen = self.seen();
        *seen = seen.map(|seen| seen + 1);
        self.stop.fetch_or(*seen == Some(self.steps), Ordering::Relaxed);
        self.inner.advance();
    }

    fn end(&self) {
        self.inner.end();
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }
}

/// Success rate of the policy on layouts of the split `familiar`.
fn evaluated(
    policy: &Path,
    (suite, choice): (&Distributions, &SplitChoice),
    workers: usize,
    progress: &dyn Progress,
) -> Result<Rate, LabError> {
    let stop = AtomicBool::new(false);
    let stopped = || LabError::input("the measurement was stopped");
    let suite = Suite::of_split(suite, choice, workers, progress, &stop)?.ok_or_else(stopped)?;
    let learned = PolicyFactory::resolve(&format!("learned:{}", policy.display()))?;
    let options = EvaluateOptions { workers, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &[learned], &options, progress, &stop)?;
    let report = reports.first().ok_or_else(|| LabError::input("the policy was not evaluated"))?;
    let successes = report.results.iter().filter(|result| result.success).count();
    Ok(Rate::new(successes, report.results.len(), &StatisticsSettings::default()))
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    format!(
        "demonstrations  {} in {:.0} s of CPU time, replayed {:.1} %\ntraining        {} samples in {:.0} s of CPU time, \
         {} parameters, L1 {:.4}\nsuccess         {:.1} % ({:.1}–{:.1} %)\nresumed         {}\n",
        measured.demos,
        measured.cpu_s_collect,
        100.0 * measured.replay_success,
        measured.samples,
        measured.cpu_s_train,
        measured.parameters,
        measured.final_l1,
        100.0 * measured.success,
        100.0 * measured.low,
        100.0 * measured.high,
        if measured.resumed_identical { "the same tensors" } else { "OTHER TENSORS" },
    )
}
