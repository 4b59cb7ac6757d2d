//! `genmanip teleop` with a named pipe in place of the hidraw file of a SpaceMouse.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use genmanip_data::EpisodeStore;
use serde_json::Value;

use super::{REPOSITORY, genmanip, program};

/// Scenario with things on a table.
fn scenario() -> String {
    format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/009_appearance-000.json")
}

/// HID report descriptor of a SpaceNavigator, with translation in report 1 and buttons in report 3.
fn descriptor() -> Vec<u8> {
    let text = fs::read_to_string(format!("{REPOSITORY}/crates/teleop/testdata/space_navigator_webhid.json")).unwrap();
    let known: Value = serde_json::from_str(&text).unwrap();
    let digits = known["descriptor"].as_str().unwrap();
    let pair = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).unwrap();
    (0..digits.len()).step_by(2).map(pair).collect()
}

/// Report 1 for a deflection along z of the device, which points down.
fn down(deflection: i16) -> Vec<u8> {
    let [low, high] = deflection.to_le_bytes();
    vec![1, 0, 0, 0, 0, low, high]
}

/// The program with its messages.
struct Driven {
    child: Child,
    lines: Receiver<String>,
}

impl Driven {
    /// Next message that contains the words.
    fn until(&self, words: &str) -> String {
        let mut heard = Vec::new();
        loop {
            let Ok(line) = self.lines.recv_timeout(Duration::from_secs(60)) else {
                panic!("`{words}` was not said: {heard:#?}")
            };
            if line.contains(words) {
                return line;
            }
            heard.push(line);
        }
    }

    fn say(&mut self, letter: &str) {
        let stdin = self.child.stdin.as_mut().unwrap();
        writeln!(stdin, "{letter}").unwrap();
    }
}

#[test]
fn a_space_mouse_behind_a_hidraw_file_drives_a_take_that_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (pipe, described) = (folder.path().join("hidraw9"), folder.path().join("descriptor"));
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    fs::write(&described, descriptor()).unwrap();
    let scenario = scenario();
    let arguments = [
        "teleop",
        &scenario,
        "--device",
        "hidraw9",
        "--descriptor",
        "descriptor",
        "--out",
        "takes",
        "--author",
        "ada",
        "--json",
    ];
    let mut child = program(folder.path(), &arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (sender, lines) = channel();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    std::thread::spawn(move || stderr.lines().map_while(Result::ok).for_each(|line| drop(sender.send(line))));
    let mut driven = Driven { child, lines };
    driven.until("moves the arm");
    let mut mouse = File::options().write(true).open(&pipe).unwrap();
    driven.until("running");
    let mut deflect = |deflection: i16, times: usize| {
        for _ in 0..times {
            mouse.write_all(&down(deflection)).unwrap();
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    deflect(0, 3);
    deflect(-350, 200);
    // Nothing more: the arm holds.
    driven.until("no input");
    deflect(0, 3);
    mouse.write_all(&[3, 1, 0]).unwrap();
    driven.until("gripper closed");
    // Unplugged and plugged in again.
    drop(mouse);
    std::thread::sleep(Duration::from_millis(400));
    let mut mouse = File::options().write(true).open(&pipe).unwrap();
    mouse.write_all(&down(0)).unwrap();
    driven.say("p");
    driven.until("paused");
    driven.say("p");
    driven.until("running");
    driven.say("k");
    let output = driven.child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let store = EpisodeStore::open(folder.path().join(told["store"].as_str().unwrap())).unwrap();
    let id = told["id"].as_str().unwrap();
    let episode = store.read(id).unwrap();
    let height = |index: usize| episode.frames[index].tcp.position.z;
    let last = episode.frames.len() - 1;
    assert!(height(last) > height(0) + 0.1, "{} {}", height(0), height(last));
    let record: Value = serde_json::from_slice(&store.read_attachment(id, "operator.json").unwrap()).unwrap();
    assert_eq!(record["operator"]["name"], "ada");
    assert_eq!(record["devices"][0]["kind"], "space_mouse");
    let events = String::from_utf8(store.read_attachment(id, "operator_events.jsonl").unwrap()).unwrap();
    assert!(events.contains(r#""bytes":"0100000000a2fe""#), "reports are kept byte for byte");
    assert!(events.contains("disconnected"));
}

#[test]
fn files_that_are_no_space_mouse_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("empty"), []).unwrap();
    let scenario = scenario();
    for (device, descriptor, words) in [
        ("none", "empty", "cannot open none"),
        ("empty", "none", "descriptor none"),
        ("empty", "empty", "no SpaceMouse"),
    ] {
        let refused = genmanip(folder.path(), &["teleop", &scenario, "--device", device, "--descriptor", descriptor]);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.stderr.contains(words) && refused.stderr.contains("hint"), "{words}: {}", refused.stderr);
    }
}
