//! Episodes that the studio runs, keeps and plays back.

use std::path::PathBuf;

use genmanip_benchmark::ReportSettings;
use genmanip_benchmark::suite_format::sha256;
use genmanip_studio::collections::Collection;
use genmanip_studio::review::ReviewInputs;
use genmanip_studio::run::find_episode;
use genmanip_workspace::NoProgress;
use serde_json::{Value, json};

use crate::client::{Studio, serve};

/// Runs a policy to the end of its job; returns the last message about it.
fn run(studio: &Studio, policy: &str) -> Value {
    let mut tab = studio.tab("ada");
    let answer = studio.post(&studio.scenario_path("/run"), &json!({ "policy": policy }));
    assert_eq!(answer.status, 200, "{}", answer.text());
    let number = answer.json()["run"]["number"].clone();
    let is_over = |run: &Value| !["waiting", "running"].contains(&run["state"].as_str().unwrap());
    tab.find(|message| message["type"] == "run" && message["run"]["number"] == number && is_over(&message["run"]))["run"]
        .clone()
}

fn numbers(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
}

/// The run folder of the scenario's only revision.
fn run_folder(studio: &Studio) -> PathBuf {
    let runs = studio.folder.path().join("out/runs");
    let mut folders: Vec<_> = std::fs::read_dir(runs).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(folders.len(), 1, "{folders:?}");
    folders.remove(0)
}

#[test]
fn the_expert_is_run_and_its_episode_is_played_back() {
    let studio = Studio::new();
    let done = run(&studio, "expert");
    assert_eq!((&done["state"], &done["revision"]), (&json!("done"), &json!(0)), "{done}");
    let row = &done["episode"];
    assert_eq!((&row["policy"], &row["oracle"], &row["recorded"]), (&json!("expert"), &json!(true), &json!(true)));
    assert_eq!(row["success"], json!(row["failure"].is_null()), "{row}");
    let listed = studio.get(&studio.scenario_path("/episodes")).json();
    assert_eq!(listed, json!([row]));
    let path = studio.scenario_path(&format!("/episodes/{}", row["episode"].as_str().unwrap()));
    let episode = studio.get(&path).json();
    assert_eq!(episode["result"]["success"], row["success"]);
    let kinds: Vec<&Value> =
        episode["timeline"]["moments"].as_array().unwrap().iter().map(|moment| &moment["kind"]).collect();
    assert!(kinds.contains(&&json!("held")), "{kinds:?}");
    let states = studio.get(&format!("{path}/states"));
    let (values, width) = (numbers(&states.body), header(&states.head, "x-width"));
    let scene = &episode["scene"];
    let links = |body: &Value| body["links"].as_array().unwrap().len();
    let objects = scene["state"]["objects"].as_array().unwrap();
    assert_eq!(width, 2 + 7 * (links(&scene["robot"]) + objects.iter().map(links).sum::<usize>()));
    assert_eq!(values.len(), width * header(&states.head, "x-frames"));
    let (first, last) = (&values[..width], &values[values.len() - width..]);
    let duration_s = row["duration_s"].as_f64().unwrap();
    assert!(first[0] == 0.0 && (f64::from(last[0]) - duration_s).abs() < 0.05, "{} of {duration_s} s", last[0]);
    assert!(header(&states.head, "x-frames") as f64 > 20.0 * duration_s);
    // The first state is the scene itself: each link stands where the scene has it.
    let shown = [&scene["robot"]].into_iter().chain(objects).flat_map(|body| body["links"].as_array().unwrap());
    for (link, pose) in shown.zip(first[2..].chunks_exact(7)) {
        for (axis, metres) in pose[..3].iter().enumerate() {
            let expected = link["world_from_link"]["position_m"][axis].as_f64().unwrap();
            assert!((expected - f64::from(*metres)).abs() < 0.01, "{link} {pose:?}");
        }
    }
    // Images of the dataset's cameras at any state; the hand's camera moves with it.
    let image = |camera: &str, state: usize| studio.get(&format!("{path}/images/{camera}?state={state}"));
    for camera in ["overview", "wrist"] {
        let (begin, later) = (image(camera, 0), image(camera, 60));
        assert_eq!((begin.status, later.status), (200, 200), "{camera}");
        assert!(begin.body.starts_with(&[0xff, 0xd8]) && begin.body != later.body, "{camera}");
    }
    assert_eq!((image("overview", 1_000_000).status, image("none", 0).status), (404, 422));
    // `genmanip report` reads the folder like that of any evaluation.
    let page = genmanip_pipeline::report::report(&run_folder(&studio), None, &ReportSettings::default(), &NoProgress);
    assert!(page.unwrap().contains("expert"));
}

fn header(head: &str, name: &str) -> usize {
    let line = head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
    line.unwrap_or_else(|| panic!("{name} in {head}")).parse().unwrap()
}

