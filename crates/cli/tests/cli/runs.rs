//! A finished run and what is made of it: replay, evaluation, report, export.

use std::fs;

use genmanip_data::EpisodeStore;
use serde_json::Value;

use crate::{
    QUICK_TASKS, assert_same_tree, collect_quick, copy_of_finished_run, finished_run, genmanip, quick_examples,
    small_images,
};
use crate::{times, tree, without_timings};

#[test]
fn every_task_has_a_verified_episode_with_scenario_pictures_and_dataset() {
    let files = tree(finished_run());
    for task in QUICK_TASKS {
        let record: Value = serde_json::from_slice(&files[&format!("episodes/{task}-000/episode.json")]).unwrap();
        assert_eq!(record["result"]["success"], true, "{task}: {record}");
        assert!(files.contains_key(&format!("scenarios/{task}-000.json")));
        assert!(files.contains_key(&format!("episodes/{task}-000/images_10hz/files.json")));
    }
    let info: Value = serde_json::from_slice(&files["dataset/meta/info.json"]).unwrap();
    assert_eq!((&info["codebase_version"], &info["fps"]), (&"v3.0".into(), &10.into()));
    assert_eq!(info["total_episodes"], QUICK_TASKS.len());
    assert!(files.keys().any(|name| name.starts_with("dataset-depth/")));
    assert!(!files.keys().any(|name| name.contains("partial")), "something half-written was left");
}

#[test]
fn recorded_commands_lead_to_the_identical_final_state() {
    let run = finished_run();
    let store = run.join("episodes");
    for (path, count) in [(run.to_owned(), 2), (store.clone(), 2), (store.join("021_spatial-000"), 1)] {
        let rows = genmanip(run, &["replay", "--check", "--json", path.to_str().unwrap()]).json(0);
        let rows = rows.as_array().unwrap();
        assert_eq!(rows.len(), count);
        assert!(rows.iter().all(|row| row["identical"] == true && row["frames"].as_u64() > Some(60)), "{rows:?}");
    }
    let with = |workers: &str| genmanip(run, &["replay", "--check", "--json", "--workers", workers, "episodes"]).stdout;
    assert_eq!(with("1"), with("2"));
}

/// Looking at a finished run once more says nothing about how long it took to make.
#[test]
fn resuming_a_finished_run_leaves_its_timings_alone() {
    let folder = copy_of_finished_run();
    let before = times(&folder.path().join("run"));
    let outcome = genmanip(folder.path(), &collect_quick(&quick_examples(), &[]));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert_eq!(times(&folder.path().join("run"))["timings.json"], before["timings.json"]);
}

/// A damaged recording is refused where it alone is meant.
#[test]
fn a_damaged_episode_is_refused() {
    let folder = copy_of_finished_run();
    let frames = folder.path().join("run/episodes/021_spatial-000/frames.parquet");
    let mut bytes = fs::read(&frames).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&frames, bytes).unwrap();
    let outcome = genmanip(folder.path(), &["replay", "--check", "run/episodes/021_spatial-000"]);
    outcome.assert_refused(&["021_spatial-000", "frames.parquet", "--repair"]);
}

#[test]
fn a_run_of_another_seed_is_refused_and_nothing_changes() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    let (files, written) = (tree(&run), times(&run));
    for (more, wanted) in
        [(["--seed", "5"], "its seed is 0, not 5"), (["--fps", "15"], "settings.images.fps is 10, not 15")]
    {
        let examples = quick_examples();
        let arguments: Vec<&str> = ["collect"]
            .into_iter()
            .chain(examples.iter().map(String::as_str))
            .chain(["--episodes", "1", "--world", small_images(), "--out", "run"])
            .chain(more)
            .chain(if more[0] == "--fps" { vec![] } else { vec!["--fps", "10"] })
            .collect();
        genmanip(folder.path(), &arguments).assert_refused(&["holds another run", wanted, "hint:"]);
    }
    assert_same_tree(&tree(&run), &files);
    assert_eq!(times(&run), written);
}

#[test]
fn a_finished_run_repeated_makes_nothing_again() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    let (files, episodes) = (tree(&run), times(&run.join("episodes")));
    let outcome = genmanip(folder.path(), &collect_quick(&quick_examples(), &[]));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert_eq!(times(&run.join("episodes")), episodes);
    assert_same_tree(&without_timings(tree(&run)), &without_timings(files));
}

