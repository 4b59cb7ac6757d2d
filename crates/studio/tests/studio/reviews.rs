//! Reviews as the page and other programs give them: independence, voiding by edits, certificates, the suite.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use genmanip_benchmark::balance::MeasuredContent;
use genmanip_benchmark::suite_format::sha256;
use genmanip_benchmark::{EvaluationReport, suites};
use genmanip_core::Document;
use genmanip_studio::collections::Collection;
use genmanip_studio::review::{Criterion, LeftOut, ReviewInputs, ReviewLog, Standing, build_suite, read_desk};
use genmanip_workspace::NoProgress;
use serde_json::{Value, json};

use crate::client::Studio;

/// Body of a review of the present content by a person.
fn said(studio: &Studio, name: &str, verdict: &str, id: &str) -> Value {
    let path = format!("/api/reviews/{}?reviewer={name}", studio.key);
    let content = studio.get(&path).json()["content_sha256"].clone();
    let mut decision = json!({ "verdict": verdict });
    if verdict == "reject" {
        decision["reasons"] = json!(["ambiguous"]);
    }
    json!({
        "reviewer": { "name": name, "kind": "human" }, "decision": decision, "content_sha256": content,
        "criteria": { (Criterion::InstructionClear.name()): verdict != "reject" },
        "client_operation_id": id, "at": "2026-01-01T00:00:00Z",
    })
}

fn names(state: &Value) -> Vec<&str> {
    let reviews = state["reviews"].as_array().unwrap();
    reviews.iter().map(|review| review["reviewer"]["name"].as_str().unwrap()).collect()
}

#[test]
fn reviews_are_independent_and_an_edit_voids_them() {
    let studio = Studio::new();
    let path = format!("/api/reviews/{}", studio.key);
    let state = |name: &str| studio.get(&format!("{path}?reviewer={name}")).json();
    let queue = |name: &str| studio.get(&format!("/api/reviews?reviewer={name}")).json();
    assert_eq!((&queue("ada")["next"], &queue("ada")["scenarios"][0]["work"]), (&json!(studio.key), &json!("first")));
    let by_ada = said(&studio, "ada", "approve", "a1");
    for _ in 0..2 {
        let answer = studio.post(&path, &by_ada);
        assert_eq!((answer.status, names(&answer.json())), (200, vec!["ada"]), "{}", answer.text());
    }
    // The other one sees that a review is there, not what it says.
    let seen = state("bo");
    assert_eq!((names(&seen), &seen["standing"], &seen["work"]), (vec![], &json!("open"), &json!("second")));
    assert_eq!(studio.post(&path, &said(&studio, "bo", "reject", "b1")).status, 200);
    let differs = state("ada");
    assert_eq!((names(&differs), &differs["standing"]), (vec!["ada", "bo"], &json!("adjudication")));
    assert_eq!(queue("ada")["next"], Value::Null);
    assert_eq!(queue("cy")["scenarios"][0]["work"], json!("adjudicate"));
    let agreement = studio.get("/api/agreement").json();
    assert_eq!((&agreement["decision"]["raw"], &agreement["decision"]["items"]), (&json!(0.0), &json!(1)));
    // One of the two may not decide.
    let mut decided = said(&studio, "bo", "approve", "b2");
    decided["adjudicates"] = json!(true);
    assert_eq!(studio.post(&path, &decided).status, 422);
    decided["reviewer"]["name"] = json!("cy");
    assert_eq!(studio.post(&path, &decided).json()["standing"], json!("uncertified"));
    let (log, old) = (ReviewLog::path_of(&studio.folder.path().join("out")), state("ada")["content_sha256"].clone());
    let before = fs::read(&log).unwrap();
    // What was said of the scenario before an edit does not count, and cannot be said any more.
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &studio.shift(0, 0.001, 0, "e1", "ada")).status, 200);
    let voided = state("ada");
    assert_eq!((names(&voided), &voided["work"]), (vec![], &json!("first")));
    let mut late = said(&studio, "dan", "approve", "d1");
    late["content_sha256"] = old.clone();
    assert_eq!(studio.post(&path, &late).status, 409);
    assert_eq!(fs::read(&log).unwrap(), before);
    // The old content again: its reviews count again.
    let undo = json!({ "author": "ada", "client_operation_id": "e2", "at": "2026-01-01T00:00:01Z" });
    assert_eq!(studio.post(&studio.scenario_path("/undo"), &undo).status, 200);
    assert_eq!((&state("ada")["content_sha256"], &state("ada")["standing"]), (&old, &json!("uncertified")));
    let studio = studio.restarted();
    assert_eq!(studio.get(&format!("{path}?reviewer=ada")).json()["standing"], json!("uncertified"));
}

