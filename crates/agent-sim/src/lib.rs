//! The agent on the simulator: service selection by name, oracle services, failure attribution and counterfactuals.
//!
//! The agent itself sees images, cameras and joint positions.
//! With an oracle service, [`WithTruth`] passes the simulator state to the oracle only; the policy is then marked
//! privileged, and every result made with it is labelled `oracle`.

pub mod act_on_files;
mod annotator;
mod choice;
mod counterfactual;
pub mod demonstration_grasps;
mod failure;
mod grasps;
mod masks;
mod model;
mod oracle;
mod oracle_segmenter;
mod random;
mod recording;
mod truth;
mod words;

pub use annotator::{Annotator, GraspAnnotator};
pub use choice::{AgentChoice, GraspChoice, MadeAgent, MaskChoice, ModelChoice, Transcribing, keep};
pub use counterfactual::Counterfactual;
pub use failure::{Blamed, FailureClass, GRASPS, Heard, Testimony, classify};
pub use masks::OracleMasks;
pub use model::{Account, ModelFile, SharedModel};
pub use oracle::{Dials, ErrorRates, Oracle};
pub use oracle_segmenter::OracleSegmenter;
pub use random::RandomMarks;
pub use recording::Recording;
pub use truth::{Planted, Truth, Turns, WithTruth};
