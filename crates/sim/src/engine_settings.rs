//! Engine-specific solver settings: the `engine` table of a world's physics settings.

use std::collections::BTreeMap;

use genmanip_core::names::near_misses;
use genmanip_core::{Drives, PhysicsSettings, RobotModel};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::SimError;

/// Contact solver settings, read from [`PhysicsSettings::engine`]; the default world's file documents their sources.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EngineSettings {
    /// Maximum number of Newton iterations of the contact solver.
    pub solver_iterations: u32,
    /// Ratio of frictional to normal impedance.
    pub impedance_ratio: f64,
    /// Memory for contacts and constraints per simulation, MiB.
    pub arena_mib: usize,
    /// MuJoCo's `solref` of contacts, except those of the pads: time constant (s) and damping ratio.
    pub contact_solref: [f64; 2],
    /// MuJoCo's `solimp` of contacts, except those of the pads: impedance at zero depth, at full depth, and that depth
    /// (m).
    pub contact_solimp: [f64; 3],
    /// MuJoCo's `solref` of pad contacts: time constant (s) and damping ratio.
    pub pad_solref: [f64; 2],
    /// MuJoCo's `solimp` of pad contacts, as `contact_solimp`.
    pub pad_solimp: [f64; 3],
    /// MuJoCo's `solimp` of dry friction in the joints of objects: impedance at rest, at speed, and the transition
    /// width.
    pub joint_friction_solimp: [f64; 3],
}

/// Maximum length of a value in an error message, characters.
const MAX_SHOWN: usize = 60;

/// Names of all solver settings.
const NAMES: [&str; 8] = [
    "solver_iterations",
    "impedance_ratio",
    "arena_mib",
    "contact_solref",
    "contact_solimp",
    "pad_solref",
    "pad_solimp",
    "joint_friction_solimp",
];

impl EngineSettings {
    /// Reads the table; every setting is required, so that a default of a later version never changes an old world.
    ///
    /// # Errors
    /// [`SimError::Settings`] with the unknown, missing or invalid setting.
    pub fn read(table: &BTreeMap<String, Value>) -> Result<Self, SimError> {
        if let Some(unknown) = table.keys().find(|key| !NAMES.contains(&key.as_str())) {
            let suggestion = near_misses(unknown, &NAMES)
                .first()
                .map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            let all = NAMES.join(", ");
            let text = format!("unknown setting `physics.engine.{unknown}`{suggestion} (known settings: {all})");
            return Err(SimError::Settings(text));
        }
        if let Some(missing) = NAMES.iter().find(|name| !table.contains_key(**name)) {
            return Err(SimError::Settings(format!(
                "`physics.engine.{missing}` is missing; every setting is required"
            )));
        }
        for (name, value) in table {
            let numbers = |count| {
                value.as_array().is_some_and(|list| {
                    list.len() == count && list.iter().all(|entry| entry.as_f64().is_some_and(f64::is_finite))
                })
            };
            let (fits, expected) = match name.as_str() {
                "solver_iterations" | "arena_mib" => {
                    let is_count = value.as_u64().is_some_and(|count| count > 0 && count < 1 << 20);
                    (is_count, "a whole number from 1 to 1048575")
                }
                "impedance_ratio" => (value.as_f64().is_some_and(|r| r.is_finite() && r > 0.0), "a positive number"),
                "contact_solref" | "pad_solref" => (numbers(2), "two numbers"),
                _ => (numbers(3), "three numbers"),
            };
            if !fits {
                let got: String = value.to_string().chars().take(MAX_SHOWN).collect();
                return Err(SimError::Settings(format!("`physics.engine.{name}`: expected {expected}, got {got}")));
            }
        }
        let table: serde_json::Map<String, Value> = table.clone().into_iter().collect();
        serde_json::from_value(Value::Object(table))
            .map_err(|error| SimError::Settings(format!("`physics.engine`: {error}")))
    }
}

/// Validated physics settings of a model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CheckedSettings {
    pub physics: PhysicsSettings,
    pub engine: EngineSettings,
    /// Drives of the robot, if there is one, with the gains of the world.
    pub drives: Option<Drives>,
}

impl CheckedSettings {
    /// Reads and validates the settings.
    ///
    /// # Errors
    /// [`SimError::Settings`] with the field, the expected and the actual value.
    pub fn of(physics: &PhysicsSettings, robot: Option<&RobotModel>) -> Result<Self, SimError> {
        let engine = EngineSettings::read(&physics.engine)?;
        let fail = |text: String| Err(SimError::Settings(text));
        if physics.control_rate_hz == 0 || physics.physics_rate_hz == 0 {
            return fail("`physics_rate_hz` and `control_rate_hz` must be positive".into());
        }
        if !physics.physics_rate_hz.is_multiple_of(physics.control_rate_hz) {
            return fail(format!(
                "`physics_rate_hz` must be a whole multiple of `control_rate_hz`, got {} and {}",
                physics.physics_rate_hz, physics.control_rate_hz
            ));
        }
        for (name, solref) in [("pad_solref", engine.pad_solref), ("contact_solref", engine.contact_solref)] {
            if solref[0] < 2.0 * physics.timestep_s() {
                return fail(format!(
                    "the time constant in `{name}` must be at least two physics steps ({:.5} s), got {}",
                    2.0 * physics.timestep_s(),
                    solref[0]
                ));
            }
        }
        let mut drives = match robot {
            Some(robot) => Some(checked_drives(robot)?),
            None => None,
        };
        if let Some(drives) = &mut drives {
            drives.pad_friction[0] *= physics.pad_friction;
        }
        if let Some(((arm, robot), drives)) = physics.arm.as_ref().zip(robot).zip(drives.as_mut()) {
            if let Some(fault) = arm.faults(robot).first() {
                return fail(fault.to_string());
            }
            for (own, gains) in [(&mut drives.arm_kp, &arm.kp), (&mut drives.arm_kv, &arm.kv)] {
                if !gains.is_empty() {
                    own.clone_from(gains);
                }
            }
        }
        Ok(Self { physics: physics.clone(), engine, drives })
    }
}

fn checked_drives(robot: &RobotModel) -> Result<Drives, SimError> {
    let fail = |text: String| Err(SimError::Settings(text));
    let Some(drives) = robot.drives.clone() else {
        return fail(format!("robot `{}` has no drives: it can be used for planning, but not simulated", robot.name));
    };
    if drives.arm_kp.is_empty() || drives.arm_kv.is_empty() {
        return fail("`arm_kp` and `arm_kv` need at least one value".into());
    }
    let positive = [
        ("grip_force_n", drives.grip_force_n),
        ("grip_kp", drives.grip_kp),
        ("grip_overclose_m", drives.grip_overclose_m),
        ("finger_damping", drives.finger_damping),
    ];
    if let Some((name, value)) = positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
        return fail(format!("`{name}` must be positive, got {value}"));
    }
    let joints = robot.arm_joints().count();
    if robot.home.len() != joints {
        return fail(format!(
            "robot `{}` has {joints} arm joints but its home position has {} values",
            robot.name,
            robot.home.len()
        ));
    }
    if drives.grip_force_n > robot.gripper.max_force {
        return fail(format!(
            "`grip_force_n` must not exceed the gripper's {} N, got {}",
            robot.gripper.max_force, drives.grip_force_n
        ));
    }
    Ok(drives)
}
