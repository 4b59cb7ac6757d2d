//! Task-generation records of version 1, which embed a task of version 1.

use serde_json::{Map, Value};

use super::task;
use crate::{DocumentError, Upgrade};

/// Upgrade of a task-generation record of version 1 to version 2.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.generation/1", upgrade: from_1 };

fn from_1(generation: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let made = generation.get_mut("result").and_then(|result| result.get_mut("task")).and_then(Value::as_object_mut);
    made.map_or(Ok(()), task::from_1)
}
