//! A policy on a simulated arm in another process.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use crate::{PROGRAM, genmanip};

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
