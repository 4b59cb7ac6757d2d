//! Why an object cannot be had.

use genmanip_core::AssetRef;

/// Errors of the catalogue.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AssetError {
    /// No such object.
    #[error("no object has uid \"{got}\"; near misses: {}", if near.is_empty() { "none".into() } else { near.join(", ") })]
    UnknownUid {
        /// What was asked for.
        got: String,
        /// Uids and names that look alike, best first.
        near: Vec<String>,
    },
    /// No such robot.
    #[error("no robot is called \"{got}\"; near misses: {}; there are {}", if near.is_empty() { "none".into() } else { near.join(", ") }, known.join(", "))]
    UnknownRobot {
        /// What was asked for.
        got: String,
        /// Names that look alike.
        near: Vec<String>,
        /// All names.
        known: Vec<String>,
    },
    /// A world was made for another version of its robot.
    #[error("world field {field}: expected {expected}, got {got}; the world was made for another version of its robot")]
    RobotMismatch {
        /// Which field of the world differs.
        field: &'static str,
        /// What the world says.
        expected: String,
        /// What the robot has.
        got: String,
    },
    /// The card exists, the generator does not know the object yet.
    #[error("object {uid} ({name}) has no generator yet; without one are {}", missing.join(", "))]
    NotYetGenerated {
        /// What was asked for.
        uid: String,
        /// Its name.
        name: String,
        /// All uids without a generator.
        missing: Vec<String>,
    },
    /// A scenario was made with other physics than this version of the generator makes.
    #[error("object {id}: expected {what} {expected}, got {got}; the scenario was made with other assets")]
    Mismatch {
        /// What the scenario calls the object.
        id: String,
        /// Which field differs.
        what: &'static str,
        /// What the scenario names.
        expected: String,
        /// What this program makes.
        got: String,
    },
    /// Objects that were not made from a recipe of their own.
    #[error("{asset} cannot be frozen: it was imported, or varies another object")]
    NoRecipe {
        /// Which.
        asset: AssetRef,
    },
    /// A frozen object whose file says what cannot be.
    #[error("the frozen object {asset}: {message}")]
    NotFrozen {
        /// Which.
        asset: AssetRef,
        /// What is wrong.
        message: String,
    },
    /// A family cannot make what a reference asks for.
    #[error("family {family} cannot make an object: {reason}")]
    NotGenerated {
        /// Name of the family.
        family: String,
        /// Which parameter is missing or wrong.
        reason: String,
    },
    /// No opened pack holds the object.
    #[error("no pack holds the imported object {hash}; open packs with --packs DIR, or import its files again")]
    NotImported {
        /// Hash of the files.
        hash: String,
    },
    /// Grasps that were tried with other physics than this version of the generator makes.
    #[error(
        "the tried grasps of object {uid} are stale: expected physics hash {expected}, got {got}; make them again with \
         `genmanip grasps bake`"
    )]
    StaleGrasps {
        /// Uid of the object.
        uid: String,
        /// Hash that the grasps were tried with.
        expected: String,
        /// Hash of the object as it is now.
        got: String,
    },
    /// A data file that cannot be read.
    #[error("{file}: {message}")]
    Data {
        /// Which file.
        file: String,
        /// What is wrong and where.
        message: String,
    },
}
