//! Verdicts: sound scenarios have no problem, planted faults are found with object and number, and repaired.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{ReferenceId, Scenario};
use genmanip_studio::verdict::{Equipment, Inspection, ProblemCode, Stage, repair_all};
use serde_json::{Value, json};

use crate::{CANS, DRAWER, operation, scenario};

fn inspect(scenario: &Scenario) -> (Equipment, Arc<Scenario>) {
    (Equipment::of_world(&scenario.world).unwrap(), Arc::new(scenario.clone()))
}

#[test]
fn certified_scenarios_are_sound() {
    for name in [CANS, DRAWER, "001_long_horizon-000", "005_common_sense-000"] {
        let (equipment, scenario) = inspect(&scenario(name));
        let verdict = Inspection::new(scenario, &equipment).verdict(7).unwrap();
        let problems: Vec<&String> = verdict.blocking().map(|problem| &problem.message).collect();
        assert!(problems.is_empty() && verdict.revision == 7, "{name}: {problems:?}");
    }
}

/// Applies an operation to the cans; the problem is found at its stage, its first repair removes it, and so does the
/// repair of everything.
fn check(value: Value, stage: Stage, code: ProblemCode, object: &str, words: &str) {
    let cans = scenario(CANS);
    let broken = operation(value.clone()).apply(&cans, Catalogue::all()).unwrap().scenario;
    let (equipment, broken) = inspect(&broken);
    let mut inspection = Inspection::new(Arc::clone(&broken), &equipment);
    let found = inspection.problems(stage).unwrap();
    let problem = found.iter().find(|problem| problem.code == code);
    let problem = problem.unwrap_or_else(|| panic!("{value}: {found:?}"));
    assert_eq!(problem.object.as_ref().map(ReferenceId::as_str), Some(object), "{value}: {problem:?}");
    assert!(problem.message.contains(words) && problem.blocking, "{value}: {}", problem.message);
    let repairs = inspection.repairs(problem).unwrap();
    let repair = repairs.first().unwrap_or_else(|| panic!("{value}: no repair"));
    let mended = repair.operation.apply(&broken, equipment.assets).unwrap().scenario;
    let left = Inspection::new(Arc::new(mended), &equipment).problems(stage).unwrap();
    assert!(left.iter().all(|left| !left.is_same(problem)), "{value}: {}: {left:?}", repair.label);
    // Equal scenarios have equal repairs.
    assert_eq!(Inspection::new(Arc::clone(&broken), &equipment).repairs(problem).unwrap(), repairs, "{value}");
    let repaired = repair_all(broken, &equipment).unwrap();
    assert!(repaired.left.is_empty() && !repaired.repairs.is_empty(), "{value}: {:?}", repaired.left);
}

#[test]
fn planted_faults_are_found_and_repaired() {
    let can = scenario(CANS).objects[2].clone();
    let place = |id: &str, position: [f64; 3]| {
        let pose = json!({"position_m": position, "orientation_wxyz": can.pose.to_wxyz_array()});
        json!({"op": "place", "args": {"objects": [{"id": id, "pose": pose}]}})
    };
    let [x, y, z] = can.pose.position.to_array();
    let say = json!({"op": "instruction", "args": {"text": "Move the lemon soda can to the left of the cola can."}});
    for (value, stage, code, object, words) in [
        (
            place("020", [x, y, z + 0.03]),
            Stage::Collision,
            ProblemCode::Floating,
            "020",
            "floats 30.0 mm above the table",
        ),
        (
            place("020", [x, y, z - 0.004]),
            Stage::Collision,
            ProblemCode::Overlap,
            "020",
            "overlaps the table by 4.0 mm",
        ),
        (place("020", [1.6, y, z]), Stage::Collision, ProblemCode::Outside, "020", "not over the top"),
        (place("020", [0.549, -0.45, z]), Stage::Relations, ProblemCode::GoalHolds, "020", "the goal holds already"),
        (place("021", [0.7, 0.25, z]), Stage::Relations, ProblemCode::EdgeFalse, "021", "is false"),
        (say, Stage::Wording, ProblemCode::SentenceMismatch, "019", "the instruction"),
    ] {
        check(value, stage, code, object, words);
    }
}
