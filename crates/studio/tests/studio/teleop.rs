//! Teleoperation through the socket of a real server: holds, floods, reconnection, and takes that are kept and replay.

use std::sync::Arc;
use std::time::{Duration, Instant};

use genmanip_assets::{Catalogue, panda};
use genmanip_core::Pose;
use genmanip_core::glam::DVec3;
use genmanip_data::EpisodeStore;
use genmanip_rollout::Stage;
use genmanip_studio::teleop::is_replayed;
use genmanip_studio::teleop::session::rollout_settings;
use serde_json::{Value, json};
use tungstenite::Message;

use crate::client::{Studio, Tab};

/// Page of a person at a keyboard.
struct Page {
    tab: Tab,
    sequence: u64,
    /// Newest status.
    status: Value,
    /// Newest state.
    state: Vec<f32>,
    states: usize,
    /// Wall-clock time of the last state that differs from the one before in the arm.
    moved: Instant,
}

impl Page {
    fn open(studio: &Studio) -> Self {
        let tab = Tab::connect_to("/api/teleop", studio.server.address(), "ada", None).unwrap();
        let now = Instant::now();
        let mut page = Self { tab, sequence: 0, status: json!({}), state: Vec::new(), states: 0, moved: now };
        page.tab.send(&json!({ "type": "start", "scenario": studio.key, "author": "ada" }));
        assert_eq!(page.tab.next("started")["scenario"], json!(studio.key));
        page
    }

    /// Sends events.
    fn send(&mut self, events: &Value) {
        self.tab.send(&json!({ "type": "events", "sequence": self.sequence, "sent_ms": 1.0, "events": events }));
        self.sequence += 1;
    }

    fn say(&mut self, command: &str) {
        self.tab.send(&json!({ "type": command }));
    }

    /// Reads messages for a time; sends a sign of life with each state if `is_alive`.
    fn watch(&mut self, time: Duration, is_alive: bool) {
        let start = Instant::now();
        while start.elapsed() < time {
            self.read(is_alive);
        }
    }

    fn read(&mut self, is_alive: bool) {
        match self.tab.read() {
            Message::Text(text) => {
                let message: Value = serde_json::from_str(text.as_str()).unwrap();
                assert_eq!(message["type"], "status", "{message}");
                self.status = message["status"].clone();
            }
            Message::Binary(bytes) => {
                let values = bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap()));
                let state: Vec<f32> = values.collect();
                // The hand is the last link of the arm that moves with it.
                let is_moving = self.state.len() == state.len()
                    && height(&self.state).to_bits() != height(&state).to_bits()
                    && (height(&self.state) - height(&state)).abs() > 5e-4;
                if is_moving {
                    self.moved = Instant::now();
                }
                (self.state, self.states) = (state, self.states + 1);
                if is_alive {
                    self.send(&json!([{ "type": "alive" }]));
                }
            }
            other => panic!("{other:?}"),
        }
    }

    /// A page whose take is running, with a connected keyboard.
    fn with_keyboard(studio: &Studio) -> Self {
        let mut page = Self::open(studio);
        page.until(true, |status| status["phase"] == "running");
        page.send(&json!([keyboard()]));
        page.watch(Duration::from_millis(200), true);
        page
    }

    /// Reads for a simulated time, s, with a sign of life for each state.
    fn simulate(&mut self, time_s: f64) {
        let end_s = self.status["time_s"].as_f64().unwrap() + time_s;
        self.until(true, |status| status["time_s"].as_f64().unwrap() > end_s);
    }

    /// Reads until the status fulfils a condition.
    fn until(&mut self, is_alive: bool, is_meant: impl Fn(&Value) -> bool) {
        let start = Instant::now();
        while !is_meant(&self.status) {
            assert!(start.elapsed() < Duration::from_secs(60), "{}", self.status);
            self.read(is_alive);
        }
    }
}

/// Height of the highest link of the robot's hand: of the link before the fingers.
fn height(state: &[f32]) -> f32 {
    state[2 + 7 * 8 + 2]
}

