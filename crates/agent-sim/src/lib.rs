//! The agent on the simulator: service selection by name, oracle services, failure attribution and counterfactuals.
//!
//! The agent itself sees images, cameras and joint positions.
//! With an oracle service, [`GroundTruthFeed`] passes the simulator state to the oracle only; the policy is then marked
//! privileged, and every result made with it is labelled `oracle`.

pub mod act_on_files;
mod annotator;
mod choice;
mod counterfactual;
pub mod demonstration_grasps;
mod failure;
mod grasps;
mod made_agent;
mod masks;
mod model;
mod oracle;
mod oracle_segmenter;
mod random;
mod recording;
mod transcript_page;
mod truth;
mod words;

pub use annotator::{Annotator, GraspAnnotator};
pub use choice::{AgentChoice, GraspChoice, MaskChoice, ModelChoice};
pub use counterfactual::Counterfactual;
pub use failure::{AnswerJudgement, EpisodeJudgements};
pub use made_agent::{MadeAgent, keep};
pub use masks::OracleMasks;
pub use model::{ModelFile, SharedModel, UsageAccount};
pub use oracle::{ErrorInjection, ErrorRates, Oracle};
pub use oracle_segmenter::OracleSegmenter;
pub use random::RandomMarks;
pub use recording::Recording;
pub use truth::{GroundTruth, GroundTruthFeed, InjectedError, TurnSnapshots};
