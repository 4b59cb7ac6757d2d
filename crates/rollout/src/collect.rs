//! Collection of demonstrations: one attempt per task and number, each with its own layout, by any number of workers.
//!
//! Attempt k of a task is a pure function of (task, seed, k). The result does not depend on the order or the workers,
//! and an interrupted run can be resumed with the same bytes.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use genmanip_assets::{AssetSource, Catalogue, GraspLibrary};
use genmanip_core::{
    Episode, EpisodeResult, EpisodeSource, Failure, FailureCause, GoalVerdict, Policy, Scenario, Seed, Task, World,
};
use genmanip_data::images::variation_seed;
use genmanip_data::{DataError, EpisodeStore};
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_motion::{Planner, PlannerSettings};
use serde::{Deserialize, Serialize};

use crate::expert::{Expert, ExpertSettings, GraspProposer, MoveSkills};
use crate::images::{self, ImageSettings};
use crate::physics_variation::vary_physics;
use crate::{RolloutError, RolloutSettings, Stage, run_corrected, run_episode};

/// Settings of a run, apart from its tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PipelineSettings {
    /// World of the scenarios.
    pub world: World,
    /// Settings of layout generation.
    #[serde(default)]
    pub layout: LayoutSettings,
    /// Settings of motion planning.
    #[serde(default)]
    pub planner: PlannerSettings,
    /// Settings of the episode loop.
    #[serde(default)]
    pub rollout: RolloutSettings,
    /// Settings of the expert that makes the demonstrations.
    #[serde(default)]
    pub expert: ExpertSettings,
    /// Images of successful episodes; `None` for none.
    #[serde(default)]
    pub images: Option<ImageSettings>,
    /// Render images of failed episodes too.
    #[serde(default)]
    pub keep_failed: bool,
    /// Source of the expert's grasps: `mesh`, `rgbd`, or `http:URL`.
    #[serde(default = "mesh", skip_serializing_if = "is_mesh")]
    pub grasps: String,
    /// Randomise the [physics](crate::physics_variation) of each attempt, from the stream `physics` of its
    /// [`variation_seed`].
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub vary_physics: bool,
    /// Policy that acts first in each attempt and is corrected by the expert when it fails, `NAME:key=value,…`; `None`
    /// for the expert alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrects: Option<String>,
    /// Files of the skills that the expert uses for the moves that they serve.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skills: Vec<SkillFile>,
}

/// A skill file of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkillFile {
    /// Path of the file when the run began.
    pub path: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// Grasp source: the objects' geometry.
pub const MESH: &str = "mesh";

fn mesh() -> String {
    MESH.into()
}

fn is_mesh(source: &String) -> bool {
    source == MESH
}

impl PipelineSettings {
    /// Default settings for a world, without images.
    pub fn in_world(world: World) -> Self {
        Self {
            world,
            layout: LayoutSettings::default(),
            planner: PlannerSettings::default(),
            rollout: RolloutSettings::default(),
            expert: ExpertSettings::default(),
            images: None,
            keep_failed: false,
            grasps: mesh(),
            vary_physics: false,
            corrects: None,
            skills: Vec::new(),
        }
    }

    /// True if attempts are randomised by [`variation_seed`].
    pub fn is_varied(&self) -> bool {
        self.vary_physics || self.images.as_ref().is_some_and(|images| !images.vary.is_empty())
    }
}

/// Read-only resources shared by all attempts.
#[derive(Clone, Copy)]
pub struct Resources<'a> {
    /// Source of the object models that scenarios name.
    pub catalogue: &'a dyn AssetSource,
    /// Motion planner of the robot; expensive to create.
    pub planner: &'a Arc<Planner>,
    /// Precomputed grasps of objects.
    pub grasps: &'a GraspLibrary,
    /// Source of grasps from images, used instead of precomputed grasps; `None` for precomputed ones.
    pub grasp_proposer: Option<&'a Arc<dyn GraspProposer>>,
    /// Creates the policy that acts first and is corrected; `None` for the expert alone.
    pub corrected: Option<&'a MakeCorrected<'a>>,
    /// Skills that the expert uses for the moves that they serve; `None` for its own motions alone.
    pub skills: Option<&'a Arc<dyn MoveSkills>>,
}

