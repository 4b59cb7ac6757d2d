//! Evaluation of policies on scenarios: one results file per policy in `evaluation/`.
//!
//! ```text
//! evaluation/LABEL.json          the results, once every case was tried
//! evaluation/LABEL/episodes/     the episodes, if they are kept
//! evaluation/LABEL/results.jsonl, identity.json   an unfinished evaluation, continued by the next call
//! evaluation/LABEL/results.shard-I-of-N.jsonl   results of shards, collected by a call without a shard
//! ```

mod ending;
mod stream;
mod suite;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_benchmark::statistics::{FailureCount, MIN_SCENARIOS, Rate};
use genmanip_benchmark::{EvaluationReport, StatisticsSettings};
use genmanip_core::{Document, Ending, EpisodeResult, NotRun};
use genmanip_data::EpisodeStore;
use genmanip_rollout::collect::Resources;
use genmanip_rollout::evaluate::Case;
use genmanip_rollout::{Cores, RolloutError};
use genmanip_workspace::text_table;

use crate::folder::RunFolder;
use crate::not_run::{self, Series};
use crate::policies::{PolicyContext, PolicyFactory};
use crate::policy_spec::mistaken;
use genmanip_workspace::Progress;
use genmanip_workspace::documents;
use genmanip_workspace::shard::Shard;
use genmanip_workspace::worlds;
use genmanip_workspace::{Stopped, WorkspaceError};

pub use ending::EndingRules;
use stream::{Identity, Stream};
pub use suite::Suite;

/// Options of [`evaluate`].
#[derive(Clone, Debug, Default)]
pub struct EvaluateOptions {
    /// Folder of a run in which `evaluation/` is written; `None` to write nothing.
    pub out: Option<PathBuf>,
    /// True to store the episodes with their frames.
    pub keep_episodes: bool,
    /// Number of cores to use.
    pub workers: usize,
    /// Maximum number of concurrent episodes; `None` for the number of cores, or [`MAX_CONCURRENT_EPISODES`] for a
    /// policy that waits for a service.
    pub at_once: Option<usize>,
    /// Part of the cases to evaluate, without a results file: a later call without a shard collects the results of all
    /// shards and writes that file. `None` for all cases.
    pub shard: Option<Shard>,
    /// Maximum cost of a policy's service, in the currency of its settings; `None` for no limit.
    pub max_cost: Option<f64>,
    /// Rules that end an episode.
    pub ending: EndingRules,
    /// True to go on after three episodes in a row that the policy could not run.
    pub keep_going: bool,
}

/// Default number of concurrent episodes that wait for a service: enough to keep two cores busy while a model takes
/// seconds, at about 35 MB each (measured with `lab batch`).
pub const MAX_CONCURRENT_EPISODES: usize = 16;

