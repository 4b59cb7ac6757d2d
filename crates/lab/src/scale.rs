//! Large runs: cost of reports, and time to open and resume a run.

use genmanip_workspace::documents;
use genmanip_workspace::workers;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use genmanip_benchmark::ReportSettings;
use genmanip_core::{Document, Seed, Task};
use genmanip_pipeline::Run;
use genmanip_pipeline::RunFolder;
use genmanip_pipeline::collect::{CollectOptions, collect};
use genmanip_pipeline::report::{report, report_full};
use genmanip_rollout::collect::Attempt;
use genmanip_workspace::Progress;
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::text_table;
use serde::Serialize;

use crate::LabError;
use crate::clock::{forget_peak_memory, peak_memory_mb, process_clock};

/// Cost of working with a run of this size.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of episodes of the run.
    pub episodes: usize,
    /// CPU time of `report`, s.
    pub report_cpu_s: f64,
    /// Size of the page that `report` writes, bytes.
    pub report_bytes: usize,
    /// Peak resident memory of `report`, MiB; `None` if unknown.
    pub report_rss_mb: Option<f64>,
    /// CPU time of `report --full`, s.
    pub full_cpu_s: f64,
    /// Peak resident memory of `report --full`, MiB; `None` if unknown.
    pub full_rss_mb: Option<f64>,
    /// CPU time of a second `report --full`, when all pages exist, s.
    pub full_again_cpu_s: f64,
    /// Wall time to open the run and check every episode against the index, s.
    pub open_s: f64,
    /// Wall time of `collect` with nothing left to do, s.
    pub resume_s: f64,
    /// Wall time to check every episode and rebuild the index, s.
    pub index_rebuild_s: f64,
}

/// Marker file of a folder with copies.
const MARK: &str = "synthetic.json";

/// Copies the finished episodes of a run into `out` until there are `episodes`, and measures the copied run.
/// The copies are further attempts at the run's tasks, from as many tasks as give exactly this number. Each copy has
/// its
/// own id, scenario and files.
///
/// # Errors
/// If the run has no finished episode, `out` is not empty, or a copy cannot be written, read or rendered.
pub fn measure(run: &Path, episodes: usize, out: &Path, progress: &dyn Progress) -> Result<Measured, LabError> {
    copy(run, episodes, out, progress)?;
    let (folder, known) = RunFolder::open(out)?;
    let store = folder.store()?;
    // Log each figure as soon as it is known, since the rest takes long.
    let timed = |what: &str, since: Instant| {
        let seconds = since.elapsed().as_secs_f64();
        progress.note(&format!("{what}: {seconds:.2} s"));
        seconds
    };

    let started = Instant::now();
    let looked_at = folder.survey(&store)?.looked_at;
    let index_rebuild_s = timed("index made", started);

    let started = Instant::now();
    let survey = RunFolder::open(out)?.0.survey(&store)?;
    let open_s = timed("opened", started);
    if (looked_at, survey.looked_at, survey.sound.len()) != (episodes, 0, episodes) {
        let found = format!("{looked_at} and {} of {episodes} copies were read", survey.looked_at);
        return Err(
            LabError::input(found).with_hint("name an empty folder with --out, and let nothing else write there")
        );
    }

    let started = Instant::now();
    let options = CollectOptions { workers: workers::workers(None), ..CollectOptions::default() };
    let collected = collect(out, known, options, progress, &AtomicBool::new(false))?;
    let resume_s = timed("continued", started);
    if collected.finished != episodes {
        let found = format!("{} of {episodes} copies are counted", collected.finished);
        return Err(LabError::input(found).with_hint("name an empty folder with --out"));
    }

    forget_peak_memory();
    let mut clock = process_clock();
    let page = report(out, None, &ReportSettings::default(), progress)?;
    documents::write_file(&out.join("report.html"), page.as_bytes())?;
    let (report_cpu_s, report_bytes, report_rss_mb) = (clock(), page.len(), peak_memory_mb());
    progress
        .note(&format!("report: {report_cpu_s:.1} s of CPU time, {report_bytes} bytes, {}", mebibytes(report_rss_mb)));

    let (workers, pages) = (workers::workers(None), out.join("report"));
    forget_peak_memory();
    let mut clock = process_clock();
    report_full(out, &pages, &ReportSettings::default(), workers, progress)?;
    let (full_cpu_s, full_rss_mb) = (clock(), peak_memory_mb());
    let mut clock = process_clock();
    let again = report_full(out, &pages, &ReportSettings::default(), workers, progress)?;
    let full_again_cpu_s = clock();
    if again.made > 0 {
        let found = format!("{} of {} pages were made twice", again.made, again.pages);
        return Err(LabError::input(found).with_hint("nothing else may write into the copy"));
    }
    Ok(Measured {
        episodes,
        report_cpu_s,
        report_bytes,
        report_rss_mb,
        full_cpu_s,
        full_rss_mb,
        full_again_cpu_s,
        open_s,
        resume_s,
        index_rebuild_s,
    })
}

