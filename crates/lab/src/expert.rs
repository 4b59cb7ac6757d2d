//! Yield of the expert: attempts at each task on new layouts until one is verified; nothing is stored.

use genmanip_workspace::worlds;
use std::collections::BTreeMap;

use genmanip_core::{EpisodeResult, ExpertStyle, Seed, StrayContact, Task, World};
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources, trial};
use genmanip_rollout::expert::ExpertSettings;
use serde::Serialize;

use crate::LabError;
use crate::clock::{cpu_clock, peak_memory_mb};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

/// Maximum number of failed attempts whose evidence is kept, per cause and kind of task; the counts include all.
const SAMPLES: usize = 5;
/// Stray contact force above which an attempt is listed, N.
const STRAY_BAR_N: f64 = 5.0;

/// Yield of the expert, per kind of task and in total.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of layouts and attempts.
    pub seed: u64,
    /// Style of the expert, see `genmanip collect --expert`.
    pub expert: ExpertStyle,
    /// Maximum number of attempts at a task before it counts as unsolved.
    pub tries_per_task: u64,
    /// Yield over all tasks.
    pub total: Yield,
    /// Yield by kind of task.
    pub kinds: BTreeMap<&'static str, Yield>,
    /// Peak resident memory of the process, MiB; `None` if unknown.
    pub peak_memory_mb: Option<f64>,
}

/// Yield of attempts at a group of tasks; each task is tried until an attempt is verified or its tries are used up.
#[derive(Default, Serialize)]
pub struct Yield {
    /// Number of attempts at these tasks.
    pub attempts: usize,
    /// Number of verified attempts at these tasks.
    pub verified: usize,
    /// Number of tasks tried.
    pub tasks: usize,
    /// Number of tasks with a verified attempt.
    pub tasks_solved: usize,
    /// Verified demonstrations per core-hour of CPU time, layout and planning included.
    pub demos_per_core_hour: f64,
    /// Number of failed attempts by cause.
    pub causes: BTreeMap<&'static str, usize>,
    /// CPU time of all attempts, s.
    pub cpu_s: f64,
    /// Largest stray contact force of any attempt, N.
    pub worst_stray_contact_n: f64,
    /// Number of attempts with a stray contact force above 5 N.
    pub episodes_above_5_n: usize,
    /// Number of these whose largest stray contact was with an object that the gripper had held within the last second.
    pub above_5_n_letting_go: usize,
    /// Attempts with a stray contact force above 5 N, largest force first.
    pub stray_contacts: Vec<Stray>,
    /// Evidence of the first failed attempts of each cause.
    pub evidence: BTreeMap<&'static str, Vec<String>>,
}

/// An attempt with a stray contact force above 5 N.
#[derive(Clone, Serialize)]
pub struct Stray {
    /// Id of the attempt.
    pub episode: String,
    /// Largest stray contact force, N.
    pub force_n: f64,
    /// Bodies and time of the contact; `None` if unknown.
    #[serde(flatten)]
    pub contact: Option<StrayContact>,
}

/// Tries each task on fresh layouts until an attempt is verified, `tries` times at most; one thread.
///
/// # Errors
/// If an attempt raises an error; a failed attempt is a result.
pub fn measure(
    tasks: &[Task],
    world: &World,
    style: ExpertStyle,
    tries: u64,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let expert = ExpertSettings { style, ..ExpertSettings::default() };
    let settings = PipelineSettings { expert, ..PipelineSettings::in_world(world.clone()) };
    let planner = worlds::planner(world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    let mut kinds: BTreeMap<&'static str, Yield> = BTreeMap::new();
    let mut total = Yield::default();
    progress.begin("trying", tasks.len());
    for task in tasks {
        let mut clock = cpu_clock();
        let results = solve(task, tries, seed, resources, &settings)?;
        let cpu_s = clock();
        for counted in [kinds.entry(task.kind.name()).or_default(), &mut total] {
            counted.add(&results, cpu_s);
        }
        progress.advance();
    }
    progress.end();
    Ok(Measured {
        seed: seed.value(),
        expert: style,
        tries_per_task: tries,
        total,
        kinds,
        peak_memory_mb: peak_memory_mb(),
    })
}

/// Attempts at a task, up to the first verified one.
fn solve(
    task: &Task,
    tries: u64,
    seed: Seed,
    resources: Resources,
    settings: &PipelineSettings,
) -> Result<Vec<EpisodeResult>, LabError> {
    let stream = seed.fork("attempt").fork(&task.id);
    let mut results = Vec::new();
    for number in 0..tries {
        let attempt = Attempt { task, number, seed: stream.fork_index(number) };
        let result = trial(&attempt, resources, settings)
            .map_err(|error| LabError::broken(format!("attempt {} broke", attempt.id()), error))?;
        let verified = result.success;
        results.push(result);
        if verified {
            break;
        }
    }
    Ok(results)
}

impl Yield {
    fn add(&mut self, results: &[EpisodeResult], cpu_s: f64) {
        self.tasks += 1;
        self.attempts += results.len();
        self.cpu_s += cpu_s;
        for result in results {
            self.verified += usize::from(result.success);
            self.tasks_solved += usize::from(result.success);
            self.worst_stray_contact_n = self.worst_stray_contact_n.max(result.max_stray_contact_n);
            if result.max_stray_contact_n > STRAY_BAR_N {
                self.episodes_above_5_n += 1;
                self.above_5_n_letting_go +=
                    usize::from(result.stray_contact.as_ref().is_some_and(|contact| contact.let_go));
                self.stray_contacts.push(Stray {
                    episode: result.id.clone(),
                    force_n: result.max_stray_contact_n,
                    contact: result.stray_contact.clone(),
                });
                self.stray_contacts.sort_by(|a, b| b.force_n.total_cmp(&a.force_n));
            }
            if let Some(failure) = result.failure() {
                *self.causes.entry(failure.cause.name()).or_default() += 1;
                let samples = self.evidence.entry(failure.cause.name()).or_default();
                if samples.len() < SAMPLES {
                    samples.push(format!("{}: {}", result.id, failure.evidence));
                }
            }
        }
        self.demos_per_core_hour = 3600.0 * self.verified as f64 / self.cpu_s.max(1e-9);
    }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let head = ["kind", "verified", "tasks solved", "per core-hour", "worst stray", "causes of failed attempts"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for (kind, counted) in measured.kinds.iter().chain([(&"all", &measured.total)]) {
        let causes: Vec<String> = counted.causes.iter().map(|(cause, count)| format!("{cause} {count}")).collect();
        rows.push(vec![
            (*kind).to_owned(),
            format!("{}/{}", counted.verified, counted.attempts),
            format!("{}/{}", counted.tasks_solved, counted.tasks),
            format!("{:.0}", counted.demos_per_core_hour),
            format!("{:.1} N", counted.worst_stray_contact_n),
            causes.join(", "),
        ]);
    }
    let strays = &measured.total.stray_contacts;
    let strays = strays.iter().map(|stray| {
        let contact = stray.contact.as_ref().map_or_else(String::new, ToString::to_string);
        format!("\n{}: {:.1} N, {contact}", stray.episode, stray.force_n)
    });
    text_table(&rows) + &strays.collect::<String>()
}