/// Creates the policy to correct, for the episodes of a stage.
pub type MakeCorrected<'a> = dyn Fn(&Stage) -> Result<Box<dyn Policy>, RolloutError> + Sync + 'a;

impl<'a> Resources<'a> {
    /// The built-in objects and grasps, with a planner.
    pub fn builtin(planner: &'a Arc<Planner>) -> Self {
        Self {
            catalogue: Catalogue::builtin(),
            planner,
            grasps: GraspLibrary::builtin(),
            grasp_proposer: None,
            corrected: None,
            skills: None,
        }
    }
}

/// One attempt of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt<'a> {
    /// Task that the attempt tries to solve.
    pub task: &'a Task,
    /// Index among the task's attempts.
    pub number: u64,
    /// Random stream of the attempt.
    pub seed: Seed,
}

impl<'a> Attempt<'a> {
    /// All attempts of a run, in the order of the tasks.
    pub fn all(tasks: &'a [Task], per_task: usize, seed: Seed) -> Vec<Self> {
        let of_task = |task: &'a Task| (0..per_task as u64).map(move |number| Self::of(task, number, seed));
        tasks.iter().flat_map(of_task).collect()
    }

    /// Attempt of a run with the given seed.
    pub fn of(task: &'a Task, number: u64, seed: Seed) -> Self {
        Self { task, number, seed: seed.fork("attempt").fork(&task.id).fork_index(number) }
    }

    /// Id of the attempt, its scenario and its episode.
    pub fn id(&self) -> String {
        attempt_id(&self.task.id, self.number)
    }

    /// Generates the scenario of the attempt.
    ///
    /// # Errors
    /// If no layout of the task is found.
    pub fn scenario(
        &self,
        resources: Resources,
        world: &World,
        settings: &LayoutSettings,
    ) -> Result<Scenario, genmanip_layout::LayoutError> {
        let Resources { catalogue, planner, grasps, .. } = resources;
        let scenario = lay_out(self.task, catalogue, world, planner, grasps, self.seed, settings)?;
        Ok(Scenario { id: self.id(), ..scenario })
    }
}

/// Id of an attempt, its scenario and its episode.
pub fn attempt_id(task: &str, number: u64) -> String {
    format!("{task}-{number:03}")
}

/// Ensures that an attempt is complete in the store, with its images. Returns its result, and true if that was stored
/// before.
///
/// # Errors
/// On internal errors. A task that cannot be solved gives a failed result, not an error.
pub fn complete(
    attempt: &Attempt,
    resources: Resources,
    store: &EpisodeStore,
    settings: &PipelineSettings,
) -> Result<(EpisodeResult, bool), RolloutError> {
    let id = attempt.id();
    let was_there = store.contains(&id);
    let played = if was_there {
        store.sweep_attempt(&id)?;
        None
    } else {
        Some(make(attempt, resources, store, settings)?)
    };
    let result = match &played {
        Some(Ok((_, episode))) => episode.result.clone(),
        Some(Err(result)) => (**result).clone(),
        None => store.read_result(&id)?,
    };
    if let Some(images) = &settings.images
        && (result.success || settings.keep_failed && store.is_recorded(&id)?)
        && !store.has_tracks(&id, images.fps, &images.cameras)
    {
        let played = played.and_then(Result::ok).map_or_else(|| reopen(&id, resources, store), |it| Ok(Some(it)))?;
        if let Some((stage, episode)) = played {
            store.attach_tracks(&id, &images::render_tracks(&stage, &episode, images)?)?;
        }
    }
    Ok((result, was_there))
}

/// An episode with its stage; if no layout was found, the result alone.
type Played = Result<(Stage, Episode), Box<EpisodeResult>>;

/// Runs one attempt and stores it.
fn make(
    attempt: &Attempt,
    resources: Resources,
    store: &EpisodeStore,
    settings: &PipelineSettings,
) -> Result<Played, RolloutError> {
    let played = play(attempt, resources, settings)?;
    match &played {
        Ok((_, episode)) => kept(store.write(episode, &[]), &episode.result.id, store)?,
        Err(result) => kept(store.write_result_only(result, None), &result.id, store)?,
    }
    Ok(played)
}

