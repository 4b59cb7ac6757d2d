//! `task new`: tasks by rules and from a language model; the model here is a script on loopback.

use std::fs;
use std::path::Path;

use genmanip_assets::Catalogue;
use genmanip_llm::fake::{Behaviour, FakeServer};
use serde_json::{Value, json};

use crate::{Outcome, genmanip, times, tree};

#[test]
fn rules_write_tasks_that_other_verbs_read() {
    let folder = tempfile::tempdir().unwrap();
    let new = |out: &str| {
        genmanip(folder.path(), &["task", "new", "--count", "6", "--seed", "3", "--out", out, "--json"]).json(0)
    };
    let rows = new("one");
    let kinds: Vec<&str> = rows.as_array().unwrap().iter().map(|row| row["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["pick_and_place", "spatial", "appearance", "common_sense", "long_horizon", "articulated"]);
    new("two");
    assert_eq!(tree(&folder.path().join("one")), tree(&folder.path().join("two")), "same seed, same files");
    for row in rows.as_array().unwrap() {
        let shown = genmanip(folder.path(), &["task", "show", "--json", row["file"].as_str().unwrap()]).json(0);
        assert_eq!((&shown["instruction"], &shown["source"]), (&row["instruction"], &"rules".into()));
    }
    let only = ["task", "new", "--kind", "articulated", "--count", "2", "--out", "three"];
    assert_eq!(genmanip(folder.path(), &only).code, Some(0));
    assert_eq!(tree(&folder.path().join("three")).len(), 2);
}

/// A sentence is a task, or a question with candidates that writes nothing.
#[test]
fn a_sentence_becomes_a_task_or_a_question() {
    let folder = tempfile::tempdir().unwrap();
    let new = |sentence: &str, out: &str| {
        genmanip(folder.path(), &["task", "new", "--text", sentence, "--seed", "3", "--out", out, "--json"])
    };
    let rows = new("put the red mug to the left of the bowl", "said").json(0);
    let row = &rows.as_array().unwrap()[0];
    assert_eq!(row["task"], "put-the-red-mug-to-the-left-of-the-bowl-3-00000");
    let shown = genmanip(folder.path(), &["task", "show", "--json", row["file"].as_str().unwrap()]).json(0);
    assert_eq!(shown["source"], "sentence");
    assert_eq!(shown["goal"][0][0]["relation"], "left", "{:#}", shown["goal"]);
    let checked = genmanip(folder.path(), &["task", "check", "said"]);
    assert_eq!(checked.code, Some(0), "{checked:?}");
    new("put the coffee spoon on the plate", "none")
        .assert_refused(&["`coffee spoon`; candidates: Spoon (015)", "hint"]);
    new("juggle the eggs", "none").assert_refused(&["not understood", "say what to move and where"]);
    new("tidy up", "none").assert_refused(&["`tidy`", "hint"]);
    assert!(!folder.path().join("none").exists());
}

/// Of four cubes there are not two dozen tasks of all kinds: what there is stays, the rest is told kind by kind.
#[test]
fn a_kind_that_runs_out_costs_nothing_that_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let new = |count: &str, out: &str, more: &[&str]| {
        let arguments = ["task", "new", "--count", count, "--seed", "3", "--objects", "cube", "--out", out, "--json"];
        genmanip(path, &[&arguments[..], more].concat())
    };
    let written = |rows: &Value| rows.as_array().unwrap().iter().filter(|row| row["refused"].is_null()).count();
    let whole = new("24", "whole", &[]);
    let rows = whole.json(1);
    let made = written(&rows);
    assert!(rows.as_array().unwrap().len() == 24 && (5..24).contains(&made), "{made}");
    assert_eq!(tree(&path.join("whole")).len(), made);
    for part in [
        "4 articulated tasks are missing: no articulated task in 400 designs",
        &format!("{} of 24 tasks missing, {made} written", 24 - made),
    ] {
        assert!(whole.stderr.contains(part), "{part}: {whole:?}");
    }
    // In two calls as in one; what is there is not written again.
    new("12", "parts", &[]);
    let before = times(&path.join("parts"));
    new("24", "parts", &[]);
    assert_eq!(tree(&path.join("parts")), tree(&path.join("whole")));
    let after = times(&path.join("parts"));
    assert!(before.iter().all(|(name, time)| after[name] == *time));
    // Other kinds take the place.
    let filled = new("24", "filled", &["--fill"]).json(0);
    assert_eq!(written(&filled), 24, "instead of {made}");

    let changed = path.join("parts").join(before.keys().next().unwrap());
    fs::write(&changed, "{}").unwrap();
    new("24", "parts", &[]).assert_refused(&["holds another task than this call composes", "larger --count"]);
    assert_eq!(fs::read_to_string(&changed).unwrap(), "{}");
}

#[test]
fn many_tasks_are_counted_by_kind_unless_each_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let new = |more: &[&str]| {
        let arguments = ["task", "new", "--count", "36", "--seed", "8", "--out", "out"];
        genmanip(folder.path(), &[&arguments[..], more].concat())
    };
    let short = new(&[]);
    assert_eq!((short.code, short.stdout.lines().count()), (Some(0), 10), "{short:?}");
    assert!(short.stdout.contains("articulated     6      0"), "{short:?}");
    assert_eq!(new(&["--each"]).stdout.lines().count(), 38);
}

