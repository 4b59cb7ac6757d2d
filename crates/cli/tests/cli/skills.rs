//! Skill files of the expert, and selection by source, on the command line.

use std::fs;

use crate::{example, genmanip};

/// A minimal skill that presses a button.
const PRESS: &str = r#"{
  "schema": "genmanip.skill/1", "name": "press-1", "verb": "press",
  "source": {
    "episode": "take", "record_hash": "00", "scenario": "s", "policy": "teleop", "seed": 1,
    "object": {"source": "generated", "family": "push button", "params": {}, "seed": 1, "version": 1},
    "family": "push button", "control_rate_hz": 60.0, "genmanip_version": "0.2.0"
  },
  "segments": {"approach": [0, 10], "contact": [10, 11], "manipulate": [11, 20], "release": [20, 25], "retreat": [25, 30]},
  "grip": {"kind": "fixed", "width_m": 0.0},
  "motion": {
    "joint": "prismatic", "states": ["released", "pressed"], "from_to": [0.0, 0.0075], "nominal": 0.0075,
    "handle_half_m": [0.03, 0.03, 0.015],
    "approach": [{"position_m": [0, 0, 0.1], "orientation_wxyz": [0, 1, 0, 0]}],
    "along": [
      {"position_m": [0, 0, 0.02], "orientation_wxyz": [0, 1, 0, 0]},
      {"position_m": [0, 0, 0.02], "orientation_wxyz": [0, 1, 0, 0]}
    ],
    "retreat": []
  }
}"#;

#[test]
fn skills_that_do_not_apply_are_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("press.skill.json"), PRESS).unwrap();
    fs::create_dir(here.join("empty")).unwrap();
    let task = example("012_pick_and_place");
    for (skill, wanted) in [
        ("press.skill.json", ["no task has a change of state that a skill serves", "press along a prismatic joint"]),
        ("missing.skill.json", ["missing.skill.json", "error"]),
        ("empty", ["there is no skill", "genmanip skills record"]),
    ] {
        genmanip(here, &["collect", &task, "--skill", skill, "--no-dataset", "--out", "run"]).assert_refused(&wanted);
        assert!(!here.join("run").exists(), "{skill}");
    }
    let shown = genmanip(here, &["skills", "show", "press.skill.json"]);
    assert!(shown.code == Some(0) && shown.stdout.contains("released to pressed"), "{shown:?}");
}