#[test]
fn evaluation_and_report_of_a_run() {
    let folder = copy_of_finished_run();
    let reports = genmanip(folder.path(), &["evaluate", "run", "--json"]).json(0);
    let success = |policy: &str| {
        let report = reports.as_array().unwrap().iter().find(|report| report["policy"] == policy).unwrap();
        (report["summary"]["success"]["value"].as_f64().unwrap(), report["oracle"] == true)
    };
    assert_eq!(success("do_nothing"), (0.0, false), "no scenario solves itself");
    assert_eq!(success("replay"), (1.0, false), "recorded commands solve what they solved");
    assert_eq!(success("expert"), (1.0, true), "same seed, same episode; the expert reads the truth");

    let outcome = genmanip(folder.path(), &["report", "run"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let html = fs::read_to_string(folder.path().join("run/report.html")).unwrap();
    assert!(html.len() < 15 << 20, "{} bytes", html.len());
    for task in QUICK_TASKS {
        assert!(html.contains(task));
    }
    assert!(html.contains("data:image/"));
    let own_words = html.replace("http://www.w3.org/", "");
    for outside in ["http://", "https://", "src=\"/", "<link", "@import", "url(/"] {
        assert!(!own_words.contains(outside), "the report refers to something outside: {outside}");
    }
}

/// Every episode has a page that opens without a server; what is there is not made again, and what is missing comes back.
#[test]
fn a_full_report_makes_every_page_once() {
    let folder = copy_of_finished_run();
    let full = |workers: &str| {
        let outcome = genmanip(folder.path(), &["report", "run", "--full", "--workers", workers]);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome.stderr
    };
    let report = folder.path().join("run/report");
    assert!(full("2").contains("2 pages, 2 of them made now"));
    let (whole, written) = (tree(&report), times(&report));
    let index = String::from_utf8(whole["index.html"].clone()).unwrap();
    for id in ["021_spatial-000", "024_appearance-000"] {
        assert!(index.contains(&format!("href=\"episodes/{id}.html\"")), "no link to {id}");
        let page = String::from_utf8(whole[&format!("episodes/{id}.html")].clone()).unwrap();
        let picture = page.split("src=\"../").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
        assert!(whole[picture].starts_with(&[0xff, 0xd8]), "{picture} is no JPEG");
        assert!(page.contains("href=\"../index.html#episodes\"") && page.matches("<svg").count() == 2);
    }
    assert!(full("1").contains("2 pages, 0 of them made now"));
    assert_eq!(tree(&report), whole);
    let again = times(&report);
    assert!(again.iter().filter(|(name, _)| name.contains('/')).all(|(name, time)| written[name] == *time));
    // As after a kill: a page without its entry, an entry without its page, half a line.
    fs::remove_file(report.join("episodes/021_spatial-000.html")).unwrap();
    let list = String::from_utf8(whole["made.jsonl"].clone()).unwrap();
    fs::write(report.join("made.jsonl"), &list[..list.len() - 20]).unwrap();
    fs::write(report.join("pictures/0123.jpg"), b"of an episode that is gone").unwrap();
    assert!(full("2").contains("2 of them made now"));
    assert_same_tree(&tree(&report), &whole);
}

/// Scenario files without a run, by other cameras: results, episodes to watch, and a report of them.
#[test]
fn evaluation_of_any_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let scenarios = finished_run().join("scenarios");
    let scenario: Value = serde_json::from_slice(&fs::read(scenarios.join("021_spatial-000.json")).unwrap()).unwrap();
    let cameras = scenario.get("cameras").or_else(|| scenario["world"].get("cameras")).unwrap();
    fs::write(here.join("mine.json"), serde_json::to_string(cameras).unwrap()).unwrap();
    let scenarios = scenarios.to_str().unwrap();
    let ask = |more: &[&str]| {
        let still = ["evaluate", scenarios, "--policy", "do_nothing:seconds=0.5", "--json"];
        genmanip(here, &[&still[..], more].concat())
    };
    let printed = ask(&[]).json(0);
    assert_eq!(printed[0]["results"].as_array().unwrap().len(), QUICK_TASKS.len());
    assert_eq!(tree(here).len(), 1, "nothing is written without --out");

    let kept = ask(&["--out", "out", "--cameras", "mine.json"]).json(0);
    let label = "do_nothing_seconds=0.5@mine";
    assert_eq!((&kept[0]["label"], &kept[0]["cameras"]), (&label.into(), &"mine".into()));
    assert_eq!(kept[0]["summary"], printed[0]["summary"], "cameras that nobody looks through change nothing");
    let files = tree(&here.join("out"));
    assert!(files.contains_key(&format!("evaluation/{label}.json")), "{:?}", files.keys());
    assert!(!files.keys().any(|name| name.ends_with("results.jsonl")), "it is finished");
    let episodes = format!("out/evaluation/{label}");
    let rows = genmanip(here, &["replay", "--check", "--json", &episodes]).json(0);
    assert!(rows.as_array().unwrap().iter().all(|row| row["identical"] == true), "{rows}");
    assert_eq!(genmanip(here, &["report", "out"]).code, Some(0));
    let html = fs::read_to_string(here.join("out/report.html")).unwrap();
    assert!(html.contains("data:image/") && html.contains("@mine"), "the kept failures are shown");
    genmanip(here, &["evaluate", scenarios, "--policy", "replay"]).assert_refused(&["nothing was recorded"]);
    genmanip(here, &["evaluate", scenarios, "--keep-episodes"]).assert_refused(&["--out DIR"]);
}

#[test]
fn a_scenario_exports_as_mjcf_to_stdout_or_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = finished_run().join("scenarios/021_spatial-000.json");
    let scenario = scenario.to_str().unwrap();
    let printed = genmanip(folder.path(), &["export", "--mjcf", scenario]);
    assert_eq!(printed.code, Some(0), "{printed:?}");
    assert!(printed.stdout.trim_start().starts_with("<mujoco"), "{}", &printed.stdout[..200]);
    assert!(printed.stdout.trim_end().ends_with("</mujoco>"));
    let written = genmanip(folder.path(), &["export", "--mjcf", scenario, "--out", "scene.xml"]);
    assert_eq!(written.code, Some(0), "{written:?}");
    assert_eq!(fs::read_to_string(folder.path().join("scene.xml")).unwrap().trim_end(), printed.stdout.trim_end());
}

