//! Source demonstrations: takes of the scripted operator through the input path, and the skills cut from them.

use genmanip_assets::GraspLibrary;
use genmanip_core::{Episode, Scenario, Seed};
use genmanip_data::EpisodeStore;
use genmanip_layout::articulation::joint_changes;
use genmanip_rollout::collect::Resources;
use genmanip_rollout::{RolloutError, RolloutSettings, Stage};
use genmanip_skills::operator::{joint_script, squeeze_m};
use genmanip_skills::{Skill, record};
use genmanip_studio::teleop::{Take, is_replayed};
use genmanip_teleop::scripted::{Habits, ScriptedOperator, VirtualKind, Waypoint};
use genmanip_teleop::{TeleopSettings, Teleoperation};
use serde::Serialize;

use super::resets::{RANGES, SkillCase, reset};
use crate::LabError;
use crate::teleop::script::script;

/// Time limit of a take, s.
const HORIZON_S: f64 = 60.0;
/// Most takes per source demonstration that is wanted.
const TAKES_PER_SOURCE: usize = 4;

/// A source demonstration and the skill cut from it.
pub struct Demonstration {
    /// Scene of the take.
    pub stage: Stage,
    /// The take.
    pub episode: Episode,
    /// Skill cut from it.
    pub skill: Skill,
}

/// Takes that were made for a skill.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Takes {
    /// Number of takes of the scripted operator.
    pub made: usize,
    /// Number of those whose goal held after settling.
    pub succeeded: usize,
    /// Number of stored takes whose commands and whose raw events both replay to the same states, bit for bit.
    pub replay_equal: usize,
    /// Reasons why others gave no skill.
    pub refused: Vec<String>,
}

/// Takes of the scripted operator, the devices in turn, until there are as many skills as wanted.
pub fn demonstrations(
    case: &SkillCase,
    base: &Scenario,
    wanted: usize,
    seed: Seed,
    resources: Resources,
    store: &EpisodeStore,
) -> Result<(Vec<Demonstration>, Takes), LabError> {
    let (mut found, mut takes) = (Vec::new(), Takes::default());
    while found.len() < wanted && takes.made < wanted * TAKES_PER_SOURCE {
        let number = takes.made;
        let own = seed.fork("take").fork_index(number as u64);
        let id = format!("{}-take-{number:02}", case.verb.name());
        // The middle range: a person moves the object between takes.
        let stage = reset(base, case, &RANGES[1], id.clone(), own, resources)?;
        let kind = VirtualKind::ALL[number % VirtualKind::ALL.len()];
        takes.made += 1;
        let episode = take(&stage, case, kind, &id, own, resources.grasps, store)?;
        takes.succeeded += usize::from(episode.result.success);
        takes.replay_equal += usize::from(is_replayed(&stage, store, &id, &rollout_settings())?);
        let hash = store.record_hash(&id).map_err(|error| LabError::broken("a take cannot be read back", error))?;
        match record(&stage, &episode, &id, &hash) {
            Ok(skill) => found.push(Demonstration { stage, episode, skill }),
            Err(error) => {
                let evidence =
                    episode.result.failure().map_or_else(String::new, |failure| format!(": {}", failure.evidence));
                takes.refused.push(format!("{id}: {error}{evidence}"));
            }
        }
    }
    Ok((found, takes))
}

/// Poses that the scripted operator wants to reach.
fn waypoints(stage: &Stage, case: &SkillCase, grasps: &GraspLibrary) -> Option<Vec<Waypoint>> {
    if !case.under.is_empty() {
        return Some(script(stage, grasps)?.waypoints);
    }
    let change = joint_changes(stage.start(), 0, case.states[1]).into_iter().next()?;
    let placed = &stage.scenario.objects[0];
    let tcp = stage.robot.tcp_pose(&stage.scenario.world.robot.home);
    joint_script(&stage.models[0], &placed.pose, &placed.joint_positions, &change, &tcp)
}

fn rollout_settings() -> RolloutSettings {
    RolloutSettings { horizon_s: HORIZON_S, ..RolloutSettings::default() }
}

/// Runs and stores a take of the scripted operator.
fn take(
    stage: &Stage,
    case: &SkillCase,
    kind: VirtualKind,
    id: &str,
    seed: Seed,
    grasps: &GraspLibrary,
    store: &EpisodeStore,
) -> Result<Episode, LabError> {
    let mut settings = TeleopSettings::default();
    if let Some(gentle_m) = squeeze_m(case.verb) {
        settings.input.squeeze_m = gentle_m;
    }
    let script =
        waypoints(stage, case, grasps).ok_or_else(|| LabError::input(format!("{id}: nothing can be moved")))?;
    let period_s = 1.0 / stage.control_rate_hz();
    let operator = ScriptedOperator::new(kind, script, Habits::default(), settings.mapping.clone(), period_s);
    let mut policy = Teleoperation::new(settings, Box::new(operator), &stage.robot, &stage.scenario.world)
        .map_err(LabError::input)?;
    let broke = |error: RolloutError| LabError::broken(format!("take {id} broke"), error);
    let take = Take::run(stage, &mut policy, id, seed, &rollout_settings(), &mut |_| Ok(())).map_err(broke)?;
    take.store(store).map_err(|error| LabError::broken("a take cannot be stored", error))?;
    Ok(take.episode)
}
