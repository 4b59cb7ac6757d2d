//! What happened: frames, episodes, results.

use std::cmp::Ordering;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Document, GoalVerdict, Pose, Scenario, Seed, Upgrade, WorldHashes, upgrade};

/// The world at one control step and the command in force during the following interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Time since the start of the episode.
    pub time_s: f64,
    /// Arm joint targets and gripper width, as applied.
    pub command: Vec<f32>,
    /// Arm joint positions.
    pub joint_position: Vec<f64>,
    /// Arm joint velocities.
    pub joint_velocity: Vec<f64>,
    /// Largest magnitude of each arm joint's torque during the interval, N·m.
    pub joint_torque: Vec<f64>,
    /// Opening between the pads.
    pub gripper_width: f64,
    /// Largest force the gripper's drive exerted during the interval (sum over both fingers), N.
    pub grip_force: f64,
    /// `world_from_tcp`.
    pub tcp: Pose,
    /// Objects in the order of the scenario.
    pub objects: Vec<ObjectState>,
    /// Index of the object that both fingers touch.
    pub grasped: Option<usize>,
    /// Largest contact force during the interval between the robot and anything but the grasped object, N.
    pub stray_contact_n: f64,
}

/// Where an object is and how it moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectState {
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions of an articulated object.
    pub joint_positions: Vec<f64>,
    /// Linear speed, m/s.
    pub speed: f64,
    /// Angular speed, rad/s.
    pub angular_speed: f64,
}

/// A recorded episode: enough to replay it bit for bit and to draw it from anywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// What it started from.
    pub scenario: Scenario,
    /// How it went.
    pub result: EpisodeResult,
    /// Complete state of the simulation before the first command.
    pub initial_state: Vec<f64>,
    /// Complete state of the simulation after the last frame.
    pub final_state: Vec<f64>,
    /// One per control step.
    pub frames: Vec<Frame>,
}

/// The judged outcome of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EpisodeResult {
    /// Name of the episode, usable as a file name.
    pub id: String,
    /// Id of the scenario.
    pub scenario_id: String,
    /// Id of the task.
    pub task_id: String,
    /// Name of the policy.
    pub policy: String,
    /// Whether the policy read simulator truth.
    pub oracle: bool,
    /// Stream of the episode.
    pub seed: Seed,
    /// The headline: the goal held at the end, after settling, nothing held or moving.
    pub success: bool,
    /// The goal held at some control step (nothing held, all at rest).
    pub success_once: bool,
    /// The verdict at the end.
    pub verdict: GoalVerdict,
    /// How it ended; `None` when it never began, because no layout was found.
    pub ending: Option<Ending>,
    /// Why it did not succeed: every cause that was seen, the most decisive first; empty after a success.
    pub failures: Vec<Failure>,
    /// Simulated length.
    pub duration_s: f64,
    /// Longest allowed length.
    pub horizon_s: f64,
    /// Control rate.
    pub control_rate_hz: f64,
    /// Number of control steps.
    pub frames: usize,
    /// Distance the tcp travelled.
    pub tcp_path_m: f64,
    /// Largest stray contact of the robot, N.
    pub max_stray_contact_n: f64,
    /// Who touched what in that contact; `None` when there was none.
    #[serde(default)]
    pub stray_contact: Option<StrayContact>,
    /// Hashes of the world's parts, its robot included; results of older versions and attempts without a layout have
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_hashes: Option<WorldHashes>,
    /// What point clouds of the final scene say, of evaluated episodes; beside the headline, which it does not change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud: Option<CloudVerdict>,
    /// Whether the request that was not made is fulfilled at the end, where the scenario has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request_success: Option<bool>,
    /// Where another policy acted first and failed, and what was corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
    /// Physics engine and version, e.g. `mujoco 3.17.0`.
    pub engine: String,
    /// Version of this program.
    pub genmanip_version: String,
}

/// Where an episode was taken over from a policy that had failed: the intervention of DAgger-like training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Correction {
    /// Name of the policy that acted first.
    pub policy: String,
    /// The first control step of the correction; those before it are the failed policy's.
    pub from_step: usize,
    /// Why the episode would have failed there, the most decisive cause first.
    pub failures: Vec<Failure>,
}

