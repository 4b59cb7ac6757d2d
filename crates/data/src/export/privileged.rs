//! Optional columns of simulator ground truth about the objects, for critics and teachers but not for policies.

use genmanip_core::{Frame, ObjectState};

use super::features::{Feature, Values};
use crate::DataError;
use crate::frames::pose_to_row;

/// Object slots per row, fixed so that data sets of different scenes can be merged. Generated scenes have at most ten
/// objects; the rest is reserve.
pub const OBJECTS: usize = 16;
/// Exported joints per object: drawer cabinets have two.
const JOINTS: usize = 2;
const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];

/// Pose, speed and joint positions of each object, in the order of the scenario, and the index of the grasped one;
/// empty slots are zero, including the quaternion.
pub fn features(states: &[&Frame], id: &str) -> Result<Vec<Feature>, DataError> {
    let most = states.iter().map(|state| state.objects.len()).max().unwrap_or(0);
    if most > OBJECTS {
        let what = format!("objects of episode {id} for the columns `sim.object_…`");
        return Err(DataError::mismatch(what, format!("at most {OBJECTS}"), most));
    }
    let joint = |object: &ObjectState, joint: usize| object.joint_positions.get(joint).copied().unwrap_or(0.0);
    let held = |state: &&Frame| state.grasped.and_then(|index| i64::try_from(index).ok()).unwrap_or(-1);
    Ok(vec![
        per_object("sim.object_pose", &POSE, states, &|object| pose_to_row(&object.pose).to_vec()),
        per_object("sim.object_speed", &["linear", "angular"], states, &|object| {
            vec![object.speed, object.angular_speed]
        }),
        per_object("sim.object_joint_position", &["joint_0", "joint_1"], states, &|object| {
            (0..JOINTS).map(|index| joint(object, index)).collect()
        }),
        Feature::new("sim.grasped_object", &[], Values::I64(states.iter().map(held).collect())),
    ])
}

fn per_object(key: &str, parts: &[&str], states: &[&Frame], of: &dyn Fn(&ObjectState) -> Vec<f64>) -> Feature {
    let names: Vec<String> =
        (0..OBJECTS).flat_map(|object| parts.iter().map(move |part| format!("object_{object}.{part}"))).collect();
    let mut values = Vec::with_capacity(states.len() * names.len());
    for state in states {
        let known = state.objects.iter().flat_map(of).map(|value| value as f32);
        let missing = (OBJECTS - state.objects.len().min(OBJECTS)) * parts.len();
        values.extend(known.chain(std::iter::repeat_n(0.0, missing)));
    }
    Feature { key: key.into(), names, values: Values::F32(values) }
}