#[test]
fn nonsense_is_refused() {
    let studio = Studio::new();
    let path = format!("/api/reviews/{}", studio.key);
    let whole = said(&studio, "ada", "approve", "a1");
    let cases: [(&str, Value, u16); 8] = [
        ("decision", json!({ "verdict": "reject", "reasons": [] }), 422),
        ("decision", json!({ "verdict": "reject", "reasons": ["ugly"] }), 422),
        ("decision", json!({ "verdict": "take_back" }), 422),
        ("decision", json!({ "verdict": "send_back" }), 422),
        ("reviewer", json!({ "name": "", "kind": "human" }), 422),
        ("reviewer", json!({ "name": "m", "kind": "model" }), 422),
        ("content_sha256", json!("0"), 409),
        ("colour", json!("red"), 422),
    ];
    for (field, value, status) in cases {
        let mut spoilt = whole.clone();
        spoilt[field] = value.clone();
        assert_eq!(studio.post(&path, &spoilt).status, status, "{field} {value}");
    }
    for body in [json!([]), json!("x"), json!({})] {
        assert_eq!(studio.post(&path, &body).status, 422, "{body}");
    }
    assert_eq!(studio.get("/api/reviews/none").status, 404);
    assert_eq!(studio.post("/api/suites", &json!({ "name": "../x" })).status, 422);
    assert_eq!(studio.post("/api/suites", &json!({ "name": "x" })).status, 422, "nothing is approved");
    assert!(!ReviewLog::path_of(&studio.folder.path().join("out")).exists());
}

/// Two approve, the expert solves it, and the scenario is in a sound suite with its reason.
#[test]
fn what_is_approved_and_certified_becomes_a_suite() {
    let studio = Studio::new();
    let path = format!("/api/reviews/{}", studio.key);
    for name in ["ada", "bo"] {
        assert_eq!(studio.post(&path, &said(&studio, name, "approve", name)).status, 200);
    }
    let balance = studio.get("/api/balance").json();
    assert_eq!((&balance["balance"]["scenarios"], &balance["standings"]["uncertified"]), (&json!(0), &json!(1)));
    assert_eq!(balance["helpful"][0]["key"], json!(studio.key));
    let tried = studio.post(&format!("{path}/certificate"), &json!({ "at": "2026-01-01T00:00:00Z" })).json();
    assert_eq!((&tried["trials"]["verified"], &tried["standing"]), (&json!(5), &json!("approved")), "{tried}");
    assert_eq!(studio.get("/api/balance").json()["balance"]["scenarios"], json!(1));
    let built = studio.post("/api/suites", &json!({ "name": "reviewed" })).json();
    assert_eq!(built["scenarios"], json!(1), "{built}");
    let folder = studio.folder.path().join("out/reviewed");
    let checked = suites::check(&folder, 1, &NoProgress, &false.into()).unwrap().unwrap();
    assert_eq!((checked.faults, checked.scenarios), (vec![], 1));
    let choice: Value = serde_json::from_slice(&fs::read(folder.join("choice.json")).unwrap()).unwrap();
    assert_eq!(choice["chosen"][0]["scenario"], json!(studio.scenario().id));
    assert_eq!(studio.post("/api/suites", &json!({ "name": "reviewed" })).status, 422, "a suite is never replaced");
    let listed = json!({ "suites": [{ "name": "reviewed", "scenarios": [studio.scenario().id] }] });
    assert_eq!(studio.get("/api/suites").json(), listed);
}