/// Evaluates the policies, one after the other, on every case of a suite, and writes one file for each.
///
/// Results are stored as they come: an interrupted evaluation, or one whose policy could not be reached, continues
/// where it stopped. When `stop` becomes true, only the reports of the policies finished before are returned.
///
/// # Errors
/// When there is no scenario, a file cannot be written, an episode raises an error, or a policy could not run three
/// episodes in a row.
pub fn evaluate(
    suite: &Suite,
    policies: &[PolicyFactory],
    options: &EvaluateOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<EvaluationReport>, WorkspaceError> {
    options.ending.check()?;
    let folder = options.out.as_deref().map(|out| suite.folder(out)).transpose()?;
    folder.as_ref().map_or(Ok(()), RunFolder::sweep)?;
    suite.left_out.iter().for_each(|note| progress.note(note));
    if let Some(limit) = options.max_cost {
        policies.iter().filter_map(PolicyFactory::account).try_for_each(|account| account.set_limit(limit))?;
    }
    let mut reports = Vec::new();
    for policy in policies {
        let started = Instant::now();
        if options.shard.is_some_and(|shard| shard.index() >= suite.cases.len()) {
            // With fewer cases than shards, this shard has nothing to do.
            break;
        }
        let Some((report, stream)) = one(suite, policy, folder.as_ref(), options, progress, stop)? else { break };
        if let (Some(folder), None) = (&folder, options.shard) {
            let file = results_file(folder.path(), &report.label);
            documents::write_file(&file, report.to_json().as_bytes())?;
            // The journal is deleted only after the report is written, since the disk may be full.
            stream.map_or(Ok(()), Stream::close)?;
            folder.set_phase_time(&format!("evaluate {}", report.label), started.elapsed().as_secs_f64());
        }
        reports.push(report);
    }
    if let (Some(folder), None) = (&folder, options.shard) {
        folder.save_timings()?;
    }
    Ok(reports)
}

/// Evaluates one policy; returns the results with the stored report, or `None` if interrupted.
fn one(
    suite: &Suite,
    policy: &PolicyFactory,
    folder: Option<&RunFolder>,
    options: &EvaluateOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<(EvaluationReport, Option<Stream>)>, WorkspaceError> {
    let ending = options.ending;
    let label = suite.label(&ending.label(policy));
    let settings = ending.settings(&suite.settings, policy);
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources { catalogue: suite.source(), ..Resources::builtin(&planner) };
    let identity = Identity::of(suite, policy, &settings, options.keep_episodes);
    let stream = folder.map(|folder| Stream::open(&folder.join("evaluation").join(&label), &identity, options.shard));
    let stream = stream.transpose()?;
    let mut results: Vec<EpisodeResult> = stream.as_ref().map_or_else(Vec::new, |stream| stream.known().to_vec());
    // The folder may hold results of an earlier call with more episodes per scenario.
    let wanted: BTreeSet<&str> = suite.cases.iter().map(|case| case.id.as_str()).collect();
    results.retain(|result| wanted.contains(result.id.as_str()));
    let known: BTreeSet<&str> = results.iter().map(|result| result.id.as_str()).collect();
    let is_left = |(number, case): &(usize, &Case)| {
        options.shard.is_none_or(|shard| shard.has(*number)) && !known.contains(case.id.as_str())
    };
    let cases: Vec<Case> = suite.cases.iter().enumerate().filter(is_left).map(|(_, case)| ending.case(case)).collect();
    let keep = match &stream {
        Some(stream) if options.keep_episodes => {
            let store = EpisodeStore::create(stream.folder().join("episodes"));
            Some(store.map_err(|error| {
                let help = "move the episodes of that evaluation away";
                WorkspaceError::broken("cannot keep episodes", error).with_hint(help)
            })?)
        }
        _ => None,
    };
    if let Some(store) = &keep {
        let kept = store.root().display();
        store.sweep_partial().map_err(|error| {
            let help = format!("check that {kept} is writable and the disk is not full");
            WorkspaceError::broken("cannot keep episodes", error).with_hint(help)
        })?;
    }
    let cores = Arc::new(Cores::new(options.workers));
    let usual = policy.account().map_or(options.workers, |_| options.workers.max(MAX_CONCURRENT_EPISODES));
    let crew = (options.at_once.unwrap_or(usual), &*cores);
    progress.begin(&label, cases.len());
    let make = |stage: &_, case: &Case| {
        let recorded = match suite.recorded(&case.id) {
            // A damaged recording is skipped for a policy that needs it; other policies do not read it.
            Err(error) if error.is_damage() && policy.needs_record() => {
                let reason = format!("what was recorded is damaged: {error}");
                return Err(RolloutError::NotRun { policy: policy.label().into(), reason, mistake: false });
            }
            Err(error) if error.is_damage() => None,
            recorded => recorded?,
        };
        let context = PolicyContext {
            stage,
            recorded: recorded.as_ref(),
            planner: &planner,
            grasps: resources.grasps,
            settings: &settings,
            cores: Some(&cores),
        };
        policy.make(&context).map_err(|error| policy.refusal(error))
    };
    let series = Series::new(policy.label(), options.keep_going || policy.is_recorded());
    let finished = |outcome: &Result<EpisodeResult, NotRun>| -> Result<(), Stopped> {
        match outcome {
            Ok(result) => {
                series.was_run();
                stream.as_ref().map_or(Ok(()), |stream| stream.add(result))?;
            }
            Err(left) => series.was_not_run(left).map_err(Stopped::Run)?,
        }
        progress.advance();
        policy.account().into_iter().for_each(|account| progress.tell(&account.describe()));
        Ok(())
    };
    let shared = (resources, &settings);
    let evaluated = genmanip_rollout::evaluate::evaluate(&cases, &make, shared, keep.as_ref(), crew, stop, &finished)
        .map_err(|error| match error {
        Stopped::Run(error) => error,
        Stopped::Episode(error) if error.unsupported().is_some() => {
            let wrong = error.unsupported().map(described).unwrap_or_default();
            mistaken(&format!("policy {label}"), &wrong)
        }
        Stopped::Episode(error) => {
            let help = keep.as_ref().map_or_else(
                || "what was finished is kept; start again to continue".into(),
                |store| {
                    let kept = store.root().display();
                    format!("move a kept episode that cannot be read out of {kept}; it is then run again")
                },
            );
            WorkspaceError::broken(format!("evaluating {label} stopped"), error).with_hint(help)
        }
    })?;
    progress.end();
    if let Some(asked) = policy.account().map(|account| account.describe()).filter(|asked| !asked.is_empty()) {
        progress.note(&format!("{label}: {asked}"));
    }
    results.extend(evaluated.results);
    let is_stopped = stop.load(Ordering::Relaxed);
    if let Some(first) = evaluated.not_run.first() {
        if results.is_empty() && !is_stopped {
            return Err(not_run::no_episode(policy.label(), first));
        }
        not_run::note(&evaluated.not_run).iter().for_each(|note| progress.note(note));
    }
    if results.is_empty() || is_stopped {
        return Ok(None);
    }
    let report = EvaluationReport::new(
        &suite.name,
        &suite.scenarios,
        results,
        &suite.reference_paths_m,
        &StatisticsSettings::default(),
    )
    .map_err(|error| {
        let kept = stream.as_ref().map_or_else(String::new, |stream| format!(" from {}", stream.folder().display()));
        WorkspaceError::broken(format!("cannot summarise {label}{kept}"), error)
            .with_hint("move what was kept of this evaluation away; it then starts again")
    })?;
    let stream = stream.filter(|_| evaluated.not_run.is_empty() && options.shard.is_none());
    let label = options.shard.map_or_else(|| label.clone(), |shard| format!("{label}, {shard}"));
    let (cameras, perturbation) = (suite.cameras.clone(), suite.perturbation.clone());
    let report = EvaluationReport {
        label,
        cameras,
        perturbation,
        horizon_s: ending.horizon_s,
        stop_on_success: settings.rollout.stop_on_success,
        ..report.by_traits(&suite.traits)
    };
    Ok(Some((report.leaving(evaluated.not_run), stream)))
}

/// An error with its causes and its hint, as text.
fn described(error: &(dyn std::error::Error + Send + Sync + 'static)) -> String {
    let hint = error.downcast_ref::<WorkspaceError>().and_then(WorkspaceError::hint);
    hint.map_or_else(|| error.to_string(), |hint| format!("{error}\nhint: {hint}"))
}

/// Table of success rates with their intervals.
pub fn table(reports: &[EvaluationReport]) -> String {
    let heads = ["policy", "episodes", "success at end", "95 % interval", "score", "failures"];
    let any_left = reports.iter().any(|report| !report.not_run.is_empty());
    let any_clouds = reports.iter().any(|report| report.summary.cloud_success.is_some());
    let mut head: Vec<String> = heads.map(String::from).to_vec();
    head.extend(any_clouds.then(|| "on point clouds (disagree)".to_owned()));
    let others = |report: &EvaluationReport| -> Vec<bool> {
        report.results.iter().filter_map(|it| it.other_request_success).collect()
    };
    let any_other = reports.iter().any(|report| !others(report).is_empty());
    head.extend(any_other.then(|| "did what was not asked".to_owned()));
    let any_stops = reports.iter().any(|report| report.stop_on_success);
    head.extend(any_stops.then(|| "ended on success".to_owned()));
    let given_up = |report: &EvaluationReport| {
        report.results.iter().filter(|it| it.success && it.ending == Some(Ending::GaveUp)).count()
    };
    let any_given_up = reports.iter().any(|report| given_up(report) > 0);
    head.extend(any_given_up.then(|| "gave up after success".to_owned()));
    head.extend(any_left.then(|| "not run".to_owned()));
    let mut lines = vec![head];
    for report in reports {
        let success = &report.summary.success;
        // If a mistake of the policy prevented episodes, the finished ones are no random sample.
        let is_mistaken = report.not_run.iter().any(|left| left.mistake);
        let rate = |text: String| if is_mistaken { "–".to_owned() } else { text };
        let mut line = vec![
            format!("{}{}", report.label, if report.oracle { " (oracle)" } else { "" }),
            success.trials.to_string(),
            rate(format!("{:.1} %", 100.0 * success.value)),
            rate(format!("{:.1}–{:.1} %", 100.0 * success.low, 100.0 * success.high)),
            rate(format!("{:.3}", report.summary.score.value)),
            most_frequent(&report.summary.failures),
        ];
        if any_clouds {
            let disagree = report.summary.cloud_disagreements.len();
            let cell = |rate: &Rate| format!("{:.1} % ({disagree})", 100.0 * rate.value);
            line.push(report.summary.cloud_success.as_ref().map(cell).unwrap_or_default());
        }
        if any_other {
            let done = others(report);
            line.push(format!("{} of {}", done.iter().filter(|&&it| it).count(), done.len()));
        }
        if any_stops {
            let ended = report.results.iter().filter(|it| it.ending == Some(Ending::Success)).count();
            line.push(if report.stop_on_success { ended.to_string() } else { String::new() });
        }
        if any_given_up {
            line.push(given_up(report).to_string());
        }
        if any_left {
            line.push(report.not_run.len().to_string());
        }
        lines.push(line);
    }
    text_table(&lines)
}

/// Maximum number of failure causes in a cell of the table.
const SHOWN_CAUSES: usize = 2;

/// The most frequent causes of failure with their counts, and the total count of all others.
fn most_frequent(failures: &[FailureCount]) -> String {
    let (shown, rest) = failures.split_at(failures.len().min(SHOWN_CAUSES));
    let others: usize = rest.iter().map(|entry| entry.count).sum();
    let shown = shown.iter().map(|entry| format!("{} {}", entry.count, entry.cause.name()));
    shown.chain((others > 0).then(|| format!("{others} other"))).collect::<Vec<_>>().join(", ")
}

/// Table of success by scenario trait, with one column per policy; values with fewer than [`MIN_SCENARIOS`] scenarios
/// are omitted. Empty for a suite without traits.
pub fn table_of_traits(reports: &[EvaluationReport]) -> String {
    let mut rows: BTreeMap<(&str, &str), Vec<String>> = BTreeMap::new();
    for (index, report) in reports.iter().enumerate() {
        for found in report.summary.traits.iter().filter(|found| found.scenarios >= MIN_SCENARIOS) {
            let Rate { value, low, high, trials, .. } = &found.success;
            let cells = rows.entry((&found.name, &found.value)).or_insert_with(|| vec![String::new(); reports.len()]);
            cells[index] =
                format!("{:.0} % ({:.0}\u{2013}{:.0}) of {trials}", 100.0 * value, 100.0 * low, 100.0 * high);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let head = ["trait", "value"].map(String::from).into_iter().chain(reports.iter().map(|it| it.label.clone()));
    let rows = rows.into_iter().map(|((name, value), cells)| {
        [name.to_owned(), value.to_owned()].into_iter().chain(cells).collect::<Vec<String>>()
    });
    text_table(&std::iter::once(head.collect()).chain(rows).collect::<Vec<_>>())
}

/// Path of the results file of an evaluation in the folder of a run.
pub fn results_file(run: &Path, label: &str) -> PathBuf {
    run.join("evaluation").join(format!("{label}.json"))
}

/// Results of an evaluation that is in progress, was interrupted, or consists of shards that were not gathered.
pub struct Unfinished {
    /// Label of the evaluation.
    pub label: String,
    /// Results so far.
    pub results: Vec<EpisodeResult>,
}

impl Unfinished {
    /// Results in the journals of the evaluation of that label; `None` if it has none.
    ///
    /// # Errors
    /// If a journal cannot be read.
    pub fn read(folder: &RunFolder, label: &str) -> Result<Option<Self>, WorkspaceError> {
        let results = stream::journalled(&folder.join("evaluation").join(label))?;
        Ok((!results.is_empty()).then(|| Self { label: label.to_owned(), results }))
    }
}

/// Path of the kept episodes of an evaluation.
pub fn kept_episodes(folder: &RunFolder, label: &str) -> PathBuf {
    let evaluation: &Path = &folder.join("evaluation");
    evaluation.join(label).join("episodes")
}