fn key(code: &str, down: bool) -> Value {
    json!({ "type": "key", "code": code, "down": down })
}

fn keyboard() -> Value {
    json!({ "type": "connected", "device": { "kind": "keyboard" } })
}

#[test]
fn a_take_is_driven_kept_listed_and_replays() {
    let studio = Studio::new();
    let mut page = Page::with_keyboard(&studio);
    let before = height(&page.state);
    page.send(&json!([key("KeyR", true)]));
    let (start, states) = (Instant::now(), page.states);
    page.watch(Duration::from_millis(800), true);
    let rate_hz = (page.states - states) as f64 / start.elapsed().as_secs_f64();
    assert!(rate_hz > 20.0, "{rate_hz} states per second");
    assert!(height(&page.state) > before + 0.03, "{} {}", height(&page.state), before);
    assert!(page.status["held"].is_null(), "{}", page.status);
    // The person lets go of nothing, but the page falls silent.
    let silent = Instant::now();
    page.until(false, |status| status["held"] == "silence");
    assert!(silent.elapsed() < Duration::from_millis(600), "{:?}", silent.elapsed());
    page.watch(Duration::from_millis(500), false);
    let held = page.moved.saturating_duration_since(silent);
    // The measured arm lags behind the command that is held.
    assert!(held < Duration::from_millis(350), "moved {held:?} after the last event");
    // A message again: the device has to be released first.
    page.send(&json!([key("KeyR", false), { "type": "blurred" }]));
    page.say("gripper");
    page.until(true, |status| status["closed"] == true);
    assert!(page.status["conditions"][1].as_u64().unwrap() > 0 && page.status["next"]["text"].is_string());
    page.say("keep");
    page.until(false, |status| status["phase"] == "kept");
    let listed = studio.get(&studio.scenario_path("/episodes")).json();
    let row = &listed[0];
    assert_eq!((&row["policy"], &row["oracle"], &row["recorded"]), (&json!("teleop"), &json!(true), &json!(true)));
    let runs = studio.folder.path().join("out/runs");
    let run = std::fs::read_dir(runs).unwrap().next().unwrap().unwrap().path();
    let store = EpisodeStore::open(run.join("evaluation/teleop/episodes")).unwrap();
    let id = store.ids().unwrap().remove(0);
    let result = serde_json::to_value(store.read_result(&id).unwrap()).unwrap();
    assert_eq!((&result["source"], &result["ending"]), (&json!("teleop"), &json!("finished")), "{result}");
    let stage = Stage::open(Arc::new(studio.scenario()), Catalogue::all(), &panda()).unwrap();
    assert!(is_replayed(&stage, &store, &id, &rollout_settings()).unwrap());
    let record: Value = serde_json::from_slice(&store.read_attachment(&id, "operator.json").unwrap()).unwrap();
    assert_eq!(record["operator"], json!({ "kind": "person", "name": "ada" }));
}