/// Difficulty comes from the results that the user names, distances from the user's targets; a planted scenario measures
/// the reviewers and is in no suite.
#[test]
fn difficulty_targets_and_planted_faults() {
    let studio = Studio::new();
    let id = studio.scenario().id;
    let rates = BTreeMap::from([("strong".to_owned(), (5, 5)), ("weak".to_owned(), (1, 5))]);
    let measured = MeasuredContent { scenario_id: id.clone(), policies: rates };
    let content = sha256(&fs::read(&studio.file).unwrap());
    let inputs = ReviewInputs { measured: BTreeMap::from([(content, measured)]), ..ReviewInputs::default() };
    let studio = studio.reviewing(inputs.clone());
    let path = format!("/api/reviews/{}", studio.key);
    let now = studio.get("/api/balance").json();
    assert_eq!(
        (&now["policies"], &now["measured"]),
        (
            &json!([
                { "policy": "strong", "scenarios": 1, "episodes": 5, "successes": 5 },
                { "policy": "weak", "scenarios": 1, "episodes": 5, "successes": 1 },
            ]),
            &json!([{
                "key": studio.key, "id": id, "difficulty": "medium", "mean_success": 0.6,
                "policies": { "strong": [5, 5], "weak": [1, 5] },
            }])
        )
    );
    let wanted = |axes: &Value, axis: &str, value: &str| {
        let axis = axes.as_array().unwrap().iter().find(|one| one["axis"] == axis).unwrap().clone();
        let values = axis["values"].as_array().unwrap();
        values.iter().find(|one| one["value"] == value).map(|one| one["wanted"].as_f64().unwrap())
    };
    assert_eq!(wanted(&now["balance"]["axes"], "difficulty", "medium"), Some(1.0));
    let targets = json!({ "difficulty": { "easy": 0.75, "medium": 0.25 } });
    let against = studio.post("/api/balance", &json!({ "targets": targets })).json();
    let shares = ["easy", "medium"].map(|value| wanted(&against["balance"]["axes"], "difficulty", value));
    assert_eq!(shares, [Some(0.75), Some(0.25)]);
    for spoilt in [json!({ "difficulty": { "easy": 0.7 } }), json!({ "difficulty": { "easy": 1.5, "hard": -0.5 } })] {
        assert_eq!(studio.post("/api/balance", &json!({ "targets": spoilt })).status, 422);
        assert_eq!(studio.post("/api/suites", &json!({ "name": "x", "targets": spoilt })).status, 422);
    }
    let inputs = ReviewInputs { targets: serde_json::from_value(targets).unwrap(), ..inputs };
    let studio = studio.reviewing(inputs.clone());
    let now = studio.get("/api/balance").json();
    assert_eq!(wanted(&now["balance"]["axes"], "difficulty", "easy"), Some(0.75));
    // The reviewers do not know that the scenario is planted.
    let studio = studio.reviewing(ReviewInputs { planted: [id].into(), ..inputs });
    for (name, verdict) in [("ada", "approve"), ("bo", "reject")] {
        assert_eq!(studio.post(&path, &said(&studio, name, verdict, name)).status, 200);
    }
    let found = studio.get("/api/agreement").json()["planted"].clone();
    let of = |detected: u32| json!({ "planted": 1, "detected": detected, "sound": 0, "false_alarms": 0 });
    assert_eq!(found, json!({ "ada": of(0), "bo": of(1) }));
    let now = studio.get("/api/balance").json();
    assert_eq!((&now["helpful"], &now["balance"]["axes"]), (&json!([]), &json!([])));
    // Results of the content before an edit say nothing about the one after it.
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &studio.shift(0, 0.001, 0, "e1", "ada")).status, 200);
    let now = studio.get("/api/balance").json();
    let left_out = json!([{ "episodes": 10, "reason": LeftOut::OtherContent.text() }]);
    assert_eq!((&now["measured"], &now["policies"], &now["left_out"]), (&json!([]), &json!([]), &left_out));
}

/// Only results that name the present content measure it: neither those of older versions, nor of other cameras,
/// another engine or another content.
#[test]
fn results_of_other_content_measure_nothing() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cli/testdata/version_1/run/evaluation/expert.json");
    let older = ReviewInputs::read(std::slice::from_ref(&file), None, None, &NoProgress).unwrap();
    let mut report = EvaluationReport::from_bytes(&fs::read(&file).unwrap()).unwrap();
    let episodes = report.results.len();
    assert!(older.measured.is_empty() && episodes > 0);
    let named = |report: &mut EvaluationReport| {
        let ids = report.results.iter().map(|result| (result.scenario_id.clone(), "ab".to_owned()));
        report.scenario_sha256 = ids.collect();
    };
    let engine = |report: &mut EvaluationReport, engine: &str| {
        report.results.iter_mut().for_each(|result| result.engine = engine.into());
    };
    assert_eq!(older.left_out, BTreeMap::from([(LeftOut::UnknownContent, episodes)]));
    named(&mut report);
    engine(&mut report, "another 1.0");
    let reasons =
        |report: &EvaluationReport| ReviewInputs::default().with_reports(std::slice::from_ref(report)).left_out;
    assert_eq!(reasons(&report), BTreeMap::from([(LeftOut::OtherEngine, episodes)]));
    engine(&mut report, &genmanip_sim::engine_version());
    report.cameras = Some("mine".into());
    assert_eq!(reasons(&report), BTreeMap::from([(LeftOut::OtherCameras, episodes)]));
    report.cameras = None;
    let counted = ReviewInputs::default().with_reports(std::slice::from_ref(&report));
    assert_eq!((counted.left_out.len(), counted.measured["ab"].episodes()), (0, episodes));
}