#[test]
fn episodes_belong_to_their_revision_and_outlast_the_server() {
    let studio = Studio::new();
    let policy = "do_nothing:seconds=1";
    for count in 1..=2 {
        let done = run(&studio, policy);
        assert_eq!(done["episode"]["success"], json!(false), "{done}");
        assert_eq!(done["episode"]["failure"]["cause"], "goal_missed");
        assert_eq!(studio.get(&studio.scenario_path("/episodes")).json().as_array().unwrap().len(), count);
    }
    // The folder gives the measured difficulty as that of any evaluation does.
    let read = |path: PathBuf| ReviewInputs::read(&[path], None, None, &NoProgress);
    let content = || sha256(&std::fs::read(&studio.file).unwrap());
    let before = content();
    let measured = read(run_folder(&studio)).unwrap().measured;
    assert_eq!(measured[&before].policies.values().collect::<Vec<_>>(), [&(0, 2)]);
    let none = read(studio.folder.path().join("scenes")).unwrap_err().to_string();
    assert!(none.starts_with("there is no evaluation below"), "{none}");
    let edited = studio.post(&studio.scenario_path("/commands"), &studio.shift(0, 0.01, 0, "a1", "ada"));
    assert_eq!(edited.status, 200);
    assert_ne!(content(), before, "the edited scenario is other content, which these results do not measure");
    assert_eq!(run(&studio, policy)["episode"]["revision"], json!(1));
    let studio = studio.restarted();
    let listed = studio.get(&studio.scenario_path("/episodes")).json();
    let revisions: Vec<&Value> = listed.as_array().unwrap().iter().map(|row| &row["revision"]).collect();
    assert_eq!(revisions, [&json!(1), &json!(0), &json!(0)]);
    let keys: std::collections::BTreeSet<&str> =
        listed.as_array().unwrap().iter().map(|row| row["episode"].as_str().unwrap()).collect();
    assert_eq!(keys.len(), 3);
    for key in keys {
        let states = studio.get(&studio.scenario_path(&format!("/episodes/{key}/states")));
        assert!(states.status == 200 && header(&states.head, "x-frames") > 30, "{}", states.head);
    }
    assert_eq!(studio.get(&studio.scenario_path("/episodes/0123456789abcdef")).status, 404);
    assert_eq!(studio.get(&studio.scenario_path("/episodes/..%2f..%2fetc/states")).status, 404);
}

#[test]
fn jobs_are_cancelled_one_at_a_time_and_only_with_offered_policies() {
    let studio = Studio::new();
    for policy in ["python:os:system", "openpi:url=ws://127.0.0.1:1", "learned:/tmp", "none", ""] {
        let refused = studio.post(&studio.scenario_path("/run"), &json!({ "policy": policy }));
        assert_eq!(refused.status, 422, "{policy}");
        assert!(refused.json()["error"]["hint"].as_str().unwrap().contains("--policy"), "{}", refused.text());
    }
    let offered = studio.get("/api/policies").json();
    assert_eq!(offered[0]["policy"], "do_nothing:seconds=1");
    assert_eq!(studio.post(&studio.scenario_path("/run/cancel"), &json!({})).status, 422);
    let mut tab = studio.tab("ada");
    assert_eq!(studio.post(&studio.scenario_path("/run"), &json!({ "policy": "expert" })).status, 200);
    assert_eq!(studio.post(&studio.scenario_path("/run"), &json!({ "policy": "expert" })).status, 422);
    assert_eq!(studio.post(&studio.scenario_path("/run/cancel"), &json!({})).status, 200);
    tab.find(|message| message["type"] == "run" && message["run"]["state"] == "cancelled");
    assert_eq!(studio.get(&studio.scenario_path("/episodes")).json(), json!([]));
    assert_eq!(studio.get(&studio.scenario_path("/run")).json()["run"]["state"], "cancelled");
    // A cancelled episode is in nobody's way.
    assert_eq!(run(&studio, "do_nothing:seconds=1")["state"], "done");
}

#[test]
fn episodes_of_a_run_are_listed_with_its_scenarios() {
    let made = Studio::new();
    run(&made, "do_nothing:seconds=1");
    let run = run_folder(&made);
    let collection =
        Collection::open(std::slice::from_ref(&run), &made.folder.path().join("out"), &NoProgress).unwrap();
    let server = serve(made.folder.path(), &[run], None);
    let opened =
        Studio { server, key: made.key.clone(), file: made.file.clone(), folder: tempfile::tempdir().unwrap() };
    let rows = opened.get("/api/scenarios").json();
    assert_eq!(rows[0]["read_only"], json!(true), "{rows}");
    let listed = opened.get(&opened.scenario_path("/episodes")).json();
    let sources: Vec<&str> = listed.as_array().unwrap().iter().map(|row| row["source"].as_str().unwrap()).collect();
    assert!(sources.iter().any(|source| source.starts_with("run ")), "{listed}");

    let id = &collection.iter().next().unwrap().summary.id;
    let found = |name: String| find_episode(&collection, &name);
    let (key, episode) = found(format!("do_nothing_seconds=1/{id}")).unwrap();
    assert_eq!(json!([key, episode]), json!([rows[0]["key"], listed[0]["episode"]]), "{listed}");
    assert_eq!(found(id.to_string()), Some((key, episode)), "the only episode of this id");
    assert_eq!((found(format!("expert/{id}")), found(format!("{id}+1"))), (None, None));
}
