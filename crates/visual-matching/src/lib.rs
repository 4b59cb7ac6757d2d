//! Worlds that look like photographs of a real workspace.
//!
//! ```text
//! photographs of a colour chart ──response──▶ linear radiance ──light──▶ key light and ambient light
//! of the empty table,                                         ├─emptied──▶ background without the arm
//! of known objects                                            └─materials▶ colour and roughness of their parts
//! ```
//!
//! [`match_workspace`] takes photographs from the world's calibrated cameras and writes what it finds into
//! `World::appearance`: response of each camera, light, table colour and photographs. Quantities
//! that the photographs do not determine are named ([`Unidentified`]) and keep their defaults. Images are compared by [`compare`], ΔE2000 and FLIP.

mod cameras;
pub mod chart;
pub mod compare;
pub mod difference;
mod empty;
mod error;
pub mod flip;
mod light;
mod matching;
mod material_fit;
mod materials;
pub mod noise;
pub mod report;
mod request;
pub mod response;
mod scene;
mod unidentified;
mod views;

pub use error::MatchError;
pub use light::LightEstimate;
pub use matching::{Matched, match_workspace};
pub use materials::FoundMaterial;
pub use request::{ChartPhoto, MatchRequest, ObjectScene, Photo};
pub use scene::KeyLight;
pub use unidentified::{Unidentified, names};
pub use views::MatchedCamera;
