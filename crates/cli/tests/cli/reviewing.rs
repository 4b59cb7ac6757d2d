//! Reviews on the command line: independence, certificates, agreement, the suite, refusals.

use serde_json::json;

use crate::{Outcome, REPOSITORY, genmanip};

const KEY: &str = "009_appearance-000";

fn review(folder: &tempfile::TempDir, arguments: &str) -> Outcome {
    let scenario = format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{KEY}.json");
    let arguments: Vec<&str> = arguments.split_whitespace().collect();
    genmanip(folder.path(), &[&["review", &scenario], &arguments[..]].concat())
}

#[test]
fn two_reviewers_agree_and_a_suite_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let call = |arguments: &str| review(&folder, arguments);
    let queue = call("--queue --reviewer ada --json").json(0);
    assert_eq!(
        (&queue["queue"]["next"], &queue["queue"]["scenarios"][0]["is_certified"]),
        (&json!(KEY), &json!(true)),
        "its suite has a certificate"
    );
    call(&format!("--reviewer ada --approve {KEY} --criterion plausible=yes")).assert_done();
    let shown = call(&format!("--show {KEY} --reviewer bo --json")).json(0);
    assert_eq!((&shown["review"]["reviews"], &shown["review"]["work"]), (&json!([]), &json!("second")));
    let model = "--reviewer m --reviewer-kind model --reviewer-version 2";
    let said = call(&format!("{model} --approve {KEY} --criterion plausible=no --json"));
    said.assert_refused(&["`plausible` is false"]);
    let said = call(&format!("{model} --approve {KEY} --criterion plausible=yes --json")).json(0);
    assert_eq!(said["reviewed"][0]["standing"], "approved");
    let numbers = call("--agreement --balance --json").json(0);
    assert_eq!(
        (&numbers["agreement"]["decision"]["raw"], &numbers["agreement"]["decision"]["kappa"]),
        (&json!(1.0), &json!(null))
    );
    assert_eq!((&numbers["balance"]["balance"]["scenarios"], &numbers["balance"]["worst"]), (&json!(1), &json!(0.0)));
    let built = call("--build mine --json").json(0);
    assert_eq!(built["suite"]["choice"]["chosen"][0]["scenario"], KEY);
    assert!(folder.path().join("mine/choice.json").is_file());
    genmanip(folder.path(), &["suite", "check", "mine"]).assert_done();
}

#[test]
fn planted_faults_measure_reviewers() {
    let folder = tempfile::tempdir().unwrap();
    let pool = ["009_appearance-000", "018_spatial-000", "025_spatial-000"]
        .map(|name| format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{name}.json"));
    let plant: Vec<&str> = ["review"].into_iter().chain(pool.iter().map(String::as_str)).collect();
    let call = |arguments: &[&str]| genmanip(folder.path(), &[&plant, arguments].concat());
    let planted = call(&["--plant", "faulty", "--faults", "2", "--seed", "7", "--json"]).json(0);
    assert_eq!(planted["faults"], json!({"floating": 1, "overlap": 1}));
    let list = std::fs::read_to_string(folder.path().join("faulty.txt")).unwrap();
    let ids: Vec<&str> = list.lines().filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(ids.len(), 2, "{list}");
    call(&["--plant", "faulty", "--faults", "2"]).assert_refused(&["faulty exists"]);
    call(&["--plant", "more", "--faults", "4"]).assert_refused(&["4 faults need", "these are 3"]);
    call(&["--plant", "more"]).assert_ended(2, &["--faults"]);
    let by = |arguments: &[&str]| genmanip(folder.path(), &[&["review", "faulty"], arguments].concat());
    by(&["--reviewer", "ada", "--reject", ids[0], "--reason", "looks_wrong"]).assert_done();
    by(&["--reviewer", "ada", "--approve", ids[1]]).assert_done();
    let numbers = by(&["--agreement", "--planted", "faulty.txt", "--json"]).json(0);
    let ada = &numbers["agreement"]["planted"]["ada"];
    assert_eq!((&ada["planted"], &ada["detected"]), (&json!(2), &json!(1)), "{numbers}");
}

#[test]
fn what_cannot_be_said_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("targets.json"), r#"{"relation": {"left": 0.9}}"#).unwrap();
    for (arguments, wanted) in [
        ("--reviewer ada --approve none", &["no scenario none", "--queue"][..]),
        (&format!("--reviewer ada --take-back {KEY}"), &["nothing to take back"]),
        (&format!("--reviewer ada --reject {KEY} --reason other"), &["`other` needs a note"]),
        (&format!("--reviewer ada --approve {KEY} --adjudicate"), &["only two reviews that differ"]),
        (&format!("--reviewer m --reviewer-kind script --approve {KEY}"), &["has a version"]),
        ("--build mine", &["no scenario is approved"]),
        ("--balance --targets targets.json", &["`relation` sum to 0.9", "hint:"]),
        ("--agreement --planted none.txt", &["none.txt"]),
    ] {
        review(&folder, arguments).assert_refused(wanted);
    }
    assert!(!folder.path().join("studio/reviews.jsonl").exists());
    for (arguments, wanted) in [
        ("", "--queue"),
        (&format!("--approve {KEY}") as &str, "--reviewer"),
        (&format!("--reviewer ada --reject {KEY}"), "--reason"),
        ("--queue --criterion nice=yes", "instruction_clear"),
    ] {
        review(&folder, arguments).assert_ended(2, &[wanted]);
    }
}
