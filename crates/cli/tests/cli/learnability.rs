//! Consistent demonstrations, and how well demonstrations could be learned from.

use std::fs;

use serde_json::Value;

use crate::{example, finished_run, genmanip};

#[test]
fn consistent_demonstrations_say_so_and_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let collect = ["collect", &task, "--episodes", "2", "--no-dataset", "--seed", "3", "--out", "run"];
    let consistent = [&collect[..], &["--expert", "consistent"]].concat();
    assert_eq!(genmanip(folder.path(), &consistent).code, Some(0));
    let json =
        |path: &str| -> Value { serde_json::from_str(&fs::read_to_string(folder.path().join(path)).unwrap()).unwrap() };
    assert_eq!(json("run/run.json")["settings"]["expert"]["style"], "consistent");
    assert_eq!(json("run/episodes/024_appearance-000/episode.json")["result"]["expert"], "consistent");
    // The default expert's run is another run.
    genmanip(folder.path(), &collect).assert_refused(&["settings.expert.style"]);

    let measured = genmanip(folder.path(), &["data", "show", "--learnability", "run", "--json"]).json(0);
    let measured = &measured["learnability"];
    assert_eq!((&measured["episodes"], &measured["small_tasks"]), (&2.into(), &1.into()), "{measured}");
    assert!(measured["grasp"].is_null() && measured["neighbours"]["tool_l1"].is_f64(), "{measured}");
    // A dataset carries the episodes along; one without them is refused.
    let dataset = finished_run().join("dataset");
    let shown = genmanip(folder.path(), &["data", "show", "--learnability", dataset.to_str().unwrap()]);
    assert!(shown.code == Some(0) && shown.stdout.contains("tasks with fewer than 40 grasps"), "{shown:?}");
    fs::create_dir(folder.path().join("foreign")).unwrap();
    genmanip(folder.path(), &["data", "show", "--learnability", "foreign"])
        .assert_refused(&["without extras/record", "name a run, or a dataset"]);
}
