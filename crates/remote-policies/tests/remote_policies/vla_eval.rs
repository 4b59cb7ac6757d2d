//! A policy behind vla-eval's protocol, against a server on loopback that speaks it.

use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use genmanip_core::{EpisodeStart, Observation, Policy, PolicyError};
use genmanip_remote_policies::Timeouts;
use genmanip_remote_policies::numpy::{Array, Numbers};
use genmanip_remote_policies::vla_eval::{Preset, VlaEvalPolicy, VlaEvalSettings};
use rmpv::Value;
use tungstenite::{Message, accept};

use super::{observation, robot, start};

/// Messages received by a server, and its responses to observations.
#[derive(Clone)]
struct Script {
    hello: Value,
    answers: Vec<(&'static str, Value)>,
}

fn map(entries: Vec<(&str, Value)>) -> Value {
    Value::Map(entries.into_iter().map(|(key, value)| (key.into(), value)).collect())
}

fn part<'a>(value: &'a Value, name: &str) -> &'a Value {
    value.as_map().unwrap().iter().find(|(key, _)| key.as_str() == Some(name)).map(|(_, value)| value).unwrap()
}

fn actions(shape: &[usize], numbers: Vec<f32>) -> Value {
    let array = Array { shape: shape.to_vec(), numbers: Numbers::F32(numbers) };
    map(vec![("actions", array.value_with_text_keys())])
}

/// Serves connections in sequence and records every message.
fn serve(script: Script) -> (SocketAddr, Arc<Mutex<Vec<Value>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, received) = (listener.local_addr().unwrap(), Arc::new(Mutex::new(Vec::new())));
    let hearing = Arc::clone(&received);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let mut socket = accept(stream).unwrap();
            let mut answers = script.answers.clone().into_iter();
            while let Ok(Message::Binary(bytes)) = socket.read() {
                let message = rmpv::decode::read_value(&mut bytes.as_ref()).unwrap();
                let (kind, seq) = (part(&message, "type").as_str().unwrap().to_owned(), part(&message, "seq").clone());
                hearing.lock().unwrap().push(message);
                let (kind, payload) = match kind.as_str() {
                    "hello" => ("hello", script.hello.clone()),
                    "observation" => match answers.next() {
                        Some(answer) => answer,
                        None => break,
                    },
                    _ => continue,
                };
                let answer =
                    map(vec![("type", kind.into()), ("payload", payload), ("seq", seq), ("timestamp", 1.5.into())]);
                let mut bytes = Vec::new();
                rmpv::encode::write_value(&mut bytes, &answer).unwrap();
                socket.send(Message::binary(bytes)).unwrap();
            }
        }
    });
    (address, received)
}

fn hello(rotation: &str) -> Value {
    let format = |format: &str| map(vec![("name", "x".into()), ("dims", 3.into()), ("format", format.into())]);
    let spec = vec![
        ("position", format("delta_xyz")),
        ("rotation", format(rotation)),
        ("gripper", format("binary_close_positive")),
    ];
    map(vec![("harness_version", "0.8.0".into()), ("protocol_version", 1.into()), ("action_spec", map(spec))])
}

fn policy(address: SocketAddr, preset: Preset) -> VlaEvalPolicy {
    let timeouts = Timeouts { answer: Duration::from_millis(500), ..Timeouts::default() };
    let (exterior, wrist) = ("side".to_owned(), "hand".to_owned());
    VlaEvalPolicy::new(VlaEvalSettings { url: format!("ws://{address}"), preset, exterior, wrist, timeouts }, robot())
}

fn begun(address: SocketAddr, preset: Preset) -> Result<VlaEvalPolicy, PolicyError> {
    let mut policy = policy(address, preset);
    let start: EpisodeStart = start();
    policy.reset(&start).map(|()| policy)
}

#[test]
fn an_episode_is_greeted_begun_asked_and_ended() {
    let one = ("action", actions(&[7], vec![1.0, 0.0, -2.0, 0.0, 0.0, 0.5, -1.0]));
    let (address, received) = serve(Script { hello: hello("axis_angle"), answers: vec![one] });
    let mut policy = begun(address, Preset::Libero).unwrap();
    let seen: Observation = observation();
    let chunk = policy.act(&seen).unwrap();
    // Deltas of at most 5 cm and 0.5 rad.
    assert_eq!(chunk.actions, [[0.05, 0.0, -0.05, 0.0, 0.0, 0.25, -1.0]]);
    assert!(!chunk.finished);
    drop(policy);
    std::thread::sleep(Duration::from_millis(200));
    let received = received.lock().unwrap();
    let kinds: Vec<&str> = received.iter().map(|message| part(message, "type").as_str().unwrap()).collect();
    assert_eq!(kinds, ["hello", "episode_start", "observation", "episode_end"]);
    let numbers: Vec<u64> = received.iter().map(|message| part(message, "seq").as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 2, 3, 4]);
    let shown = part(&received[2], "payload");
    assert_eq!(part(shown, "task_description").as_str(), Some("put it there"));
    assert_eq!(Array::read(part(shown, "states")).unwrap().shape, [8]);
    let images = part(shown, "images");
    let [agent, wrist] = ["agentview", "wrist"].map(|name| Array::read(part(images, name)).unwrap());
    let [side, hand] = ["side", "hand"].map(|name| &seen.images[name]);
    assert_eq!((agent.numbers, wrist.numbers), (Numbers::U8(side.rgb.clone()), Numbers::U8(hand.rgb.clone())));
}

#[test]
fn joint_targets_come_in_chunks() {
    let two = ("action", actions(&[2, 8], (0..16).map(|number| number as f32 / 100.0).collect()));
    let plain = map(vec![("harness_version", "1".into())]);
    let (address, received) = serve(Script { hello: plain, answers: vec![two] });
    let mut policy = begun(address, Preset::Joint).unwrap();
    let chunk = policy.act(&observation()).unwrap();
    assert_eq!((chunk.actions.len(), chunk.actions[1][0]), (2, 0.08));
    let received = received.lock().unwrap();
    let shown = part(&received[2], "payload");
    assert!(part(part(shown, "images"), "side").is_map(), "under the names of their cameras");
}

/// An invalid response ends the episode, which is then not run with a reason.
#[test]
fn what_is_no_answer_is_named() {
    let error = map(vec![("error", "observation_failed: no weights".into())]);
    let cases = [
        ("axis_angle", vec![("error", error)], "an error: observation_failed: no weights"),
        ("axis_angle", vec![("action", actions(&[6], vec![0.0; 6]))], "shape [6], expected [7]"),
        ("axis_angle", vec![("action", actions(&[7], vec![f32::NAN; 7]))], "`actions` with NaN"),
        ("axis_angle", vec![("action", map(vec![]))], "no `actions`"),
        ("axis_angle", vec![("hello", map(vec![]))], "a message `hello`, expected `action`"),
        ("axis_angle", vec![], "the policy server"),
        ("quaternion_xyzw", vec![], "the rotation format of actions is `quaternion_xyzw`, expected `axis_angle`"),
    ];
    for (rotation, answers, expected) in cases {
        let (address, _) = serve(Script { hello: hello(rotation), answers });
        let outcome = begun(address, Preset::Libero).and_then(|mut policy| policy.act(&observation()));
        let Err(PolicyError::Unreachable(what)) = outcome else { panic!("{expected}: {outcome:?}") };
        assert!(what.contains(expected), "{what}");
    }
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    assert!(matches!(begun(nobody, Preset::Libero).err(), Some(PolicyError::Unreachable(_))));
}