fn write_settings(folder: &Path, address: &str) {
    let text = format!(
        "[server]\nbase_url = \"{address}\"\nmodel = \"script\"\nmax_retries = 0\n[cassettes]\nfolder = \"tapes\"\n\
         [generation]\nmax_rounds = 2\nworkers = 1\n"
    );
    fs::write(folder.join("llm.toml"), text).unwrap();
}

fn ask(folder: &Path, mode: &str, out: &str) -> Outcome {
    let arguments = ["task", "new", "--designer", "llm", "--settings", "llm.toml", "--kind", "pick_and_place"];
    let rest = ["--count", "1", "--seed", "5", "--cassettes", mode, "--out", out, "--json"];
    genmanip(folder, &[&arguments[..], &rest[..]].concat())
}

/// One of the offered objects to the other side of another; nothing here comes from a model.
fn scripted_answer(offered: &Value) -> String {
    let cards: Vec<_> = offered.as_array().unwrap().iter().map(|uid| uid.as_str().unwrap()).collect();
    let card = |uid: &str| Catalogue::builtin().card(uid).unwrap();
    let moved = *cards.iter().find(|uid| card(uid).can_grasp).unwrap();
    let still: Vec<&str> = cards.iter().copied().filter(|uid| *uid != moved && !card(uid).is_articulated).collect();
    let edge = |subject: &str, position: &str, reference: &str| json!({"obj1": "none", "obj1_uid": subject, "position": position, "obj2": "none", "obj2_uid": reference});
    let mut goal = edge(moved, "right", still[0]);
    goal["obj1_state"] = "none".into();
    let nodes: Vec<Value> =
        [moved, still[0], still[1], still[2]].map(|uid| json!({"obj_uid": uid, "state": "none"})).to_vec();
    json!({
        "instruction": "Move it to the robot's right of the other one.",
        "goal_conditions": [[goal]],
        "scene_graph": {
            "description": "Four things.",
            "edges": [edge(moved, "left", still[0]), edge(still[1], "right", still[0]), edge(still[2], "front", still[0])],
            "nodes": nodes,
        },
    })
    .to_string()
}

/// Refused answers are kept and exit with 1; a good one becomes a task; a replay needs no server and writes the same.
#[test]
fn a_language_model_is_asked_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let server = FakeServer::scripted(["No.", "Still no."].map(|text| Behaviour::Answer(text.into()))).unwrap();
    write_settings(path, &server.base_url());
    let refused = ask(path, "live", "refused").json(1);
    assert_eq!(refused[0]["file"], Value::Null);
    assert!(refused[0]["refused"].as_str().unwrap().contains("no_json"), "{refused}");
    let id = refused[0]["task"].as_str().unwrap();
    let rounds = fs::read_to_string(path.join(format!("refused/rounds/{id}.json"))).unwrap();
    let rounds: Value = serde_json::from_str(&rounds).unwrap();
    assert_eq!(rounds["rounds"].as_array().unwrap().len(), 2);

    let answer = scripted_answer(&rounds["offered"]);
    let server = FakeServer::scripted([Behaviour::Answer(answer)]).unwrap();
    write_settings(path, &server.base_url());
    let made = ask(path, "record", "recorded").json(0);
    let file = made[0]["file"].as_str().unwrap();
    let shown = genmanip(path, &["task", "show", "--json", file]).json(0);
    assert_eq!(shown["source"], "language model script");
    drop(server);
    assert_eq!(ask(path, "replay", "replayed").code, Some(0));
    assert_eq!(tree(&path.join("recorded")), tree(&path.join("replayed")));
}

#[test]
fn what_cannot_be_designed_is_refused_in_one_message() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("llm.toml"), "[server]\nbase_url = \"ftp://x\"\n").unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let cases: [(&str, i32, &[&str]); 7] = [
        ("--designer magic --out out", 2, &["unknown designer `magic`", "rules or llm"]),
        ("--kind cooking --out out", 2, &["unknown kind `cooking`", "pick_and_place"]),
        ("--designer llm --out out", 1, &["needs --settings", "language-models.md"]),
        ("--settings llm.toml --out out", 2, &["for language models", "--designer llm"]),
        ("--designer llm --settings none.toml --out out", 1, &["cannot read none.toml"]),
        ("--designer llm --settings llm.toml --out out", 1, &["llm.toml", "server.base_url"]),
        ("--count 1 --out file/out", 1, &["cannot write"]),
    ];
    for (arguments, code, wanted) in cases {
        let arguments: Vec<&str> = ["task", "new"].into_iter().chain(arguments.split(' ')).collect();
        genmanip(folder.path(), &arguments).assert_ended(code, wanted);
        assert!(!folder.path().join("out").exists());
    }
}
