//! Episodes of real tasks: physical plausibility, bit-exact replay, parallel workers, policies of all kinds.

#![allow(clippy::unwrap_used)] // Clippy's exemption covers test functions only, not their helpers.

mod collecting;
mod copies;
mod correcting;
mod evidence;
mod expert;
mod grasping;
mod masking;
mod physics;
mod playing_back;
mod policies;
mod red_pixel;
mod replaying;
mod robots;
mod seeing;
mod shaping;
mod stepping;
mod surfaces;

use std::sync::{Arc, OnceLock};

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, GraspLibrary, panda};
use genmanip_core::{Episode, Scenario, Seed, Task};
use genmanip_layout::LayoutSettings;
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_rollout::collect::{Attempt, Resources};
use genmanip_rollout::expert::{Expert, ExpertSettings};
use genmanip_rollout::{RolloutSettings, Stage, run_episode};
use genmanip_tasks::answer::{RecordedAnswer, check_answer};

/// A fruit on a plate, a cube on a cube, and a cube identified by its position.
const TASKS: [&str; 3] = ["017_pick_and_place", "024_appearance", "021_spatial"];

/// An example task.
fn task(id: &str) -> Task {
    task_in("tasks", id)
}

/// A task from a recorded answer in a folder of the examples.
fn task_in(folder: &str, id: &str) -> Task {
    let path = format!("{}/../../examples/{folder}/{id}.json", env!("CARGO_MANIFEST_DIR"));
    let recorded = RecordedAnswer::from_json(&std::fs::read_to_string(path).unwrap()).unwrap();
    let request = recorded.request(id, Catalogue::builtin().cards()).unwrap();
    check_answer(&recorded.response, &request).task.unwrap()
}

fn planner() -> &'static Arc<Planner> {
    static PLANNER: OnceLock<Arc<Planner>> = OnceLock::new();
    PLANNER.get_or_init(|| Arc::new(Planner::new(panda(), PlannerSettings::default()).unwrap()))
}

fn resources() -> Resources<'static> {
    Resources::builtin(planner())
}

fn scenario(task: &Task) -> Scenario {
    let attempts = Attempt::all(std::slice::from_ref(task), 1, Seed::new(11));
    attempts[0].scenario(resources(), &default_world(), &LayoutSettings::default()).unwrap()
}

fn stage(scenario: Scenario) -> Stage {
    Stage::open(Arc::new(scenario), Catalogue::builtin(), planner().robot()).unwrap()
}

fn expert(stage: &Stage) -> Expert {
    Expert::new(stage, planner(), GraspLibrary::builtin(), ExpertSettings::default()).unwrap()
}

/// An episode of the expert for each of [`TASKS`] with its stage; computed once.
fn episodes() -> &'static [(Stage, Episode)] {
    static EPISODES: OnceLock<Vec<(Stage, Episode)>> = OnceLock::new();
    EPISODES.get_or_init(|| {
        let run = |id: &&str| {
            let stage = stage(scenario(&task(id)));
            let seed = Seed::new(11).fork(id);
            let episode = run_episode(&stage, &mut expert(&stage), id, seed, &RolloutSettings::default()).unwrap();
            (stage, episode)
        };
        TASKS.iter().map(run).collect()
    })
}

/// The fastest stage, for policies that can run on any.
fn any_stage() -> &'static Stage {
    &episodes()[1].0
}
