//! Runs of version 1: version 1 tasks, one fixed world, and grasp settings in three sections.

use serde_json::{Map, Value};

use super::{feasibility, object, objects, task, world};
use crate::{DocumentError, Upgrade};

/// Upgrade of a run of version 1 to version 2.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.run/1", upgrade: from_1 };

fn from_1(run: &mut Map<String, Value>) -> Result<(), DocumentError> {
    objects(run, "tasks", "$")?.into_iter().try_for_each(task::from_1)?;
    let settings = object(run, "settings", "$")?;
    feasibility::gather(settings);
    world::replace_settings(settings)
}
