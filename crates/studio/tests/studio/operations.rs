//! Operations and their inverses, and the messages of those that do not fit.

use genmanip_assets::Catalogue;
use genmanip_core::{Document, Scenario};
use genmanip_studio::edit::{EditError, Operation};
use serde_json::{Value, json};

use crate::{CANS, DRAWER, operation, scenario};

fn pose(x: f64, y: f64) -> Value {
    json!({"position_m": [x, y, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]})
}

/// Applies an operation and takes it back; returns the changed scenario.
fn check(before: &Scenario, value: Value) -> Scenario {
    let applied = operation(value.clone()).apply(before, Catalogue::all());
    let change = applied.unwrap_or_else(|error| panic!("{value}: {error} ({})", error.hint()));
    assert_ne!(change.scenario, *before, "{value}");
    // What the log holds does the same again.
    let logged: Operation = serde_json::from_str(&serde_json::to_string(&change.operation).unwrap()).unwrap();
    assert_eq!(logged.apply(before, Catalogue::all()).unwrap().scenario, change.scenario, "{value}");
    let inverse: Operation = serde_json::from_str(&serde_json::to_string(&change.inverse).unwrap()).unwrap();
    let back = inverse.apply(&change.scenario, Catalogue::all()).unwrap_or_else(|error| panic!("{value}: {error}"));
    assert_eq!(back.scenario.to_json(), before.to_json(), "{value}");
    assert_eq!(back.inverse.apply(&back.scenario, Catalogue::all()).unwrap().scenario, change.scenario, "{value}");
    change.scenario
}

#[test]
fn every_operation_is_taken_back_exactly() {
    let cans = scenario(CANS);
    let camera = json!(cans.world.cameras[0]);
    let mut other = camera.clone();
    other["name"] = "mine".into();
    let edges = json!([{"subject": "020", "relation": "left", "reference": "051"}]);
    for value in [
        json!({"op": "place", "args": {"objects": [{"id": "020", "pose": pose(0.5, 0.2)}]}}),
        json!({"op": "place", "args": {"objects": [{"id": "020", "pose": pose(0.5, 0.2)}, {"id": "019", "pose": pose(0.4, 0.1)}]}}),
        json!({"op": "add", "args": {"asset": "027", "pose": pose(0.6, 0.3)}}),
        json!({"op": "add", "args": {"asset": {"source": "builtin", "uid": "027", "version": 2}, "pose": pose(0.6, 0.3), "distractor": true}}),
        json!({"op": "add", "args": {"asset": "020", "pose": pose(0.6, 0.3)}}),
        json!({"op": "remove", "args": {"object": "051"}}),
        json!({"op": "duplicate", "args": {"object": "020"}}),
        json!({"op": "duplicate", "args": {"object": "051", "pose": pose(0.7, 0.2)}}),
        json!({"op": "swap", "args": {"object": "020", "uid": "027"}}),
        json!({"op": "swap", "args": {"object": "051", "uid": "mug-3"}}),
        json!({"op": "instruction", "args": {"text": "Put the cola can left of the soda can."}}),
        json!({"op": "goal", "args": {"goal": [[{"test": "relation", "subject": "020", "relation": "left", "reference": "019"}]]}}),
        json!({"op": "edges", "args": {"edges": edges}}),
        json!({"op": "edges", "args": {"edges": edges, "description": "Three cans."}}),
        json!({"op": "kind", "args": {"kind": "spatial"}}),
        json!({"op": "camera", "args": {"camera": other}}),
        json!({"op": "remove_camera", "args": {"name": "left"}}),
    ] {
        check(&cans, value);
    }
    let drawer = scenario(DRAWER);
    let articulated = drawer.task.scene_graph.nodes.iter().position(|node| node.state.is_some()).unwrap();
    let id = &drawer.task.scene_graph.nodes[articulated].id;
    let now = drawer.task.scene_graph.nodes[articulated].state.clone().unwrap();
    let states = &drawer.task.objects[articulated].states;
    let state = states.iter().find(|state| **state != now).unwrap();
    let after = check(&drawer, json!({"op": "state", "args": {"object": id, "state": state}}));
    assert_ne!(after.objects[articulated].joint_positions, drawer.objects[articulated].joint_positions);
    check(&drawer, json!({"op": "duplicate", "args": {"object": id}}));
}

#[test]
fn names_follow_a_swap_and_a_removal() {
    let cans = scenario(CANS);
    let swapped = check(&cans, json!({"op": "swap", "args": {"object": "019", "uid": "027"}}));
    let task = &swapped.task;
    assert_eq!(task.goal.alternatives[0][0].to_string(), "020 right 027");
    let edges = |scenario: &Scenario| -> Vec<String> {
        scenario.task.scene_graph.edges.iter().map(|edge| edge.atom().to_string()).collect()
    };
    assert_eq!(edges(&swapped), ["027 right 051", "020 left 051", "021 back 051"]);
    assert_eq!((swapped.objects[0].id.as_str(), task.objects[0].uid.as_str()), ("027", "027"));
    assert_eq!(swapped.objects[0].pose, cans.objects[0].pose);
    let removed = check(&cans, json!({"op": "remove", "args": {"object": "051"}}));
    assert_eq!((edges(&removed).len(), removed.task.objects.len(), removed.objects.len()), (0, 3, 3));
    let twice = check(&cans, json!({"op": "duplicate", "args": {"object": "020"}}));
    assert_eq!(twice.objects[4].id, "020#2");
    assert_eq!(twice.task.objects[4], twice.task.objects[2]);
    let distractor = json!({"op": "add", "args": {"asset": "027", "pose": pose(0.6, 0.3), "distractor": true}});
    let with_both =
        check(&check(&cans, distractor), json!({"op": "add", "args": {"asset": "001", "pose": pose(0.6, 0.0)}}));
    let ids: Vec<&str> = with_both.objects.iter().map(|object| object.id.as_str()).collect();
    assert_eq!(ids, ["019", "051", "020", "021", "001", "027"]);
}

