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

pub mod atomic_write;
pub mod columns;
pub mod depth;
mod error;
pub mod export;
pub mod files;
pub mod frames;
pub mod genmanip_format;
pub mod hdf5;
pub mod images;
mod inventory;
pub mod lerobot;
mod manifest;
pub mod masks;
pub mod mcap;
pub mod mp4;
pub mod panics;
pub mod partial;
pub mod ply;
mod provenance;
pub mod store;
pub mod table;
pub mod video;
mod yuv;
pub mod zarr;

pub use error::DataError;
pub use export::{ExportReport, ExportSettings, Selection};
pub use images::{CameraTrack, ColorHistogram, TrackRecorder};
pub use inventory::{FileInventory, Inspected};
pub use lerobot::LerobotSettings;
pub use provenance::Provenance;
pub use store::{Attachment, EpisodeStore, Listing};
pub use video::{EncodedVideo, VideoEncoder, VideoSettings};
