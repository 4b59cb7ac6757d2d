//! How documents of the version before become documents of the present one.
//!
//! What the older version did not say is filled in with what was fixed while it was current, written out here as
//! literals and never taken from today's defaults: otherwise an old file would change its meaning with them.

mod world;

use serde_json::{Map, Value};

use crate::DocumentError;

/// A scenario of version 1: robot, cameras and workspace move into a world, the rest of which was fixed then.
pub(crate) fn scenario_of_version_1(body: &mut Map<String, Value>) -> Result<(), DocumentError> {
    world::insert_world_of_version_1(body)
}

/// The settings of a run of version 1: physics and reach, which could not be chosen then, give way to the world.
///
/// # Errors
/// When the run was made with other numbers than those that were fixed then.
pub fn run_settings_of_version_1(settings: &mut Map<String, Value>) -> Result<(), DocumentError> {
    world::replace_settings_of_version_1(settings)
}
