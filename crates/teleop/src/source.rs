//! Source of device events, to be implemented for each way in which an operator's input reaches the program.

use genmanip_core::{EpisodeSource, EpisodeStart, Observation, PolicyError};
use serde::{Deserialize, Serialize};

use crate::device::DeviceEvent;

/// Operator of an episode: a person, or a program in place of one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operator {
    /// Person or program.
    pub kind: OperatorKind,
    /// Name or pseudonym, as the person gave it.
    pub name: String,
}

/// Kind of operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OperatorKind {
    /// A person.
    Person,
    /// A program that sends the events of a virtual device.
    Scripted,
}

impl OperatorKind {
    /// Value of an episode's `source` for this kind of operator.
    pub fn episode_source(self) -> EpisodeSource {
        match self {
            Self::Person => EpisodeSource::Teleop,
            Self::Scripted => EpisodeSource::ScriptedTeleop,
        }
    }
}

/// Source of device events.
pub trait Source: Send {
    /// The operator.
    fn operator(&self) -> Operator;

    /// True if the operator reads simulator ground truth.
    fn is_privileged(&self) -> bool {
        false
    }

    /// Called before the first control step of an episode.
    ///
    /// # Errors
    /// If the source cannot serve the episode.
    fn start(&mut self, start: &EpisodeStart) -> Result<(), PolicyError>;

    /// Events that arrived since the previous control step, in the order of their arrival.
    fn receive(&mut self, step: usize, observation: &Observation) -> Vec<DeviceEvent>;
}
