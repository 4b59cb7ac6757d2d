//! `collect --verified N` and `collect --cameras`.

use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{assert_same_tree, example, genmanip, program, tree, without_timings};

/// Attempts and verified demonstrations of all tasks.
fn sums(rows: &Value) -> (u64, u64) {
    let sum = |key: &str| rows.as_array().unwrap().iter().map(|row| row[key].as_u64().unwrap()).sum();
    (sum("attempts"), sum("verified"))
}

/// With this seed the first attempt fails, so that the second call needs four attempts for three demonstrations.
#[test]
fn exactly_as_many_are_verified_however_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let [first, second] = ["008_long_horizon", "024_appearance"].map(example);
    let arguments = |out, verified, workers| {
        let run = ["collect", &first, &second, "--seed", "3", "--no-dataset", "--json", "--out", out];
        [&run[..], &["--verified", verified, "--workers", workers]].concat()
    };
    let collect = |out, verified, workers| sums(&genmanip(at, &arguments(out, verified, workers)).json(0));
    assert_eq!(collect("one", "3", "1"), (4, 3));
    assert_eq!(collect("two", "3", "2"), (4, 3));

    assert_eq!(collect("extended", "1", "2"), (2, 1));
    kill_once_there(at, &arguments("extended", "3", "1"), "extended/episodes/008_long_horizon-001/episode.json");
    assert_eq!(collect("extended", "3", "2"), (4, 3));
    let verified = |out: &str| {
        let results =
            tree(&at.join(out).join("episodes")).into_iter().filter(|(name, _)| name.ends_with("episode.json"));
        let is_verified =
            |bytes: Vec<u8>| serde_json::from_slice::<Value>(&bytes).unwrap()["result"]["success"] == true;
        results.filter(|(_, bytes)| is_verified(bytes.clone())).count()
    };
    let one = without_timings(tree(&at.join("one")));
    for out in ["two", "extended"] {
        assert_eq!(verified(out), 3);
        assert_same_tree(&without_timings(tree(&at.join(out))), &one);
    }
    genmanip(at, &arguments("one", "2", "1"))
        .assert_refused(&["3 verified demonstrations already", "at least as many"]);
    assert_same_tree(&without_timings(tree(&at.join("one"))), &one);
}

fn kill_once_there(folder: &Path, arguments: &[&str], path: &str) {
    let mut child = program(folder, arguments).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while !folder.join(path).exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended before {path} was there");
        assert!(Instant::now() < deadline, "two minutes before {path}");
        sleep(Duration::from_millis(3));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Cameras of a world file, a new one among them, are those of the dataset and of exports, each in its own folder.
#[test]
fn cameras_of_a_world_file_reach_the_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let done = |line: &str| {
        let outcome = genmanip(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert_eq!(outcome.code, Some(0), "{line}: {outcome:?}");
    };
    done("world init --out world.toml");
    for camera in ["static", "wrist"] {
        done(&format!("camera set world.toml {camera} --size 64x36"));
    }
    done("camera add world.toml front --preset d435 --size 64x36 --eye 1.6,0,0.9 --target 0.5,0,0");
    let task = example("024_appearance");
    done(&format!("collect {task} --verified 1 --seed 3 --rate 10 --world world.toml --cameras front,wrist --out run"));
    done("export run --to lerobot --rate 10 --cameras front --no-depth");
    done("export run --to lerobot --rate 10 --cameras wrist --no-depth");
    done("export run --to lerobot --rate 10 --no-images");
    let exports = "run/exports/lerobot-joint-10hz";
    let cases = [
        ("run/dataset".to_owned(), &["front", "wrist"][..]),
        (format!("{exports}-front"), &["front"]),
        (format!("{exports}-wrist"), &["wrist"]),
        (format!("{exports}-no_images"), &[]),
    ];
    for (dataset, cameras) in cases {
        let info = fs::read_to_string(folder.path().join(&dataset).join("meta/info.json")).unwrap();
        let info: Value = serde_json::from_str(&info).unwrap();
        let features = info["features"].as_object().unwrap();
        let images: Vec<&str> = features.keys().filter_map(|key| key.strip_prefix("observation.images.")).collect();
        assert_eq!(images, cameras, "{dataset}");
        for camera in cameras {
            let shape = &features[&format!("observation.images.{camera}")]["shape"];
            assert_eq!(*shape, serde_json::json!([36, 64, 3]), "{dataset}");
        }
    }
}
