//! New scenarios from a sentence, and worlds with their cameras as files.

use genmanip_core::{Document, World};
use serde_json::{Value, json};

use crate::client::Studio;

#[test]
fn a_sentence_becomes_a_scenario_once_its_words_are_clear() {
    let studio = Studio::new();
    let text = "Put the red mug to the left of the bowl.";
    let asked = studio.post("/api/sentences", &json!({ "text": text })).json();
    let phrases = asked["phrases"].as_array().unwrap();
    let bowl = phrases.iter().find(|phrase| phrase["phrase"] == "bowl").unwrap();
    let candidates = bowl["candidates"].as_array().unwrap();
    assert!(bowl["is_known"] == json!(true) && candidates.len() > 1, "{asked}");
    // Not the one that would come first.
    let chosen = candidates.last().unwrap()["uid"].clone();
    let create = || studio.post("/api/scenarios", &json!({ "text": text, "choices": { "bowl": chosen } }));
    let keys: Vec<String> = (0..2)
        .map(|_| {
            let made = create();
            assert_eq!(made.status, 200, "{}", made.text());
            made.json()["key"].as_str().unwrap().to_owned()
        })
        .collect();
    assert_ne!(keys[0], keys[1], "a second one is another scenario");
    let rows = studio.get("/api/scenarios").json();
    for key in &keys {
        let row = rows.as_array().unwrap().iter().find(|row| row["key"] == json!(key)).unwrap();
        assert_eq!((&row["instruction"], &row["read_only"]), (&json!(text), &json!(false)));
        let scene = studio.get(&format!("/api/scenarios/{key}")).json();
        let uids: Vec<&Value> =
            scene["state"]["objects"].as_array().unwrap().iter().map(|object| &object["uid"]).collect();
        assert!(uids.contains(&&chosen), "{uids:?} lacks {chosen}");
    }
    for text in ["", "how do you do", &"mug ".repeat(200), "put the purple dragon on the plate", "put\u{7} it"] {
        let refused = studio.post("/api/scenarios", &json!({ "text": text }));
        assert_eq!(refused.status, 422, "{text}");
        assert!(!refused.json()["error"]["hint"].as_str().unwrap().is_empty(), "{}", refused.text());
    }
    let unknown = studio.post("/api/sentences", &json!({ "text": "put the purple dragon on the plate" })).json();
    assert_eq!(unknown["phrases"][0]["is_known"], json!(false), "{unknown}");
}

/// Each change of a camera in the page is a command of the log, and the world goes out as a file that the program reads.
#[test]
fn cameras_are_edited_and_the_world_is_a_file() {
    let studio = Studio::new();
    let known = studio.get("/api/cameras").json();
    let (preset, sensor) = (&known["presets"][0], &known["sensors"][0]);
    assert!(preset["name"].is_string() && preset["intrinsics"]["fx"].as_f64().unwrap() > 100.0, "{known}");
    let camera = json!({
        "name": "extra", "mount": "world", "intrinsics": preset["intrinsics"], "sensor": sensor["sensor"],
        "mount_from_camera": { "position_m": [0.5, 0.0, 1.0], "orientation_wxyz": [0, 1, 0, 0] },
    });
    let command = |op: &str, args: Value, base: u64| {
        let body = json!({
            "op": op, "args": args, "base_revision": base, "client_operation_id": format!("c{base}"), "author": "ada",
            "at": "2026-01-01T00:00:00Z",
        });
        studio.post(&studio.scenario_path("/commands"), &body)
    };
    let added = command("camera", json!({ "camera": camera }), 0);
    assert_eq!(added.status, 200, "{}", added.text());
    let image = studio.get(&studio.scenario_path("/images/extra"));
    assert!(image.status == 200 && image.body.starts_with(&[0xff, 0xd8]));
    let file = studio.get(&studio.scenario_path("/world"));
    assert!(file.head.contains("attachment"), "{}", file.head);
    let world = World::from_bytes(&file.body).unwrap();
    assert!(world.camera("extra").is_some_and(|camera| camera.sensor.is_some()));
    let before = World::from_bytes(&studio.get(&studio.scenario_path("/world?revision=0")).body).unwrap();
    assert!(before.camera("extra").is_none());
    let scene = studio.get(&studio.scenario_path("?revision=0")).json();
    assert_eq!(scene["revision"], json!(0));
    assert_eq!(command("remove_camera", json!({ "name": "extra" }), 1).status, 200);
    assert_eq!(World::from_bytes(&studio.get(&studio.scenario_path("/world")).body).unwrap(), before);
    // A camera that sees nothing is refused with the reason.
    let mut flat = camera;
    flat["intrinsics"]["width"] = json!(0);
    assert_eq!(command("camera", json!({ "camera": flat }), 2).status, 422);
}
