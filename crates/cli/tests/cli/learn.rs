//! Learned policies from the command line.

use serde_json::Value;

use super::serving::Serving;
use super::{REPOSITORY, example, genmanip};

/// Results of one policy, without its name.
fn results(mut evaluated: Value) -> Value {
    let mut results = evaluated[0]["results"].take();
    for result in results.as_array_mut().unwrap() {
        result["policy"] = Value::Null;
    }
    results
}

/// Of a suite the missing demonstrations are collected first: of the layouts and with the settings of `collect`.
#[test]
fn a_suite_is_learned_from_its_layouts() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let train = |more: &[&str]| {
        let usual = ["train", "genmanip-learn-10", "--distribution", "switch", "--preset", "state", "--steps", "2"];
        genmanip(here, &[&usual[..], more].concat())
    };
    let trained = train(&["--demos", "2", "--out", "two", "--json"]).json(0);
    assert_eq!(trained["demonstrations"], Value::from(2));
    let by_hand = ["--distribution", "switch", "--verified", "2", "--expert", "consistent", "--no-dataset"];
    let collect = ["collect", "--suite", "genmanip-learn-10", "--split", "train", "--out", "two-demonstrations"];
    let before = super::tree(&here.join("two-demonstrations/episodes"));
    assert_eq!(genmanip(here, &[&collect[..], &by_hand].concat()).code, Some(0));
    assert!(super::tree(&here.join("two-demonstrations/episodes")) == before, "it is the same run");

    let run = genmanip(
        here,
        &["train", "two-demonstrations", "--demos", "2", "--preset", "state", "--steps", "2", "--out", "x"],
    );
    run.assert_refused(&["two-demonstrations is no suite of task distributions"]);
    let suite = genmanip(here, &["train", "genmanip-learn-10", "--preset", "state", "--steps", "2", "--out", "x"]);
    suite.assert_refused(&["how many demonstrations?", "--demos"]);
    assert!(!here.join("x").exists() && !here.join("x-demonstrations").exists());
}

/// A network that has hardly learned anything moves the arm in the same way here and behind a server.
#[test]
fn a_served_policy_acts_as_in_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let done = |arguments: &[&str]| {
        let outcome = genmanip(here, arguments);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
    };
    let task = example("024_appearance");
    done(&["collect", &task, "--episodes", "1", "--seed", "3", "--no-dataset", "--out", "run"]);
    let evaluate = |policy: &str| {
        genmanip(here, &["evaluate", "run/scenarios", "--policy", policy, "--horizon", "4", "--json"]).json(0)
    };
    // Half of all initial networks say at once that they have finished, the first two among them.
    let moving = (2..8).find_map(|seed| {
        let policy = format!("policy-{seed}");
        done(&["train", "run", "--preset", "tiny", "--steps", "1", "--seed", &seed.to_string(), "--out", &policy]);
        let results = results(evaluate(&format!("learned:{policy}")));
        (results[0]["tcp_path_m"].as_f64().unwrap() > 0.01).then_some((policy, results))
    });
    let (moving, expected) = moving.unwrap();
    assert_eq!(expected.as_array().map(Vec::len), Some(1));
    let page = std::fs::read_to_string(here.join(&moving).join("training.html")).unwrap();
    assert_eq!(page.matches("data:image/jpeg").count(), 2, "a moment with the images of both cameras");
    let moving = format!("learned:{moving}");
    let serving = Serving::start(here, &["serve", "policy", &moving, "--address", "127.0.0.1:0"]);
    let policy = |more: &str| format!("openpi:url=ws://{},preset=genmanip{more}", serving.address);
    assert_eq!(results(evaluate(&policy(""))), expected);
    genmanip(here, &["evaluate", "run/scenarios", "--policy", &policy(",wrist=other")])
        .assert_refused(&["preset=genmanip takes no exterior and wrist"]);

    done(&["train", "run", "--preset", "state", "--steps", "1", "--out", "privileged"]);
    genmanip(here, &["serve", "policy", "learned:privileged"])
        .assert_refused(&["reads simulator ground truth", "--preset tiny"]);
}

/// The policy of the repository sees: from images alone it solves layouts that it was not trained on.
#[test]
fn the_policy_of_the_repository_solves_unseen_layouts() {
    let folder = tempfile::tempdir().unwrap();
    let policy = format!("learned:{REPOSITORY}/examples/policies/into-tiny");
    let suite = ["evaluate", "--suite", "genmanip-learn-10", "--split", "familiar", "--distribution", "into"];
    let more = ["--first", "8", "--policy", &policy, "--out", "out", "--json"];
    let evaluated = genmanip(folder.path(), &[&suite[..], &more].concat()).json(0);
    assert_eq!(evaluated[0]["oracle"], Value::Bool(false));
    let solved = evaluated[0]["summary"]["success"]["successes"].as_u64().unwrap();
    // 5 of 8 when it was trained; chance solves none.
    assert!((3..=8).contains(&solved), "{solved} of 8");
}
