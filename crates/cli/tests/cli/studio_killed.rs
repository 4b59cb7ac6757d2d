//! The studio and `edit` killed at random moments: no acknowledged edit is lost, and every file stays readable.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::mpsc;
use std::thread::{self, sleep};
use std::time::Duration;

use genmanip_core::{Document, Scenario, Seed};
use serde_json::{Value, json};

use crate::serving::Serving;
use crate::{REPOSITORY, genmanip, program};

/// Number of kills of the long test, unless the variable `GENMANIP_KILLS` gives another one.
const KILLS: u64 = 100;
const KEY: &str = "009_appearance-000";
/// Longest time until the kill, ms: of a studio that writes edits, and of a whole call of `edit`.
const UNTIL_KILL_MS: [u64; 2] = [120, 400];

/// A command that moves the can.
fn command(number: u64, base_revision: u64) -> Value {
    let y = -0.2 + 0.0001 * (number % 1000) as f64;
    let pose = json!({"position_m": [0.45, y, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]});
    json!({
        "op": "place", "args": {"objects": [{"id": "020", "pose": pose}]}, "base_revision": base_revision,
        "client_operation_id": format!("kill-{number}"), "author": "ada", "at": "2026-01-01T00:00:00Z",
    })
}

/// Sends a command; the revision if it was acknowledged.
fn send(address: &str, command: &Value) -> Option<u64> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(20))).ok()?;
    let body = command.to_string();
    write!(
        stream,
        "POST /api/scenarios/{KEY}/commands HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\
         content-type: application/json\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    )
    .ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    assert!(head.contains(" 200 "), "{answer}");
    serde_json::from_str::<Value>(body).ok()?["state"]["revision"].as_u64()
}

#[test]
fn a_studio_that_is_killed_loses_no_acknowledged_edit() {
    kill(2);
}

#[test]
#[ignore = "some minutes: cargo xtask test web --long"]
fn a_studio_that_is_killed_often_loses_no_acknowledged_edit() {
    let asked = std::env::var("GENMANIP_KILLS").ok();
    kill(asked.map_or(KILLS, |number| number.parse().expect("a number of kills")));
}

/// Kills the studio and `edit`, each `kills` times.
fn kill(kills: u64) {
    let folder = tempfile::tempdir().unwrap();
    let file = format!("{KEY}.json");
    fs::copy(format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/{file}"), folder.path().join(&file)).unwrap();
    let (mut revision, mut number, mut acknowledged) = (0, 0, Vec::new());
    let moment = |kill: u64, most_ms: u64| Duration::from_millis(Seed::new(1).fork_index(kill).value() % most_ms);
    for kill in 0..kills {
        let mut serving = Serving::start(folder.path(), &["studio", &file, "--no-open", "--port", "0"]);
        let (address, first, base) = (serving.address.clone(), number, revision);
        let (told, heard) = mpsc::channel();
        let sender = thread::spawn(move || {
            let (mut revision, mut number) = (base, first);
            while let Some(now) = send(&address, &command(number, revision)) {
                told.send((number, now)).unwrap();
                (number, revision) = (number + 1, now);
            }
            // The last one may have been applied without an answer.
            number + 1
        });
        // The first acknowledgement shows that it is up.
        let up = heard.recv_timeout(Duration::from_secs(30)).unwrap();
        sleep(moment(kill, UNTIL_KILL_MS[0]));
        serving.kill();
        number = sender.join().unwrap();
        let new: Vec<(u64, u64)> = std::iter::once(up).chain(heard.try_iter()).collect();

        // The same for a call of `edit`, which acknowledges by ending.
        let operation = command(kill, 0);
        let operation = json!({"op": operation["op"], "args": operation["args"]}).to_string();
        let arguments: Vec<&str> = ["edit", &file].into_iter().chain(["--op", &operation].repeat(8)).collect();
        let mut editing = program(folder.path(), &arguments).spawn().unwrap();
        sleep(moment(kills + kill, UNTIL_KILL_MS[1]));
        let _ = editing.kill();
        editing.wait().unwrap();

        let after = genmanip(folder.path(), &["edit", &file, "--history", "--json"]).json(0);
        revision = after["revision"].as_u64().unwrap();
        let lines = after["history"].as_array().unwrap();
        acknowledged.extend(new);
        for (number, at) in &acknowledged {
            let id = json!(format!("kill-{number}"));
            let found: Vec<&Value> = lines.iter().filter(|line| line["client_operation_id"] == id).collect();
            assert_eq!(found.len(), 1, "kill {kill}: edit {number} of revision {at}");
            assert_eq!(found[0]["revision"], json!(at), "kill {kill}");
        }
        let text = fs::read_to_string(folder.path().join(&file)).unwrap();
        Scenario::from_json(&text).unwrap_or_else(|error| panic!("kill {kill}: {error}"));
    }
    assert!(acknowledged.len() as u64 > kills, "{} edits were acknowledged", acknowledged.len());
}