#[test]
fn floods_hold_and_a_cut_socket_pauses_without_replaying_anything() {
    let studio = Studio::new();
    let mut page = Page::with_keyboard(&studio);
    page.send(&json!([key("KeyR", true)]));
    page.watch(Duration::from_millis(300), true);
    assert!(page.status["held"].is_null(), "{}", page.status);
    page.send(&json!(vec![key("KeyR", true); 1000]));
    page.until(true, |status| status["dropped"].as_u64() > Some(0));
    page.watch(Duration::from_millis(300), true);
    let held = height(&page.state);
    page.watch(Duration::from_millis(400), true);
    assert!((height(&page.state) - held).abs() < 0.002, "{held} {}", height(&page.state));
    // Another page cannot take over a scenario that somebody drives.
    let mut other = Tab::connect_to("/api/teleop", studio.server.address(), "bob", None).unwrap();
    other.send(&json!({ "type": "keep" }));
    assert!(other.next("refused")["error"]["hint"].as_str().unwrap().contains("start"));
    other.send(&json!({ "type": "start", "scenario": studio.key }));
    assert!(other.next("refused")["error"]["message"].as_str().unwrap().contains("already"));
    let steps = page.status["steps"].as_u64().unwrap();
    drop(page);
    // The server notices that the connection is gone.
    let start = Instant::now();
    let mut page = loop {
        other.send(&json!({ "type": "start", "scenario": studio.key }));
        let answer = other.find(|message| ["started", "refused"].contains(&message["type"].as_str().unwrap()));
        if answer["type"] == "started" {
            assert_eq!(answer["again"], true);
            let now = Instant::now();
            break Page { tab: other, sequence: 0, status: json!({}), state: Vec::new(), states: 0, moved: now };
        }
        assert!(start.elapsed() < Duration::from_secs(10), "{answer}");
    };
    page.until(false, |status| status["phase"] == "paused");
    let paused = page.status["steps"].as_u64().unwrap();
    assert!(paused - steps < 60, "{steps} {paused}");
    page.say("resume");
    page.send(&json!([keyboard()]));
    page.until(true, |status| status["phase"] == "running" && status["steps"].as_u64() > Some(paused + 30));
    assert_eq!(page.status["held"], json!(null));
    // A second take, then none at all.
    page.say("retry");
    page.until(true, |status| status["take"] == 2);
    page.say("discard");
    page.until(true, |status| status["phase"] == "discarded");
    assert_eq!(studio.get(&studio.scenario_path("/episodes")).json(), json!([]));
}

