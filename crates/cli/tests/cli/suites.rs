//! A small suite from its seed to an evaluation, and what happens to one that somebody changed.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::{REPOSITORY, assert_same_tree, genmanip, genmanip_lab, tree, without_timings};

#[test]
fn a_suite_is_built_checked_and_evaluated_on() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let build = ["suite", "build", "--out", "mine", "--seed", "3", "--per-kind", "1", "--candidates", "1"];
    let shown = genmanip(here, &[&build[..], &["--catalog", "builtin", "--json"]].concat()).json(0);
    assert_eq!(shown["scenarios"].as_array().unwrap().len(), 4);
    assert_eq!(shown["funnel"].as_array().unwrap().len(), 3);
    let entry = &shown["scenarios"][0];
    assert_eq!(entry["certificate"]["verified"], 5);
    assert!(entry["horizon_s"].as_f64().unwrap() >= 2.0 * entry["certificate"]["shortest_s"].as_f64().unwrap());
    assert!(!here.join("mine/work").exists(), "{:?}", tree(here).keys());
    genmanip(here, &build).assert_refused(&["mine/suite.json exists", "another --out folder"]);

    let sound = genmanip(here, &["suite", "check", "mine", "--json"]).json(0);
    assert_eq!((&sound["scenarios"], &sound["faults"]), (&4.into(), &serde_json::json!([])));
    let words = genmanip(here, &["suite", "show", "mine"]).stdout;
    assert!(words.contains("are solved by the expert, 5 of 5 times") && words.contains("spread"), "{words}");

    let call = ["evaluate", "--suite", "mine", "--policy", "do_nothing:seconds=0.1", "--json"];
    let reports = genmanip(here, &call).json(0);
    assert_eq!(reports[0]["suite_hash"], shown["suite_hash"]);
    assert_eq!(reports[0]["results"][0]["horizon_s"], entry["horizon_s"]);
    assert_eq!(reports[0]["summary"]["success"]["successes"], 0);
    assert_eq!(reports[0]["reference_paths_m"].as_object().unwrap().len(), 4);

    let same = genmanip(here, &["suite", "diff", "mine", "mine", "--json"]).json(0);
    assert_eq!((&same["same_scenarios"], &same["changed"]), (&true.into(), &serde_json::json!({})));

    // The same scenarios with other friction and masses: certified again, and paired with the suite.
    let perturb =
        ["suite", "perturb", "mine", "--axis", "physics", "--dial", "0.3", "--out", "slippery", "--seed", "5"];
    let changed = genmanip(here, &[&perturb[..], &["--json"]].concat()).json(0);
    assert_eq!(changed["perturbation"]["of_hash"], shown["suite_hash"]);
    assert!(!changed["scenarios"].as_array().unwrap().is_empty());
    for (suite, out) in [("mine", "a"), ("slippery", "b")] {
        let call = ["evaluate", "--suite", suite, "--policy", "do_nothing:seconds=0.1", "--out", out];
        assert_eq!(genmanip(here, &call).code, Some(0));
    }
    let file = |out: &str| format!("{out}/evaluation/do_nothing_seconds=0.1.json");
    let compared = genmanip(here, &["compare", &file("a"), &file("b"), "--json"]).json(0);
    assert_eq!(compared["overall"]["pairs"], changed["scenarios"].as_array().unwrap().len());
    assert_eq!(compared["overall"]["second"], "do_nothing_seconds=0.1 (physics 0.3)");
    assert_eq!(genmanip(here, &["suite", "check", "slippery"]).code, Some(0));
    genmanip(here, &["suite", "perturb", "mine", "--axis", "camera", "--dial", "2", "--out", "far"])
        .assert_refused(&["--dial 2", "up to 1"]);
    genmanip(here, &["suite", "perturb", "mine", "--axis", "gravity", "--out", "x"]).assert_ended(2, &["robot_start"]);

    // The control of the agent: marks by chance, which know nothing.
    let first = format!("mine/scenarios/{}.json", entry["id"].as_str().unwrap());
    let marks = genmanip(here, &["evaluate", &first, "--policy", "agent:vlm=random", "--json"]).json(0);
    assert_eq!((&marks[0]["oracle"], marks[0]["results"].as_array().unwrap().len()), (&false.into(), 1));
    assert!(marks[0]["policy"].as_str().unwrap().starts_with("agent vlm=random masks=rgbd"), "{}", marks[0]["policy"]);

    let review = ["suite", "review", "mine", shown["scenarios"][1]["id"].as_str().unwrap(), "--reviewer", "ada"];
    let said = genmanip(here, &[&review[..], &["--verdict", "flawed", "--note", "upside down"]].concat());
    assert_eq!(said.stdout, "1 reviews: 0 sound, 0 ambiguous, 1 flawed\n", "{said:?}");
    genmanip(here, &["suite", "review", "mine", "none", "--reviewer", "ada", "--verdict", "sound"])
        .assert_refused(&["no scenario `none`", "suite show mine"]);
    assert_eq!(genmanip(here, &["suite", "check", "mine"]).code, Some(0));

    frozen_objects_and_pictures(here, &reports);
    readers_point_at_what_is_meant(here);

    let train = ["suite", "train", "mine", "--per-kind", "2", "--seed", "4", "--out", "train"];
    let trained = genmanip(here, &[&train[..], &["--json"]].concat()).json(0);
    assert_eq!((&trained["suite_hash"], &trained["funnel"]["passed"]["spatial"]), (&shown["suite_hash"], &2.into()));
    assert_eq!(fs::read_dir(here.join("train/tasks")).unwrap().count(), 8);
    genmanip(here, &train).assert_refused(&["training.json exists"]);
    let same = genmanip(here, &["suite", "train", "mine", "--check", "train/tasks"]);
    assert_eq!((same.code, same.stdout.as_str()), (Some(0), "nothing is shared with the suite\n"), "{same:?}");
    // What a suite is made of is no training.
    let scenario: Value = serde_json::from_slice(
        &fs::read(here.join(format!("mine/scenarios/{}.json", entry["id"].as_str().unwrap()))).unwrap(),
    )
    .unwrap();
    let mut task = scenario["task"].clone();
    task["schema"] = "genmanip.task/2".into();
    fs::write(here.join("stolen.json"), task.to_string()).unwrap();
    let stolen = genmanip(here, &["suite", "train", "mine", "--check", "stolen.json"]);
    assert_eq!(stolen.code, Some(1), "{stolen:?}");
    assert!(stolen.stdout.contains("its sentence is one of the suite"), "{stolen:?}");

    // One digit of one scenario, and a scenario that nobody froze.
    let id = entry["id"].as_str().unwrap();
    let path = here.join(format!("mine/scenarios/{id}.json"));
    let text = with_another_digit(&path, "\"pose\"");
    fs::write(here.join("mine/scenarios/stranger.json"), &text).unwrap();
    let spoilt = genmanip(here, &["suite", "check", "mine"]);
    assert_eq!(spoilt.code, Some(1), "{spoilt:?}");
    for said in [&format!("{id}: is not as it was frozen"), "stranger.json belongs to no scenario"] {
        assert!(spoilt.stdout.contains(said), "{said}: {spoilt:?}");
    }
    genmanip(here, &call).assert_refused(&["not those that were frozen", "genmanip suite check mine"]);
    genmanip(here, &["suite", "check", "nowhere"]).assert_refused(&["no suite at nowhere", "suite build"]);
}