/// A run exported with other actions at another rate: its pictures are drawn for it, its actions played back solve the
/// tasks, and the same call makes the same bytes.
#[test]
fn a_run_exports_with_any_action_and_plays_it_back() {
    let folder = copy_of_finished_run();
    let here = folder.path();
    let export = ["export", "run", "--to", "lerobot", "--action", "ee", "--rotation", "quat", "--rate", "20"];
    let more = ["--cameras", "wrist", "--columns", "boxes,masks"];
    let report = genmanip(here, &[&export[..], &more, &["--json"]].concat()).json(0);
    let dataset = "run/exports/lerobot-ee-quat-20hz-wrist";
    assert_eq!((&report["dataset"], &report["episodes"]), (&dataset.into(), &2.into()));
    let files = tree(&here.join(dataset));
    let json = |name: &str| serde_json::from_slice::<Value>(&files[name]).unwrap();
    let (info, contract) = (json("meta/info.json"), json("meta/action_contract.json"));
    assert_eq!((&info["fps"], &info["features"]["action"]["shape"][0]), (&20.into(), &8.into()));
    assert_eq!(info["features"]["action"]["names"], contract["names"]);
    assert_eq!((&contract["action"]["space"], &contract["rate_hz"]), (&"ee_pose".into(), &20.0.into()));
    assert!(info["features"].get("observation.images.wrist").is_some());
    assert!(info["features"].get("observation.images.static").is_none());
    assert_eq!(info["features"]["sim.box.wrist"]["shape"][0], 64);
    let sibling: Value =
        serde_json::from_slice(&tree(&here.join(format!("{dataset}-depth")))["meta/info.json"]).unwrap();
    assert!(sibling["features"].get("observation.images.wrist_mask").is_some());
    let shown = genmanip(here, &["data", "show", dataset, "--json"]).json(0);
    assert_eq!(shown["dataset"]["findings"], Value::Array(Vec::new()));
    let from_others = ["export", "run", "--to", "zarr", "--source", "transfer,teleop", "--out", "none"];
    genmanip(here, &from_others).assert_refused(&["no episode to export from transfer or teleop", "--source"]);
    let own = ["data", "filter", dataset, "--source", "expert", "--out", "own", "--json"];
    assert_eq!(genmanip(here, &own).json(0)[0]["episodes"], 2);
    let old = genmanip(here, &["export", "run", "--to", "lerobot-v2.1", "--no-images", "--out", "old"]);
    let told = genmanip(here, &["data", "import", "old", "--out", "new", "--json"]).json(0);
    assert_eq!(
        (old.code, &told["imported"]["format"], &told["episodes"]),
        (Some(0), &"lerobot-v2.1".into(), &2.into())
    );
    let back = genmanip(here, &["data", "convert", "new", "--to", "lerobot-v2.1", "--out", "back"]);
    assert_eq!(back.code, Some(0), "{back:?}");
    assert_eq!(genmanip(here, &["data", "check", "new", "old"]).code, Some(1), "the same episodes");
    assert_eq!(genmanip(here, &["data", "check", "back"]).code, Some(0));

    let policy = format!("playback:dataset={dataset}");
    let reports = genmanip(here, &["evaluate", "run", "--policy", &policy, "--json"]).json(0);
    assert_eq!(reports[0]["summary"]["success"]["value"], 1.0, "{}", reports[0]["results"]);
    assert_eq!(reports[0]["oracle"], false);
    // Again: nothing is drawn, and the bytes are the same.
    let again = genmanip(here, &[&export[..], &more].concat());
    assert!(again.code == Some(0) && !again.stderr.contains("drawing"), "{again:?}");
    assert_same_tree(&tree(&here.join(dataset)), &files);

    for (arguments, wanted) in [
        (
            &["export", "run", "--to", "lerobot", "--rotation", "6d"][..],
            &["joints have no rotation", "--action ee"][..],
        ),
        (&["export", "nowhere", "--to", "lerobot"], &["nowhere"]),
        (&["export", "run", "--to", "lerobot", "--cameras", "ceiling", "--rate", "30"], &["unknown camera `ceiling`"]),
        (&["export", "run", "--to", "lerobot", "--out", "run/episodes"], &["no place", "--out"]),
        (&["export", "run", "--to", "paper", "--columns", "boxes"], &["paper has no place for boxes", "--to lerobot"]),
        (&["export", "run", "--to", "zarr", "--columns", "masks"], &["zarr has no place for masks", "--to lerobot"]),
        (&["data", "import", "run", "--out", "x"], &["cannot import run", "meta/info.json"]),
        (&["evaluate", "run", "--policy", "playback:dataset=run"], &["cannot play run back", "lerobot"]),
    ] {
        genmanip(here, arguments).assert_refused(wanted);
    }
    for arguments in [
        &["export", "run"][..],
        &["export", "run", "--mjcf", "--to", "lerobot"],
        &["export", "run", "--mjcf", "--rate", "15"],
        &["export", "run", "--mjcf", "--source", "expert"],
    ] {
        assert_eq!(genmanip(here, arguments).code, Some(2), "{arguments:?}");
    }
}

