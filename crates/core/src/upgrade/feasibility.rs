//! Upgrade of version 1 pick-and-place settings, in three sections, to those of the shared feasibility query.

use serde_json::{Map, Value, json};

/// Moves `planner.reach` to `layout.grasp`, and the expert's grasp settings to `expert.feasibility`.
pub(super) fn gather(settings: &mut Map<String, Value>) {
    let mut section = |name: &str| settings.get_mut(name).and_then(Value::as_object_mut).map(std::mem::take);
    let (mut layout, mut planner, mut expert) = (
        section("layout").unwrap_or_default(),
        section("planner").unwrap_or_default(),
        section("expert").unwrap_or_default(),
    );
    let heights = json!([0.003, 0.015, 0.03, 0.05, 0.08, 0.12]);

    let reach = planner.shift_remove("reach").unwrap_or_default();
    let reach = |key: &str, fixed: Value| reach.get(key).cloned().unwrap_or(fixed);
    let grasp = json!({
        "wanted": 1,
        "configurations": reach("configurations", json!(6)),
        "configurations_kept": 1,
        "half_turn": "both",
        "clearance_m": reach("padding", json!(0.001)),
        "object_clearance_m": null,
        "finger_room_m": null,
        "approach_m": reach("approach", json!(0.08)),
        "tests_pregrasp": true,
        "lift_m": 0.1,
        "release_heights_m": heights,
        "goal_configurations": 4,
    });
    layout.insert("grasp".into(), grasp);

    let mut known = |key: &str, fixed: Value| expert.shift_remove(key).unwrap_or(fixed);
    let clearances = known("hand_clearances_m", json!([0.003, 0.001]));
    let feasibility = json!({
        "wanted": known("planned_grasps", json!(12)),
        "configurations": 48,
        "configurations_kept": 1,
        "half_turn": "both",
        "clearance_m": clearances[0],
        "object_clearance_m": known("object_clearance_m", json!(0.0005)),
        "finger_room_m": known("finger_clearance_m", json!(0.024)),
        "approach_m": known("approach_m", json!(0.09)),
        "tests_pregrasp": false,
        "lift_m": known("lift_m", json!(0.1)),
        "release_heights_m": known("release_heights_m", heights),
        "goal_configurations": 4,
    });
    expert.insert("feasibility".into(), feasibility);
    expert.insert("tight_clearance_m".into(), clearances[1].clone());
    expert.insert("rim_clearance_m".into(), json!(0.03));
    expert.insert("fingers_m_s".into(), json!(0.08));
    for (name, section) in [("layout", layout), ("planner", planner), ("expert", expert)] {
        settings.insert(name.into(), section.into());
    }
}
