//! Hostile users and broken disks: one clear error, nothing outside changed, and no waiting.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::{
    Outcome, PROGRAM, QUICK, QUICK_TASKS, assert_same_tree, collect_quick, copy_of_finished_run, either_program,
    example, finished_run, genmanip, program, quick_examples, tree, without_timings,
};

/// A shell command in a folder, `$G` being the program.
fn shell(folder: &Path, command: &str) -> Outcome {
    let output = Command::new("sh").args(["-c", command]).env("G", PROGRAM).current_dir(folder).output().unwrap();
    output.into()
}

/// `collect` of the quick tasks into `run` again.
fn collect_again(folder: &Path, more: &[&str]) -> Outcome {
    let examples = quick_examples();
    genmanip(folder, &collect_quick(&examples, more))
}

#[test]
fn what_no_run_made_is_never_replaced() {
    // A data set of the user's own beside no run.
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join("run/dataset/meta");
    fs::create_dir_all(&own).unwrap();
    fs::write(own.join("info.json"), "{\"mine\": true}").unwrap();
    let before = tree(folder.path());
    collect_again(folder.path(), &[]).assert_refused(&["holds `dataset`, but no run.json", "hint:"]);
    assert_same_tree(&tree(folder.path()), &before);
    // One put into a run afterwards.
    for name in ["dataset", "dataset-depth"] {
        let folder = copy_of_finished_run();
        let dataset = folder.path().join("run").join(name);
        fs::remove_dir_all(&dataset).unwrap();
        fs::create_dir_all(dataset.join("meta")).unwrap();
        fs::write(dataset.join("meta/info.json"), "{\"mine\": true}").unwrap();
        let before = tree(folder.path());
        collect_again(folder.path(), &[]).assert_refused(&["that this run did not write", name, "move it elsewhere"]);
        assert_same_tree(&tree(folder.path()), &before);
    }
}

#[test]
fn lost_output_is_an_error_and_a_closed_pipe_is_none() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = finished_run().join("scenarios/021_spatial-000.json");
    let scenario = scenario.display();
    for (command, hint) in [
        (format!("$G export --mjcf {scenario} > /dev/full"), "is the disk full?"),
        ("$G camera list --json > /dev/full".into(), "is the disk full?"),
        ("$G doctor > /dev/full".into(), "is the disk full?"),
        (format!("$G export --mjcf {scenario} --out /dev/full"), "free some space"),
    ] {
        let outcome = shell(folder.path(), &command);
        assert_eq!(outcome.code, Some(1), "{command}: {outcome:?}");
        assert!(outcome.stderr.contains("cannot write") && outcome.stderr.contains(hint), "{command}: {outcome:?}");
    }
    assert_eq!(shell(folder.path(), "$G --help > /dev/full").code, Some(1));
    // The reader has seen enough.
    let outcome = shell(folder.path(), &format!("$G export --mjcf {scenario} | head -c 10; $G --help | head -n 1"));
    assert_eq!((outcome.code, outcome.stderr.as_str()), (Some(0), ""), "{outcome:?}");
    assert_eq!(tree(folder.path()).len(), 0);
}

