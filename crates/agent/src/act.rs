//! One pick and one placement from a single RGB-D image: for images of files, or a real camera and arm.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{EpisodeStart, Observation, Policy, PolicyError, Pose, RgbdImage, Seed};
use genmanip_motion::Planner;
use schemars::JsonSchema;
use serde::Serialize;

use crate::ask::{FailedStage, Transcribed};
use crate::pipeline::Agent;
use crate::settings::AgentSettings;

/// Name of the one camera.
const CAMERA: &str = "camera";
/// Commands per second.
const RATE_HZ: f64 = 60.0;
/// Joints that move less in one step stand still, rad.
const STILL_RAD: f32 = 1e-6;

/// What is to be done, and how things stand.
#[derive(Clone, Debug)]
pub struct ActQuestion {
    /// Colour and depth, with where the camera is in the robot's base frame.
    pub image: RgbdImage,
    /// Arm joint positions, rad.
    pub joints: Vec<f64>,
    /// Opening of the gripper, m.
    pub gripper_width_m: f64,
    /// What is to be done, in words.
    pub instruction: String,
    /// Of the searches.
    pub seed: Seed,
}

/// The motions of the first sub-task, or why there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct Acted {
    /// Commands per second.
    pub rate_hz: f64,
    /// The pick, then the placement.
    pub steps: Vec<ActedStep>,
    /// Why the rest is missing.
    pub failure: Option<FailedStage>,
}

/// One motion from rest to rest.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ActedStep {
    /// What it does, in words.
    pub what: String,
    /// Since the start of the first step, s.
    pub start_s: f64,
    /// Where the arm comes to rest, or the fingers begin to move.
    pub waypoints: Vec<Waypoint>,
    /// Arm joint targets (rad) and opening of the gripper (m), one row per command.
    pub trajectory: Vec<Vec<f32>>,
}

/// A place on the way.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Waypoint {
    /// Since the start of the first step, s.
    pub time_s: f64,
    /// Arm joint targets, rad.
    pub joints: Vec<f64>,
    /// Opening of the gripper, m.
    pub gripper_width_m: f64,
    /// Pose of the tool in the robot's base frame; z points along the fingers, y from one to the other.
    pub world_from_tcp: Pose,
}

impl AgentSettings {
    /// The same for one image: one camera, and no second look.
    #[must_use]
    pub fn for_one_image(self) -> Self {
        Self { cameras: vec![CAMERA.into()], size: None, ..self.open_loop() }
    }
}

/// Asks about an image and plans one pick and one placement; nothing is moved. The thing counts as taken after the first.
///
/// `agent` must have been made with [`AgentSettings::for_one_image`], `transcribed` is its transcript.
///
/// # Errors
/// What the agent cannot work with: an image without depth, a wrong number of joints; a service that does not answer.
/// That no way was found is a result.
pub fn act_once(
    agent: &mut Agent,
    transcribed: &Transcribed,
    planner: &Planner,
    question: &ActQuestion,
) -> Result<Acted, PolicyError> {
    let (instruction, seed) = (question.instruction.clone(), question.seed);
    agent.reset(&EpisodeStart { instruction, seed, cameras: Vec::new(), scenario: None })?;
    let mut acted = Acted { rate_hz: RATE_HZ, ..Acted::default() };
    let (mut joints, mut width_m, mut start_s) = (question.joints.clone(), question.gripper_width_m, 0.0);
    let image = Arc::new(question.image.clone());
    // The pick, then the placement.
    for _ in 0..2 {
        let state: Vec<f64> = joints.iter().copied().chain([width_m]).collect();
        let observation = Observation {
            time_s: start_s,
            state: BTreeMap::from([(Observation::STATE.to_owned(), state)]),
            images: BTreeMap::from([(CAMERA.to_owned(), Arc::clone(&image))]),
            privileged: None,
        };
        let trajectory = match agent.act(&observation) {
            Ok(chunk) => chunk.actions,
            Err(PolicyError::GaveUp(_)) => {
                acted.failure = transcribed.transcript().failure;
                break;
            }
            Err(error) => return Err(error),
        };
        let Some((&last_width, last_arm)) = trajectory.last().and_then(|last| last.split_last()) else { break };
        joints = last_arm.iter().copied().map(f64::from).collect();
        // The fingers press on the thing, and so stand wider than they are told.
        width_m = f64::from(last_width) + agent.settings().motion.squeeze_m;
        let waypoints = waypoints(planner, &trajectory, start_s);
        let what = transcribed.transcript().last_act().unwrap_or_default();
        let duration_s = trajectory.len() as f64 / RATE_HZ;
        acted.steps.push(ActedStep { what, start_s, waypoints, trajectory });
        start_s += duration_s;
    }
    Ok(acted)
}

/// Commands after which the arm stands still, or stood still and moves, and the last.
fn waypoints(planner: &Planner, trajectory: &[Vec<f32>], start_s: f64) -> Vec<Waypoint> {
    let arm = |command: &[f32]| command[..command.len().saturating_sub(1)].to_vec();
    let moves = |index: usize| {
        let Some(next) = trajectory.get(index + 1) else { return false };
        arm(&trajectory[index]).iter().zip(arm(next)).any(|(one, other)| (one - other).abs() > STILL_RAD)
    };
    let is_turn = |index: &usize| *index + 1 == trajectory.len() || *index > 0 && moves(*index) != moves(*index - 1);
    let waypoint = |index: usize| {
        let joints: Vec<f64> = arm(&trajectory[index]).into_iter().map(f64::from).collect();
        Waypoint {
            time_s: start_s + index as f64 / RATE_HZ,
            world_from_tcp: planner.tcp_pose(&joints),
            gripper_width_m: trajectory[index].last().copied().map_or(0.0, f64::from),
            joints,
        }
    };
    (0..trajectory.len()).filter(is_turn).map(waypoint).collect()
}