/// Cards of the suite's scenarios, answered from the scenarios themselves: once rightly, once with one thing exchanged.
fn readers_point_at_what_is_meant(here: &Path) {
    let questions = genmanip_lab(here, &["readers", "--suite", "mine", "--out", "cards", "--json"]).json(0);
    let mut answers = Vec::new();
    for card in questions["cards"].as_array().unwrap() {
        assert!(here.join("cards").join(card["picture"].as_str().unwrap()).is_file());
        let scenario = scenario_of(here, card["sentence"].as_str().unwrap());
        let number = |id: &Value| {
            let objects = scenario["objects"].as_array().unwrap();
            1 + objects.iter().position(|object| object["id"] == *id).unwrap()
        };
        let goal = scenario["task"]["goal"][0].as_array().unwrap();
        let moves: Vec<Value> = goal
            .iter()
            .map(|atom| {
                let second = atom.get("second_reference").filter(|id| id.is_string());
                let place: Vec<usize> = std::iter::once(&atom["reference"]).chain(second).map(number).collect();
                json!({"object": number(&atom["subject"]), "place": place})
            })
            .collect();
        answers.push(json!({"id": card["id"], "moves": moves}));
    }
    fs::write(here.join("right.json"), json!({"answers": answers}).to_string()).unwrap();
    answers[1]["moves"] = json!([{"object": 99, "place": [1]}]);
    fs::write(here.join("wrong.json"), json!({"answers": answers}).to_string()).unwrap();
    let call = ["readers", "--suite", "mine", "--answers", "right.json,wrong.json", "--json"];
    let compared = genmanip_lab(here, &call).json(0);
    let agree = |reader: usize| compared["readers"][reader]["agree"]["successes"].as_u64();
    assert_eq!((agree(0), agree(1), &compared["agree"]["trials"]), (Some(4), Some(3), &8.into()));
    assert_eq!(compared["readers"][1]["differ"][0]["card"], "001");
    genmanip_lab(here, &["readers", "--ends", "nowhere", "--out", "ends"]).assert_refused(&["nowhere/evaluation"]);
}

