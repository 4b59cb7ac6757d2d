//! The contract of the actions of a data set, as the data set carries it.

use serde::{Deserialize, Serialize};

use crate::{ActionSpec, Document};

/// What the `action` column of a data set means; a policy that was trained on it returns such actions.
///
/// Row i holds for `1 / rate_hz` from the time of row i on. Changes and speeds are counted as `delta_from` says; from the
/// robot's home and the open hand in the first row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionContract {
    /// Meaning of the numbers.
    pub action: ActionSpec,
    /// Actions per second; the 60 Hz control rate is a whole multiple.
    pub rate_hz: f64,
    /// Name of the robot.
    pub robot: String,
    /// Names of the numbers, in their order.
    pub names: Vec<String>,
}

impl Document for ActionContract {
    const SCHEMA: &'static str = "genmanip.action_contract/1";
}
