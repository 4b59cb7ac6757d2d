//! Plans one pick and one placement from a single RGB-D image, for recorded images or a real camera and arm.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{EpisodeStart, FailedStage, Observation, Policy, PolicyError, Pose, RgbdImage, Seed};
use genmanip_motion::Planner;
use schemars::JsonSchema;
use serde::Serialize;

use crate::ask::TranscriptRecorder;
use crate::pipeline::Agent;
use crate::settings::AgentSettings;

/// Name given to the only camera.
const CAMERA: &str = "camera";
/// Rate of the planned commands, Hz.
const RATE_HZ: f64 = 60.0;
/// Maximum joint step between commands for the arm to count as at rest (rad).
const STILL_RAD: f32 = 1e-6;

/// Instruction, image and robot state to plan from.
#[derive(Clone, Debug)]
pub struct ActQuestion {
    /// Colour and depth image; its camera pose is in the robot's base frame.
    pub image: RgbdImage,
    /// Arm joint positions (rad).
    pub joints: Vec<f64>,
    /// Gripper opening (m).
    pub gripper_width_m: f64,
    /// Instruction in natural language.
    pub instruction: String,
    /// Seed of grasp sampling and motion planning.
    pub seed: Seed,
}

/// Motions of the first sub-task, or the reason why planning failed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct Acted {
    /// Rate of the commands, Hz.
    pub rate_hz: f64,
    /// Planned steps: the pick, then the placement.
    pub steps: Vec<ActedStep>,
    /// Failure of the first step that could not be planned; `None` if both were.
    pub failure: Option<FailedStage>,
}

/// One motion from rest to rest.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ActedStep {
    /// Description of the motion, for people.
    pub what: String,
    /// Time since the start of the first step (s).
    pub start_s: f64,
    /// Configurations at which the arm stops or the gripper starts to move.
    pub waypoints: Vec<Waypoint>,
    /// Arm joint targets (rad) and gripper opening (m), one row per command.
    pub trajectory: Vec<Vec<f32>>,
}

/// A configuration of the arm on the trajectory.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Waypoint {
    /// Time since the start of the first step (s).
    pub time_s: f64,
    /// Arm joint targets (rad).
    pub joints: Vec<f64>,
    /// Gripper opening (m).
    pub gripper_width_m: f64,
    /// Tool pose (TCP) in the robot's base frame; z points along the fingers, y from one finger to the other.
    pub world_from_tcp: Pose,
}

impl AgentSettings {
    /// The settings adapted to a single image: one camera, open loop.
    #[must_use]
    pub fn for_one_image(self) -> Self {
        Self { cameras: vec![CAMERA.into()], size: None, ..self.open_loop() }
    }
}

/// Plans one pick and one placement from an image without moving the robot. The second plan assumes that the pick
/// succeeded.
///
/// `agent` must have been made with [`AgentSettings::for_one_image`], `transcribed` is its transcript.
///
/// # Errors
/// Fails if the image has no depth, the number of joints is wrong, or a service does not answer. A planning failure is
/// reported in [`Acted::failure`].
pub fn plan_pick_and_place(
    agent: &mut Agent,
    transcribed: &TranscriptRecorder,
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
        // While an object is held, the measured width exceeds the commanded width by the squeeze.
        width_m = f64::from(last_width) + agent.settings().motion.squeeze_m;
        let waypoints = waypoints(planner, &trajectory, start_s);
        let what = transcribed.transcript().last_act().unwrap_or_default();
        let duration_s = trajectory.len() as f64 / RATE_HZ;
        acted.steps.push(ActedStep { what, start_s, waypoints, trajectory });
        start_s += duration_s;
    }
    Ok(acted)
}

/// Waypoints where the arm starts or stops moving, and the last command.
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