/// A stored episode with its stage; `None` if it is damaged, which is reported when it is read.
fn reopen(id: &str, resources: Resources, store: &EpisodeStore) -> Result<Option<(Stage, Episode)>, RolloutError> {
    let episode = match store.read(id) {
        Err(error) if error.is_damage() => return Ok(None),
        episode => episode?,
    };
    let scenario = Arc::new(episode.scenario.clone());
    Ok(Some((Stage::open(scenario, resources.catalogue, resources.planner.robot())?, episode)))
}

/// Treats an attempt that exists already as written: a concurrent process stored the same one, whose bytes are equal.
fn kept(written: Result<(), DataError>, id: &str, store: &EpisodeStore) -> Result<(), DataError> {
    match written {
        Err(DataError::Exists { .. }) if store.contains(id) => Ok(()),
        written => written,
    }
}

/// Runs one attempt and returns its result without storing anything.
///
/// # Errors
/// On internal errors; a task that cannot be solved gives a failed result.
pub fn trial(
    attempt: &Attempt,
    resources: Resources,
    settings: &PipelineSettings,
) -> Result<EpisodeResult, RolloutError> {
    Ok(play(attempt, resources, settings)?.map_or_else(|result| *result, |(_, episode)| episode.result))
}

/// Lays out the scene, randomises its physics if asked, and runs the expert, or the policy to correct and then the
/// expert. `Err` holds the result of an attempt without a layout.
fn play(attempt: &Attempt, resources: Resources, settings: &PipelineSettings) -> Result<Played, RolloutError> {
    let mut scenario = match attempt.scenario(resources, &settings.world, &settings.layout) {
        Ok(scenario) => scenario,
        Err(error) if error.is_defect() => return Err(error.into()),
        Err(error) => return Ok(Err(Box::new(not_laid_out(attempt, &error, settings)))),
    };
    if settings.vary_physics {
        vary_physics(&mut scenario, variation_seed(attempt.seed).fork("physics"), 1.0);
    }
    let stage = Stage::open(Arc::new(scenario), resources.catalogue, resources.planner.robot())?;
    let mut expert = Expert::new(&stage, resources.planner, resources.grasps, settings.expert.clone())?;
    if let Some(source) = resources.grasp_proposer {
        expert = expert.with_grasp_proposer(Arc::clone(source));
    }
    if let Some(skills) = resources.skills {
        expert = expert.with_skills(Arc::clone(skills));
    }
    let (id, seed, rollout) = (attempt.id(), attempt.seed, &settings.rollout);
    let mut episode = match resources.corrected {
        None => run_episode(&stage, &mut expert, &id, seed, rollout)?,
        Some(make) => run_corrected(&stage, &mut *make(&stage)?, &mut expert, &id, seed, rollout)?,
    };
    episode.result.expert = settings.expert.style;
    episode.result.source = expert.has_used_skill().then_some(EpisodeSource::Transfer);
    Ok(Ok((stage, episode)))
}

fn not_laid_out(attempt: &Attempt, error: &genmanip_layout::LayoutError, settings: &PipelineSettings) -> EpisodeResult {
    EpisodeResult {
        id: attempt.id(),
        scenario_id: String::new(),
        task_id: attempt.task.id.clone(),
        policy: "expert".into(),
        oracle: true,
        seed: attempt.seed,
        success: false,
        success_once: false,
        verdict: GoalVerdict { score: 0.0, success: false, alternatives: Vec::new() },
        ending: None,
        failures: vec![Failure { cause: FailureCause::Layout, evidence: error.to_string() }],
        duration_s: 0.0,
        horizon_s: settings.rollout.horizon_s,
        control_rate_hz: f64::from(settings.world.physics.control_rate_hz),
        frames: 0,
        unreachable_actions: 0,
        tcp_path_m: 0.0,
        max_stray_contact_n: 0.0,
        stray_contact: None,
        world_hashes: Some(settings.world.hashes()),
        cloud: None,
        other_request_success: None,
        correction: None,
        expert: settings.expert.style,
        agent_failure: None,
        source: None,
        engine: genmanip_sim::engine_version(),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    }
}

