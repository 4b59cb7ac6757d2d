//! Runs and evaluations in shards: brought together they are those of one program, byte for byte.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::{assert_same_tree, example, genmanip, program, quick_examples, small_images, tree, without_timings};

/// `collect` of four attempts, two tasks with two each, into a folder.
fn collect<'a>(examples: &'a [String], out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let tasks = examples.iter().map(String::as_str);
    let usual = ["--episodes", "2", "--fps", "10", "--seed", "720001", "--world", small_images(), "--out", out];
    ["collect"].into_iter().chain(tasks).chain(usual).chain(more.iter().copied()).collect()
}

/// Starts a call and kills it as soon as something is there.
fn kill_once_there(folder: &Path, arguments: &[&str], path: &Path) {
    let mut child = program(folder, arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while !path.exists() {
        assert!(child.try_wait().unwrap().is_none() && Instant::now() < deadline, "{} never came", path.display());
        sleep(Duration::from_millis(3));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn three_shards_one_of_them_killed_make_the_run_of_one_program() {
    let folder = tempfile::tempdir().unwrap();
    let (at, examples) = (folder.path(), quick_examples());
    let call = |arguments: &[&str]| genmanip(at, arguments);
    let done = |arguments: &[&str]| {
        let outcome = call(arguments);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome
    };
    // The first has two attempts and dies while it draws the first of them.
    let of_shard = |shard| collect(&examples, "shards", &["--shard", shard, "--workers", "1"]);
    kill_once_there(at, &of_shard("0/3"), &at.join("shards/shard-0-of-3/episodes/021_spatial-000/episode.json"));
    done(&of_shard("1/3"));
    call(&["merge", "shards", "--out", "run"]).assert_refused(&[
        "not all of the run is there: shard 2 of 3; ",
        "024_appearance-001 (shard 0 of 3)",
        "--finish",
    ]);
    assert!(!at.join("run").exists(), "a refused merge leaves something");

    // Two writers of one shard, then the last, which finds its number as in a job of Kubernetes.
    std::thread::scope(|scope| {
        let twins = [0, 1].map(|_| scope.spawn(|| done(&of_shard("0/3"))));
        twins.into_iter().for_each(|twin| drop(twin.join().unwrap()));
    });
    let arguments = of_shard("auto/3");
    let indexed = program(at, &arguments).env("JOB_COMPLETION_INDEX", "2").output().unwrap();
    assert!(indexed.status.success(), "{indexed:?}");
    assert!(!at.join("shards/shard-2-of-3/dataset").exists(), "a dataset is of the whole run");

    done(&["merge", "shards", "--out", "run"]);
    done(&collect(&examples, "straight", &["--workers", "2"]));
    let [merged, straight] = ["run", "straight"].map(|name| without_timings(tree(&at.join(name))));
    assert!(straight.contains_key("dataset/meta/info.json") && straight.contains_key("index.jsonl"));
    assert_same_tree(&merged, &straight);
    // Again it finds all of it there; the run goes on as any other.
    done(&["merge", "shards", "--out", "run"]);
    done(&collect(&examples, "run", &[]));
    assert_same_tree(&without_timings(tree(&at.join("run"))), &straight);

    // Without one shard, the rest is made where all is brought together.
    fs::remove_dir_all(at.join("shards/shard-2-of-3")).unwrap();
    done(&["merge", "shards", "--out", "finished", "--finish"]);
    assert_same_tree(&without_timings(tree(&at.join("finished"))), &straight);

    evaluations(at);
}

/// Shards of an evaluation lie in one run; a call that is no shard gathers them and does the rest.
fn evaluations(at: &Path) {
    let policies = ["--policy", "replay", "--policy", "do_nothing:seconds=1", "--workers", "1"];
    let evaluate = |run: &str, more: &[&str]| {
        let outcome = genmanip(at, &[&["evaluate", run][..], &policies, more].concat());
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome
    };
    for shard in ["0/3", "2/3"] {
        let told = evaluate("run", &["--shard", shard]).stderr;
        assert!(told.contains("gathers all shards"), "{told}");
    }
    let results = |run: &str| {
        let mut files = tree(&at.join(run).join("evaluation"));
        files.retain(|name, _| !name.contains('/'));
        files
    };
    assert!(results("run").is_empty(), "a shard wrote results of the whole");
    let report = genmanip(at, &["report", "run", "--out", "report.html"]);
    assert!(report.stderr.contains("The evaluation replay is not finished: its "), "{report:?}");
    let page = fs::read_to_string(at.join("report.html")).unwrap();
    assert!(page.contains("are listed without a success rate") && !page.contains("evaluated in"), "{page}");
    evaluate("run", &[]);
    evaluate("straight", &[]);
    let renamed = |run: &str| -> std::collections::BTreeMap<String, Vec<u8>> {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap().replace(&format!("\"suite\": \"{run}\""), "");
        results(run).into_iter().map(|(name, bytes)| (name, text(bytes).into_bytes())).collect()
    };
    assert_same_tree(&renamed("run"), &renamed("straight"));
    assert_eq!(results("run").len(), 2);
    assert!(!at.join("run/evaluation/replay").exists(), "what shards left is gathered");
}

/// A job of this machine: its script makes all shards, which are the run, and leaves nothing of the sample.
#[test]
fn a_launched_job_makes_all_shards() {
    let folder = tempfile::tempdir().unwrap();
    let (at, examples) = (folder.path(), quick_examples());
    let mut arguments = vec!["launch", "--local", "--shards", "2", "--", "collect"];
    arguments.extend(examples.iter().map(String::as_str));
    arguments.extend(["--episodes", "1", "--no-dataset", "--seed", "3", "--out", "my shards"]);
    let launched = genmanip(at, &arguments);
    assert_eq!(launched.code, Some(0), "{launched:?}");
    assert!(launched.stderr.contains("core hours"), "{launched:?}");
    let mut left: Vec<_> =
        fs::read_dir(at.join("my shards")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    // The record that both shards share is hidden.
    assert!(left.remove(0).to_string_lossy().ends_with(".run.json"), "{left:?}");
    assert_eq!(left, ["launch.sh", "shard-0-of-2", "shard-1-of-2"]);
    let merged = genmanip(at, &["merge", "my shards", "--out", "run"]);
    assert_eq!(merged.code, Some(0), "{merged:?}");

    let refused = |arguments: &[&str], code: i32, wanted: &str| {
        genmanip(at, &[&["launch"], arguments].concat()).assert_ended(code, &[wanted]);
    };
    let task = &examples[0];
    refused(&["--local", "--shards", "9", "--", "collect", task, "--out", "more"], 1, "9 shards");
    refused(&["--local", "--shards", "1", "--", "replay", "run"], 2, "only `collect`");
    refused(&["--local", "--shards", "1", "--", "collect", task, "--out", "more", "--shard", "0/1"], 2, "--shards and");
    refused(&["--kubernetes", "--shards", "1", "--", "collect", task, "--out", "more"], 1, "an image");
    assert!(!at.join("more").exists());
}

#[test]
fn what_is_no_shard_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let check = |arguments: &[&str], code: i32, wanted: &[&str]| {
        genmanip(folder.path(), arguments).assert_ended(code, wanted);
    };
    let collect = ["collect", &task, "--out", "run", "--shard"];
    check(&[&collect[..], &["3/3"]].concat(), 2, &["there is no shard 3 of 3: they are 0/3 to 2/3"]);
    check(&[&collect[..], &["one"]].concat(), 2, &["expected I/N"]);
    check(&[&collect[..], &["auto"]].concat(), 1, &["neither SLURM_ARRAY_TASK_ID nor", "--shard I/N"]);
    check(&["merge", "missing", "--out", "run"], 1, &["cannot list missing"]);
    check(&["merge", ".", "--out", "run"], 1, &["there is no shard in", "--shard I/N"]);
    check(&["evaluate", &task, "--policy", "do_nothing", "--shard", "0/2"], 1, &["error:"]);
    assert!(!folder.path().join("run").exists());
}
