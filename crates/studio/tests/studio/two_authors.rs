//! Random operations of two authors.

use std::fs;

use genmanip_core::{InstanceId, Scenario};
use genmanip_studio::edit::{EditError, EditedScenario};
use proptest::prelude::*;
use proptest::sample::Index;
use serde_json::{Value, json};

use crate::{CANS, DRAWER, command, copy, open, stamp};

/// Random choice of an operation.
#[derive(Clone, Debug)]
struct Draw {
    kind: u8,
    one: Index,
    other: Index,
    x: f64,
    y: f64,
    /// Number of revisions that the author has not seen.
    behind: u64,
    second_author: bool,
}

fn draws(count: usize) -> impl Strategy<Value = Vec<Draw>> {
    let draw = (0..16_u8, any::<Index>(), any::<Index>(), 0.3..0.7, -0.3..0.3, 0..4_u64, any::<bool>());
    let draw = draw.prop_map(|(kind, one, other, x, y, behind, second_author)| Draw {
        kind,
        one,
        other,
        x,
        y,
        behind,
        second_author,
    });
    prop::collection::vec(draw, count)
}

fn random_operation(draw: &Draw, scenario: &Scenario) -> Value {
    let ids: Vec<&InstanceId> = scenario.objects.iter().map(|object| &object.id).collect();
    let nodes: Vec<&InstanceId> = scenario.task.scene_graph.nodes.iter().map(|node| &node.id).collect();
    let [id, node, other] = [draw.one.get(&ids), draw.one.get(&nodes), draw.other.get(&nodes)];
    let pose = json!({"position_m": [draw.x, draw.y, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]});
    let relation = json!({"test": "relation", "subject": node, "relation": "left", "reference": other});
    let uid = ["001", "027", "mug-3", "drawer-cabinet-1"][draw.other.index(4)];
    let mut camera = json!(scenario.world.cameras[draw.one.index(scenario.world.cameras.len())]);
    match draw.kind {
        0..=4 => json!({"op": "place", "args": {"objects": [{"id": id, "pose": pose}]}}),
        5 => json!({"op": "add", "args": {"asset": uid, "pose": pose}}),
        6 => json!({"op": "add", "args": {"asset": uid, "pose": pose, "distractor": true}}),
        7 | 8 => json!({"op": "remove", "args": {"object": id}}),
        9 => json!({"op": "duplicate", "args": {"object": id}}),
        10 => json!({"op": "swap", "args": {"object": id, "uid": uid}}),
        11 => json!({"op": "instruction", "args": {"text": format!("Move the {id} to {}.", draw.x)}}),
        12 => json!({"op": "goal", "args": {"goal": [[relation]]}}),
        13 => json!({"op": "edges", "args": {"edges": [{"subject": node, "relation": "near", "reference": other}]}}),
        14 => {
            camera["name"] = "mine".into();
            json!({"op": "camera", "args": {"camera": camera}})
        }
        _ => json!({"op": "remove_camera", "args": {"name": camera["name"]}}),
    }
}

const AUTHORS: [&str; 2] = ["ada", "bo"];

/// Every command is applied, answered as a conflict, or refused because it does not fit what its author saw.
fn check_two_authors(name: &str, draws: &[Draw]) {
    let (_folder, path) = copy(name);
    let mut document = open(&path);
    for (number, draw) in draws.iter().enumerate() {
        let author = AUTHORS[usize::from(draw.second_author)];
        let base = document.revision().saturating_sub(draw.behind);
        let seen = document.at_revision(base).unwrap();
        let before = (document.revision(), fs::read(&path).unwrap());
        let done = match draw.other.index(6) {
            0 => document.undo(&stamp(author, number)),
            1 => document.redo(&stamp(author, number)),
            _ => document.apply(&command(author, number, base, random_operation(draw, &seen))),
        };
        match done {
            Ok(applied) => assert_eq!(applied.revision, before.0 + 1),
            Err(EditError::Conflict(_) | EditError::Invalid { .. } | EditError::Nothing { .. }) => {
                assert_eq!((document.revision(), fs::read(&path).unwrap()), before);
            }
            Err(error) => panic!("{draw:?}: {error}"),
        }
    }
    drop(document);
    let last = fs::read(&path).unwrap();
    let document = open(&path);
    // Tabs are told what these authors can undo and redo; nobody else can.
    assert!(draws.iter().all(|draw| {
        let author = AUTHORS[usize::from(draw.second_author)];
        document.authors().contains(author) || !(document.can_undo(author) || document.can_redo(author))
    }));
    assert_eq!(genmanip_core::Document::to_json(document.scenario().as_ref()).into_bytes(), last);
}

/// All commands of one author undone and redone.
fn check_there_and_back(name: &str, draws: &[Draw]) {
    let (_folder, path) = copy(name);
    let first = fs::read(&path).unwrap();
    let mut document = open(&path);
    for (number, draw) in draws.iter().enumerate() {
        let value = random_operation(draw, document.scenario());
        match document.apply(&command("ada", number, document.revision(), value)) {
            Ok(_) | Err(EditError::Invalid { .. }) => {}
            Err(error) => panic!("{draw:?}: {error}"),
        }
    }
    let last = fs::read(&path).unwrap();
    let all = |document: &mut EditedScenario, step: fn(&mut EditedScenario, &str) -> bool| {
        (0..).take_while(|number| step(document, &format!("{}-{number}", document.revision()))).count()
    };
    let undone = all(&mut document, |document, id| document.undo(&stamp("ada", format!("undo {id}"))).is_ok());
    assert_eq!((fs::read(&path).unwrap() == first, document.can_undo("ada")), (true, false));
    let redone = all(&mut document, |document, id| document.redo(&stamp("ada", format!("redo {id}"))).is_ok());
    assert_eq!((fs::read(&path).unwrap() == last, undone), (true, redone));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4, max_shrink_iters: 200, ..ProptestConfig::default() })]

    #[test]
    fn commands_are_applied_or_answered(draws in draws(60)) {
        check_two_authors(CANS, &draws);
    }

    #[test]
    fn undo_and_redo_end_with_the_same_bytes(draws in draws(25)) {
        check_there_and_back(DRAWER, &draws);
    }
}

/// As the properties, once and long.
#[test]
fn five_hundred_operations_there_and_back() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let drawn = draws(500).new_tree(&mut TestRunner::deterministic()).unwrap().current();
    check_there_and_back(CANS, &drawn);
}