fn scenario_of(here: &Path, sentence: &str) -> Value {
    let files = fs::read_dir(here.join("mine/scenarios")).unwrap();
    let scenarios = files.map(|file| serde_json::from_slice(&fs::read(file.unwrap().path()).unwrap()).unwrap());
    let mut said = scenarios.filter(|scenario: &Value| scenario["task"]["instruction"] == sentence);
    said.next().unwrap()
}

/// Freezes the suite with its objects and pictures: results stay, and a changed byte of either is named.
fn frozen_objects_and_pictures(here: &Path, before: &Value) {
    let frozen = genmanip(here, &["suite", "freeze", "mine", "--json"]).json(0);
    let assets = frozen["assets"].as_array().unwrap();
    assert!(!assets.is_empty());
    assert_eq!(frozen["scenarios"][3]["pictures"].as_object().unwrap().len(), 5);
    genmanip(here, &["suite", "freeze", "mine"]).assert_refused(&["holds its objects and pictures already"]);
    let sound = genmanip(here, &["suite", "check", "mine", "--json"]).json(0);
    assert_eq!((&sound["faults"], &sound["notes"]), (&json!([]), &json!([])));
    let call = ["evaluate", "--suite", "mine", "--policy", "do_nothing:seconds=0.1", "--json"];
    let after = genmanip(here, &call).json(0);
    assert_eq!((&after[0]["results"], &after[0]["suite_hash"]), (&before[0]["results"], &before[0]["suite_hash"]));

    let name = assets[0]["file"].as_str().unwrap();
    let path = here.join("mine/assets").join(name);
    let bytes = fs::read(&path).unwrap();
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 1;
    fs::write(&path, changed).unwrap();
    let spoilt = genmanip(here, &["suite", "check", "mine"]);
    assert_eq!(spoilt.code, Some(1), "{spoilt:?}");
    assert!(spoilt.stdout.contains(&format!("assets/{name} is not as it was frozen")), "{spoilt:?}");
    // Evaluations go by the frozen object, not by what the catalogue makes of its name.
    genmanip(here, &call).assert_refused(&[&format!("assets/{name} is not as it was frozen")]);
    fs::write(&path, bytes).unwrap();

    let file = here.join("mine/suite.json");
    let text = fs::read_to_string(&file).unwrap();
    let hash = frozen["scenarios"][1]["pictures"]["static"].as_str().unwrap();
    fs::write(&file, text.replace(hash, &hash.chars().rev().collect::<String>())).unwrap();
    let spoilt = genmanip(here, &["suite", "check", "mine"]);
    let id = frozen["scenarios"][1]["id"].as_str().unwrap();
    assert!(spoilt.stdout.contains(&format!("{id}: looks otherwise through static")), "{spoilt:?}");
    fs::write(&file, text).unwrap();
    assert_eq!(genmanip(here, &["suite", "check", "mine"]).code, Some(0));
}

