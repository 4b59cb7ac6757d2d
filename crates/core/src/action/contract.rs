//! The action contract that a dataset carries.

use serde::{Deserialize, Serialize};

use crate::{ActionSpec, Document};

/// Meaning of a dataset's `action` column; a policy trained on the dataset returns such actions.
///
/// Row i holds for `1 / rate_hz` from the timestamp of row i. Deltas and velocities are relative to `delta_from`; in
/// the first row, to the robot's home position and the open gripper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionContract {
    /// Layout of the action vector.
    pub action: ActionSpec,
    /// Action rate, Hz; divides the control rate.
    pub rate_hz: f64,
    /// Name of the robot.
    pub robot: String,
    /// Names of the vector's entries, in order.
    pub names: Vec<String>,
}

impl Document for ActionContract {
    const SCHEMA: &'static str = "genmanip.action_contract/1";
}
