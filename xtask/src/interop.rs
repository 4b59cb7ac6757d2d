//! `cargo xtask test --interop`: published packages of other projects speak with our side of their protocol.

mod environment;
mod lerobot;
mod opencv;
mod usd;

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Ending, Workspace};
use crate::{docs, wheel};
pub use environment::{environment, hashed_environment};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

const SERVER: &str = "crates/remote-policies/testdata/openpi_server.py";
/// Packages of openpi's environment.
const PACKAGES: [&str; 3] = ["openpi-client==0.1.2", "websockets==17.4", "typing-extensions==4.16.0"];
/// Records what openpi's own client and packer say to each other, and what it recorded.
const RECORDER: &str = "crates/remote-policies/testdata/record_conversation.py";
const CONVERSATION: &str = "crates/remote-policies/testdata/openpi_conversation.zlib";
const VLA_EVAL: &str = "python/tests/interop_vla_eval.py";
/// The harness, and what our wheel depends on; apart from openpi's client, whose pins are others.
const VLA_EVAL_PACKAGES: [&str; 2] = ["vla-eval==0.8.0", "numpy==2.3.5"];
/// Until the server listens.
const PATIENCE: Duration = Duration::from_secs(60);

/// Both protocols, one after the other, on one scenario; then calibrations, and a dataset.
pub fn run(workspace: &Workspace) -> Result {
    let place = workspace.target_dir()?.join("interop");
    let scenario = place.join("scenario");
    let _ = fs::remove_dir_all(&scenario);
    fs::create_dir_all(&place).on("make the folder", &place)?;
    let mut layout = workspace.command(workspace.genmanip()?);
    let layout = layout.args(["--quiet", "layout", "examples/tasks/021_spatial.json", "--seed", "1", "--out"]);
    process::output(layout.arg(&scenario))?;
    openpi(workspace, &place, &scenario)?;
    vla_eval(workspace, &place, &scenario)?;
    opencv::run(workspace, &place)?;
    usd::run(workspace, &place)?;
    lerobot::run(workspace, &place)?;
    println!("{}", docs::run(workspace, &[], docs::Blocks::Interop)?);
    Ok(())
}

/// A model server of vla-eval leads our arm, and its orchestrator runs that server on our scenes.
fn vla_eval(workspace: &Workspace, place: &Path, scenario: &Path) -> Result {
    let python = environment(workspace, "python3", &place.join("vla-eval"), &VLA_EVAL_PACKAGES)?;
    wheel::environment(workspace)?;
    wheel::install(workspace, &python, &wheel::build(workspace)?)?;
    let run = place.join("vla-eval-run");
    let _ = fs::remove_dir_all(&run);
    fs::create_dir_all(&run).on("make the folder", &run)?;
    let mut command = workspace.command(&python);
    process::visible(command.arg(VLA_EVAL).arg(workspace.genmanip()?).arg(scenario).arg(&run))
}

/// Evaluates a policy that asks a server made of openpi's own client package.
fn openpi(workspace: &Workspace, place: &Path, scenario: &Path) -> Result {
    let python = environment(workspace, "python3", &place.join("python"), &PACKAGES)?;
    let again = place.join("conversation.zlib");
    process::output(workspace.command(&python).arg(RECORDER).arg(&again))?;
    let read = |path: &Path| fs::read(path).on("read", path);
    if read(&again)? != read(&workspace.root.join(CONVERSATION))? {
        return Err(Problem {
            what: format!("{CONVERSATION} is not what openpi's client says"),
            expected: "the same bytes".into(),
            hint: format!("record it again: python {RECORDER} {CONVERSATION}"),
        });
    }
    let (port, run) = (place.join("port"), place.join("run"));
    let _ = fs::remove_file(&port);
    let _ = fs::remove_dir_all(&run);
    let genmanip = workspace.genmanip()?;
    let told = fs::File::create(place.join("told.jsonl")).on("write", place)?;
    let mut command = workspace.command(&python);
    let server = command.arg(SERVER).arg(&port).stdout(told).stderr(Stdio::inherit()).spawn();
    let _server = Ending(server.map_err(|error| process::cannot_start("python", &error))?);
    let start = Instant::now();
    while !port.exists() && start.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(50));
    }
    let port = fs::read_to_string(&port).on("read", &port)?;
    let mut evaluate = workspace.command(&genmanip);
    let policy = format!("openpi:url=ws://127.0.0.1:{},preset=droid", port.trim());
    evaluate.args(["--quiet", "evaluate"]).arg(scenario).args(["--policy", &policy, "--out"]).arg(&run);
    process::output(&mut evaluate)?;
    let told = fs::read_to_string(place.join("told.jsonl")).on("read", place)?;
    let shown = told.lines().next().unwrap_or_default();
    let wanted =
        ["\"observation/exterior_image_1_left\": {\"shape\": [224, 224, 3], \"dtype\": \"|u1\"", "\"prompt\": \""];
    if let Some(missing) = wanted.into_iter().find(|part| !shown.contains(part)) {
        return Err(Problem {
            what: format!("openpi's client did not read `{missing}`"),
            expected: "pictures, joints and the instruction".into(),
            hint: format!("it read {shown}"),
        });
    }
    println!("openpi-client: {} questions read by the real client, as they were meant", told.lines().count());
    Ok(())
}
