//! Runs of version 1: they hold tasks of version 1.

use serde_json::{Map, Value};

use super::{objects, task};
use crate::{DocumentError, Upgrade};

/// From `genmanip.run/1`.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.run/1", upgrade: from_1 };

fn from_1(run: &mut Map<String, Value>) -> Result<(), DocumentError> {
    objects(run, "tasks", "$")?.into_iter().try_for_each(task::from_1)
}
