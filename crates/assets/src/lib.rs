//! Parametric objects and robots: surfaces, collision pieces and mass properties.
//!
//! Nothing is downloaded or scanned.
//! `data/catalog.json` has one record per object with its description and recipe; each kind of part builds its
//! surface, its exact convex collision pieces and their moments.
//!
//! Articulated objects add links with one joint each, and define the joint intervals of their states.
//! Every state is stable without external force: doors and dials rotate about vertical axes, drawers are level, a
//! chest's lid and a faucet's lever lean against their stops, and a spring carries most of a laptop's lid.
//! The push button latches: a soft spring carries its cap's weight and dry friction of 2 N keeps it where it was
//! pushed, so that `pressed` can be judged after the gripper has left.
//!
//! ```
//! use genmanip_assets::Catalogue;
//! let mug = Catalogue::builtin().build("001")?;
//! assert_eq!(mug.card.name, "Red Mug");
//! assert!(mug.is_hollow(), "it has a cavity");
//! # Ok::<(), genmanip_assets::AssetError>(())
//! ```

mod built_models;
mod catalogue;
mod color;
mod data_file;
mod error;
mod families;
mod finish;
mod frozen;
mod grasps;
mod handle;
pub mod imported;
pub mod instances;
mod link_builder;
pub mod metadata;
mod paint;
mod parts;
mod recipe;
mod record;
mod robot;
pub mod robots;
pub mod search;
pub mod solid;
mod source;
pub mod stable_poses;
pub mod surface;
mod variant;
pub mod world_text;
pub mod worlds;

#[cfg(test)]
mod tests;

pub use catalogue::{CATALOGUES, Catalogue};
pub use error::AssetError;
pub use families::{Families, Family};
pub use frozen::{FrozenAsset, FrozenLink};
pub use grasps::{GraspFile, GraspLibrary, GraspProvenance, ObjectGrasps, cache_grasps, cached_grasps};
pub use handle::{HANDLE, handle_bounds};
pub use robots::panda;
pub use source::AssetSource;
pub use variant::variant;