fn copy(run: &Path, episodes: usize, out: &Path, progress: &dyn Progress) -> Result<(), LabError> {
    let unwritable = |error: std::io::Error| LabError::broken(format!("cannot write {}", out.display()), error);
    let (folder, known) = RunFolder::open(run)?;
    let store = folder.store()?;
    let mut finished: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let all = known.tasks.iter().collect::<Result<Vec<Task>, _>>()?;
    let attempts = Attempt::all(&all, known.episodes_per_task, known.seed);
    let sound = folder.survey(&store)?.sound;
    for attempt in attempts.iter().filter(|attempt| sound.binary_search_by(|known| known.id.cmp(&attempt.id())).is_ok())
    {
        finished.entry(attempt.task.id.clone()).or_default().push(attempt.id());
    }
    if fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(LabError::input(format!("{} is not empty", out.display())).with_hint("name an empty folder"));
    }
    let mut tasks: Vec<Task> = all.iter().filter(|task| finished.contains_key(&task.id)).cloned().collect();
    if tasks.is_empty() {
        return Err(
            LabError::input(format!("{} has no finished episode", run.display())).with_hint("collect some first")
        );
    }
    // The smallest number of attempts per task that gives the exact total; a single task always does.
    let is_exact = |per_task: &usize| episodes.is_multiple_of(*per_task);
    let per_task = (episodes.div_ceil(tasks.len())..=episodes).find(is_exact).unwrap_or(episodes);
    tasks.truncate(episodes / per_task);
    let mut settings = known.settings.clone();
    settings.images = None;
    let spooled = Tasks::spool(tasks.clone(), &std::env::temp_dir())?;
    let copied = Run { tasks: spooled, episodes_per_task: per_task, settings, seed: Seed::new(0), ..known.clone() };
    let target = RunFolder::begin(out, &copied)?;
    let mark = serde_json::json!({ "copied_from": run.display().to_string(), "episodes": episodes });
    documents::write_file(&out.join(MARK), format!("{mark:#}\n").as_bytes())?;
    let (into, scenarios) = (target.store()?, out.join("scenarios"));
    fs::create_dir_all(&scenarios).map_err(unwritable)?;
    let seconds = folder.timings().attempts;
    progress.begin("copying", episodes);
    for attempt in Attempt::all(&tasks, per_task, copied.seed) {
        let sources = &finished[&attempt.task.id];
        let (source, name) = (&sources[attempt.number as usize % sources.len()], attempt.id());
        let scenario = store
            .copy_as(source, &into, &name)
            .map_err(|error| LabError::broken(format!("cannot copy episode {source}"), error))?;
        if let Some(scenario) = scenario {
            fs::write(scenarios.join(format!("{name}.json")), scenario.to_json()).map_err(unwritable)?;
        }
        if let Some(&seconds) = seconds.get(source) {
            target.set_attempt_time(&name, seconds);
        }
        progress.advance();
    }
    progress.end();
    target.save_timings()
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let rows = [
        ["episodes".into(), measured.episodes.to_string()],
        ["report, CPU time".into(), format!("{:.1} s", measured.report_cpu_s)],
        ["report, size".into(), format!("{:.1} MB", measured.report_bytes as f64 / 1e6)],
        ["report, memory".into(), mebibytes(measured.report_rss_mb)],
        ["full report, CPU time".into(), format!("{:.1} s", measured.full_cpu_s)],
        ["full report, memory".into(), mebibytes(measured.full_rss_mb)],
        ["full report again, CPU time".into(), format!("{:.1} s", measured.full_again_cpu_s)],
        ["open".into(), format!("{:.2} s", measured.open_s)],
        ["resume".into(), format!("{:.2} s", measured.resume_s)],
        ["index rebuilt".into(), format!("{:.2} s", measured.index_rebuild_s)],
    ];
    let head = ["what", "measured"].map(String::from).to_vec();
    text_table(&[head].into_iter().chain(rows.map(|row| row.to_vec())).collect::<Vec<_>>())
}

fn mebibytes(figure: Option<f64>) -> String {
    figure.map_or("unknown".into(), |figure| format!("{figure:.0} MiB"))
}
