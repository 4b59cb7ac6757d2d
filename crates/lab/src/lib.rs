//! Measurements on unseen seeds and files.
//!
//! One module per measurement: a function from arguments to serialisable values, and their text summary. Figures are
//! CPU times of one thread unless stated otherwise; nothing is printed.

pub mod agent;
mod agent_page;
pub mod answers;
pub mod assets;
pub mod batch;
pub mod blame;
mod board_images;
mod board_sets;
pub mod bridge;
pub mod calibration;
mod clock;
pub mod data;
pub mod design;
pub mod environment;
mod episodes;
pub mod expert;
pub mod fit;
pub mod grasp;
pub mod hand_eye;
mod hidden_arms;
pub mod hostile;
pub mod identification;
pub mod layout;
pub mod learn;
pub mod learned_controls;
pub mod matching;
pub mod motion;
mod program;
mod quantile;
pub mod readers;
pub mod relations;
pub mod render;
pub mod rendered;
pub mod scale;
pub mod segment;
pub mod statistics;
pub mod strangers;
pub mod studio;
pub mod suite;
pub mod teleop;
pub mod transfer;
pub mod wording;

pub use clock::cpu_clock;
/// Error of a measurement.
pub use genmanip_workspace::WorkspaceError as LabError;
pub use program::program;
pub use quantile::Spread;
