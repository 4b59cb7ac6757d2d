//! Recorded data: native episode store, camera tracks, and exporters.
//!
//! The store is the source of truth; every other format is a pure function of it.
//!
//! ```no_run
//! use genmanip_data::export::Selection;
//! use genmanip_data::{EpisodeStore, lerobot};
//! # fn main() -> Result<(), genmanip_data::DataError> {
//! # let robot: genmanip_core::RobotModel = unimplemented!();
//! let store = EpisodeStore::open("out/episodes")?;
//! let settings = lerobot::LerobotSettings::default();
//! let report = lerobot::export(&store, &Selection::Verified, &robot, &settings, "out/dataset".as_ref())?;
//! assert_eq!(report.episodes, store.ids()?.len());
//! # Ok(())
//! # }
//! ```

mod atomic_write;
pub mod check;
mod columns;
pub mod depth;
mod error;
pub mod export;
pub mod files;
mod frames;
pub mod genmanip_format;
pub mod hdf5;
pub mod images;
pub mod import;
mod inventory;
pub mod lerobot;
mod manifest;
pub mod masks;
pub mod mcap;
mod mp4;
mod panics;
mod partial;
pub mod ply;
pub mod store;
mod table;
pub mod video;
mod yuv;
pub mod zarr;

pub use error::DataError;
pub use export::{ExportReport, ExportSettings, Selection};
pub use images::{CameraTrack, ColorHistogram, TrackRecorder};
pub use inventory::{FileInventory, Inspected};
pub use lerobot::LerobotSettings;
pub use store::{Attachment, EpisodeStore, Listing};
pub use video::{EncodedVideo, VideoEncoder, VideoSettings};