/// Reviews and certificates of a suite are taken over once; an edited copy takes the place of its original.
#[test]
fn older_reviews_and_certificates_of_a_suite_count() {
    let folder = tempfile::tempdir().unwrap();
    let suite = small_suite(folder.path());
    let ids = ["009_appearance-000", "010_appearance-000"];
    suites::review(&suite, ids[0], "ada", genmanip_benchmark::suite_format::ReviewVerdict::Sound, "").unwrap();
    suites::review(&suite, ids[1], "bo", genmanip_benchmark::suite_format::ReviewVerdict::Flawed, "odd").unwrap();
    let out = folder.path().join("out");
    let open = || {
        let collection = Collection::open(std::slice::from_ref(&suite), &out, &NoProgress).unwrap();
        read_desk(&collection, &out).unwrap().0
    };
    let mut desk = open();
    let state = desk.state(ids[0], "ada").unwrap();
    assert_eq!((state.reviews.len(), state.row.is_certified), (1, true));
    assert!(!ReviewLog::path_of(&out).exists(), "looking writes nothing");
    let mut second = state.reviews[0].clone();
    second.reviewer.name = "bo".into();
    second.at = "2026-01-01T00:00:00Z".into();
    desk.add(ids[0], second).unwrap();
    // Later changes of the older file change nothing.
    fs::remove_file(suite.join("review.json")).unwrap();
    let mut desk = open();
    // A planted scenario is in no suite, even when it is approved.
    let planted = ReviewInputs { planted: [ids[0].to_owned()].into(), ..ReviewInputs::default() };
    desk.set_inputs(planted);
    let refused = build_suite(&desk, &folder.path().join("none"), "none", None, &Default::default()).unwrap_err();
    assert!(refused.to_string().starts_with("no scenario is approved"), "{refused}");
    assert_eq!(desk.dashboard(desk.targets()).balance.scenarios, 0);
    desk.set_inputs(ReviewInputs::default());
    let standing = |id: &str| desk.standing(desk.get(id).unwrap());
    assert_eq!((standing(ids[0]), standing(ids[1])), (Standing::Approved, Standing::Open { missing: 1 }));
    let written = fs::read_to_string(ReviewLog::path_of(&out)).unwrap();
    assert_eq!(written.matches("\"imported\"").count(), 1, "{written}");
    let build = build_suite(&desk, &folder.path().join("new"), "new", None, &Default::default()).unwrap();
    assert_eq!((build.suite.scenarios.len(), build.choice.rejected[0].reason.as_str()), (1, "one review is missing"));
    // An edited copy.
    let copies = out.join("small");
    fs::create_dir_all(&copies).unwrap();
    let file = suites::scenario_file(&suite, ids[0]);
    let mut copy =
        genmanip_studio::edit::EditedScenario::copy_into(&file, &copies, genmanip_assets::Catalogue::all()).unwrap();
    let text = json!({ "op": "instruction", "args": { "text": "Put the yellow can right of the red can." } });
    copy.apply(&crate::command("ada", "1", 0, text)).unwrap();
    let desk = open();
    let keys: BTreeSet<&str> = desk.items().map(|item| item.key.as_str()).collect();
    assert_eq!(keys, BTreeSet::from(["009_appearance-000~2", ids[1]]));
    assert_eq!(desk.standing(desk.get("009_appearance-000~2").unwrap()), Standing::Open { missing: 2 });
}

/// Two scenarios of the shipped suite as a suite.
fn small_suite(folder: &Path) -> std::path::PathBuf {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../suites/genmanip-200-rc");
    let suite = folder.join("small");
    fs::create_dir_all(suite.join("scenarios")).unwrap();
    let mut file: Value = serde_json::from_slice(&fs::read(shipped.join("suite.json")).unwrap()).unwrap();
    file["name"] = json!("small");
    file["assets"] = json!([]);
    let is_kept = |entry: &Value| ["009_appearance-000", "010_appearance-000"].contains(&entry["id"].as_str().unwrap());
    file["scenarios"].as_array_mut().unwrap().retain(is_kept);
    for entry in file["scenarios"].as_array().unwrap() {
        let name = format!("scenarios/{}.json", entry["id"].as_str().unwrap());
        fs::copy(shipped.join(&name), suite.join(&name)).unwrap();
    }
    fs::write(suite.join("suite.json"), file.to_string()).unwrap();
    suite
}
