//! Objects and robots made from parameters: what they look like, what they touch with, what they weigh.
//!
//! Nothing is downloaded and nothing is scanned.
//! `data/catalog.json` has one record per object: what it is, how it looks, and of which parts it is made,
//! and the part families know how to make a part: its surface, its exact convex collision bodies and their moments.
//!
//! Articulated objects add links with a joint each, and say which joint positions a state of the card stands for.
//! All states are such that the object stays in them by itself: doors and dials turn about upright axes, drawers lie
//! level, a chest's lid and a faucet's lever lean against their stops, and a spring carries most of a laptop's lid.
//! The push button latches: a soft spring carries its cap's weight and dry friction of 2 N keeps it where it was
//! pushed, so that `pressed` can be checked after the hand has left.
//!
//! ```
//! use genmanip_assets::Catalogue;
//! let mug = Catalogue::builtin().build("001")?;
//! assert_eq!(mug.card.name, "Red Mug");
//! assert!(mug.is_hollow(), "things can be put in");
//! # Ok::<(), genmanip_assets::AssetError>(())
//! ```

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
mod link_builder;
pub mod listed;
pub mod notes;
mod paint;
mod parts;
mod recipe;
mod record;
mod robot;
pub mod robots;
pub mod search;
pub mod solid;
mod source;
pub mod standing;
pub mod surface;
mod variant;
pub mod worlds;

#[cfg(test)]
mod tests;

pub use catalogue::{CATALOGUES, Catalogue};
pub use error::AssetError;
pub use families::{Families, Family};
pub use frozen::{FrozenAsset, FrozenLink};
pub use grasps::{GraspFile, GraspLibrary, GraspProvenance, ObjectGrasps, remember, remembered};
pub use handle::{HANDLE, handle_bounds};
pub use robot::{panda, panda_2f85, robot_from_json};
pub use source::AssetSource;
pub use variant::variant;