/// Changes one digit of the first number with a point behind a word of a file; the text that was there.
fn with_another_digit(path: &Path, word: &str) -> String {
    let text = fs::read_to_string(path).unwrap();
    let at = text.find(word).map(|at| at + text[at..].find('.').unwrap() + 3).unwrap();
    let digit = if text.as_bytes()[at] == b'1' { "2" } else { "1" };
    fs::write(path, format!("{}{digit}{}", &text[..at], &text[at + 1..])).unwrap();
    text
}

/// Answers that vision-language models gave to pictures of the shipped suite, given again: the verdicts that came then.
/// Where the looks have changed, the questions have, too: then the answers belong to the suite before.
#[test]
fn recorded_answers_of_models_give_the_recorded_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let answers = format!("{REPOSITORY}/examples/answers/genmanip-200-rc");
    let text = fs::read_to_string(format!("{answers}-verdicts.json")).unwrap();
    let recorded: Value = serde_json::from_str(&text).unwrap();
    let recorded = recorded["verdicts"].as_array().unwrap();
    let is_it = |row: &Value, name: &str| row["scenario"] == name;
    // One that succeeded and one that did not.
    let names = ["appearance-200-00059-000", "common_sense-200-00086-000"];
    let files = names.map(|name| format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{name}.json"));
    let policy = format!("agent:vlm=recorded,answers={answers}");
    let made = genmanip(folder.path(), &["evaluate", &files[0], &files[1], "--policy", &policy, "--json"]).json(0);
    let results = made[0]["results"].as_array().unwrap();
    assert_eq!(made[0]["not_run"], Value::Array(Vec::new()));
    for (name, success) in names.into_iter().zip([true, false]) {
        let then = recorded.iter().find(|row| is_it(row, name)).unwrap();
        let now = results.iter().find(|row| row["scenario_id"] == name).unwrap();
        assert_eq!(then["success"], success, "{name}");
        assert_eq!(now["success"], then["success"], "{name}");
        // Today's renderer shades the same masks a little differently, which moves grasps by fractions of a millimetre.
        for key in ["duration_s", "tcp_path_m"] {
            let [now, then] = [now, then].map(|row| row[key].as_f64().unwrap());
            assert!((now - then).abs() <= 0.01 * then, "{name}: {key} is {now}, was {then}");
        }
        assert_eq!(now["verdict"]["score"], then["score"], "{name}");
    }
}

