//! Environment interface: its CPU cost compared with the bare simulation, and bitwise reproducibility.

use genmanip_workspace::worlds;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::{CameraRequest, Ending, Episode, ImageChannels, Seed, Task};
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_rollout::environment::Conclusion;
use genmanip_rollout::expert::Expert;
use genmanip_rollout::{Environment, RolloutError, RolloutSettings, Stage, run_episode};
use genmanip_sim::Sim;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_viz::replay;
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

/// Repetitions of every episode, alternating bare simulation and environment.
const REPEATS: usize = 5;
/// Control steps between two images; 15 Hz at a control rate of 60 Hz.
const STEPS_PER_IMAGE: usize = 4;
/// Maximum number of control steps timed with images.
const IMAGE_STEPS: usize = 2400;
/// Side length of the timed images, px.
const IMAGE_SIZE: u32 = 256;

/// Cost and reproducibility of the environment.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of episodes replayed.
    pub episodes: usize,
    /// Control steps per second of CPU time through the environment, which also observes, records and judges.
    pub control_steps_per_s: f64,
    /// Control steps per second of CPU time with the same commands in the bare simulation.
    pub bare_steps_per_s: f64,
    /// Rate of the environment over the bare rate (1 is no overhead), median of the repetitions.
    pub ratio: f64,
    /// Control steps per second of CPU time with one colour image of 256×256 pixels at 15 Hz.
    pub image_steps_per_s: f64,
    /// True if stepping through the recorded commands reproduced every frame and the initial and final state of each
    /// episode, bit for bit.
    pub identical_to_collect: bool,
    /// True if every episode, saved half-way and restored in a fresh environment, ended in the same state.
    pub restore_identical: bool,
}

/// Measures on episodes of the expert, one for each of these tasks that has a layout.
///
/// # Errors
/// If an episode raises an error; a failed episode counts like any other.
pub fn measure(tasks: &[Task], seed: Seed, progress: &dyn Progress) -> Result<Measured, LabError> {
    let settings = PipelineSettings::in_world((*default_world()).clone());
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    let mut cases = Vec::new();
    progress.begin("collecting", tasks.len());
    for task in tasks {
        let attempt = Attempt { task, number: 0, seed: seed.fork("attempt").fork(&task.id) };
        // A task without a layout gives no episode.
        if let Ok(scenario) = attempt.scenario(resources, &settings.world, &settings.layout) {
            let broke = |error: RolloutError| LabError::broken(format!("attempt {} broke", attempt.id()), error);
            let stage = Stage::open(Arc::new(scenario), resources.catalogue, planner.robot()).map_err(broke)?;
            let mut expert = Expert::new(&stage, &planner, resources.grasps, settings.expert.clone())
                .map_err(|error| broke(error.into()))?;
            let episode =
                run_episode(&stage, &mut expert, &attempt.id(), attempt.seed, &settings.rollout).map_err(broke)?;
            cases.push((stage, episode));
        }
        progress.advance();
    }
    progress.end();
    measure_on(&cases, progress)
}

/// Measures on recorded episodes: `path` is a run, an episode store or a single episode.
///
/// # Errors
/// If there is no episode, or one cannot be read, opened or replayed.
pub fn measure_store(path: &Path, progress: &dyn Progress) -> Result<Measured, LabError> {
    measure_on(&replay::recorded(path)?, progress)
}

fn measure_on(cases: &[(Stage, Episode)], progress: &dyn Progress) -> Result<Measured, LabError> {
    let Some(steps) = cases.iter().map(|(_, episode)| episode.frames.len()).reduce(|a, b| a + b) else {
        return Err(LabError::input("no episode to step through").with_hint("take more tasks, or another seed"));
    };
    let broke = |error| LabError::broken("stepping through an episode broke", error);
    let (mut identical, mut restored) = (true, true);
    progress.begin("comparing", cases.len());
    for (stage, episode) in cases {
        identical &= is_identical(stage, episode).map_err(broke)?;
        restored &= is_restored(stage, episode).map_err(broke)?;
        progress.advance();
    }
    progress.end();
    progress.begin("timing", REPEATS);
    let mut repeats = Vec::new();
    for _ in 0..REPEATS {
        let (mut bare_s, mut stepped_s) = (0.0, 0.0);
        for (stage, episode) in cases {
            bare_s += bare(stage, episode).map_err(broke)?;
            stepped_s += stepped(stage, episode).map_err(broke)?;
        }
        repeats.push((bare_s, stepped_s));
        progress.advance();
    }
    progress.end();
    let rate = |seconds: f64| steps as f64 / seconds.max(1e-9);
    Ok(Measured {
        episodes: cases.len(),
        control_steps_per_s: rate(median(repeats.iter().map(|(_, stepped_s)| *stepped_s))),
        bare_steps_per_s: rate(median(repeats.iter().map(|(bare_s, _)| *bare_s))),
        ratio: median(repeats.iter().map(|(bare_s, stepped_s)| bare_s / stepped_s.max(1e-9))),
        image_steps_per_s: with_images(cases).map_err(broke)?,
        identical_to_collect: identical,
        restore_identical: restored,
    })
}

