//! Messages for requests that cannot be met: one each, and nothing is changed.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::{example, finished_run, genmanip, recorded, tree};

/// A folder with everything the cases name.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &[u8]| fs::write(folder.path().join(name), text).unwrap();
    let scenario: Value =
        serde_json::from_slice(&fs::read(finished_run().join("scenarios/021_spatial-000.json")).unwrap()).unwrap();
    let changed = |name: &str, change: &dyn Fn(&mut Value)| {
        let mut changed = scenario.clone();
        change(&mut changed);
        write(name, changed.to_string().as_bytes());
    };
    write("file", b"not a folder");
    write("answer.txt", b"{}");
    write("latin1.json", b"{\"instruction\": \"caf\xe9\"}");
    write("words.json", b"Sure! Here is your task.");
    write("list.json", b"[1, 2]");
    write("old_task.json", br#"{"schema": "genmanip.task/0"}"#);
    write("half_task.json", br#"{"schema": "genmanip.task/2", "id": "half"}"#);
    let task = scenario["task"].clone();
    let changed_task = |name: &str, change: &dyn Fn(&mut Value)| {
        let mut changed = task.clone();
        changed["schema"] = "genmanip.task/2".into();
        change(&mut changed);
        write(name, changed.to_string().as_bytes());
    };
    changed_task("no_goal.json", &|t| t["goal"] = json!([]));
    changed_task("no_card.json", &|t| t["objects"] = json!([]));
    changed_task("no_node.json", &|t| t["goal"][0][0]["reference"] = "011".into());
    changed_task("twin_node.json", &|t| {
        let nodes = t["scene_graph"]["nodes"].as_array_mut().unwrap();
        nodes.push(nodes[0].clone());
    });
    fs::copy(recorded("022_pick_and_place"), folder.path().join("flawed.json")).unwrap();
    fs::copy(example("021_spatial"), folder.path().join("021.json")).unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    let at = |x: &str| {
        format!(r#"{{"schema": "genmanip.scenario/2", "objects": [{{"pose": {{"position_m": [{x}, 0, 0]}}}}]}}"#)
    };
    write("nan.json", at("NaN").as_bytes());
    write("huge.json", at("1e999").as_bytes());
    changed("null.json", &|s| s["objects"][0]["pose"]["position_m"][2] = Value::Null);
    changed("turn.json", &|s| s["objects"][1]["pose"]["orientation_wxyz"] = json!([0, 0, 0, 0]));
    changed("newer.json", &|s| s["schema"] = "genmanip.scenario/3".into());
    changed("stranger.json", &|s| s["objects"][0]["asset"]["uid"] = "101".into());
    changed("other_physics.json", &|s| s["objects"][0]["physics_hash"] = format!("v2:{}", "0".repeat(16)).into());
    changed("other_robot.json", &|s| s["world"]["robot"]["name"] = "ur5".into());
    changed("short_home.json", &|s| s["world"]["robot"]["home"] = json!([0.0, 0.1]));
    changed("wrong_joints.json", &|s| s["objects"][0]["joint_positions"] = json!([0.5]));
    folder
}

const CASES: [&str; 47] = [
    "task check missing.json",
    "task check empty",
    "task check latin1.json",
    "task check words.json",
    "task check list.json",
    "task check answer.txt --objects 001,999",
    "task check answer.txt --objects 001 --kind cooking",
    "task show flawed.json",
    "task show old_task.json",
    "task show half_task.json",
    "task show words.json",
    "task show no_goal.json",
    "task show no_card.json",
    "task show no_node.json",
    "layout twin_node.json --out out",
    "task show 021.json --svg file/graph.svg",
    "layout missing.json --out out",
    "layout 021.json --out file/out",
    "collect 021.json 021.json --out out",
    "collect 021.json --out file/out",
    "collect 021.json --out file",
    "collect 021.json --episodes 0 --out out",
    "collect 021.json --fps 7 --out out",
    "evaluate nowhere",
    "evaluate nowhere --policy magic",
    "report nowhere",
    "replay --check nowhere",
    "replay --check empty",
    "demo",
    "serve policy expert",
    "collect --suite genmanip-learn-10 --out out",
    "collect --suite genmanip-200-rc --out out",
    "evaluate --suite genmanip-learn-10",
    "evaluate --suite genmanip-200-rc --split familiar",
    "evaluate --suite genmanip-learn-10 --split familiar --first 1000",
    "layout --suite genmanip-learn-10 --split train --distribution in --out out",
    "suite perturb genmanip-learn-10 --axis light --out out",
    "export --mjcf nan.json",
    "export --mjcf null.json",
    "export --mjcf turn.json",
    "export --mjcf huge.json",
    "export --mjcf newer.json",
    "export --mjcf stranger.json",
    "export --mjcf other_physics.json",
    "export --mjcf other_robot.json",
    "export --mjcf short_home.json",
    "export --mjcf wrong_joints.json",
];

/// Said of an empty folder and of one that is not there.
const OF_DATASETS: [&str; 10] = [
    "data check DATASET",
    "data show DATASET --html page.html",
    "data card DATASET",
    "data import DATASET --out out",
    "data convert DATASET --to lerobot-v2.1 --out out",
    "data merge DATASET DATASET --out out",
    "data split DATASET --out out",
    "data filter DATASET --where success=true --out out",
    "data delete DATASET --episodes 0 --out out",
    "data rerender DATASET --out out",
];

#[test]
fn every_refusal_is_one_clear_message_and_changes_nothing() {
    let folder = workplace();
    let before = listing(folder.path());
    let mut said = String::new();
    let of_datasets = |folder| OF_DATASETS.map(|case| case.replace("DATASET", folder));
    let cases = CASES.map(String::from).into_iter().chain(["empty", "nowhere"].into_iter().flat_map(of_datasets));
    for case in cases {
        let arguments: Vec<&str> = case.split(' ').collect();
        let outcome = genmanip(folder.path(), &arguments);
        assert_eq!(outcome.stdout, "", "{case}: {outcome:?}");
        assert_eq!(outcome.stderr.matches("error:").count(), 1, "{case}: {outcome:?}");
        assert!(!outcome.stderr.contains("panicked"), "{case}: {outcome:?}");
        // A call that cannot be understood ends with 2, as everywhere; one that cannot be met ends with 1.
        let is_misused = ["For more information, try '--help'", "unknown policy", "unknown kind"];
        let code = if is_misused.iter().any(|part| outcome.stderr.contains(part)) { 2 } else { 1 };
        assert_eq!(outcome.code, Some(code), "{case}: {outcome:?}");
        said += &format!("$ genmanip {case}\n{}\n", outcome.stderr);
    }
    assert_eq!(listing(folder.path()), before, "a refusal changed the folder");
    insta::assert_snapshot!("refusals", without_hashes(&said));
}

/// Hashes change with every change of the objects; here they only have to be there.
fn without_hashes(text: &str) -> String {
    let is_hash = |word: &str| {
        word.len() >= 12 && word.chars().all(|c| c.is_ascii_hexdigit()) && word.chars().any(|c| c.is_ascii_alphabetic())
    };
    let mut plain = String::new();
    for word in text.split_inclusive(|c: char| !c.is_ascii_alphanumeric()) {
        let body = word.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
        plain += &if is_hash(body) { word.replace(body, "HASH") } else { word.to_owned() };
    }
    plain
}

/// Files with their bytes, and folders.
fn listing(root: &Path) -> (std::collections::BTreeMap<String, Vec<u8>>, Vec<std::ffi::OsString>) {
    let mut names: Vec<_> = fs::read_dir(root).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    (tree(root), names)
}

/// Whatever a file is called, its task gets a name that can be used for folders; what a document says is checked.
#[test]
fn names_of_files_and_tasks_stay_inside_the_run() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(example("024_appearance"), folder.path().join("müde Aufgabe (1).json")).unwrap();
    let outcome = genmanip(folder.path(), &["layout", "müde Aufgabe (1).json", "--out", "out"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let names: Vec<String> = tree(&folder.path().join("out")).into_keys().collect();
    assert_eq!(names, ["layouts.jsonl", "m_de_Aufgabe__1_-000.json"]);

    let mut task = genmanip(folder.path(), &["task", "show", &example("024_appearance"), "--json"]).json(0);
    for id in ["../../escaped", "", ".hidden", "a b"] {
        task["id"] = id.into();
        fs::write(folder.path().join("task.json"), task.to_string()).unwrap();
        for verb in ["layout", "collect"] {
            let outcome = genmanip(folder.path(), &[verb, "task.json", "--out", "elsewhere"]);
            outcome.assert_refused(&["task.json", "$.id", "hint:"]);
        }
    }
    assert!(!folder.path().join("elsewhere").exists());
}