#[test]
fn other_sites_and_large_or_unknown_messages_are_refused() {
    let studio = Studio::new();
    let refused = Tab::connect_to("/api/teleop", studio.server.address(), "eve", Some("http://evil.example"));
    assert_eq!(refused.err(), Some(403));
    let mut tab = Tab::connect_to("/api/teleop", studio.server.address(), "ada", None).unwrap();
    for message in
        ["{}", "[]", r#"{"type":"start"}"#, r#"{"type":"start","scenario":"none"}"#, r#"{"type":"keep","more":1}"#]
    {
        tab.send_raw(Message::text(message)).unwrap();
        assert!(tab.next("refused")["error"]["message"].is_string(), "{message}");
    }
    let _ = tab.send_raw(Message::text(" ".repeat(1 << 20)));
    assert!(tab.is_closed());
}

/// Store and id of the only take of a studio.
fn stored(studio: &Studio) -> (EpisodeStore, String) {
    let run = std::fs::read_dir(studio.folder.path().join("out/runs")).unwrap().next().unwrap().unwrap().path();
    let store = EpisodeStore::open(run.join("evaluation/teleop/episodes")).unwrap();
    let id = store.ids().unwrap().remove(0);
    (store, id)
}

fn json_of(store: &EpisodeStore, id: &str, name: &str) -> Value {
    serde_json::from_slice(&store.read_attachment(id, name).unwrap()).unwrap()
}

fn replays(studio: &Studio, store: &EpisodeStore, id: &str) -> bool {
    let stage = Stage::open(Arc::new(studio.scenario()), Catalogue::all(), &panda()).unwrap();
    is_replayed(&stage, store, id, &rollout_settings()).unwrap()
}

#[test]
fn going_back_restores_the_state_and_what_was_undone_is_cut_and_said() {
    let studio = Studio::new();
    let mut page = Page::with_keyboard(&studio);
    page.send(&json!([key("KeyR", true)]));
    page.simulate(0.7);
    page.send(&json!([key("KeyR", false)]));
    page.simulate(0.5);
    let (high, rested_s) = (height(&page.state), page.status["time_s"].as_f64().unwrap());
    page.simulate(4.5);
    // Down again: that is undone, and the part before it is not.
    page.send(&json!([key("KeyF", true)]));
    page.simulate(0.8);
    page.send(&json!([key("KeyF", false)]));
    page.simulate(0.3);
    assert!(height(&page.state) < high - 0.03, "{} {high}", height(&page.state));
    let before_s = page.status["time_s"].as_f64().unwrap();
    page.say("back");
    page.until(true, |status| {
        status["phase"] == "paused" && status["undone"][0] == 1 && status["time_s"].as_f64().unwrap() < before_s - 4.0
    });
    let (cut_s, now_s) = (page.status["undone"][1].as_f64().unwrap(), page.status["time_s"].as_f64().unwrap());
    assert!((5.0..5.4).contains(&cut_s), "{cut_s}");
    assert!(now_s > rested_s && now_s + cut_s < before_s + 0.5, "{rested_s} {now_s} {before_s}");
    page.say("resume");
    page.until(true, |status| status["phase"] == "running");
    page.simulate(0.2);
    assert!((height(&page.state) - high).abs() < 1e-3, "{} {high}", height(&page.state));
    page.send(&json!([key("KeyR", true)]));
    page.simulate(0.4);
    assert!(height(&page.state) > high + 0.01, "{} {high}", height(&page.state));
    page.say("keep");
    page.until(true, |status| status["phase"] == "kept");
    let (store, id) = stored(&studio);
    let record = json_of(&store, &id, "operator.json");
    let undone = &record["undone"][0];
    let (from, to) = (undone["from"].as_u64().unwrap(), undone["to"].as_u64().unwrap());
    assert!(to - from >= 300 && undone["events"].as_u64().unwrap() > 10, "{undone}");
    let parts = json!([{ "from": 0, "to": from, "frame": "world" }, { "from": from, "frame": "world" }]);
    assert_eq!(record["in_command"][0], parts[0]);
    assert_eq!(record["in_command"][1]["from"], parts[1]["from"]);
    let text = String::from_utf8(store.read_attachment(&id, "operator_events.jsonl").unwrap()).unwrap();
    let marked: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let cut: Vec<&Value> = marked.iter().filter(|line| line["undone"] == 1).collect();
    assert_eq!(cut.len() as u64, undone["events"].as_u64().unwrap());
    assert!(cut.iter().any(|line| line["event"]["code"] == "KeyF"), "the undone key is still in the file");
    assert!(marked.iter().all(|line| line["event"]["code"] != "KeyF" || line["undone"] == 1));
    let episode = store.read(&id).unwrap();
    assert!(episode.frames.windows(2).all(|pair| pair[1].time_s > pair[0].time_s));
    assert!(replays(&studio, &store, &id));
}

#[test]
fn the_person_takes_over_from_a_policy_hands_back_and_idle_ends_are_cut() {
    let studio = Studio::new();
    let mut page = Page::open(&studio);
    page.until(false, |status| status["phase"] == "running");
    page.send(&json!([keyboard()]));
    // Idle at first; then a policy that the studio does not offer, and one that it does.
    page.simulate(1.5);
    page.tab.send(&json!({ "type": "hand_over", "policy": "python:os:system" }));
    let refused = page.tab.find(|message| message["type"] == "refused");
    assert!(refused["error"]["message"].as_str().unwrap().contains("python"), "{refused}");
    page.tab.send(&json!({ "type": "hand_over", "policy": "expert" }));
    page.until(true, |status| status["policy"] == "expert");
    let handed_s = page.status["time_s"].as_f64().unwrap();
    page.until(true, |status| status["time_s"].as_f64().unwrap() > handed_s + 1.0);
    page.say("take_over");
    page.until(true, |status| status["policy"].is_null());
    page.simulate(0.2);
    page.send(&json!([key("KeyR", true)]));
    let low = height(&page.state);
    page.simulate(0.5);
    page.send(&json!([key("KeyR", false)]));
    assert!(height(&page.state) > low + 0.01, "{low} {}", height(&page.state));
    // A policy that ends leaves the person in command, and pauses.
    page.tab.send(&json!({ "type": "hand_over", "policy": "do_nothing:seconds=1" }));
    page.until(true, |status| status["phase"] == "paused");
    assert!(page.status["note"].as_str().unwrap().contains("has finished"), "{}", page.status);
    assert!(page.status["policy"].is_null());
    page.say("resume");
    page.until(true, |status| status["phase"] == "running" && status["note"].is_null());
    page.simulate(1.5);
    page.tab.send(&json!({ "type": "keep", "trim": true }));
    page.until(true, |status| status["phase"] == "kept");
    let (store, id) = stored(&studio);
    let episode = store.read(&id).unwrap();
    let result = serde_json::to_value(&episode.result).unwrap();
    let record = json_of(&store, &id, "operator.json");
    assert_eq!(result["source"], "correction");
    assert_eq!(result["correction"]["policy"], "expert");
    let stretches = record["in_command"].as_array().unwrap();
    let who: Vec<&Value> = stretches.iter().map(|stretch| &stretch["policy"]).collect();
    assert_eq!(who, [&Value::Null, &json!("expert"), &Value::Null, &json!("do_nothing:seconds=1"), &Value::Null]);
    assert_eq!(result["correction"]["from_step"], stretches[2]["from"]);
    assert!(stretches.windows(2).all(|pair| pair[0]["to"] == pair[1]["from"]), "{stretches:?}");
    // Six idle control steps stay at each end.
    let trimmed: Vec<u64> = record["trimmed"].as_array().unwrap().iter().map(|cut| cut.as_u64().unwrap()).collect();
    assert!(trimmed[0] > 40 && trimmed[1] > 40, "{trimmed:?}");
    assert_eq!(stretches[0]["to"], 6);
    let last = &stretches[4];
    assert!(last["to"].as_u64().unwrap() - last["from"].as_u64().unwrap() <= 7, "{last}");
    // The expert plans, so the arm has moved before the person took over.
    let way_m = |stretch: &Value| {
        let [from, to] = [&stretch["from"], &stretch["to"]].map(|step| step.as_u64().unwrap() as usize);
        episode.frames[from].tcp.position.distance(episode.frames[to - 1].tcp.position)
    };
    assert!(
        way_m(&stretches[1]) > 0.02 && way_m(&stretches[0]) < 1e-3,
        "{} {}",
        way_m(&stretches[1]),
        way_m(&stretches[0])
    );
    assert!(replays(&studio, &store, &id));
}

#[test]
fn a_leader_arm_beside_the_page_is_followed_and_holds_when_it_falls_silent() {
    let studio = Studio::new();
    let mut program = Tab::connect_to("/api/teleop", studio.server.address(), "arm", None).unwrap();
    program.send(&json!({ "type": "join", "scenario": studio.key }));
    assert!(program.next("refused")["error"]["message"].as_str().unwrap().contains("nobody"));
    let mut page = Page::with_keyboard(&studio);
    program.send(&json!({ "type": "join", "scenario": studio.key }));
    assert_eq!(program.next("joined")["scenario"], json!(studio.key));
    let mut other = Tab::connect_to("/api/teleop", studio.server.address(), "arm", None).unwrap();
    other.send(&json!({ "type": "join", "scenario": studio.key }));
    assert!(other.next("refused")["error"]["message"].as_str().unwrap().contains("another program"));
    // The leader is above the robot.
    let mut joints = panda().home.clone();
    joints[3] += 0.3;
    let wanted = panda().tcp_pose(&joints);
    let mut sequence = 0;
    let mut send = |program: &mut Tab, events: Value| {
        program.send(&json!({ "type": "events", "sequence": sequence, "events": events }));
        sequence += 1;
    };
    send(&mut program, json!([{ "type": "connected", "device": { "kind": "leader_arm", "name": "gello" } }]));
    let start_s = page.status["time_s"].as_f64().unwrap();
    let mut ramped = false;
    while page.status["time_s"].as_f64().unwrap() < start_s + 4.0 {
        send(&mut program, json!([{ "type": "joints", "position_rad": joints, "gripper": 1.0 }]));
        page.read(true);
        ramped |= page.status["limits"].to_string().contains("ramp");
    }
    assert!(ramped, "{}", page.status);
    assert_eq!(page.status["limits"], json!([]), "it has caught up");
    let silent = Instant::now();
    page.until(true, |status| status["held"] == "silence");
    assert!(silent.elapsed() < Duration::from_millis(400), "{:?}", silent.elapsed());
    drop(program);
    page.simulate(0.3);
    page.say("keep");
    page.until(true, |status| status["phase"] == "kept");
    let (store, id) = stored(&studio);
    let record = json_of(&store, &id, "operator.json");
    assert_eq!(record["devices"][1], json!({ "kind": "leader_arm", "name": "gello" }));
    let episode = store.read(&id).unwrap();
    let last = episode.frames.last().unwrap().tcp;
    assert!(last.position.distance(wanted.position) < 0.01, "{last:?} {wanted:?}");
    assert!(replays(&studio, &store, &id));
}

#[test]
fn the_tool_goes_to_a_target_unless_it_cannot_and_a_key_stops_it() {
    let studio = Studio::new();
    let mut page = Page::with_keyboard(&studio);
    let tool = |page: &Page| -> Pose { serde_json::from_value(page.status["world_from_tcp"].clone()).unwrap() };
    let go_to = |page: &mut Page, pose: &Pose| page.tab.send(&json!({ "type": "go_to", "pose": pose }));
    let above = |pose: Pose, z: f64| Pose { position: pose.position + DVec3::new(-0.05, 0.12, z), ..pose };
    let start = tool(&page);
    let near = above(start, -0.05);
    go_to(&mut page, &near);
    page.until(true, |status| status["policy"] == "go_to");
    page.until(true, |status| status["policy"].is_null());
    page.simulate(0.3);
    let reached = tool(&page);
    assert!(reached.position.distance(near.position) < 0.003 && reached.angle_to(&near) < 0.02, "{reached:?} {near:?}");
    assert_eq!(page.status["phase"], "running");
    // A key on the way back stops it at once.
    go_to(&mut page, &start);
    page.until(true, |status| status["policy"] == "go_to");
    page.simulate(0.2);
    page.send(&json!([key("KeyW", true), key("KeyW", false)]));
    page.until(true, |status| status["policy"].is_null());
    page.simulate(0.3);
    let stopped = tool(&page);
    assert!(stopped.position.distance(start.position) > 0.02, "{stopped:?} {start:?}");
    page.simulate(0.3);
    assert!(tool(&page).position.distance(stopped.position) < 0.003);
    // Out of reach: it says so and stays.
    go_to(&mut page, &Pose::from_position(DVec3::new(2.0, 0.0, 0.5)));
    page.until(true, |status| status["phase"] == "paused");
    assert!(page.status["note"].as_str().unwrap().contains("out of reach"), "{}", page.status);
    page.tab.send(&json!({ "type": "go_to", "pose": { "position_m": [0, 0, 0], "orientation_wxyz": [2, 0, 0, 0] } }));
    let refused = page.tab.find(|message| message["type"] == "refused");
    assert!(refused["error"]["message"].as_str().unwrap().contains("orientation_wxyz"), "{refused}");
    page.say("resume");
    page.until(true, |status| status["phase"] == "running");
    page.say("keep");
    page.until(true, |status| status["phase"] == "kept");
    let (store, id) = stored(&studio);
    let result = serde_json::to_value(store.read_result(&id).unwrap()).unwrap();
    assert_eq!((&result["source"], &result["correction"]), (&json!("teleop"), &Value::Null), "{result}");
    let record = json_of(&store, &id, "operator.json");
    let by: Vec<&Value> = record["in_command"].as_array().unwrap().iter().map(|stretch| &stretch["policy"]).collect();
    let planned = json!("go_to");
    assert_eq!(by, [&Value::Null, &planned, &Value::Null, &planned, &Value::Null, &Value::Null], "{record}");
    assert!(replays(&studio, &store, &id));
}
