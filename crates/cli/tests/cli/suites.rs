//! A small suite from its seed to an evaluation, and what happens to one that somebody changed.

use std::fs;

use crate::{genmanip, tree};

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

    // One digit of one scenario, and a scenario that nobody froze.
    let id = entry["id"].as_str().unwrap();
    let path = here.join(format!("mine/scenarios/{id}.json"));
    let text = fs::read_to_string(&path).unwrap();
    let at = text.find("\"pose\"").map(|at| at + text[at..].find('.').unwrap() + 3).unwrap();
    let digit = if text.as_bytes()[at] == b'1' { "2" } else { "1" };
    fs::write(&path, format!("{}{digit}{}", &text[..at], &text[at + 1..])).unwrap();
    fs::write(here.join("mine/scenarios/stranger.json"), &text).unwrap();
    let spoilt = genmanip(here, &["suite", "check", "mine"]);
    assert_eq!(spoilt.code, Some(1), "{spoilt:?}");
    for said in [&format!("{id}: is not as it was frozen"), "stranger.json belongs to no scenario"] {
        assert!(spoilt.stdout.contains(said), "{said}: {spoilt:?}");
    }
    genmanip(here, &call).assert_refused(&["not those that were frozen", "genmanip suite check mine"]);
    genmanip(here, &["suite", "check", "nowhere"]).assert_refused(&["no suite at nowhere", "suite build"]);
}
