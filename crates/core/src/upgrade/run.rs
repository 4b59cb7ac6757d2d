//! Runs of version 1: physics and reach could not be chosen, and there was one world.

use serde_json::{Map, Value};

use super::{object, objects, task, world};
use crate::{DocumentError, Upgrade};

/// From `genmanip.run/1`.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.run/1", upgrade: from_1 };

fn from_1(run: &mut Map<String, Value>) -> Result<(), DocumentError> {
    for task in objects(run, "tasks", "$")? {
        task::from_1(task)?;
    }
    world::replace_settings(object(run, "settings", "$")?)
}