/// The same episodes in another look: rows stay, pictures do not, and the same call makes the same bytes.
#[test]
fn a_dataset_is_drawn_again_in_another_look() {
    let folder = copy_of_finished_run();
    let here = folder.path();
    let one = genmanip(here, &["data", "filter", "run/dataset", "--where", "kind=spatial", "--out", "one"]);
    assert_eq!(one.code, Some(0), "{one:?}");
    let call = |more: &[&str], out: &str| {
        let rerender = ["data", "rerender", "one", "--cameras", "wrist", "--out", out, "--json"];
        let made = genmanip(here, &[&rerender[..], more].concat()).json(0);
        assert_eq!((&made["dataset"], &made["episodes"]), (&out.into(), &1.into()));
        assert_eq!(genmanip(here, &["data", "check", out, "--replays", "1"]).code, Some(0), "{out}");
        let mut files = tree(&here.join(out));
        // The card tells the name of the dataset.
        assert!(files.remove("README.md").is_some());
        files
    };
    let lights = ["--vary", "light,background"];
    let first = call(&lights, "first");
    assert_same_tree(&call(&[&lights[..], &["--workers", "1"]].concat(), "again"), &first);
    let (second, plain) = (call(&[&lights[..], &["--look", "2"]].concat(), "second"), call(&["--plain"], "plain"));
    let film = "videos/observation.images.wrist/chunk-000/file-000.mp4";
    for (one, other) in [(&first, &second), (&first, &plain), (&second, &plain)] {
        assert_ne!(one[film], other[film]);
    }
    // The usual look is that of the run.
    assert_eq!(plain[film], tree(&here.join("one"))[film]);
    let rows = "data/chunk-000/file-000.parquet";
    assert_eq!((&first[rows], &second[rows]), (&plain[rows], &plain[rows]));
    for (arguments, wanted) in [
        (&["data", "rerender", "one", "--out", "first"][..], &["no place", "--out"][..]),
        (&["data", "rerender", "run", "--out", "x"], &["cannot draw run again", "extras/record"]),
        (&["data", "rerender", "one", "--cameras", "ceiling", "--out", "x"], &["unknown camera `ceiling`"]),
    ] {
        genmanip(here, arguments).assert_refused(wanted);
    }
    let hidden = fs::read_dir(here).unwrap().filter_map(|entry| entry.unwrap().file_name().into_string().ok());
    assert_eq!(hidden.filter(|name| name.ends_with(".drawing")).count(), 0);
}

