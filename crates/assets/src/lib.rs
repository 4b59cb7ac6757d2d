//! Objects and robots made from parameters: what they look like, what they touch with, what they weigh.
//!
//! Nothing is downloaded and nothing is scanned.
//! `data/catalog.json` says what each object is (cards), `data/recipes.json` of which parts it is made,
//! and the part families know how to make a part: its surface, its exact convex collision bodies and their moments.
//!
//! ```
//! use genmanip_assets::Catalogue;
//! let mug = Catalogue::builtin().build("001")?;
//! assert_eq!(mug.card.name, "Red Mug");
//! assert!(!mug.cavity.is_empty(), "things can be put in");
//! # Ok::<(), genmanip_assets::AssetError>(())
//! ```

mod catalogue;
mod error;
mod finish;
mod paint;
mod parts;
mod recipe;
mod robot;
mod solid;
mod surface;

#[cfg(test)]
mod tests;

pub use catalogue::Catalogue;
pub use error::AssetError;
pub use robot::{panda, robot_from_json};
