//! Source of the commands of an episode.

use genmanip_core::{EpisodeResult, EpisodeSource, named_enum};
use serde::{Deserialize, Serialize};

/// Name of the expert in results.
const EXPERT: &str = "expert";

named_enum! {
    /// Source of the commands of an episode; data sets are selected by it.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Provenance {
        /// The expert alone.
        Expert = "expert",
        /// A person at a device.
        Teleop = "teleop",
        /// A scripted operator at a virtual device.
        ScriptedTeleop = "scripted_teleop",
        /// A skill that was cut from another episode.
        Transfer = "transfer",
        /// A policy or the expert, and a person or the expert that took over from it.
        Correction = "correction",
        /// Any other policy.
        Policy = "policy",
    }
}

impl Provenance {
    /// Source of the commands of an episode with this result.
    pub fn of(result: &EpisodeResult) -> Self {
        match result.source {
            Some(EpisodeSource::Teleop) => Self::Teleop,
            Some(EpisodeSource::ScriptedTeleop) => Self::ScriptedTeleop,
            Some(EpisodeSource::Transfer) => Self::Transfer,
            Some(EpisodeSource::Correction) => Self::Correction,
            None if result.correction.is_some() => Self::Correction,
            None if result.policy == EXPERT => Self::Expert,
            None => Self::Policy,
        }
    }
}