/// Environment at the start of an episode; its horizon exceeds the recorded frames, so that it does not end the
/// episode.
fn begin(stage: &Stage, episode: &Episode) -> Environment {
    let horizon_s = (episode.frames.len() + 1) as f64 / stage.control_rate_hz();
    let mut environment = Environment::new(RolloutSettings { horizon_s, ..RolloutSettings::default() });
    environment.reset(stage, episode.result.seed);
    environment
}

/// Applies the commands from frame `from` on. The frames of settling after the last command are cut off, since the
/// recording contains its own.
fn run_through(mut environment: Environment, episode: &Episode, from: usize) -> Result<Episode, RolloutError> {
    for frame in &episode.frames[from..] {
        environment.step(&frame.command)?;
    }
    let state = environment.save()?;
    let mut ended = environment.finish(Conclusion {
        id: &episode.result.id,
        policy: &episode.result.policy,
        oracle: episode.result.oracle,
        ending: Ending::Finished,
        gave_up: None,
    })?;
    ended.frames.truncate(episode.frames.len());
    ended.final_state = state.state().to_vec();
    Ok(ended)
}

fn is_identical(stage: &Stage, episode: &Episode) -> Result<bool, RolloutError> {
    let ended = run_through(begin(stage, episode), episode, 0)?;
    Ok(bits(&ended.initial_state) == bits(&episode.initial_state)
        && bits(&ended.final_state) == bits(&episode.final_state)
        && ended.frames == episode.frames)
}

fn is_restored(stage: &Stage, episode: &Episode) -> Result<bool, RolloutError> {
    let middle = episode.frames.len() / 2;
    let mut first = begin(stage, episode);
    for frame in &episode.frames[..middle] {
        first.step(&frame.command)?;
    }
    let saved = first.save()?;
    let mut second = begin(stage, episode);
    second.restore(&saved)?;
    let (first, second) = (run_through(first, episode, middle)?, run_through(second, episode, middle)?);
    Ok(first == second && bits(&first.final_state) == bits(&second.final_state))
}

/// CPU time of all commands of an episode in the bare simulation, s.
fn bare(stage: &Stage, episode: &Episode) -> Result<f64, RolloutError> {
    let mut sim = Sim::new(Arc::clone(&stage.scene));
    let mut clock = cpu_clock();
    for frame in &episode.frames {
        std::hint::black_box(sim.control_step(&frame.command)?);
    }
    Ok(clock())
}

/// CPU time of all commands of an episode through the environment, s.
fn stepped(stage: &Stage, episode: &Episode) -> Result<f64, RolloutError> {
    let mut environment = begin(stage, episode);
    let mut clock = cpu_clock();
    for frame in &episode.frames {
        std::hint::black_box(environment.step(&frame.command)?);
    }
    Ok(clock())
}

/// Control steps per second of CPU time, with a colour image of the first camera every few steps.
fn with_images(cases: &[(Stage, Episode)]) -> Result<f64, RolloutError> {
    let (mut steps, mut seconds) = (0, 0.0);
    for (stage, episode) in cases {
        let Some(camera) = stage.scenario.world.cameras.first() else { continue };
        let request = [CameraRequest::new(&camera.name, ImageChannels::RGB).sized(IMAGE_SIZE, IMAGE_SIZE)];
        let mut environment = begin(stage, episode);
        // The first observation builds the renderer's meshes, which are then reused by the stage; it is not timed.
        environment.observe(&request)?;
        let mut clock = cpu_clock();
        for (number, frame) in episode.frames.iter().enumerate().take(IMAGE_STEPS - steps) {
            if number.is_multiple_of(STEPS_PER_IMAGE) {
                std::hint::black_box(environment.observe(&request)?);
            }
            environment.step(&frame.command)?;
            steps += 1;
        }
        seconds += clock();
        if steps >= IMAGE_STEPS {
            break;
        }
    }
    Ok(steps as f64 / seconds.max(1e-9))
}

fn bits(state: &[f64]) -> Vec<u64> {
    state.iter().map(|value| value.to_bits()).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let rate = |steps_per_s: f64| format!("{steps_per_s:.0} steps/s");
    let said = |holds: bool| if holds { "yes" } else { "no" }.to_owned();
    let rows = [
        ("episodes", measured.episodes.to_string()),
        ("environment", rate(measured.control_steps_per_s)),
        ("bare simulation", rate(measured.bare_steps_per_s)),
        ("ratio", format!("{:.3}", measured.ratio)),
        ("with images at 15 Hz", rate(measured.image_steps_per_s)),
        ("identical to collect", said(measured.identical_to_collect)),
        ("restored identically", said(measured.restore_identical)),
    ];
    text_table(&rows.map(|(what, value)| vec![what.to_owned(), value]))
}