/// Both are begun before either has written: one wins, the other says why, and nothing is mixed.
#[test]
fn two_starts_with_other_seeds_never_mix() {
    // `genmanip-lab hostile --races` does this as often as one likes.
    for pair in 0..2 {
        let folder = tempfile::tempdir().unwrap();
        let task = example("024_appearance");
        let start = |seed: String| {
            let arguments = ["collect", &task, "--episodes", "1", "--no-dataset", "--seed", &seed, "--out", "new/run"];
            program(folder.path(), &arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
        };
        let seeds = [2 * pair, 2 * pair + 1];
        let both = seeds.map(|seed| start(seed.to_string()));
        let ended = both.map(|child| child.wait_with_output().unwrap());
        let said = ended.each_ref().map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
        let lost: Vec<usize> = (0..2).filter(|&index| said[index].contains("holds another run (its seed is")).collect();
        assert_eq!(lost.len(), 1, "{said:?}");
        assert_eq!(ended[lost[0]].status.code(), Some(1));
        let record: Value = serde_json::from_slice(&fs::read(folder.path().join("new/run/run.json")).unwrap()).unwrap();
        assert_eq!(record["seed"], seeds[1 - lost[0]], "the winner's record");
        let made = ["collect", &task, "--episodes", "1", "--no-dataset", "--seed"];
        let seed = seeds[1 - lost[0]].to_string();
        let alone = [&made[..], &[&seed, "--out", "alone"]].concat();
        genmanip(folder.path(), &alone);
        let [raced, alone] = ["new/run", "alone"].map(|run| without_timings(tree(&folder.path().join(run))));
        assert_same_tree(&raced, &alone);
    }
}

#[test]
fn two_starts_of_one_run_share_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let examples = quick_examples();
    let arguments = collect_quick(&examples, &["--workers", "1"]);
    let start = || program(folder.path(), &arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    for child in [start(), start()] {
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_same_tree(&without_timings(tree(&folder.path().join("run"))), &without_timings(tree(finished_run())));
}

#[test]
fn links_in_a_run_folder_lead_nowhere() {
    // What a partial file was called once.
    let folder = copy_of_finished_run();
    let (run, outside) = (folder.path().join("run"), folder.path().join("outside"));
    fs::write(&outside, "mine").unwrap();
    symlink(&outside, run.join(".timings.json.partial")).unwrap();
    assert_eq!(collect_again(folder.path(), &[]).code, Some(0));
    assert_eq!(fs::read_to_string(&outside).unwrap(), "mine");
    // Folders of the run that lie elsewhere.
    let elsewhere = folder.path().join("elsewhere");
    for name in ["episodes", "evaluation", "dataset", "exports", "scenarios"] {
        let folder = copy_of_finished_run();
        let inside = folder.path().join("run").join(name);
        fs::create_dir_all(&elsewhere).unwrap();
        let _ = fs::remove_dir_all(&inside);
        symlink(&elsewhere, &inside).unwrap();
        for verb in [&["evaluate", "run", "--policy", "do_nothing"][..], &["report", "run"]] {
            genmanip(folder.path(), verb).assert_refused(&["is a symbolic link", name, "hint:"]);
        }
        collect_again(folder.path(), &[]).assert_refused(&["is a symbolic link", name]);
        assert_eq!(fs::read_dir(&elsewhere).unwrap().count(), 0);
    }
}

/// A camera without pixels divided by zero wherever it was looked through.
#[test]
fn a_camera_without_pixels_is_refused_everywhere() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    let scenario = run.join("scenarios/021_spatial-000.json");
    let mut value: Value = serde_json::from_slice(&fs::read(&scenario).unwrap()).unwrap();
    value["world"]["cameras"][0]["intrinsics"]["width"] = 0.into();
    fs::write(&scenario, value.to_string()).unwrap();
    let scenario = scenario.to_str().unwrap();
    for verb in [
        &["export", "--mjcf", scenario][..],
        &["plan", scenario, "--pick", "orange", "--picture", "x.png"],
        &["evaluate", scenario, "--policy", "do_nothing"],
        &["camera", "preview", scenario, "--out", "x.png"],
    ] {
        genmanip(folder.path(), verb).assert_refused(&["021_spatial-000.json", "cameras[0].intrinsics", "0x"]);
    }
}

/// Flips a byte in the middle of a file.
fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

#[test]
fn one_damaged_episode_is_named_and_the_rest_is_used() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    damage(&run.join("episodes/021_spatial-000/frames.parquet"));
    fs::create_dir(run.join("episodes/notes")).unwrap();

    let outcome = genmanip(folder.path(), &["replay", "--check", "run", "--json"]);
    let rows = outcome.json(1);
    assert!(rows[0]["damaged"].as_str().unwrap().contains("frames.parquet"), "{rows}");
    assert_eq!((&rows[1]["episode"], &rows[1]["identical"]), (&"024_appearance-000".into(), &true.into()));
    assert_eq!(outcome.stderr.matches("notes in the episodes is no episode").count(), 1, "{outcome:?}");

    let outcome = genmanip(folder.path(), &["report", "run"]);
    assert!(outcome.code == Some(0) && outcome.stderr.contains("021_spatial-000 is damaged"), "{outcome:?}");
    let outcome = genmanip(folder.path(), &["evaluate", "run", "--policy", "do_nothing"]);
    assert!(outcome.code == Some(0) && outcome.stderr.contains("notes in the episodes is no episode"), "{outcome:?}");

    // Without being told to mend it, collect leaves it out and says how.
    let outcome = collect_again(folder.path(), &[]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("021_spatial-000 is damaged and left out"), "{outcome:?}");
    assert!(outcome.stderr.contains("--repair"), "{outcome:?}");
    let info: Value = serde_json::from_slice(&fs::read(run.join("dataset/meta/info.json")).unwrap()).unwrap();
    assert_eq!(info["total_episodes"], 1, "the data set holds the rest");
    // Told to, it makes the episode anew, and everything is as it was.
    let outcome = collect_again(folder.path(), &["--repair"]);
    assert!(outcome.code == Some(0) && outcome.stderr.contains("made anew"), "{outcome:?}");
    let set_aside = run.join("damaged/021_spatial-000.0/frames.parquet");
    assert!(set_aside.is_file());
    let outcome = genmanip(folder.path(), &["replay", "--check", "run"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    for unneeded in ["damaged", "evaluation", "episodes/notes"] {
        fs::remove_dir_all(run.join(unneeded)).unwrap();
    }
    fs::remove_file(run.join("report.html")).unwrap();
    assert_same_tree(&without_timings(tree(&run)), &without_timings(tree(finished_run())));
}

#[test]
fn a_damaged_record_spoils_no_verb() {
    let cut: fn(&[u8]) -> Vec<u8> = |_| b"{\"schema\": ".to_vec();
    // The run's index knows an episode by its size, so that this is only noticed when it is read.
    let of_same_size: fn(&[u8]) -> Vec<u8> = |whole| [b"x", &whole[1..]].concat();
    for change in [cut, of_same_size] {
        let folder = copy_of_finished_run();
        let record = folder.path().join("run/episodes/021_spatial-000/episode.json");
        fs::write(&record, change(&fs::read(&record).unwrap())).unwrap();
        for (verb, code) in [
            (&["replay", "--check", "run"][..], 1),
            (&["report", "run"], 0),
            (&["evaluate", "run", "--policy", "do_nothing"], 0),
        ] {
            let outcome = genmanip(folder.path(), verb);
            assert_eq!(outcome.code, Some(code), "{outcome:?}");
            let all = format!("{}{}", outcome.stdout, outcome.stderr);
            assert!(all.contains("021_spatial-000") && all.contains("not JSON"), "{outcome:?}");
        }
        let outcome = collect_again(folder.path(), &["--repair"]);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
    }
}

/// A run of whose episodes none can be used still has its scenarios, and one evaluation does not spoil the report.
#[test]
fn damaged_episodes_leave_the_rest_of_a_run_usable() {
    let folder = copy_of_finished_run();
    let run = folder.path().join("run");
    let keep = ["evaluate", "run", "--policy", "do_nothing:seconds=0.1", "--keep-episodes"];
    assert_eq!(genmanip(folder.path(), &keep).code, Some(0));
    // Nothing tells that the second start has nothing to do.
    let kept = run.join("evaluation/do_nothing_seconds=0.1/episodes");
    fs::write(kept.join("021_spatial-000/episode.json"), "{").unwrap();
    let outcome = genmanip(folder.path(), &keep);
    outcome.assert_refused(&["021_spatial-000/episode.json", "not JSON", "hint: move a kept episode"]);
    fs::remove_dir_all(kept.join("021_spatial-000")).unwrap();
    assert_eq!(genmanip(folder.path(), &keep).code, Some(0));
    fs::write(kept.join("store.json"), "{").unwrap();
    let outcome = genmanip(folder.path(), &["report", "run"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(outcome.stderr.contains("episodes kept by do_nothing_seconds=0.1 are left out"), "{outcome:?}");

    for task in QUICK_TASKS {
        fs::write(run.join(format!("episodes/{task}-000/episode.json")), "{").unwrap();
    }
    let reports = genmanip(folder.path(), &["evaluate", "run", "--policy", "do_nothing:seconds=0.2", "--json"]);
    let reports = reports.json(0);
    assert_eq!(reports[0]["results"].as_array().unwrap().len(), QUICK_TASKS.len(), "on the scenarios");
    assert!(run.join("evaluation/do_nothing_seconds=0.2.json").is_file());
}

/// Inputs that would block for ever, or for a long time.
#[test]
fn nothing_waits_without_a_word() {
    let folder = tempfile::tempdir().unwrap();
    assert!(Command::new("mkfifo").arg(folder.path().join("fifo.json")).status().unwrap().success());
    let (scenario, task) = (finished_run().join("scenarios/021_spatial-000.json"), example("024_appearance"));
    fs::copy(scenario, folder.path().join("scenario.json")).unwrap();
    fs::copy(task, folder.path().join("task.json")).unwrap();
    fs::create_dir(folder.path().join("prompts")).unwrap();
    fs::rename(folder.path().join("fifo.json"), folder.path().join("prompts/request.md")).unwrap();
    symlink("prompts/request.md", folder.path().join("fifo.json")).unwrap();
    symlink("prompts/request.md", folder.path().join("fifo.urdf")).unwrap();
    for verb in [
        "task show fifo.json",
        "task check fifo.json",
        "layout fifo.json --out out",
        "layout task.json --out out --world fifo.json",
        "collect fifo.json --out out",
        "export --mjcf fifo.json",
        "plan fifo.json --to 0.5,0,0.3",
        "evaluate fifo.json --policy do_nothing",
        "evaluate scenario.json --policy do_nothing --cameras fifo.json",
        "world check fifo.json",
        "world show fifo.json",
        "camera list fifo.json",
        "camera preview fifo.json --out x.png",
        "lab motion --problems fifo.json",
        "lab motion --generate easy --robot fifo.urdf",
        "lab relations --cases fifo.json --profile seed",
        "lab fit fifo.json",
        "grasps show 001 --file fifo.json",
        "task new --designer llm --settings fifo.json --out out",
    ] {
        let arguments: Vec<&str> = verb.split(' ').collect();
        either_program(folder.path(), &arguments).assert_refused(&["fifo.", "found a pipe or device", "hint:"]);
    }
    let prompts =
        "[server]\nbase_url = \"http://127.0.0.1:9/v1\"\nmodel = \"m\"\n[generation]\nprompts = \"prompts\"\n";
    fs::write(folder.path().join("settings.toml"), prompts).unwrap();
    let asked = ["task", "new", "--designer", "llm", "--settings", "settings.toml", "--out", "out"];
    genmanip(folder.path(), &asked).assert_refused(&["prompts/request.md", "found a pipe"]);
    // A thousand conditions.
    let mut task = genmanip(folder.path(), &["task", "show", &example("021_spatial"), "--json"]).json(0);
    let atom = task["goal"][0][0].clone();
    task["goal"] = vec![vec![atom; 250]; 4].into();
    fs::write(folder.path().join("many.json"), task.to_string()).unwrap();
    let outcome = genmanip(folder.path(), &["task", "show", "many.json", "--svg", "many.svg"]);
    outcome.assert_refused(&["many.json", "$.goal", "1000", "at most 256"]);
    // As many as are taken.
    let atom = task["goal"][0][0].clone();
    task["goal"] = vec![vec![atom; 64]; 4].into();
    fs::write(folder.path().join("most.json"), task.to_string()).unwrap();
    // Within five seconds of processor time, however busy the machine is.
    let outcome = shell(folder.path(), "ulimit -t 5; exec $G task show most.json --svg most.svg");
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

/// Without further threads from the system, the work is done in the one there is.
#[test]
fn a_shortage_of_threads_is_survived() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let collect = |out: &str| {
        // No thread can have a stack of 2^46 bytes.
        format!(
            "RUST_MIN_STACK=70368744177664 $G collect {task} --episodes 1 --no-dataset --seed 3 --workers 2 --out {out}"
        )
    };
    let outcome = shell(folder.path(), &collect("short"));
    assert!(outcome.code == Some(0) && !outcome.stderr.contains("panicked"), "{outcome:?}");
    // Not even the engine's own; limits hold for others than root only.
    let is_root = shell(folder.path(), "id -u").stdout.trim() == "0";
    let other = if is_root { "setpriv --reuid 65534 --regid 65534 --clear-groups" } else { "" };
    let task = fs::copy(&task, folder.path().join("task.json")).map(|_| "task.json").unwrap();
    let command = format!(
        "chmod 777 .; {other} $G --version || exit 77; {other} sh -c 'ulimit -u 1; exec $G collect {task} --episodes 1 \
         --no-dataset --seed 3 --workers 2 --out none'"
    );
    let outcome = shell(folder.path(), &command);
    // 77: another user cannot start the program from here.
    assert!(matches!(outcome.code, Some(0 | 77)), "{outcome:?}");
}

/// A memory limit stops an attempt; nothing of it is kept as a verdict.
#[test]
fn a_shortage_of_memory_is_never_a_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let collect = ["collect", &task, "--episodes", QUICK[1], "--no-dataset", "--seed", "3", "--workers", "1", "--out"];
    genmanip(folder.path(), &[&collect[..], &["alone"]].concat());
    let whole = without_timings(tree(&folder.path().join("alone")));
    for mib in [130, 160, 210, 280] {
        let out = format!("run{mib}");
        let command = format!("ulimit -v {}; exec $G {} {out}", mib << 10, collect.join(" "));
        let limited = shell(folder.path(), &command);
        // A program that could not even start has left nothing.
        let kept = Some(folder.path().join(&out)).filter(|run| run.exists()).map(|run| tree(&run)).unwrap_or_default();
        for (name, bytes) in kept.iter().filter(|(name, _)| name.ends_with("episode.json")) {
            let record: Value = serde_json::from_slice(bytes).unwrap();
            assert_eq!(record["result"]["success"], true, "{mib} MiB, {name}: {record}\n{}", limited.stderr);
        }
        assert_eq!(genmanip(folder.path(), &[&collect[..], &[&out]].concat()).code, Some(0));
        assert_same_tree(&without_timings(tree(&folder.path().join(&out))), &whole);
    }
}

/// Homes that cannot be written, few open files, and names that are no text.
#[test]
fn odd_surroundings_are_no_trouble() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("024_appearance");
    let collect = format!("$G collect {task} --episodes 1 --no-dataset --seed 3 --workers 2 --out");
    for command in [
        format!("ulimit -n 32; {collect} few"),
        format!("HOME=/proc TMPDIR=/proc {collect} nohome"),
        format!("mkdir \"$(printf 'r\\303')\"; {collect} \"$(printf 'r\\303')\"/run"),
        format!("cp {task} \"$(printf 't\\303.json')\"; $G task show \"$(printf 't\\303.json')\""),
        "$G layout \"$(printf 't\\303.json')\" --out \"$(printf 'l\\303')\"".into(),
    ] {
        let outcome = shell(folder.path(), &command);
        assert_eq!(outcome.code, Some(0), "{command}: {outcome:?}");
    }
}