/// A camera that only some episodes have is refused before any of them is drawn.
#[test]
fn a_camera_that_an_episode_lacks_is_named_before_anything_is_drawn() {
    let folder = copy_of_finished_run();
    let here = folder.path();
    for store in ["run/episodes", "run/dataset/extras/record"] {
        let store = EpisodeStore::open(here.join(store)).unwrap();
        let mut episode = store.read("024_appearance-000").unwrap();
        episode.scenario.world.cameras.retain(|camera| camera.name != "wrist");
        fs::remove_dir_all(store.root().join("024_appearance-000")).unwrap();
        store.write(&episode, &[]).unwrap();
    }
    let before = tree(here);
    for arguments in [
        &["export", "run", "--to", "lerobot", "--cameras", "wrist", "--rate", "30", "--out", "x"][..],
        &["data", "rerender", "run/dataset", "--cameras", "wrist", "--out", "x"],
    ] {
        let wanted = ["episode 024_appearance-000 cannot be drawn", "unknown camera `wrist`", "cameras are overview"];
        genmanip(here, arguments).assert_refused(&wanted);
        assert_same_tree(&tree(here), &before);
        assert!(fs::read_dir(here).unwrap().count() == 1, "only the run is there");
    }
}

/// Another policy acts first, and the dataset says which rows are whose, also merged, exported and drawn again.
#[test]
fn corrections_are_labelled_row_by_row() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let collect = |more: &[&str]| genmanip(here, &collect_quick(&quick_examples(), more));
    let outcome = collect(&["--corrections=do_nothing:seconds=0.2"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert_eq!(genmanip(here, &["data", "check", "run/dataset", "--replays", "1"]).code, Some(0));
    let rerendered = ["data", "rerender", "run/dataset", "--cameras", "wrist", "--out", "again"];
    assert_eq!(genmanip(here, &rerendered).code, Some(0));
    let exported = genmanip(here, &["export", "run", "--to", "lerobot-v2.1", "--rate", "10", "--out", "v21"]);
    assert_eq!(exported.code, Some(0), "{exported:?}");
    for dataset in ["run/dataset", "again", "v21"] {
        let info = fs::read_to_string(here.join(dataset).join("meta/info.json")).unwrap();
        assert!(info.contains("is_correction"), "{dataset}");
    }
    let lines = fs::read_to_string(here.join("v21/meta/episodes.jsonl")).unwrap();
    for line in lines.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        // 0.2 s of nothing, and a second in which it is judged.
        assert_eq!(
            (&line["correction"]["policy"], &line["correction"]["from_step"]),
            (&"do_nothing".into(), &72.into())
        );
    }
    collect(&[]).assert_refused(&["settings.corrects"]);
    for (policy, wanted) in [
        ("--corrections=replay", "policy replay cannot be corrected"),
        ("--corrections=openpi:url=ws://127.0.0.1:9", "127.0.0.1:9"),
    ] {
        genmanip(
            here,
            &[
                &["collect"],
                &quick_examples().iter().map(String::as_str).collect::<Vec<_>>()[..],
                &["--out", "x", "--no-dataset", policy],
            ]
            .concat(),
        )
        .assert_refused(&[wanted]);
    }
}

