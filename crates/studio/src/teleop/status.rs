//! Status of a session, and what a person may ask of it.

use genmanip_core::Pose;
use genmanip_teleop::record::Hold;
use serde::Serialize;

/// Stage of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Waiting for episodes of other jobs.
    #[default]
    Waiting,
    /// The simulation runs in real time.
    Running,
    /// The simulation stands still.
    Paused,
    /// The take is judged, and is to be kept, repeated or discarded.
    Judged,
    /// The take was stored.
    Kept,
    /// All takes were discarded.
    Discarded,
    /// The session has failed.
    Failed,
}

impl Phase {
    /// True if the session has ended.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Kept | Self::Discarded | Self::Failed)
    }
}

/// Command of the person for the take in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TakeCommand {
    /// Goes on.
    Run,
    /// Stands still.
    Pause,
    /// Begins anew; the take is dropped.
    Retry,
    /// Ends the take and stores it.
    Keep,
    /// As [`TakeCommand::Keep`], without the idle ends of the take.
    KeepTrimmed,
    /// Ends the session; nothing is stored.
    Discard,
}

/// Request of the person that ends the stretch of whoever is in command.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// Goes [`BACK_S`](super::session::BACK_S) back, and pauses.
    Back,
    /// Gives the command to a policy, by its name with arguments.
    HandOver(String),
    /// Moves the tool to a pose, `world_from_tcp`, by the planner.
    GoTo(Pose),
    /// Takes the command from a policy.
    TakeOver,
}

impl TakeCommand {
    /// True if the take is to be kept.
    pub fn is_keep(self) -> bool {
        matches!(self, Self::Keep | Self::KeepTrimmed)
    }
}

/// State of a session, as the page shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SessionStatus {
    /// Stage.
    pub phase: Phase,
    /// Number of the take, from 1.
    pub take: usize,
    /// Simulated time of the take, s.
    pub time_s: f64,
    /// Control steps of the take.
    pub steps: usize,
    /// Control steps of the take that began late.
    pub late_steps: usize,
    /// Reason why the deflected device does not move the arm.
    pub held: Option<Hold>,
    /// Limits that slow the tool.
    pub limits: Vec<genmanip_teleop::target::Limit>,
    /// Frame in use.
    pub frame: genmanip_teleop::mapping::OperatorFrame,
    /// Pose of the tool.
    pub world_from_tcp: Pose,
    /// True if the gripper is to be closed.
    pub closed: bool,
    /// Force between the robot and anything but the grasped object, N.
    pub contact_n: f64,
    /// Name of the object that both fingers press.
    pub grasped: Option<String>,
    /// Number of conditions of the goal that hold, and of all, of its best alternative.
    pub conditions: [usize; 2],
    /// Next condition that does not hold.
    pub next: Option<Unmet>,
    /// Policy in command; `None` if the person is.
    pub policy: Option<String>,
    /// Number of times that the person went back, and the simulated time undone by that in all, s.
    pub undone: (usize, f64),
    /// Message for the person, such as the reason why a policy gave up.
    pub note: Option<String>,
    /// Verdict on the settled take; `None` before it.
    pub success: Option<bool>,
    /// Sequence number of the last message with events.
    pub sequence: Option<u64>,
    /// Time of the page at which it was sent, ms.
    pub sent_ms: f64,
    /// Events dropped for their number or size, and messages out of order.
    pub dropped: u64,
}

/// Condition of the goal that does not hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unmet {
    /// Explanation in words and numbers.
    pub text: String,
    /// Distance of the deciding quantity from its threshold.
    pub distance: f64,
    /// Unit of the distance.
    pub unit: Option<genmanip_core::Unit>,
}