/// The goal judged on point clouds, as the paper judges it: from what the fixed cameras see of the final scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CloudVerdict {
    /// Whether the goal holds.
    pub success: bool,
    /// Fraction of the goal reached, 0-1.
    pub score: f64,
    /// Things of the goal that no camera sees enough of, by id; conditions about them do not hold.
    pub unseen: Vec<String>,
}

impl Document for EpisodeResult {
    const SCHEMA: &'static str = "genmanip.result/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::result::FROM_1);
}

impl EpisodeResult {
    /// The most decisive cause, with the evidence of all causes; `None` after a success.
    pub fn failure(&self) -> Option<Failure> {
        let evidence: Vec<&str> = self.failures.iter().map(|failure| failure.evidence.as_str()).collect();
        let first = self.failures.first()?;
        Some(Failure { cause: first.cause, evidence: evidence.join("; ") })
    }
}

/// How an episode ended, whatever came of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The policy said that it is finished.
    Finished,
    /// The policy gave up, or what it returned could not be executed.
    GaveUp,
    /// The longest allowed time was over.
    Horizon,
    /// The goal had held long enough and the loop was told to stop then.
    Success,
}

impl Ending {
    /// The name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::GaveUp => "gave_up",
            Self::Horizon => "horizon",
            Self::Success => "success",
        }
    }
}

/// An episode that was asked for but not run, because its policy could not be reached: no result, to be tried again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotRun {
    /// Name of the episode.
    pub id: String,
    /// Id of the scenario.
    pub scenario_id: String,
    /// What the policy's end said.
    pub reason: String,
}

/// Who touched what in the hardest stray contact of an episode, and when.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StrayContact {
    /// Start of the control interval in which it was hardest.
    pub time_s: f64,
    /// Link of the robot, e.g. `robot/hand`.
    pub link: String,
    /// What it touched: `table`, `floor`, another link of the robot, or an object's uid, e.g. `001` or `057/body`.
    pub other: String,
    /// What the hand was doing.
    pub hand: HandPhase,
    /// Whether it touched what it had held within the last second: what is let go of may fall against the open hand.
    #[serde(default)]
    pub let_go: bool,
}

/// What the hand is doing, as its command and its fingers tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HandPhase {
    /// Nothing between the fingers.
    Empty,
    /// The fingers are sent together.
    Closing,
    /// Both fingers press on something.
    Holding,
    /// The fingers are sent apart.
    Opening,
}

impl HandPhase {
    /// The phase of a frame, given the opening width that was commanded before it.
    pub fn of(frame: &Frame, width_before: f32) -> Self {
        let width = frame.command.last().copied().unwrap_or(width_before);
        match width.total_cmp(&width_before) {
            Ordering::Less => Self::Closing,
            Ordering::Greater => Self::Opening,
            Ordering::Equal if frame.grasped.is_some() => Self::Holding,
            Ordering::Equal => Self::Empty,
        }
    }

    /// The name in files and tables.
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

/// One attempt to collect a demonstration, as counted in the yield.
#[derive(Clone, Debug, PartialEq)]
pub enum AttemptOutcome {
    /// The goal held after settling.
    Verified,
    /// It did not, and why.
    Failed(Failure),
}

/// A cause with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// The cause.
    pub cause: FailureCause,
    /// What was seen, with numbers, e.g. `Red Mug slipped at 3.2 s`.
    pub evidence: String,
}

/// Why an attempt fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FailureCause {
    /// The layout could not be made.
    Layout,
    /// No grasp candidate is free of collisions.
    NoGrasp,
    /// No arm configuration reaches.
    NoIk,
    /// No place satisfies the goal.
    NoGoalPose,
    /// No collision-free path was found.
    Planning,
    /// The object left the gripper while carried, or was never held.
    Slipped,
    /// Something else was knocked over or displaced.
    Disturbed,
    /// Everything ran, the goal does not hold.
    GoalMissed,
    /// The horizon ended first.
    Timeout,
    /// The policy refused or broke.
    Policy,
}

impl FailureCause {
    /// The name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Layout => "layout",
            Self::NoGrasp => "no_grasp",
            Self::NoIk => "no_ik",
            Self::NoGoalPose => "no_goal_pose",
            Self::Planning => "planning",
            Self::Slipped => "slipped",
            Self::Disturbed => "disturbed",
            Self::GoalMissed => "goal_missed",
            Self::Timeout => "timeout",
            Self::Policy => "policy",
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.cause.name(), self.evidence)
    }
}
