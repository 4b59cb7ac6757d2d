//! Recorded frames, episodes and their results.

use std::cmp::Ordering;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::{AgentFailure, Failure};
use crate::{Document, GoalVerdict, Pose, ReferenceId, Scenario, Seed, Upgrade, WorldHashes, named_enum, upgrade};

/// Simulation state at one control step, and the command applied during the following interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Time since the start of the episode, s.
    pub time_s: f64,
    /// Arm joint targets (rad) and opening width (m), as applied.
    pub command: Vec<f32>,
    /// Arm joint positions, rad.
    pub joint_position: Vec<f64>,
    /// Arm joint velocities, rad/s.
    pub joint_velocity: Vec<f64>,
    /// Peak torque magnitude of each arm joint during the interval, N·m.
    pub joint_torque: Vec<f64>,
    /// Opening width between the pads, m.
    pub gripper_width: f64,
    /// Peak force of the gripper drive during the interval (sum over both fingers), N.
    pub grip_force: f64,
    /// `world_from_tcp` as measured.
    pub tcp: Pose,
    /// States of the objects, in the order of the scenario.
    pub objects: Vec<ObjectState>,
    /// Index of the object pressed by both fingers; `None` if there is none.
    pub grasped: Option<usize>,
    /// Peak contact force during the interval between the robot and anything but the grasped object, N.
    pub stray_contact_n: f64,
}

/// Pose, joint positions and speed of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectState {
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions of an articulated object in link order, rad or m; empty for a rigid one.
    pub joint_positions: Vec<f64>,
    /// Linear speed, m/s.
    pub speed: f64,
    /// Angular speed, rad/s.
    pub angular_speed: f64,
}

/// A recorded episode: enough to replay it bit-exactly and to render it from any viewpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// Task, layout and world.
    pub scenario: Scenario,
    /// Judged outcome.
    pub result: EpisodeResult,
    /// Full simulator state before the first command.
    pub initial_state: Vec<f64>,
    /// Full simulator state after the last frame.
    pub final_state: Vec<f64>,
    /// One frame per control step.
    pub frames: Vec<Frame>,
}

/// The judged outcome of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EpisodeResult {
    /// Episode id, usable as a file name.
    pub id: String,
    /// Id of the scenario that was run.
    pub scenario_id: String,
    /// Id of the scenario's task.
    pub task_id: String,
    /// Name of the policy that acted.
    pub policy: String,
    /// True if the policy reads simulator ground truth.
    pub oracle: bool,
    /// Seed of the episode's random choices.
    pub seed: Seed,
    /// Primary metric: the goal holds at the end, after settling, with nothing held or moving.
    pub success: bool,
    /// True if the goal held at any control step with nothing held and everything at rest.
    pub success_once: bool,
    /// Verdict on the goal at the end of the episode.
    pub verdict: GoalVerdict,
    /// Termination reason; `None` if the episode never began because no layout was found.
    pub ending: Option<Ending>,
    /// Observed failure causes, the most decisive first; empty on success.
    pub failures: Vec<Failure>,
    /// Analysis of an agent's failed episode; absent for other policies and after a success.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent_failure: Option<AgentFailure>,
    /// Simulated duration of the episode, s.
    pub duration_s: f64,
    /// Time limit of the episode, s.
    pub horizon_s: f64,
    /// Control rate of the world, Hz.
    pub control_rate_hz: f64,
    /// Number of control steps that were simulated.
    pub frames: usize,
    /// Number of actions that were held because their pose is unreachable; files omit 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unreachable_actions: usize,
    /// Path length of the TCP, m.
    pub tcp_path_m: f64,
    /// Peak stray contact force of the robot, N.
    pub max_stray_contact_n: f64,
    /// Details of the contact with the peak stray force; `None` if there was none.
    #[serde(default)]
    pub stray_contact: Option<StrayContact>,
    /// Hashes of the world's parts, including its robot; absent in results of older versions and in attempts without a
    /// layout.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_hashes: Option<WorldHashes>,
    /// Verdict on point clouds of the final scene, which does not affect `success`; `None` unless the episode was
    /// evaluated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud: Option<CloudVerdict>,
    /// True if the scenario's alternative request, which was not made, is satisfied at the end; `None` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request_success: Option<bool>,
    /// Takeover from another policy, and the failure that was corrected; `None` in other episodes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
    /// Style of the expert that acted in a collected episode; absent for the default one.
    #[serde(default, skip_serializing_if = "ExpertStyle::is_default")]
    pub expert: ExpertStyle,
    /// Source of the commands of a teleoperated or transferred episode; absent if a policy or the expert gave them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<EpisodeSource>,
    /// Physics engine and version, e.g. `mujoco 3.17.0`.
    pub engine: String,
    /// Version of the program that ran the episode.
    pub genmanip_version: String,
}

