//! A policy on a simulated arm in another process.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use genmanip_remote_policies::fake::{self, Answer};

use crate::{PROGRAM, REPOSITORY, genmanip};

/// Simulated arm; killed at the end of the test.
struct Simulated {
    child: Child,
    url: String,
}

impl Simulated {
    fn start(options: &[&str]) -> Self {
        let mut command = Command::new(PROGRAM);
        command.args(["real", "simulate", "--address", "127.0.0.1:0"]).args(options).stderr(Stdio::piped());
        let mut child = command.stdin(Stdio::null()).spawn().unwrap();
        let said = BufReader::new(child.stderr.take().unwrap());
        let (mut lines, mut url) = (said.lines(), String::new());
        while url.is_empty() {
            let line = lines.next().unwrap().unwrap();
            url = line.split_whitespace().find(|word| word.starts_with("tcp://")).unwrap_or_default().to_owned();
        }
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, url }
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

#[test]
fn a_policy_runs_on_an_arm_in_another_process_and_is_recorded() {
    let arm = Simulated::start(&["--latency-ms", "10", "--jitter-ms", "5"]);
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let run = |more: &[&str]| {
        let mut arguments = vec!["real", "run", "--policy", "do_nothing", "--robot", &arm.url, "--horizon", "1"];
        arguments.extend_from_slice(more);
        genmanip(here, &arguments)
    };
    let dry = run(&["--dry-run", "--json"]).json(0);
    assert_eq!((dry["commands"].as_u64(), dry["beyond_limits"].as_u64()), (Some(60), Some(0)), "{dry}");
    let result = run(&["--out", "run", "--success", "yes", "--notes", "as expected", "--json"]).json(0);
    assert_eq!((result["id"].as_str(), result["success"].as_bool()), (Some("real-0000"), Some(true)), "{result}");
    let facts = std::fs::read_to_string(here.join("run/episodes/real-0000/real.json")).unwrap();
    assert!(facts.contains("\"robot\": \"panda\"") && facts.contains("as expected"), "{facts}");
    assert!(here.join("run/episodes/real-0000/images_15hz/static.h264").is_file());
    let second = run(&["--out", "run", "--fps", "0", "--slow", "--json"]).json(0);
    assert_eq!((second["id"].as_str(), second["success"].as_bool()), (Some("real-0001"), Some(false)), "{second}");
    assert!(second["failures"][0]["evidence"].as_str().unwrap().contains("nobody judged"), "{second}");
    run(&["--out", "run", "--instruction", "another task"]).assert_refused(&["run"]);
    genmanip(here, &["real", "simulate", "--address", "0.0.0.0:0"]).assert_refused(&["0.0.0.0:0", "--allow-others"]);
    // The existing exporters read what was recorded; what was not cannot be drawn.
    let exported = genmanip(here, &["export", "run", "--to", "mcap", "--json"]).json(0);
    assert!(here.join("run/exports").is_dir(), "{exported}");
    genmanip(here, &["export", "run", "--to", "mcap", "--rate", "30"]).assert_refused(&["real arm", "--rate"]);
    run(&["--workspace", "1,2,3"]).assert_ended(2, &["X1,Y1,Z1"]);
    genmanip(here, &["real", "run", "--policy", "expert", "--robot", &arm.url]).assert_refused(&["simulator truth"]);
    let nowhere = ["real", "run", "--policy", "do_nothing", "--robot", "tcp://127.0.0.1:9"];
    genmanip(here, &nowhere).assert_refused(&["cannot be reached", "genmanip real simulate"]);
}

/// A policy server in a third process' stead: chunks are asked ahead by default and the arm never waits; with
/// `--no-ahead` they are not. The goal is judged by the images of the simulated cameras: nothing was moved.
#[test]
fn chunks_are_asked_ahead_and_the_goal_is_judged_by_points() {
    let address = fake::start(|question| {
        std::thread::sleep(Duration::from_millis(50));
        let joints = question.array("observation/joint_position").unwrap().reals();
        let from: Vec<f32> = joints.iter().map(|position| *position as f32).collect();
        // The first joint turns at 0.1 rad/s.
        let row = |action: u8| [&[from[0] + 0.1 * f32::from(action + 1) / 15.0], &from[1..7], &[0.0]].concat();
        Answer::Actions((0..10).map(row).collect())
    });
    let policy = format!("openpi:url=ws://{},preset=droid_jointpos", address.unwrap());
    let scenario = format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/015_spatial-000.json");
    let scenario = scenario.as_str();
    let arm = Simulated::start(&[scenario, "--latency-ms", "10", "--jitter-ms", "5"]);
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let run = |name: &str, more: &[&str]| {
        let mut arguments = vec!["real", "run", "--policy", &policy, "--robot", &arm.url, "--horizon", "4"];
        arguments.extend_from_slice(&["--scenario", scenario, "--fps", "0", "--out", name, "--json"]);
        arguments.extend_from_slice(more);
        let result = genmanip(here, &arguments).json(0);
        let facts = std::fs::read(here.join(name).join("episodes/real-0000/real.json")).unwrap();
        (result, serde_json::from_slice::<serde_json::Value>(&facts).unwrap())
    };
    let (result, facts) = run("judged", &["--judge", "points"]);
    let chunks = &facts["chunks"];
    assert!(chunks["joined"].as_u64() >= Some(3) && chunks["holds"].as_u64() == Some(0), "{chunks}");
    assert_eq!(facts["tally"]["arm_stops"].as_u64(), Some(0), "{facts}");
    let points = &facts["points"];
    let is_empty = |key: &str| points[key].as_array().is_some_and(Vec::is_empty);
    assert!(is_empty("moved") && is_empty("not_laid_out"), "{points}");
    assert_eq!((points["verdict"]["success"].as_bool(), result["success"].as_bool()), (Some(false), Some(false)));
    assert!(result["cloud"].is_object(), "{result}");
    let (_, facts) = run("waiting", &["--no-ahead"]);
    assert!(facts["chunks"].is_null() && facts["points"].is_null(), "{facts}");
    assert!(facts["tally"]["commands"].as_u64() > Some(100), "{facts}");
}