/// Maps jobs in worker threads; results are in the order of the jobs. Once `stop` is set no further job starts; jobs
/// that never started have no result.
///
/// # Errors
/// As [`in_parallel_each`].
pub fn in_parallel<J: Sync, R: Send, E: Send>(
    jobs: &[J],
    workers: usize,
    stop: &AtomicBool,
    work: &(dyn Fn(&J) -> Result<R, E> + Sync),
) -> Result<Vec<R>, E> {
    let mut results = Vec::new();
    in_parallel_each(jobs, workers, stop, work, &mut |result| results.push(result))?;
    Ok(results)
}

/// Maps jobs in worker threads; passes each result to `deliver` in the order of the jobs as soon as possible. Once
/// `stop` is set no further job starts.
///
/// # Errors
/// The first error in the order of the jobs; no further job starts after it, and no later result is delivered.
pub fn in_parallel_each<J: Sync, R: Send, E: Send>(
    jobs: &[J],
    workers: usize,
    stop: &AtomicBool,
    work: &(dyn Fn(&J) -> Result<R, E> + Sync),
    deliver: &mut (dyn FnMut(R) + Send),
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let broken = AtomicBool::new(false);
    let delivery = Mutex::new(Delivery { delivered: 0, waiting: BTreeMap::new(), failed: None, deliver });
    let run = || {
        while !stop.load(Ordering::Relaxed) && !broken.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { break };
            let result = work(job);
            if result.is_err() {
                broken.store(true, Ordering::Relaxed);
            }
            delivery.lock().unwrap_or_else(PoisonError::into_inner).add(index, result);
        }
    };
    std::thread::scope(|scope| {
        let wanted = workers.clamp(1, jobs.len().max(1));
        // If the system refuses more threads, those running do all the work, in the worst case this one.
        let given = (0..wanted).take_while(|_| std::thread::Builder::new().spawn_scoped(scope, run).is_ok()).count();
        if given == 0 {
            run();
        }
    });
    delivery.into_inner().unwrap_or_else(PoisonError::into_inner).failed.map_or(Ok(()), Err)
}

/// Restores the order of the jobs for delivery.
struct Delivery<'a, R, E> {
    delivered: usize,
    /// Early results by job index.
    waiting: BTreeMap<usize, Result<R, E>>,
    failed: Option<E>,
    deliver: &'a mut (dyn FnMut(R) + Send),
}

impl<R, E> Delivery<'_, R, E> {
    fn add(&mut self, index: usize, result: Result<R, E>) {
        self.waiting.insert(index, result);
        while self.failed.is_none()
            && let Some(result) = self.waiting.remove(&self.delivered)
        {
            self.delivered += 1;
            match result {
                Ok(result) => (self.deliver)(result),
                Err(error) => self.failed = Some(error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn results_are_delivered_in_the_order_of_the_jobs() {
        let jobs: Vec<u64> = (0..40).collect();
        let check = |workers: usize, broken: Option<u64>| {
            let mut delivered = Vec::new();
            // Early jobs take longest, so that later ones overtake them.
            let work = |&job: &u64| {
                std::thread::sleep(Duration::from_millis((40 - job) / 8));
                if broken.is_some_and(|broken| job >= broken) { Err(job) } else { Ok(job) }
            };
            let end = in_parallel_each(&jobs, workers, &AtomicBool::new(false), &work, &mut |job| delivered.push(job));
            assert_eq!(end.err(), broken, "{workers} workers");
            assert_eq!(delivered, jobs[..broken.unwrap_or(40) as usize], "{workers} workers");
        };
        for workers in [1, 2, 7] {
            check(workers, None);
            check(workers, Some(23));
        }
        let stopped = in_parallel::<_, _, ()>(&jobs, 3, &AtomicBool::new(true), &|&job| Ok(job)).unwrap();
        assert!(stopped.is_empty(), "{stopped:?}");
    }
}
