//! Killed and interrupted runs: what was finished stays, and the end is the same as without the interruption.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::{
    assert_same_tree, collect_quick, copy_of_finished_run, example, finished_run, genmanip, program, quick_examples,
    times, tree, without_timings,
};

/// Waits until something is there; the run must still be going on then.
fn wait_for(run: &mut Child, path: &Path) {
    wait_until(run, &format!("{} was there", path.display()), || path.exists().then_some(()));
}

fn wait_until<T>(run: &mut Child, what: &str, is_so: impl Fn() -> Option<T>) -> T {
    let deadline = Instant::now() + Duration::from_secs(120);
    loop {
        if let Some(found) = is_so() {
            return found;
        }
        assert!(run.try_wait().unwrap().is_none(), "ended before {what}");
        assert!(Instant::now() < deadline, "two minutes before {what}");
        sleep(Duration::from_millis(3));
    }
}

/// Name endings of unfinished files in a folder.
fn mark_of_unfinished(folder: &Path) -> Option<String> {
    let names = fs::read_dir(folder).ok()?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names.filter_map(|name| Some(name[name.find(".partial-")?..].to_owned())).next()
}

fn start(folder: &Path, arguments: &[&str]) -> Child {
    program(folder, arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// SIGKILL while the pictures of the first episode are drawn, and again while those of the second are.
#[test]
fn a_killed_run_continues_and_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (run, examples) = (folder.path().join("run"), quick_examples());
    let arguments = collect_quick(&examples, &["--workers", "1"]);
    let [first, second] = ["021_spatial-000", "024_appearance-000"].map(|id| run.join("episodes").join(id));
    let kill_once_there = |path: &Path| {
        let mut child = start(folder.path(), &arguments);
        wait_for(&mut child, path);
        child.kill().unwrap();
        child.wait().unwrap();
    };

    let mut child = start(folder.path(), &arguments);
    let mark = wait_until(&mut child, "pictures were begun", || mark_of_unfinished(&first));
    child.kill().unwrap();
    child.wait().unwrap();
    let recorded = times(&first);
    assert!(!first.join("images_10hz").exists(), "the kill came too late to test anything");
    // It may as well have been killed while it wrote in one of these.
    for inside in ["scenarios", "evaluation"] {
        fs::create_dir_all(run.join(inside)).unwrap();
        fs::write(run.join(inside).join(format!(".x.json{mark}")), "{").unwrap();
    }

    kill_once_there(&second.join("episode.json"));
    let drawn = times(&first);
    assert!(drawn.contains_key("images_10hz/files.json"));
    assert!(recorded.iter().filter(|(name, _)| !name.contains("partial")).all(|(name, time)| drawn[name] == *time));
    // A reader of the half-finished run sees whole episodes only.
    let rows = genmanip(folder.path(), &["replay", "--check", "run", "--json"]).json(0);
    assert!(rows.as_array().unwrap().iter().all(|row| row["identical"] == true), "{rows}");

    let outcome = genmanip(folder.path(), &arguments);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert_eq!(times(&first), drawn, "a finished episode was written again");
    assert_same_tree(&without_timings(tree(&run)), &without_timings(tree(finished_run())));
}

/// Ctrl-C finishes the attempt under way; the continued run equals one that two workers made in one go.
#[test]
fn an_interrupted_run_says_so_and_continues() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let collect = |out, workers| {
        ["collect", &task, "--episodes", "8", "--no-dataset", "--seed", "3", "--workers", workers, "--out", out]
    };
    let interrupted = collect("interrupted", "1");

    let mut child = start(folder.path(), &interrupted);
    wait_for(&mut child, &folder.path().join("interrupted/episodes/024_appearance-000/episode.json"));
    let sent = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(sent.success());
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("of 8 attempts; start again to continue"), "{said}");
    let finished = times(&folder.path().join("interrupted/episodes"));
    assert!(!folder.path().join("interrupted/episodes/024_appearance-007").exists(), "it did not stop");

    let outcome = genmanip(folder.path(), &interrupted);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let after = times(&folder.path().join("interrupted/episodes"));
    assert!(finished.iter().all(|(name, time)| after[name] == *time), "a finished episode was written again");

    assert_eq!(genmanip(folder.path(), &collect("straight", "2")).code, Some(0));
    let [left, right] = ["interrupted", "straight"].map(|run| without_timings(tree(&folder.path().join(run))));
    assert_same_tree(&left, &right);
    assert!(fs::exists(folder.path().join("straight/episodes/024_appearance-007/frames.parquet")).unwrap());
}

