//! `task check` and `task show`: the contract of a language model's answer.

use std::fs::{self, File};
use std::io::Write;

use serde_json::{Value, json};

use crate::{example, genmanip, recorded};

/// File, verdict and the flaws that must be among those found.
const RECORDED: [(&str, &str, &[&str]); 12] = [
    ("017_pick_and_place", "valid", &[]),
    ("024_appearance", "valid", &[]),
    ("002_common_sense", "rejected", &["instruction_too_long"]),
    ("004_articulated", "rejected", &["unknown_state"]),
    ("022_pick_and_place", "rejected", &["unknown_uid"]),
    ("023_pick_and_place", "rejected", &["not_graspable"]),
    ("026_spatial", "rejected", &["circular_goal"]),
    ("027_spatial", "rejected", &["contradictory_edges"]),
    ("028_appearance", "rejected", &["uid_name_mismatch"]),
    ("029_pick_and_place", "rejected", &["goal_already_satisfied"]),
    ("006_common_sense", "repaired", &["sloppy_json"]),
    ("030_long_horizon", "repaired", &["flat_dnf"]),
];

#[test]
fn check_prints_file_verdict_flaws_repairs_and_task() {
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<String> = RECORDED.iter().map(|(name, ..)| recorded(name)).collect();
    let arguments: Vec<&str> =
        ["task", "check", "--json"].into_iter().chain(files.iter().map(String::as_str)).collect();
    let checked = genmanip(folder.path(), &arguments).json(1);
    let checked = checked.as_array().unwrap();
    assert_eq!(checked.len(), RECORDED.len());
    for ((entry, file), (name, verdict, flaws)) in checked.iter().zip(&files).zip(RECORDED) {
        assert_eq!(entry["file"], *file);
        assert_eq!(entry["verdict"], verdict, "{name}: {entry}");
        let found: Vec<&str> = entry["flaws"].as_array().unwrap().iter().map(|flaw| flaw.as_str().unwrap()).collect();
        assert!(flaws.iter().all(|flaw| found.contains(flaw)), "{name}: wanted {flaws:?}, found {found:?}");
        assert_eq!(found.is_empty(), verdict == "valid", "{name}: {found:?}");
        assert_eq!(entry["repairs"].as_array().unwrap().is_empty(), verdict != "repaired", "{name}");
        assert_eq!(entry["task"].is_null(), verdict == "rejected", "{name}");
    }
}

