//! `genmanip-lab teleop`: small amounts, with the bars that do not depend on the amount.

use std::path::Path;

use super::lab;

#[test]
fn teleoperation_meets_its_bars_and_its_episodes_replay() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["teleop", "--seed", "5", "--episodes", "1", "--commands", "200", "--out", "takes", "--json"];
    let measured = lab(folder.path(), &arguments).json(0);
    let number = |key: &str| measured[key].as_f64().unwrap_or_else(|| panic!("`{key}` in {measured:#}"));
    for (key, most) in [
        ("axis_errors", 0.0),
        ("cross_talk_deg", 0.1),
        ("cross_talk_mm", 0.5),
        ("return_mm", 0.1),
        ("return_deg", 0.1),
        ("measured_off_mm", 3.0),
        ("measured_off_deg", 1.0),
        ("hold_ms_max", 100.0),
        ("input_to_command_ms_p95", 17.0),
    ] {
        assert!(number(key) <= most, "{key}: {} of at most {most}", number(key));
    }
    assert_eq!((number("axes"), number("replay_equal")), (192.0, 1.0));
    for key in ["input_to_image_ms_p95", "images_per_s"] {
        assert!(measured[key].is_null(), "{key} needs the page");
    }
    let take = folder.path().join("takes").join("space_mouse-000");
    let record = read(&take.join("operator.json"));
    assert!(record.contains("\"genmanip.operator/1\"") && record.contains("\"scripted\""), "{record}");
    assert!(
        read(&take.join("operator_events.jsonl"))
            .starts_with("{\"sequence\":0,\"step\":0,\"event\":{\"type\":\"connected\"")
    );
    assert!(read(&take.join("episode.json")).contains("\"source\": \"scripted_teleop\""));
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}
