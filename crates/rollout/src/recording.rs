//! Recording of an episode in progress: frames, events, memory of the judge, and moments to return to.

use genmanip_core::{Frame, GoalVerdict, Seed, StrayContact};
use genmanip_sim::BodyId;

use crate::Stage;
use crate::evidence::{Evidence, Unreachable};

/// An event of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Start of the control interval of the event; for goal events, the time of the verdict.
    pub time_s: f64,
    /// Kind of event, with its object or bodies.
    pub kind: EventKind,
}

/// Kinds of events that the environment reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// Both fingers started to press on the object with this index.
    Grasped(usize),
    /// The grip on the object with this index ended.
    Released(usize),
    /// A link of the robot started to touch something it should not, or the touched body changed.
    StrayContact([BodyId; 2]),
    /// The goal holds, and did not at the previous verdict.
    GoalReached,
    /// The goal no longer holds.
    GoalLost,
}

/// Complete state of an episode at one moment: simulation, judge's memory, recording and events.
#[derive(Clone, Debug)]
pub struct Snapshot {
    pub(crate) stage: Stage,
    pub(crate) seed: Seed,
    pub(crate) state: Vec<f64>,
    pub(crate) record: Record,
}

impl Snapshot {
    /// Complete state of the simulation.
    pub fn state(&self) -> &[f64] {
        &self.state
    }
}

/// Moment of an episode to which [`Environment::rewind`](crate::Environment::rewind) returns. It holds no frames, so
/// that an episode may have many.
#[derive(Clone, Debug)]
pub struct Mark {
    pub(crate) state: Vec<f64>,
    pub(crate) memory: Memory,
    /// Numbers of frames and events so far.
    pub(crate) frames: usize,
    pub(crate) events: usize,
}

impl Mark {
    /// Number of control steps before the moment.
    pub fn step(&self) -> usize {
        self.frames
    }
}

/// Recording of the episode so far, without the simulation state.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub(crate) initial_state: Vec<f64>,
    pub(crate) frames: Vec<Frame>,
    pub(crate) events: Vec<Event>,
    pub(crate) memory: Memory,
}

/// Memory of judging and explaining, beside the frames and events of an episode.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    pub(crate) success_once: bool,
    /// Number of control steps when the goal was first seen to hold, if it has held since; `None` otherwise.
    pub(crate) held_since: Option<usize>,
    pub(crate) worst_stray_n: f64,
    pub(crate) stray_contact: Option<StrayContact>,
    /// Bodies of the stray contact in the last control interval; `None` without one.
    pub(crate) stray_bodies: Option<[BodyId; 2]>,
    /// Index of the object gripped last, and time of the last grip (s). `None` before the first grip.
    pub(crate) last_gripped: Option<(usize, f64)>,
    /// Named state of each object's joints at the last verdict, for hysteresis: a state lasts until it is clearly left.
    pub(crate) joint_states: Vec<Option<String>>,
    /// Summary of the actions whose pose was unreachable; `None` if there were none.
    pub(crate) unreachable: Option<Unreachable>,
    /// Number of control steps before settling, and the verdict after it; `None` before settling.
    pub(crate) settled: Option<(usize, GoalVerdict)>,
}

impl Record {
    pub(crate) fn seen(&self) -> Evidence<'_> {
        Evidence { frames: &self.frames, unreachable: self.memory.unreachable.as_ref() }
    }
}
