//! Errors of finding and building objects.

use genmanip_core::AssetRef;

/// Errors of the catalogue.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssetError {
    /// Unknown uid.
    #[error("no object has uid \"{got}\"; near misses: {}", if near.is_empty() { "none".into() } else { near.join(", ") })]
    UnknownUid {
        /// The requested uid.
        got: String,
        /// Similar uids and names, best first.
        near: Vec<String>,
    },
    /// Unknown robot.
    #[error("unknown robot \"{got}\"; near misses: {}; known robots: {}", if near.is_empty() { "none".into() } else { near.join(", ") }, known.join(", "))]
    UnknownRobot {
        /// The requested name.
        got: String,
        /// Similar names.
        near: Vec<String>,
        /// All names.
        known: Vec<String>,
    },
    /// The world was made for a different version of its robot.
    #[error(
        "world field {field}: expected {expected}, got {got}; the world was made for a different version of its robot"
    )]
    RobotMismatch {
        /// Field that differs.
        field: &'static str,
        /// Value in the world.
        expected: String,
        /// Value of the robot.
        got: String,
    },
    /// The object has a card but no recipe yet.
    #[error("object {uid} ({name}) has no recipe yet; objects without a recipe: {}", missing.join(", "))]
    NotYetGenerated {
        /// The requested uid.
        uid: String,
        /// Its name.
        name: String,
        /// All uids without a recipe.
        missing: Vec<String>,
    },
    /// The scenario was made with different physics than this version produces.
    #[error(
        "object {id}: expected {what} {expected}, got {got}; the scenario was made with a different version of the assets"
    )]
    Mismatch {
        /// Instance id in the scenario.
        id: String,
        /// Field that differs.
        what: &'static str,
        /// Value in the scenario.
        expected: String,
        /// Current value.
        got: String,
    },
    /// An object without a recipe of its own.
    #[error("{asset} cannot be frozen: it was imported, or is a variant of another object")]
    NoRecipe {
        /// The asset.
        asset: AssetRef,
    },
    /// A frozen object with inconsistent contents.
    #[error("the frozen object {asset}: {message}")]
    NotFrozen {
        /// The asset.
        asset: AssetRef,
        /// The inconsistency.
        message: String,
    },
    /// A family cannot generate the requested object.
    #[error("family {family} cannot generate an object: {reason}")]
    NotGenerated {
        /// Name of the family.
        family: String,
        /// The missing or invalid parameter.
        reason: String,
    },
    /// No opened pack contains the object.
    #[error("no open pack contains the imported object {hash}; open packs with --packs DIR, or import its files again")]
    NotImported {
        /// Hash of the files.
        hash: String,
    },
    /// Grasps that were tried with different physics than this version produces.
    #[error(
        "the tried grasps of object {uid} are stale: expected physics hash {expected}, got {got}; regenerate them with \
         `genmanip grasps bake`"
    )]
    StaleGrasps {
        /// Uid of the object.
        uid: String,
        /// Physics hash that the grasps were tried with.
        expected: String,
        /// Current physics hash of the object.
        got: String,
    },
    /// An invalid data file.
    #[error("{file}: {message}")]
    Data {
        /// Name of the file.
        file: String,
        /// The error and its position.
        message: String,
    },
}
