//! The fixed world of documents from before worlds became data.

#![expect(clippy::approx_constant, reason = "frozen as they were written")]

use serde_json::{Map, Value, json};

use super::lacks;
use crate::DocumentError;

/// [`crate::RobotModel::physics_hash`] of the Panda used by every scenario of version 1.
const PANDA_HASH: &str = "v2:b1cf8b6b79622b1e";

/// Moves `robot`, `robot_home`, `cameras` and `workspace` of a scenario into its `world`.
pub(super) fn insert(body: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let mut take = |key: &str| body.shift_remove(key).ok_or_else(|| lacks("$", &format!("the field `{key}`")));
    let (robot, home) = (take("robot")?, take("robot_home")?);
    let (cameras, workspace) = (take("cameras")?, take("workspace")?);
    if robot != "panda" {
        let message = format!("version 1 knew the robot \"panda\" only, got {robot}");
        return Err(DocumentError::Invalid { path: "$.robot".into(), message });
    }
    let mut world = fixed();
    if let Value::Object(world) = &mut world {
        world.insert("workspace".into(), workspace);
        world.insert("robot".into(), json!({"name": robot, "physics_hash": PANDA_HASH, "home": home}));
        world.insert("cameras".into(), cameras);
    }
    body.insert("world".into(), world);
    Ok(())
}

/// Settings that were fixed in version 1.
fn fixed() -> Value {
    json!({
        "surfaces": [{
            "id": "table",
            "name": "table",
            "top_center_m": [0.55, 0.0, 0.0],
            "yaw_rad": 0.0,
            "size_m": [0.8, 1.1, 0.2],
            "friction": 0.3,
            "edge_margin_m": 0.0,
            "legs": true
        }],
        "floor_z_m": -0.8,
        "physics": {
            "control_rate_hz": 60,
            "physics_rate_hz": 480,
            "gravity_m_s2": 9.81,
            "rotational_friction_m": [0.005, 0.0005],
            "engine": {
                "arena_mib": 16,
                "contact_solimp": [0.95, 0.99, 0.001],
                "contact_solref": [0.006, 1.0],
                "impedance_ratio": 30.0,
                "joint_friction_solimp": [0.999, 0.9999, 0.001],
                "pad_solimp": [0.95, 0.99, 0.001],
                "pad_solref": [0.006, 1.0],
                "solver_iterations": 100
            }
        },
        "relations": {
            "close_m": 0.15,
            "touching_gap_m": 0.02,
            "sinking_m": 0.005,
            "inside_share": 0.5,
            "support_overlap": 0.7,
            "support_area_ratio": 1.5,
            "between_angle_rad": 0.785_398_163_397_448_3,
            "state_hysteresis": 0.1,
            "window_margin_m": 0.01
        }
    })
}

/// `settings.sim` of every run of version 1, which was not configurable.
fn fixed_sim() -> Value {
    json!({
        "physics_rate_hz": 480,
        "control_rate_hz": 60,
        "solver_iterations": 100,
        "impedance_ratio": 30.0,
        "gravity": 9.81,
        "arena_mib": 16,
        "arm_kp": [4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0],
        "arm_kv": [200.0, 200.0, 150.0, 150.0, 60.0, 60.0, 40.0],
        "arm_armature": 0.1,
        "arm_damping": 1.0,
        "grip_force_n": 40.0,
        "grip_kp": 5000.0,
        "grip_overclose_m": 0.01,
        "finger_armature": 0.3,
        "finger_damping": 80.0,
        "pad_friction": [1.0, 0.02, 0.0001],
        "pad_solref": [0.006, 1.0],
        "pad_solimp": [0.95, 0.99, 0.001],
        "object_rotational_friction": [0.005, 0.0005],
        "contact_solref": [0.006, 1.0],
        "contact_solimp": [0.95, 0.99, 0.001],
        "joint_friction_solimp": [0.999, 0.9999, 0.001],
        "table_friction": 0.3,
        "robot_friction": 0.3
    })
}

/// Replaces `sim` and `layout.reach_m` of a run's settings by the `world` of its layouts.
pub(super) fn replace_settings(settings: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let refuse = |path: &str, expected: &Value, got: &Value| {
        let message = format!("version 1 fixed this to {expected}, got {got}");
        Err(DocumentError::Invalid { path: path.into(), message })
    };
    if let Some(sim) = settings.shift_remove("sim").filter(|sim| *sim != fixed_sim()) {
        return refuse("$.settings.sim", &fixed_sim(), &sim);
    }
    let layout = settings.get_mut("layout").and_then(Value::as_object_mut);
    let reach = json!([0.32, 0.70]);
    if let Some(got) = layout.and_then(|layout| layout.shift_remove("reach_m")).filter(|got| *got != reach) {
        return refuse("$.settings.layout.reach_m", &reach, &got);
    }
    let mut world = fixed();
    if let Value::Object(world) = &mut world {
        world.insert("workspace".into(), json!({"x": [0.2, 0.9], "y": [-0.5, 0.5]}));
        let home = json!([0.0, -0.5, 0.0, -2.38, 0.0, 1.88, 0.785_398_163_397]);
        world.insert("robot".into(), json!({"name": "panda", "physics_hash": PANDA_HASH, "home": home}));
        world.insert("cameras".into(), serde_json::from_str(CAMERAS).unwrap_or_default());
    }
    settings.insert("world".into(), world);
    Ok(())
}

/// The five cameras of every scenario of version 1.
const CAMERAS: &str = include_str!("cameras_of_version_1.json");
