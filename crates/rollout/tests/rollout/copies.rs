//! Two instances of one asset, from the language model's answer to the verdict.

use genmanip_assets::Catalogue;
use genmanip_core::{GoalVerdict, InstanceId, Seed, Task, TaskKind};
use genmanip_relations::Rest;
use genmanip_rollout::{RolloutSettings, Stage, run_episode};
use genmanip_tasks::answer::{RecordedAnswer, Verdict, check_answer};
use serde_json::{Value, json};

use crate::{expert, scenario, stage};

const CUBE: &str = "046";
const OTHER: &str = "046#2";
const BOARD: &str = "014";
const MUG: &str = "001";

/// A task parsed from a language model's answer about two red cubes, a mug and a board.
fn task(instruction: &str, subject: &str) -> Task {
    let edge = |subject: &str, position: &str, reference: &str| json!({"obj1": "none", "obj1_uid": subject, "position": position, "obj2": "none", "obj2_uid": reference});
    let nodes: Vec<Value> =
        [CUBE, OTHER, MUG, BOARD].iter().map(|uid| json!({"obj_uid": uid, "state": "none"})).collect();
    let response = json!({
        "instruction": instruction,
        "goal_conditions": [[{
            "obj1": "Red Cube", "obj1_uid": subject, "obj1_state": "none",
            "position": "on", "obj2": "none", "obj2_uid": BOARD,
        }]],
        "scene_graph": {
            "description": "Two red cubes on either side of a mug, and a cutting board.",
            "edges": [edge(CUBE, "left", MUG), edge(OTHER, "right", MUG), edge(BOARD, "front", MUG)],
            "nodes": nodes,
        },
    });
    let recorded = RecordedAnswer {
        task_type: TaskKind::PickAndPlace,
        objects: [CUBE, MUG, BOARD, OTHER].map(|id| id.parse().unwrap()).to_vec(),
        surfaces: Vec::new(),
        num_objects: 4,
        response: response.to_string(),
        expect: None,
        note: None,
    };
    let request = recorded.request("copies", Catalogue::builtin().cards()).unwrap();
    let report = check_answer(&recorded.response, &request);
    assert_eq!(report.verdict, Verdict::Valid, "{:?}", report.flaws);
    report.task.unwrap()
}

/// Verdict of the stage's goal after the expert has put the object `carried` on the board.
fn judged(stage: &Stage, carried: &str) -> GoalVerdict {
    let mut only = (*stage.scenario).clone();
    only.task.interchangeable.clear();
    for atom in only.task.goal.alternatives.iter_mut().flatten() {
        let (subject, carried) = (atom.subject().clone(), carried.parse().unwrap());
        *atom = atom.renamed(&[(&*subject, &carried)].into());
    }
    let carrying = crate::stage(only);
    let episode =
        run_episode(&carrying, &mut expert(&carrying), "copies", Seed::new(5), &RolloutSettings::default()).unwrap();
    assert!(episode.result.success, "{:?}", episode.result.failures);
    let scene = stage.posed(&episode.frames.last().unwrap().objects);
    genmanip_relations::judge_goal(&scene, &stage.goal, &Rest::default(), &stage.relations)
}

#[test]
fn either_instance_satisfies_the_goal_unless_the_instruction_is_specific() {
    let open = task("Put the red cube on the cutting board.", CUBE);
    assert_eq!(open.interchangeable, [[CUBE, OTHER]]);
    let stage_of_open = stage(scenario(&open));
    assert_eq!(stage_of_open.scenario.objects[1].id, OTHER);
    assert_eq!(stage_of_open.scenario.objects[0].physics_hash, stage_of_open.scenario.objects[1].physics_hash);
    for carried in [CUBE, OTHER] {
        let verdict = judged(&stage_of_open, carried);
        let best = verdict.best().unwrap();
        assert!(verdict.success && *best[0].atom.subject() == carried, "{carried}: {best:?}");
    }
    let episode =
        run_episode(&stage_of_open, &mut expert(&stage_of_open), "open", Seed::new(5), &RolloutSettings::default());
    assert!(episode.unwrap().result.success);

    let one = task("Put the red cube that is to the robot's right of the mug on the cutting board.", OTHER);
    assert_eq!(one.interchangeable, Vec::<Vec<InstanceId>>::new());
    let stage_of_one = stage(scenario(&one));
    assert!(judged(&stage_of_one, OTHER).success);
    assert!(!judged(&stage_of_one, CUBE).success, "the instruction asks for the other cube");
}