#[test]
fn a_film_strip_is_a_jpeg() {
    let folder = tempfile::tempdir().unwrap();
    let episode = finished_run().join("episodes/024_appearance-000");
    let outcome = genmanip(folder.path(), &["replay", episode.to_str().unwrap(), "--strip", "strip.jpg"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(fs::read(folder.path().join("strip.jpg")).unwrap().starts_with(&[0xff, 0xd8]));
}

/// Data sets of the finished run, made by the verbs of `data`.
#[test]
fn datasets_are_split_and_merged_again() {
    let folder = copy_of_finished_run();
    let call = |arguments: &[&str]| genmanip(folder.path(), &[&["data"], arguments, &["--json"]].concat());
    let parts = call(&["split", "run/dataset", "--out", "parts", "--fractions", "train=0.5,test=0.5"]).json(0);
    assert_eq!((&parts[0]["episodes"], &parts[1]["episodes"]), (&1.into(), &1.into()), "{parts}");
    let merged = call(&["merge", "parts/train", "parts/test", "--out", "merged"]).json(0);
    assert_eq!(merged[0]["episodes"], 2);
    let spatial = call(&["filter", "merged", "--where", "kind=spatial", "--where", "success=true", "--out", "spatial"]);
    assert_eq!(spatial.json(0)[0]["episodes"], 1);
    assert_eq!(call(&["delete", "merged", "--episodes", "1", "--out", "first"]).json(0)[0]["episodes"], 1);
    for dataset in ["parts/train", "parts/test", "merged", "spatial", "first"] {
        assert_eq!(call(&["check", dataset]).code, Some(0), "{dataset}");
    }
    assert_eq!(call(&["card", "merged"]).json(0)["sentences"], 2);
    assert!(folder.path().join("merged/croissant.json").exists());
    assert_eq!(call(&["check", "merged"]).code, Some(0));
    let replayed = genmanip(folder.path(), &["replay", "--check", "merged/extras/record", "--json"]).json(0);
    assert!(replayed.as_array().unwrap().iter().all(|row| row["identical"] == true), "{replayed}");
    let checked = call(&["check", "merged", "--replays", "2"]).json(0);
    assert_eq!(checked["datasets"][0]["findings"], Value::Array(Vec::new()));
    let shown = genmanip(folder.path(), &["data", "show", "merged", "--html", "merged.html"]);
    assert_eq!(shown.code, Some(0), "{shown:?}");
    let page = fs::read_to_string(folder.path().join("merged.html")).unwrap();
    assert_eq!(page.matches("<img").count(), 8, "four moments of two episodes");
    let refused = |arguments: &[&str], code: i32, wanted: &str| {
        genmanip(folder.path(), &[&["data"], arguments].concat()).assert_ended(code, &[wanted]);
    };
    // Another command than the one that was given, with sound hashes: only simulating it again tells.
    let record = EpisodeStore::open(folder.path().join("spatial/extras/record")).unwrap();
    let mut episode = record.read("021_spatial-000").unwrap();
    episode.frames[30].command[0] += 0.2;
    fs::remove_dir_all(record.root().join("021_spatial-000")).unwrap();
    record.write(&episode, &[]).unwrap();
    assert_eq!(call(&["check", "spatial"]).code, Some(0));
    let found = call(&["check", "spatial", "--replays", "1"]).json(1);
    let found = &found["datasets"][0]["findings"][0];
    assert_eq!((&found["check"], &found["file"]), (&"replay".into(), &"extras/record/021_spatial-000".into()));
    refused(&["merge", "merged", "merged", "--out", "twice"], 1, "each episode only once");
    refused(&["delete", "merged", "--episodes", "7", "--out", "x"], 1, "0 to 1");
    refused(&["delete", "merged", "--episodes", "two", "--out", "x"], 2, "3,7-9");
    refused(&["filter", "merged", "--where", "success", "--out", "x"], 2, "COLUMN=VALUE");
    refused(&["filter", "run", "--where", "success=true", "--out", "x"], 1, "LeRobotDataset v3.0");
    refused(&["card", "run"], 1, "error:");
    refused(&["merge", "spatial", "first", "--out", "merged"], 1, "error:");
}