#[test]
fn layouts_of_a_split_are_demonstrated_evaluated_on_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let with = |verb: &str, split: &str, more: &[&str]| {
        let chosen = [verb, "--suite", "genmanip-learn-10", "--distribution", "into", "--split", split];
        genmanip(here, &[&chosen, more].concat())
    };
    let demonstrate = |count, out| {
        let more = ["--verified", count, "--expert", "consistent", "--no-dataset", "--out", out];
        assert_eq!(with("collect", "train", &more).code, Some(0));
    };
    demonstrate("1", "run");
    demonstrate("2", "run");
    demonstrate("2", "again");
    assert_same_tree(&without_timings(tree(&here.join("run"))), &without_timings(tree(&here.join("again"))));

    // The layouts are those that `layout` writes, and `evaluate` uses.
    let rows = with("layout", "train", &["--first", "2", "--out", "scenarios", "--json"]).json(0);
    assert_eq!(rows.as_array().unwrap().len(), 2);
    for name in ["into-train-0000-000.json", "into-train-0001-000.json"] {
        let read = |folder: &str| fs::read(here.join(folder).join(name)).unwrap();
        assert_eq!(read("run/scenarios"), read("scenarios"), "{name}");
    }
    let do_nothing = ["--policy", "do_nothing:seconds=0.1", "--first", "1", "--json"];
    let reports = with("evaluate", "train", &do_nothing).json(0);
    assert_eq!(reports[0]["suite"], "genmanip-learn-10/train/into");
    let result = &reports[0]["results"][0];
    let shown = genmanip(here, &["suite", "show", "genmanip-learn-10", "--json"]).json(0);
    let entry = &shown["distributions"][0];
    assert_eq!((&result["id"], &result["horizon_s"]), (&"into-train-0000-000".into(), &entry["horizon_s"]));
    with("evaluate", "tests", &do_nothing).assert_ended(2, &["tests", "familiar"]);
    genmanip(here, &["evaluate", "scenarios", "--split", "train"])
        .assert_ended(2, &["--split chooses layouts", "--suite"]);
}

#[test]
fn a_suite_of_distributions_is_frozen_and_changes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let shipped = fs::read(Path::new(REPOSITORY).join("suites/genmanip-learn-10/suite.json")).unwrap();
    let mut document: Value = serde_json::from_slice(&shipped).unwrap();
    document["distributions"].as_array_mut().unwrap().truncate(2);
    let splits = ["train", "validation", "familiar", "instance", "category", "relation"];
    document["layouts"] = splits.map(|split| (split.to_owned(), json!(2))).into_iter().collect();
    fs::create_dir(here.join("small")).unwrap();
    fs::write(here.join("small/suite.json"), document.to_string()).unwrap();
    let check = |code: i32, faults: &[&str]| {
        let checked = genmanip(here, &["suite", "check", "small", "--all", "--json"]).json(code);
        assert_eq!(checked["checked"], 24);
        let found: Vec<&str> = checked["faults"].as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect();
        assert_eq!(found.len(), faults.len(), "{found:?}");
        assert!(found.iter().zip(faults).all(|(found, fault)| found.contains(fault)), "{found:?}");
    };
    let missing = splits.map(|split| format!("into {split}: 0 of 2"));
    let missing = missing.iter().cloned().chain(missing.iter().map(|fault| fault.replace("into", "onto")));
    let missing: Vec<String> = missing.collect();
    check(1, &missing.iter().map(String::as_str).collect::<Vec<_>>());
    let freeze = ["suite", "freeze", "small"];
    assert_eq!(genmanip(here, &freeze).code, Some(0));
    check(0, &[]);
    genmanip(here, &freeze).assert_refused(&["small is frozen already", "suite check"]);
    genmanip(here, &[&freeze[..], &["--images"]].concat()).assert_refused(&["no images", "omit --images"]);

    // A test layout that is a training layout, and a file that is none.
    let path = here.join("small/layouts/into.txt");
    let text = fs::read_to_string(&path).unwrap();
    let hashes: Vec<&str> = text.lines().filter(|line| !line.starts_with(['#', '['])).collect();
    fs::write(&path, text.replace(hashes[5], hashes[0])).unwrap();
    let other = format!("into-familiar-0001: its layout is {}, not {}", hashes[5], hashes[0]);
    check(1, &["into-familiar-0001 is the layout of into-train-0000", &other]);
    fs::write(&path, text.replace(hashes[0], "00")).unwrap();
    genmanip(here, &["suite", "show", "small"]).assert_refused(&["line 3", "twelve hexadecimal digits"]);
    fs::write(here.join("small/suite.json"), document.to_string().replace("peach-1", "avocado-1")).unwrap();
    genmanip(here, &["suite", "show", "small"]).assert_refused(&["`avocado-1` does not belong into split `train`"]);
}
