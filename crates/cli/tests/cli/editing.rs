//! Edits of a scenario: commands, undo in another call, verdict, repair, refusals.

use std::fs;

use serde_json::json;

use crate::{Outcome, REPOSITORY, genmanip};

const FILE: &str = "009_appearance-000.json";

/// A copy of a scenario of the suite for editing.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let original = format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{FILE}");
    let copied = genmanip(folder.path(), &["edit", &original, "--copy-to", ".", "--history", "--json"]).json(0);
    assert_eq!((copied["revision"].as_u64(), copied["history"].as_array().map(Vec::len)), (Some(0), Some(0)));
    folder
}

fn edit(folder: &tempfile::TempDir, arguments: &[&str]) -> Outcome {
    genmanip(folder.path(), &[&["edit", FILE], arguments].concat())
}

/// The can at its place, lifted by some metres.
fn lift(height_m: f64) -> String {
    let scenario = fs::read_to_string(format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{FILE}")).unwrap();
    let scenario: serde_json::Value = serde_json::from_str(&scenario).unwrap();
    let can = scenario["objects"].as_array().unwrap().iter().find(|object| object["id"] == "020").unwrap();
    let mut pose = can["pose"].clone();
    pose["position_m"][2] = json!(pose["position_m"][2].as_f64().unwrap() + height_m);
    json!({"op": "place", "args": {"objects": [{"id": "020", "pose": pose}]}}).to_string()
}

#[test]
fn a_fault_is_found_repaired_and_undone() {
    let folder = workplace();
    let text = || fs::read_to_string(folder.path().join(FILE)).unwrap();
    let first = text();
    assert_eq!(edit(&folder, &["--verdict", "--json"]).json(0)["verdict"]["problems"], json!([]));
    fs::write(folder.path().join("lift.json"), lift(0.03)).unwrap();
    edit(&folder, &["--op", "@lift.json", "--author", "ada", "--snapshot", "lifted"]).assert_done();
    let lifted = text();
    assert_ne!(lifted, first);
    let verdict = edit(&folder, &["--verdict", "--json"]).json(1)["verdict"].clone();
    let problem = &verdict["problems"][0];
    assert_eq!(
        (&problem["code"], &problem["object"], &problem["unit"]),
        (&json!("floating"), &json!("020"), &json!("mm"))
    );
    assert!(problem["repairs"][0]["label"].as_str().unwrap().starts_with("lower it by"), "{problem}");
    let repaired = edit(&folder, &["--repair", "--author", "bo", "--verdict", "--json"]).json(0);
    assert_eq!((&repaired["revision"], &repaired["verdict"]["problems"]), (&json!(2), &json!([])));
    let difference = edit(&folder, &["--difference", "0,2", "--json"]).json(0)["difference"].clone();
    assert_eq!(difference["added"], json!([]));
    // Another author's commands are not one's own.
    edit(&folder, &["--undo", "--author", "cleo"]).assert_refused(&["cleo has nothing to undo", "hint:"]);
    edit(&folder, &["--undo", "--author", "ada"]).assert_refused(&["objects/020/pose", "revision 2"]);
    edit(&folder, &["--undo", "--author", "bo"]).assert_done();
    assert_eq!(text(), lifted);
    edit(&folder, &["--undo", "--author", "ada"]).assert_done();
    assert_eq!(text(), first);
    let history = edit(&folder, &["--history", "--json"]).json(0);
    let undone: Vec<_> = history["history"].as_array().unwrap().iter().map(|line| line["undoes"].clone()).collect();
    assert_eq!(undone, [json!(null), json!(null), json!(2), json!(1)]);
    assert_eq!(history["snapshots"][0]["revision"], 1);
}

#[test]
fn what_does_not_fit_is_refused_and_changes_nothing() {
    let folder = workplace();
    let before = crate::tree(folder.path());
    let suite = format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{FILE}");
    for (arguments, wanted) in [
        (&["--op", "{"][..], &["--op: not JSON", "docs/formats/edits.md"][..]),
        (&["--op", r#"{"op": "fly", "args": {}}"#], &["unknown variant `fly`"]),
        (&["--op", r#"{"op": "remove", "args": {"object": "7"}}"#], &["args.object", "\"7\"", "019, 051, 020, 021"]),
        (&["--op", r#"{"op": "swap", "args": {"object": "020", "uid": "02"}}"#], &["args.uid", "did you mean"]),
        (&["--revert", "3"], &["revision from 1 to 0"]),
        (&["--difference", "0,3"], &["revision up to 0"]),
        (&["--op", "@nothing.json"], &["nothing.json", "hint:"]),
        (&["--undo"], &["cli has nothing to undo"]),
        (&["--copy-to", "."], &["without", "hint:"]),
    ] {
        edit(&folder, arguments).assert_refused(wanted);
    }
    edit(&folder, &[]).assert_ended(2, &["--op"]);
    let kind = r#"{"op": "kind", "args": {"kind": "spatial"}}"#;
    genmanip(folder.path(), &["edit", &suite, "--op", kind]).assert_refused(&[
        "read-only",
        "genmanip-200-rc",
        "--copy-to",
    ]);
    crate::assert_same_tree(&crate::tree(folder.path()), &before);
    let path = folder.path().join(FILE);
    fs::write(&path, fs::read_to_string(&path).unwrap().replace("bright-yellow", "yellow")).unwrap();
    edit(&folder, &["--op", kind]).assert_refused(&["was changed by another program", "hint:"]);
}
