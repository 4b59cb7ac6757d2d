//! Errors of finding and building objects.

use genmanip_core::{AssetRef, AssetUid, InstanceId};

/// Errors of the catalogue, of robots and of worlds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssetError {
    /// No object of the catalogue has this uid.
    #[error("no object has uid \"{got}\"; near misses: {}", if near.is_empty() { "none".into() } else { near.join(", ") })]
    UnknownUid {
        /// The requested uid.
        got: AssetUid,
        /// Similar objects as `uid (name)`, best first.
        near: Vec<String>,
    },
    /// No robot of the registry has this name.
    #[error("unknown robot \"{got}\"; near misses: {}; known robots: {}", if near.is_empty() { "none".into() } else { near.join(", ") }, known.join(", "))]
    UnknownRobot {
        /// The requested name.
        got: String,
        /// Similar names, best first.
        near: Vec<String>,
        /// Names of all robots.
        known: Vec<String>,
    },
    /// The world was made for a version of its robot with other physics or another number of joints.
    #[error(
        "world field {field}: expected {expected}, got {got}; the world was made for a different version of its robot"
    )]
    RobotMismatch {
        /// Name of the field that differs.
        field: &'static str,
        /// Value stated in the world.
        expected: String,
        /// Value that the current robot has.
        got: String,
    },
    /// The object has a card but no recipe yet.
    #[error("object {uid} ({name}) has no recipe yet; objects without a recipe: {}", missing.join(", "))]
    NotYetGenerated {
        /// The requested uid.
        uid: AssetUid,
        /// Name of the object.
        name: String,
        /// Uids of all objects without a recipe.
        missing: Vec<AssetUid>,
    },
    /// The scenario was made with different physics than this version produces.
    #[error(
        "object {id}: expected {what} {expected}, got {got}; the scenario was made with a different version of the assets"
    )]
    Mismatch {
        /// Instance id in the scenario.
        id: InstanceId,
        /// Name of the field that differs.
        what: &'static str,
        /// Value stated in the scenario.
        expected: String,
        /// Value that this version produces.
        got: String,
    },
    /// The object has no recipe of its own, so it cannot be frozen.
    #[error("{asset} cannot be frozen: it was imported, or is a variant of another object")]
    NoRecipe {
        /// Reference of the object that was to be frozen.
        asset: AssetRef,
    },
    /// A frozen object is inconsistent.
    #[error("the frozen object {asset}: {message}")]
    NotFrozen {
        /// Reference of the frozen object.
        asset: AssetRef,
        /// Description of the inconsistency.
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
    #[error("no open pack contains the object {asset}; open packs with --packs DIR, or import its files again")]
    NotImported {
        /// The object.
        asset: AssetRef,
    },
    /// The grasps were tried with different physics than this version produces.
    #[error(
        "the tried grasps of object {uid}{} are stale: expected physics hash {expected}, got {got}; regenerate them with \
         `genmanip grasps bake`",
        robot.as_ref().map_or_else(String::new, |name| format!(" with {name}"))
    )]
    StaleGrasps {
        /// Uid of the object.
        uid: AssetUid,
        /// Name of the robot if the physics hashes are its own.
        robot: Option<String>,
        /// Physics hash that the grasps were tried with.
        expected: String,
        /// Current physics hash of the object.
        got: String,
    },
    /// A data file is invalid.
    #[error("{file}: {message}")]
    Data {
        /// Name of the file.
        file: String,
        /// Description of the error with its position.
        message: String,
    },
}