named_enum! {
    /// Choices of the expert where several solve the task.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum ExpertStyle {
        /// The best grasp, and a random goal pose: varied demonstrations.
        #[default]
        Default = "default",
        /// The grasp nearest to the gripper's orientation, and the goal pose nearest to the middle of the goal region:
        /// demonstrations that a policy can predict from its observations.
        Consistent = "consistent",
    }
}

named_enum! {
    /// Source of the commands of an episode: people, programs in their place, and takes of theirs; neither a policy nor
    /// the expert.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum EpisodeSource {
        /// A person at a device.
        Teleop = "teleop",
        /// A scripted operator, which acted through the events of a virtual device.
        ScriptedTeleop = "scripted_teleop",
        /// A skill that was cut from another episode and transferred to this scene.
        Transfer = "transfer",
        /// A policy or the expert, from which a person at a device took over.
        Correction = "correction",
    }
}

impl ExpertStyle {
    /// True for the default, which files omit.
    pub fn is_default(&self) -> bool {
        *self == Self::Default
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Takeover of an episode from a failing policy, as in DAgger-style training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Correction {
    /// Name of the policy that acted first.
    pub policy: String,
    /// First control step of the correction; earlier steps belong to that policy.
    pub from_step: usize,
    /// Causes of the failure that the correction prevented, the most decisive first; empty if a person took over before
    /// any failure.
    pub failures: Vec<Failure>,
}

/// Goal verdict computed from point clouds of the fixed cameras in the final scene, as in the paper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CloudVerdict {
    /// True if the goal holds according to the point clouds.
    pub success: bool,
    /// Fraction of conditions that hold in the best alternative, 0-1.
    pub score: f64,
    /// Ids of the goal's objects with too few visible points; conditions on them do not hold.
    pub unseen: Vec<ReferenceId>,
}

impl Document for EpisodeResult {
    const SCHEMA: &'static str = "genmanip.result/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::result::FROM_1);
}

impl EpisodeResult {
    /// The most decisive cause, with the evidence of all causes joined; `None` without causes.
    pub fn failure(&self) -> Option<Failure> {
        let evidence: Vec<&str> = self.failures.iter().map(|failure| failure.evidence.as_str()).collect();
        let first = self.failures.first()?;
        Some(Failure { cause: first.cause, evidence: evidence.join("; ") })
    }
}

/// Termination reason of an episode, regardless of success.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The policy reported that it is finished.
    Finished,
    /// The policy gave up, or returned an action that could not be executed.
    GaveUp,
    /// The time limit was reached.
    Horizon,
    /// The goal held long enough and early termination was enabled.
    Success,
}

impl Ending {
    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::GaveUp => "gave_up",
            Self::Horizon => "horizon",
            Self::Success => "success",
        }
    }
}

/// An episode that was requested but not run because its policy was unreachable or its program made a mistake. It is no
/// result and is retried by the next run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotRun {
    /// Episode id.
    pub id: String,
    /// Id of the scenario that was to be run.
    pub scenario_id: String,
    /// Error reported by the policy's endpoint or program.
    pub reason: String,
    /// True for a mistake of the policy's program; absent otherwise.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mistake: bool,
}

/// Contact behind [`EpisodeResult::max_stray_contact_n`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StrayContact {
    /// Start of the control interval with the peak force, s.
    pub time_s: f64,
    /// Link of the robot, e.g. `robot/hand`.
    pub link: String,
    /// Contact partner: `table`, `floor`, another link of the robot, or an object's link, e.g. `001` or `057/body`.
    pub other: String,
    /// State of the gripper at that time.
    pub hand: GripperPhase,
    /// True if the partner was held within the last second: a released object may fall against the open gripper.
    #[serde(default)]
    pub let_go: bool,
}

/// State of the gripper, derived from its command and contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GripperPhase {
    /// The fingers rest with nothing pressed between them.
    Empty,
    /// The fingers are commanded to close.
    Closing,
    /// The fingers rest and press on an object.
    Holding,
    /// The fingers are commanded to open.
    Opening,
}

impl GripperPhase {
    /// Phase of a frame, given the previously commanded opening width.
    pub fn of(frame: &Frame, width_before: f32) -> Self {
        let width = frame.command.last().copied().unwrap_or(width_before);
        match width.total_cmp(&width_before) {
            Ordering::Less => Self::Closing,
            Ordering::Greater => Self::Opening,
            Ordering::Equal if frame.grasped.is_some() => Self::Holding,
            Ordering::Equal => Self::Empty,
        }
    }

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Closing => "closing",
            Self::Holding => "holding",
            Self::Opening => "opening",
        }
    }
}

impl std::fmt::Display for StrayContact {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let just_held = if self.let_go { ", which it had just held" } else { "" };
        write!(f, "{} on {} at {:.1} s, hand {}{just_held}", self.link, self.other, self.time_s, self.hand.name())
    }
}

/// Outcome of one attempt to collect a demonstration, as counted in the yield.
#[derive(Clone, Debug, PartialEq)]
pub enum AttemptOutcome {
    /// The goal held after settling.
    Verified,
    /// The attempt failed for this cause.
    Failed(Failure),
}
