//! An environment on loopback, controlled in MessagePack.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_pipeline::sessions::SceneSource;
use genmanip_remote_policies::numpy::Array;
use genmanip_serve::{Endpoint, EnvEndpoint, ServeSettings, Server, openapi};
use rmpv::Value;
use serde_json::json;

/// Status, and the response as JSON text if it is an error.
fn ask(server: &Server, request: &serde_json::Value, action: Option<Vec<f64>>) -> (u16, Value) {
    let mut body = Vec::new();
    let mut map: Vec<(Value, Value)> =
        request.as_object().unwrap().iter().map(|(key, value)| (key.as_str().into(), packed(value))).collect();
    map.extend(action.map(|action| ("action".into(), Array::vector(action).value())));
    rmpv::encode::write_value(&mut body, &Value::Map(map)).unwrap();
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let head =
        format!("POST /env HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {}\r\n\r\n", body.len());
    stream.write_all(head.as_bytes()).unwrap();
    stream.write_all(&body).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    let status = String::from_utf8_lossy(&bytes[9..12]).parse().unwrap();
    match rmpv::decode::read_value(&mut &bytes[end + 4..]) {
        Ok(value) if status == 200 => (status, value),
        _ => (status, String::from_utf8_lossy(&bytes[end + 4..]).into_owned().into()),
    }
}

fn packed(value: &serde_json::Value) -> Value {
    match value {
        serde_json::Value::String(text) => text.as_str().into(),
        serde_json::Value::Number(number) => number.as_u64().map_or(number.as_f64().unwrap().into(), Value::from),
        serde_json::Value::Array(values) => Value::Array(values.iter().map(packed).collect()),
        serde_json::Value::Object(map) => {
            Value::Map(map.iter().map(|(key, value)| (key.as_str().into(), packed(value))).collect())
        }
        serde_json::Value::Bool(yes) => (*yes).into(),
        serde_json::Value::Null => Value::Nil,
    }
}

fn part<'a>(value: &'a Value, name: &str) -> &'a Value {
    value.as_map().unwrap().iter().find(|(key, _)| key.as_str() == Some(name)).map(|(_, value)| value).unwrap()
}

#[test]
fn a_program_drives_an_environment() {
    let task = PathBuf::from(format!("{}/../../examples/tasks/012_pick_and_place.json", env!("CARGO_MANIFEST_DIR")));
    let endpoint =
        Endpoint::Env(Arc::new(EnvEndpoint::new(Arc::new(SceneSource::of_tasks(&[task], None).unwrap()), 1)));
    let described = openapi(&endpoint).to_string();
    assert!(described.contains("application/msgpack") && described.contains("stop_on_success"), "{described}");
    let address = ([127, 0, 0, 1], 0).into();
    let server = Server::start(endpoint, &ServeSettings { address, max_request_bytes: 10_000, workers: 2 }).unwrap();
    let native = json!({"space": "joint_position", "gripper": {"encoding": "width_m"}});
    let cameras = json!([{"name": "static", "size": [32, 24], "channels": {"rgb": true, "depth": true}}]);
    let open = json!({"ask": "open", "settings": {"action": native, "rate_hz": 60, "cameras": cameras}});
    for (setting, value) in [("rate_hz", json!(7)), ("shaping_discount", json!(2)), ("horizon_s", json!(-1))] {
        let mut wrong = open.clone();
        wrong["settings"][setting] = value;
        let (status, said) = ask(&server, &wrong, None);
        assert!(status == 422 && said.to_string().contains(&format!("`{setting}`")), "{said}");
    }
    let (status, opened) = ask(&server, &open, None);
    assert_eq!(status, 200, "{opened}");
    assert_eq!(part(&opened, "scenes").as_array().unwrap().len(), 1);
    let session = part(&opened, "session").as_u64().unwrap();
    let on = |what: &str, more: serde_json::Value, action| {
        let mut request = json!({"ask": what, "session": session});
        request.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        ask(&server, &request, action)
    };
    let refusals = [
        (open, None, 422, "1 sessions are open"),
        (json!({"ask": "fly", "session": session}), None, 400, "unknown variant `fly`"),
        (json!({"ask": "observe", "session": 9}), None, 422, "there is no session 9"),
        (json!({"ask": "observe", "session": session}), None, 422, "there is no episode"),
        (json!({"ask": "restore", "session": session}), None, 422, "no state was saved"),
        (json!({"ask": "observe"}), None, 400, "missing field `session`"),
        (json!({"ask": "step", "session": session}), Some(vec![f64::NAN; 8]), 400, "expected a finite number"),
        (json!({"ask": "step", "session": session}), Some(vec![0.0; 5000]), 413, "larger than 10000 bytes"),
    ];
    for (request, action, expected, words) in refusals {
        let (status, said) = ask(&server, &request, action);
        assert_eq!(status, expected, "{said}");
        assert!(said.to_string().contains(words), "{said}");
    }

    let (_, begun) = on("reset", json!({"seed": 780_200}), None);
    assert!(part(&begun, "instruction").as_str().is_some_and(|text| !text.is_empty()));
    let seen = part(&begun, "observation");
    let state = Array::read(part(seen, "state")).unwrap().reals();
    assert_eq!(Array::read(part(seen, "tool_target")).unwrap().shape, [7]);
    let image = part(part(seen, "images"), "static");
    assert_eq!(Array::read(part(image, "rgb")).unwrap().shape, [24, 32, 3]);
    assert_eq!(Array::read(part(image, "depth_m")).unwrap().shape, [24, 32]);
    assert_eq!(on("save", json!({}), None).0, 200);
    let moved = |start: f64| {
        let action = state.iter().map(|value| value - start).collect();
        let (status, stepped) = on("step", json!({}), Some(action));
        assert_eq!(status, 200, "{stepped}");
        stepped
    };
    let first = moved(0.001);
    assert_eq!(part(&first, "terminated").as_bool(), Some(false));
    assert_ne!(moved(0.002), first);
    assert_eq!(on("restore", json!({}), None).0, 200);
    assert_eq!(moved(0.001), first, "the same action from the same moment");
    assert!(part(&on("verdict", json!({}), None).1, "verdict").is_map());
    let (_, ended) = on("finish", json!({"policy": "mine"}), None);
    assert_eq!(part(part(&ended, "result"), "policy").as_str(), Some("mine"));
    assert_eq!(on("close", json!({}), None).0, 200);
    assert_eq!(on("close", json!({}), None).0, 422);
}