/// The verbs that work through many episodes, each killed at random moments of its work: it continues, with another
/// number of workers, to the bytes of a call in one go.
///
/// `GENMANIP_KILLS=10` kills each ten times instead of twice.
#[test]
#[expect(clippy::print_stdout, reason = "says how many kills came in time")]
fn killed_verbs_continue_to_the_same_bytes() {
    let kills: u32 = std::env::var("GENMANIP_KILLS").map_or(2, |count| count.parse().unwrap());
    let examples = quick_examples();
    let layout = ["layout", &examples[0], &examples[1], "--count", "4", "--seed", "5", "--explain", "--out", "made"];
    let expert =
        ["evaluate", "made", "--policy", "expert", "--policy", "do_nothing", "--keep-episodes", "--out", "run"];
    let report = ["report", "run", "--full"];
    // What each leaves behind, and in which folder.
    for (verb, made) in [(&layout[..], "made"), (&expert, "run"), (&report, "run/report")] {
        let folder = tempfile::tempdir().unwrap();
        let prepared = |name: &str| {
            let into = folder.path().join(name);
            fs::create_dir_all(&into).unwrap();
            if verb[0] == "evaluate" {
                assert_eq!(genmanip(&into, &layout).code, Some(0));
            }
            if verb[0] == "report" {
                copy(finished_run(), &into.join("run"));
            }
            into
        };
        let straight = prepared("straight");
        let since = Instant::now();
        let outcome = genmanip(&straight, &[verb, &["--workers", "2"]].concat());
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        let takes = since.elapsed();
        let expected = without_clock(tree(&straight.join(made)));
        let mut early = 0;
        for kill in 0..kills {
            let killed = prepared(&format!("killed{kill}"));
            // Moments that spread evenly over the work, whatever their number.
            let moment = (f64::from(kill) + 0.5) * 0.618_034 % 1.0;
            let mut child = start(&killed, &[verb, &["--workers", "2"]].concat());
            sleep(takes.mul_f64(moment));
            early += u32::from(child.try_wait().unwrap().is_none());
            child.kill().unwrap();
            child.wait().unwrap();
            let outcome = genmanip(&killed, &[verb, &["--workers", "1"]].concat());
            assert_eq!(outcome.code, Some(0), "{} killed after {moment:.2} of its work: {outcome:?}", verb[0]);
            assert_same_tree(&expected, &without_clock(tree(&killed.join(made))));
            fs::remove_dir_all(killed).unwrap();
        }
        assert!(early > 0, "{}: every kill came too late", verb[0]);
        println!("{}: {kills} of {kills} the same bytes, {early} killed before the end", verb[0]);
    }
}

/// The report of an evaluation that cannot be written, as on a full disk: its results stay, and the next call takes them.
#[test]
fn results_are_kept_until_their_report_is_written() {
    let folder = copy_of_finished_run();
    let evaluation = folder.path().join("run/evaluation");
    let verb = ["evaluate", "run", "--policy", "do_nothing:seconds=0.1"];
    let [report, results] =
        ["do_nothing_seconds=0.1.json", "do_nothing_seconds=0.1/results.jsonl"].map(|it| evaluation.join(it));
    fs::create_dir_all(report.join("in the way")).unwrap();
    genmanip(folder.path(), &verb).assert_refused(&["found a folder", "do_nothing_seconds=0.1.json"]);
    assert_eq!(fs::read_to_string(&results).unwrap().lines().count(), 2, "both episodes");
    fs::remove_dir_all(&report).unwrap();
    assert_eq!(genmanip(folder.path(), &verb).code, Some(0));
    assert!(report.is_file() && !results.exists());
}

fn copy(from: &Path, to: &Path) {
    for (name, bytes) in tree(from) {
        let path = to.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

fn without_clock(mut tree: BTreeMap<String, Vec<u8>>) -> BTreeMap<String, Vec<u8>> {
    tree.remove("timings.json");
    tree
}