/// Documents, answers and what is neither, in one folder: every fault of every file, and a summary.
#[test]
fn a_folder_of_documents_and_answers_is_checked_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    genmanip(path, &["task", "new", "--count", "6", "--seed", "4", "--copies", "1", "--out", "tasks", "--json"])
        .json(0);
    let sound = genmanip(path, &["task", "check", "tasks", "--json"]).json(0);
    assert!(sound.as_array().unwrap().iter().all(|entry| entry["verdict"] == "valid"), "{sound}");

    let file = path.join("tasks/spatial-4-00001.json");
    let document: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    let mut broken = document.clone();
    broken["id"] = "../elsewhere".into();
    broken["goal"][0][0]["subject"] = "999".into();
    let first = broken["scene_graph"]["nodes"][0].clone();
    broken["scene_graph"]["nodes"].as_array_mut().unwrap().push(first);
    fs::write(&file, broken.to_string()).unwrap();
    let mut wordy = document;
    wordy["instruction"] = ["word"; 31].join(" ").into();
    fs::write(path.join("tasks/wordy.json"), wordy.to_string()).unwrap();
    fs::write(path.join("tasks/half.json"), "{\"schema\": ").unwrap();
    fs::copy(recorded("017_pick_and_place"), path.join("tasks/017_pick_and_place.json")).unwrap();

    let checked = genmanip(path, &["task", "check", "tasks", "--json"]).json(1);
    let flaws = |name: &str| {
        let entry = checked.as_array().unwrap().iter().find(|entry| entry["file"].as_str().unwrap().contains(name));
        entry.unwrap()["flaws"].clone()
    };
    assert_eq!(flaws("spatial-4-00001"), json!(["unfit_id", "duplicate_node", "missing_node"]));
    assert_eq!(flaws("wordy"), json!(["instruction_too_long"]));
    assert_eq!(flaws("half"), json!(["no_task"]));
    assert_eq!((flaws("017"), flaws("articulated")), (json!([]), json!([])));
    let words = genmanip(path, &["task", "check", "tasks"]);
    assert!(words.stdout.contains("9 checked: 3 rejected, 6 valid\n"), "{words:?}");
    assert!(words.stderr.contains("3 of 9 rejected"), "{words:?}");
    // The same as lines of a list, each with its place.
    let entries = checked.as_array().unwrap();
    let line = |entry: &Value| {
        let text = fs::read_to_string(path.join(entry["file"].as_str().unwrap())).unwrap();
        serde_json::from_str(&text).map_or(text, |value: Value| value.to_string())
    };
    fs::write(path.join("list.jsonl"), entries.iter().map(line).collect::<Vec<_>>().join("\n\n")).unwrap();
    let lines = genmanip(path, &["task", "check", "list.jsonl", "--json"]).json(1);
    assert_eq!(lines.as_array().unwrap().len(), entries.len());
    for (number, (of_line, of_file)) in lines.as_array().unwrap().iter().zip(entries).enumerate() {
        assert_eq!(of_line["file"], format!("list.jsonl:{}", 2 * number + 1));
        assert_eq!((&of_line["verdict"], &of_line["flaws"]), (&of_file["verdict"], &of_file["flaws"]));
    }
    let words = genmanip(path, &["task", "check", "list.jsonl"]);
    assert!(words.stdout.contains("9 checked: 3 rejected, 6 valid\n"), "{words:?}");
    let half = entries.iter().position(|entry| entry["file"] == "tasks/half.json").unwrap();
    let place = format!("list.jsonl:{} is no", 2 * half + 1);
    assert!(words.stdout.contains(&place), "{place} in {words:?}");
    let long = " ".repeat(5 << 20);
    fs::write(path.join("long.jsonl"), [long.as_bytes(), b"{}\n\xff\n", &b"{\n".repeat(2)].concat()).unwrap();
    let long = genmanip(path, &["task", "check", "long.jsonl", "--json"]).json(1);
    let said: Vec<&str> =
        long.as_array().unwrap().iter().map(|entry| entry["details"][0]["message"].as_str().unwrap()).collect();
    assert!(said.len() == 4 && said[0].contains("long.jsonl:1 is larger than"), "{said:?}");
    assert!((1..4).all(|line| said[line].contains(&format!("long.jsonl:{}", line + 1))), "{said:?}");
    fs::write(path.join("empty.jsonl"), "\n").unwrap();
    genmanip(path, &["task", "check", "empty.jsonl"]).assert_refused(&["empty.jsonl has no task", "per line"]);
    genmanip(path, &["task", "check", "none.jsonl"]).assert_refused(&["none.jsonl", "check the path"]);
    // A document that is there twice is sound, but its id is not one task's.
    let (first, id) = (sound[0]["file"].as_str().unwrap(), sound[0]["task"]["id"].as_str().unwrap());
    fs::copy(path.join(first), path.join("copy.json")).unwrap();
    let twice = genmanip(path, &["task", "check", first, "copy.json"]);
    assert_eq!(twice.code, Some(0));
    assert!(twice.stdout.contains(&format!("note: several tasks are called `{id}`: ")), "{twice:?}");
    assert!(!words.stdout.contains("note:"), "{words:?}");
    // Every other verb names the first fault, and says that there are more.
    genmanip(path, &["task", "show", file.to_str().unwrap()])
        .assert_refused(&["at $.id: `../elsewhere` cannot name a folder (and 2 more"]);
}

#[test]
fn exit_code_is_0_when_nothing_is_rejected_and_1_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        (vec![recorded("017_pick_and_place"), recorded("030_long_horizon")], 0),
        (vec![recorded("017_pick_and_place"), recorded("022_pick_and_place")], 1),
    ];
    for (files, code) in cases {
        let arguments: Vec<&str> = ["task", "check"].into_iter().chain(files.iter().map(String::as_str)).collect();
        let outcome = genmanip(folder.path(), &arguments);
        assert_eq!(outcome.code, Some(code), "{outcome:?}");
        assert_eq!(outcome.stdout.lines().filter(|line| line.contains(".json")).count(), 2, "{outcome:?}");
    }
}