#[test]
fn a_goal_puts_an_object_on_the_table() {
    let goal = |relation: &str| {
        let atom = json!({"test": "relation", "subject": "020", "relation": relation, "reference": "table"});
        json!({"op": "goal", "args": {"goal": [[atom]]}})
    };
    let cans = scenario(CANS);
    assert!(cans.task.surfaces.is_empty());
    let after = check(&cans, goal("on"));
    assert_eq!(after.task.goal.alternatives[0][0].to_string(), "020 on table");
    assert_eq!(after.task.surfaces.iter().map(|surface| &*surface.name).collect::<Vec<_>>(), ["table"]);
    for relation in ["in", "left", "near"] {
        let error = operation(goal(relation)).apply(&cans, Catalogue::all()).expect_err(relation);
        assert!(error.to_string().contains("got \"table\""), "{error}");
    }
    let edge = json!({"subject": "020", "relation": "on", "reference": "table"});
    let edges = json!({"op": "edges", "args": {"edges": [edge]}});
    assert!(operation(edges).apply(&cans, Catalogue::all()).is_err(), "every object stands on the table anyway");
}

#[test]
fn what_does_not_fit_is_refused_with_its_place() {
    let cans = scenario(CANS);
    for (value, place, message, hint) in [
        (json!({"op": "place", "args": {"objects": []}}), "args.objects", "at least one", ""),
        (
            json!({"op": "place", "args": {"objects": [{"id": "7", "pose": pose(0.5, 0.0)}]}}),
            "args.objects[0].id",
            "got \"7\"",
            "019, 051",
        ),
        (
            json!({"op": "place", "args": {"objects": [{"id": "020", "pose": pose(500.0, 0.0)}]}}),
            "args.objects[0].pose",
            "within 10 m",
            "metres",
        ),
        (
            json!({"op": "place", "args": {"objects": [{"id": "020", "pose": pose(0.5, 0.0), "joint_positions": [1.0]}]}}),
            "args.objects[0].joint_positions",
            "expected 0 joint positions",
            "order",
        ),
        (
            json!({"op": "add", "args": {"asset": "0277", "pose": pose(0.5, 0.0)}}),
            "args.asset",
            "got \"0277\"",
            "did you mean",
        ),
        (
            json!({"op": "add", "args": {"asset": "020", "id": "020", "pose": pose(0.5, 0.0)}}),
            "args.id",
            "unused",
            "leave",
        ),
        (
            json!({"op": "add", "args": {"asset": "020", "id": "7", "pose": pose(0.5, 0.0)}}),
            "args.id",
            "asset \"020\"",
            "020#2",
        ),
        (json!({"op": "remove", "args": {"object": "020"}}), "args.object", "the goal does not name", "`goal`"),
        (json!({"op": "swap", "args": {"object": "020", "uid": "020"}}), "args.uid", "another asset", "uid"),
        (
            json!({"op": "state", "args": {"object": "020", "state": "open"}}),
            "args.state",
            "got \"open\"",
            "articulated",
        ),
        (json!({"op": "goal", "args": {"goal": []}}), "args.goal", "got 0", "alternatives"),
        (
            json!({"op": "goal", "args": {"goal": [[{"test": "state", "object": "020", "state": "open"}]]}}),
            "args.goal[0][0]",
            "state of",
            "articulated",
        ),
        (
            json!({"op": "goal", "args": {"goal": [[{"test": "relation", "subject": "020", "relation": "left", "reference": "nobody"}]]}}),
            "args.goal[0][0]",
            "\"nobody\"",
            "019",
        ),
        (
            json!({"op": "goal", "args": {"goal": [[{"test": "relation", "subject": "020", "relation": "between", "reference": "019"}]]}}),
            "args.goal[0][0]",
            "second_reference",
            "",
        ),
        (
            json!({"op": "edges", "args": {"edges": [{"subject": "020", "relation": "left", "reference": "020"}]}}),
            "args.edges[0]",
            "different",
            "",
        ),
        (
            json!({"op": "camera", "args": {"camera": {"name": "a", "mount": "world", "mount_from_camera": pose(0.0, 0.0), "intrinsics": {"width": 0, "height": 1, "fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}}}}),
            "args.camera",
            "expected",
            "",
        ),
        (json!({"op": "remove_camera", "args": {"name": "nobody"}}), "args.name", "nobody", "overview"),
        (json!({"op": "instruction", "args": {"text": "a\u{7}"}}), "args.text", "control", ""),
    ] {
        let error = operation(value.clone()).apply(&cans, Catalogue::all()).expect_err("refused");
        let EditError::Invalid { place: got, message: text, hint: help } = &error else { panic!("{value}: {error}") };
        assert!(got.starts_with(place), "{value}: {error}");
        assert!(text.contains(message) && help.contains(hint), "{value}: {error} ({help})");
    }
    for (text, expected) in [
        (r#"{"op": "fly", "args": {}}"#, "unknown variant `fly`"),
        (r#"{"op": "remove", "args": {"object": "020", "how": 1}}"#, "unknown field `how`"),
        (r#"{"op": "remove", "args": {}}"#, "missing field `object`"),
    ] {
        let error = serde_json::from_str::<Operation>(text).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
}
