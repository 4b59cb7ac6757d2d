//! Arms identified from recordings.

use std::fs;

use serde_json::Value;

use crate::genmanip;

/// A rehearsal with known truth: proposed motion, recording of a simulated arm, identified world.
#[test]
fn an_identified_arm_is_written_into_a_world() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    assert_eq!(genmanip(here, &["world", "init", "--out", "truth.toml"]).code, Some(0));
    let truth = fs::read_to_string(here.join("truth.toml")).unwrap()
        + "\n[physics.arm]\nfriction_loss = [1, 1, 1, 1, 0.3, 0.3, 0.3]\nlatency_s = 0.03\n";
    fs::write(here.join("truth.toml"), truth).unwrap();
    let excite = ["identify", "excite", "--candidates", "1", "--duration", "3", "--out", "motion.json", "--json"];
    let proposed = genmanip(here, &excite).json(0);
    assert_eq!(proposed["expected"].as_array().unwrap().len(), 29, "{proposed}");
    genmanip(here, &["identify", "motion.json"]).assert_refused(&["without measurements", "rehearse"]);
    let rehearse = ["identify", "rehearse", "motion.json", "--world", "truth.toml", "--out", "recording.json"];
    assert_eq!(genmanip(here, &rehearse).code, Some(0));
    let found = genmanip(here, &["identify", "recording.json", "--out", "found.toml", "--json"]).json(0);
    let latency = found["parameters"].as_array().unwrap().iter().find(|it| it["name"] == "latency").unwrap();
    assert!((latency["value"].as_f64().unwrap() - 0.03).abs() < 2e-3, "{latency}");
    assert!(found["held_out"]["after_rad"].as_f64().unwrap() < 3e-4, "{}", found["held_out"]);
    assert!(fs::read_to_string(here.join("found.toml")).unwrap().contains("[physics.arm]"));
    assert_eq!(genmanip(here, &["world", "check", "found.toml"]).code, Some(0));
}

#[test]
fn motions_and_recordings_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let push = ["identify", "excite", "--for", "table-friction", "--out", "push.json"];
    genmanip(here, &[&push[..], &["--block-at", "5,0"]].concat()).assert_refused(&["out of reach"]);
    assert_eq!(genmanip(here, &push).code, Some(0));
    let good: Value = serde_json::from_str(&fs::read_to_string(here.join("push.json")).unwrap()).unwrap();
    type Change = fn(&mut Value);
    let cases: [(Change, &str); 3] = [
        (|motion| motion["robot"] = "ur5e_2f85".into(), "it is of robot `ur5e_2f85`"),
        (|motion| motion["time_s"][1] = "soon".into(), "time_s[1]"),
        (|motion| motion["block"] = Value::Null, "block"),
    ];
    for (change, said) in cases {
        let mut changed = good.clone();
        change(&mut changed);
        fs::write(here.join("changed.json"), changed.to_string()).unwrap();
        genmanip(here, &["identify", "changed.json"]).assert_refused(&[said]);
    }
    genmanip(here, &["identify", "nowhere.json"]).assert_refused(&["nowhere.json"]);
}