/// A valid recorded answer, stripped of what surrounds it: the same task.
#[test]
fn a_bare_answer_is_checked_against_the_objects_named() {
    let folder = tempfile::tempdir().unwrap();
    let file: Value = serde_json::from_str(&fs::read_to_string(recorded("017_pick_and_place")).unwrap()).unwrap();
    fs::write(folder.path().join("017_pick_and_place.txt"), file["response"].as_str().unwrap()).unwrap();
    let uids: Vec<&str> = file["objects"].as_array().unwrap().iter().map(|uid| uid.as_str().unwrap()).collect();
    let bare = |objects: &str| {
        let file = "017_pick_and_place.txt";
        genmanip(folder.path(), &["task", "check", file, "--objects", objects, "--kind", "pick_and_place", "--json"])
    };

    let checked = bare(&uids.join(",")).json(0);
    let whole = genmanip(folder.path(), &["task", "check", &recorded("017_pick_and_place"), "--json"]).json(0);
    assert_eq!(checked[0]["verdict"], "valid");
    for part in ["goal", "scene_graph", "instruction"] {
        assert_eq!(checked[0]["task"][part], whole[0]["task"][part]);
    }

    let fewer = bare("001,008").json(1);
    assert_eq!(fewer[0]["verdict"], "rejected");
    assert!(fewer[0]["flaws"].as_array().unwrap().contains(&json!("unknown_uid")), "{fewer}");

    bare("001,999").assert_refused(&["999", "near misses"]);
    bare("1").assert_refused(&["\"1\"", "001"]);
}

/// The task in the output is a document that every other verb reads.
#[test]
fn a_checked_task_can_be_used_as_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let checked = genmanip(folder.path(), &["task", "check", &example("024_appearance"), "--json"]).json(0);
    fs::write(folder.path().join("task.json"), checked[0]["task"].to_string()).unwrap();
    let from_file = genmanip(folder.path(), &["task", "show", "task.json", "--json"]).json(0);
    let from_answer = genmanip(folder.path(), &["task", "show", &example("024_appearance"), "--json"]).json(0);
    assert_eq!(from_file, from_answer);
}

#[test]
fn show_puts_a_task_in_words_and_draws_its_graph() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = genmanip(folder.path(), &["task", "show", &example("024_appearance"), "--svg", "graph.svg"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    insta::assert_snapshot!("task_show", outcome.stdout);
    let svg = fs::read_to_string(folder.path().join("graph.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("Puzzle Cube"), "{svg}");
}

/// Whatever a file holds that is too large, and however it is named, there is one message, and only its head is read:
/// nobody can read a terabyte in a test.
#[test]
fn a_terabyte_of_garbage_is_refused_by_its_head() {
    let folder = tempfile::tempdir().unwrap();
    let fillings: [(&str, &[u8]); 3] =
        [("letters", b"x"), ("braces", b"{\"a\":["), ("binary", &[0, 159, 146, 150, 255])];
    for (name, filling) in fillings {
        let chunk = filling.repeat((1 << 20) / filling.len() + 1);
        let mut file = File::create(folder.path().join("big.json")).unwrap();
        for _ in 0..100 {
            file.write_all(&chunk).unwrap();
        }
        // The rest is a hole, which takes no room on the disk.
        file.set_len(1 << 40).unwrap();
        drop(file);
        for verb in [["task", "check"], ["task", "show"], ["export", "--mjcf"]] {
            let outcome = genmanip(folder.path(), &[verb[0], verb[1], "big.json"]);
            outcome.assert_refused(&["big.json is larger than", "hint:"]);
            assert!(outcome.stderr.len() < 400, "{name}: {outcome:?}");
        }
        // As a bare answer it is judged like any other: rejected, with the reason as a flaw.
        let judged = genmanip(folder.path(), &["task", "check", "big.json", "--objects", "001,002", "--json"]).json(1);
        assert_eq!(judged[0]["flaws"], json!(["too_large"]), "{name}");
        assert!(judged.to_string().len() < 2000, "{name}");
    }
}
