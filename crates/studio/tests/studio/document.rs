//! The edited scenario: commands, undo and redo, conflicts, snapshots, differences, copies.

use std::fs;
use std::path::Path;

use genmanip_assets::Catalogue;
use genmanip_studio::edit::{EditError, EditLog, EditedScenario};
use serde_json::{Value, json};

use crate::{CANS, command, copy, open, stamp, suite_file};

fn place(id: &str, x: f64) -> Value {
    json!({"op": "place", "args": {"objects": [
        {"id": id, "pose": {"position_m": [x, 0.3, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}},
    ]}})
}

fn say(text: &str) -> Value {
    json!({"op": "instruction", "args": {"text": text}})
}

fn x_of(document: &EditedScenario, id: &str) -> f64 {
    let scenario = document.scenario();
    scenario.objects[scenario.index_of(&id.into()).unwrap()].pose.position.x
}

fn instruction(document: &EditedScenario) -> &str {
    &document.scenario().task.instruction
}

fn bytes(path: &Path) -> Vec<u8> {
    fs::read(path).unwrap()
}

#[test]
fn what_is_acknowledged_is_on_the_disk() {
    let (_folder, path) = copy(CANS);
    let first = bytes(&path);
    let mut document = open(&path);
    assert!(!EditLog::path_of(&path).exists() && document.revision() == 0 && !document.can_undo("ada"));
    let applied = document.apply(&command("ada", 1, 0, place("020", 0.5))).unwrap();
    assert_eq!(applied.revision, 1);
    assert_eq!(x_of(&open(&path), "020"), 0.5);
    document.apply(&command("ada", 2, 1, say("Move it."))).unwrap();
    // A command that is sent again has no further effect.
    let before = (bytes(&path), bytes(&EditLog::path_of(&path)));
    assert_eq!(document.apply(&command("ada", 2, 1, say("Move it."))).unwrap().revision, 2);
    assert_eq!((bytes(&path), bytes(&EditLog::path_of(&path))), before);
    let second = bytes(&path);
    assert_eq!(document.undo(&stamp("ada", 3)).unwrap().revision, 3);
    assert_eq!(document.undo(&stamp("ada", 3)).unwrap().revision, 3);
    document.undo(&stamp("ada", 4)).unwrap();
    assert_eq!(bytes(&path), first);
    assert!(matches!(document.undo(&stamp("ada", 5)), Err(EditError::Nothing { .. })));
    drop(document);
    let mut document = open(&path);
    assert!(document.can_redo("ada") && !document.can_redo("bo") && !document.can_undo("ada"));
    document.redo(&stamp("ada", 6)).unwrap();
    document.redo(&stamp("ada", 7)).unwrap();
    assert_eq!(bytes(&path), second);
    assert!(matches!(document.redo(&stamp("ada", 8)), Err(EditError::Nothing { .. })));
    // A new command ends what can be redone.
    document.undo(&stamp("ada", 9)).unwrap();
    document.apply(&command("ada", 10, 7, say("Take it."))).unwrap();
    assert!(!document.can_redo("ada"));
    let revisions: Vec<(u64, Option<u64>, Option<u64>)> =
        open(&path).history().map(|line| (line.revision, line.undoes, line.redoes)).collect();
    let expected = [(1, None), (2, None), (3, Some(2)), (4, Some(1)), (5, None), (6, None), (7, Some(2)), (8, None)];
    let redoes = |revision| [(5, 1), (6, 2)].iter().find(|(at, _)| *at == revision).map(|(_, redone)| *redone);
    assert_eq!(revisions, expected.map(|(revision, undoes)| (revision, undoes, redoes(revision))));
}

#[test]
fn only_the_same_field_is_a_conflict() {
    let (_folder, path) = copy(CANS);
    let mut document = open(&path);
    document.apply(&command("ada", 1, 0, place("020", 0.5))).unwrap();
    document.apply(&command("bo", 2, 0, place("019", 0.4))).unwrap();
    document.apply(&command("bo", 3, 0, say("Move it."))).unwrap();
    // One's own keys come faster than the answers.
    document.apply(&command("ada", 4, 0, place("020", 0.51))).unwrap();
    let conflict = |document: &mut EditedScenario, id: u32, base: u64, value: Value| {
        let error = document.apply(&command("bo", id, base, value)).unwrap_err();
        let EditError::Conflict(conflict) = error else { panic!("{error}") };
        *conflict
    };
    let got = conflict(&mut document, 5, 0, place("020", 0.6));
    assert_eq!((got.field.as_str(), got.revision), ("objects/020/pose", 4));
    assert_eq!((&got.mine["position_m"][0], &got.theirs["position_m"][0]), (&json!(0.6), &json!(0.51)));
    assert_eq!(document.revision(), 4);
    // The same on the present revision is a choice.
    document.apply(&command("bo", 6, 4, place("020", 0.6))).unwrap();
    // Undoing what another author has changed since.
    assert!(matches!(document.undo(&stamp("ada", 7)), Err(EditError::Conflict(_))));
    document.undo(&stamp("bo", 8)).unwrap();
    document.undo(&stamp("ada", 9)).unwrap();
    assert_eq!((x_of(&document, "020"), instruction(&document)), (0.5, "Move it."));
    // A removal changes the whole object, and the edges that name it.
    document.apply(&command("ada", 10, 7, json!({"op": "remove", "args": {"object": "051"}}))).unwrap();
    let got = conflict(&mut document, 11, 7, place("051", 0.3));
    assert_eq!((got.field.as_str(), &got.theirs), ("objects/051/pose", &Value::Null));
    let edges = json!([{"subject": "021", "relation": "left", "reference": "051"}]);
    assert_eq!(conflict(&mut document, 12, 7, json!({"op": "edges", "args": {"edges": edges}})).field, "edges");
    let goal = json!([[{"test": "relation", "subject": "020", "relation": "left", "reference": "051"}]]);
    assert_eq!(conflict(&mut document, 13, 7, json!({"op": "goal", "args": {"goal": goal}})).field, "goal");
    let error = document.apply(&command("bo", 14, 8, json!({"op": "goal", "args": {"goal": goal}}))).unwrap_err();
    assert!(matches!(error, EditError::Invalid { .. }), "{error}");
    let error = document.apply(&command("bo", 15, 99, say("a"))).unwrap_err();
    assert!(error.to_string().contains("revision up to 8"), "{error}");
}

#[test]
fn one_command_is_reverted_and_snapshots_compared() {
    let (_folder, path) = copy(CANS);
    let mut document = open(&path);
    document.apply(&command("ada", 1, 0, say("Move it."))).unwrap();
    document.snapshot("before bo", &stamp("ada", "s")).unwrap();
    assert!(document.snapshot("before bo", &stamp("ada", "s2")).is_err());
    document.apply(&command("bo", 2, 1, place("020", 0.5))).unwrap();
    document.apply(&command("ada", 3, 2, json!({"op": "duplicate", "args": {"object": "051"}}))).unwrap();
    document.apply(&command("ada", 4, 3, json!({"op": "remove", "args": {"object": "021"}}))).unwrap();
    document.revert(1, &stamp("bo", 5)).unwrap();
    assert!(instruction(&document).starts_with("Move the bright-yellow"));
    drop(document);
    let mut document = open(&path);
    assert_eq!(document.snapshots()[0].revision, 1);
    let difference = document.difference(1, 5).unwrap();
    assert!(difference.added == ["051#2"] && difference.removed == ["021"], "{difference:?}");
    assert_eq!((difference.moved[0].id.as_str(), difference.moved.len()), ("020", 1));
    assert_eq!(difference.instruction.unwrap()[0], "Move it.");
    assert_eq!(difference.edges_removed.len(), 1);
    // Reverting the same one again applies it again.
    document.revert(1, &stamp("bo", 6)).unwrap();
    assert_eq!(instruction(&document), "Move it.");
    assert!(document.difference(0, 99).is_err() && document.revert(99, &stamp("bo", 7)).is_err());
}

#[test]
fn a_change_from_outside_stops_editing() {
    let (_folder, path) = copy(CANS);
    let mut document = open(&path);
    document.apply(&command("ada", 1, 0, place("020", 0.5))).unwrap();
    let (scenario, log) = (bytes(&path), bytes(&EditLog::path_of(&path)));
    fs::write(&path, bytes(&suite_file(CANS))).unwrap();
    let error = document.apply(&command("ada", 2, 1, place("020", 0.6))).unwrap_err();
    assert!(matches!(error, EditError::ChangedOutside { .. }), "{error}");
    // The content of the revision before is what a killed program leaves behind, so that another one is needed.
    let text = fs::read_to_string(&path).unwrap().replace("bright-yellow", "yellow");
    fs::write(&path, text).unwrap();
    drop(document);
    assert!(matches!(EditedScenario::open(&path, Catalogue::all()), Err(EditError::ChangedOutside { .. })));
    assert_eq!(bytes(&EditLog::path_of(&path)), log);
    fs::write(&path, scenario).unwrap();
    let mut document = open(&path);
    // Another program that edits at the same time.
    let mut other = open(&path);
    document.apply(&command("ada", 2, 1, place("020", 0.6))).unwrap();
    let error = other.apply(&command("bo", 3, 1, say("a"))).unwrap_err();
    assert!(matches!(error, EditError::ChangedOutside { .. }), "{error}");
    let mut other = open(&path);
    let error = other.apply(&command("bo", 3, 1, say("a"))).unwrap_err();
    assert!(matches!(error, EditError::Busy { .. }), "{error}");
    drop(document);
    other.apply(&command("bo", 3, 2, say("a"))).unwrap();
}

#[test]
fn scenarios_of_suites_and_runs_are_copied() {
    let folder = tempfile::tempdir().unwrap();
    let file = suite_file(CANS);
    let before = bytes(&file);
    let error = open(&file).apply(&command("ada", 1, 0, say("a"))).unwrap_err();
    assert!(matches!(&error, EditError::ReadOnly { reason, .. } if reason.contains("genmanip-200-rc")), "{error}");
    let mut mine = EditedScenario::copy_into(&file, folder.path(), Catalogue::all()).unwrap();
    mine.apply(&command("ada", 1, 0, say("a"))).unwrap();
    let path = mine.path().to_owned();
    drop(mine);
    let mine = open(&path);
    assert!(mine.parent().unwrap().path.ends_with("009_appearance-000.json") && mine.revision() == 1);
    assert_eq!(bytes(&file), before);
    assert!(EditedScenario::copy_into(&file, folder.path(), Catalogue::all()).is_err());
}

#[test]
fn a_damaged_log_is_named_with_its_line() {
    let (_folder, path) = copy(CANS);
    let mut document = open(&path);
    document.apply(&command("ada", 1, 0, place("020", 0.5))).unwrap();
    document.apply(&command("ada", 2, 1, place("020", 0.6))).unwrap();
    drop(document);
    let log = EditLog::path_of(&path);
    let whole = fs::read_to_string(&log).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    let joined = |lines: &[&str]| lines.iter().map(|line| format!("{line}\n")).collect::<String>();
    for (text, expected) in [
        (String::new(), "line 1"),
        (joined(&[lines[0], "{", lines[2]]), "line 2"),
        (joined(&[lines[0], lines[2]]), "expected revision 1"),
        (joined(&[&lines[0].replace("edits/1", "edits/9"), lines[1]]), "edits/9"),
        (joined(&[lines[0], lines[1], &lines[2].replace("020", "nobody")]), "nobody"),
        (joined(&[lines[0], lines[1], &lines[2].replace("0.6", "0.61")]), "another hash"),
    ] {
        fs::write(&log, text).unwrap();
        let Err(error) = EditedScenario::open(&path, Catalogue::all()) else { panic!("{expected}") };
        assert!(error.to_string().contains(expected) && !error.hint().is_empty(), "{error}");
    }
}
