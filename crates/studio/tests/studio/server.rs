//! The studio as its page and other programs use it.

use std::fs;

use genmanip_studio::server::Token;
use serde_json::{Value, json};
use tungstenite::Message;

use crate::client::{Studio, Tab, request, serve, suite_scenario};

#[test]
fn scenes_name_meshes_that_are_there() {
    let studio = Studio::new();
    assert_eq!(studio.get("/api/session").json()["author"], "owner");
    let rows = studio.get("/api/scenarios").json();
    assert_eq!((&rows[0]["key"], &rows[0]["read_only"]), (&json!(studio.key), &json!(false)));
    let answer = studio.get(&studio.scenario_path(""));
    assert!(answer.body.len() < 200_000, "{} bytes", answer.body.len());
    let scene = answer.json();
    let scenario = studio.scenario();
    assert_eq!(scene["state"]["instruction"], json!(scenario.task.instruction));
    assert_eq!(scene["state"]["objects"].as_array().unwrap().len(), scenario.objects.len());
    let links = scene["state"]["objects"].as_array().unwrap().iter().chain([&scene["robot"]]);
    for link in links.flat_map(|body| body["links"].as_array().unwrap()) {
        let mesh = studio.get(link["mesh"].as_str().unwrap());
        assert_eq!(mesh.status, 200);
        assert!(mesh.head.contains("immutable") && mesh.body.starts_with(b"glTF"), "{}", mesh.head);
    }
    for (path, status) in [
        ("/meshes/0123.glb", 404),
        ("/meshes/..%2f..%2fetc", 404),
        ("/api/scenarios/none", 404),
        ("/api/none", 404),
        ("/none.js", 404),
        ("/api/catalogue?limit=x", 400),
    ] {
        assert_eq!(studio.get(path).status, status, "{path}");
    }
    // A browser with a mistyped address is sent to the page.
    let browser = [("accept", "text/html,application/xhtml+xml")];
    for (path, status) in [("/;", 303), ("/scenarios/none", 303), ("/api/none", 404)] {
        assert_eq!(request(studio.server.address(), "GET", path, &browser, &[]).status, status, "{path}");
    }
}

#[test]
fn other_sites_are_refused() {
    let studio = Studio::new();
    let address = studio.server.address();
    let own = format!("http://{address}");
    for (head, status) in [
        (("origin", own.as_str()), 200),
        (("origin", "https://example.org"), 403),
        (("host", "rebound.example.org"), 403),
    ] {
        assert_eq!(request(address, "GET", "/api/session", &[head], &[]).status, status, "{head:?}");
    }
    assert!(Tab::connect(address, "ada", Some(&own)).is_ok());
    assert_eq!(Tab::connect(address, "eve", Some("https://example.org")).err(), Some(403));
}

#[test]
fn others_need_the_token() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = crate::client::place_scenario(folder.path());
    let server = serve(folder.path(), &[file], Some(Token::new("secret")));
    let get = |path: &str, head: &[(&str, &str)]| request(server.address(), "GET", path, head, &[]);
    assert_eq!(get("/api/session", &[]).status, 401);
    assert_eq!(get("/", &[]).status, 401);
    assert_eq!(get("/api/session", &[("authorization", "Bearer wrong")]).status, 401);
    assert_eq!(get("/api/session?token=secre", &[]).status, 401);
    assert_eq!(get("/api/session", &[("authorization", "Bearer secret")]).status, 200);
    assert_eq!(get("/api/session", &[("cookie", "a=b; genmanip_studio=secret")]).status, 200);
    let given = get("/api/session?token=secret", &[]);
    assert!(given.status == 200 && given.head.contains("set-cookie: genmanip_studio=secret"), "{}", given.head);
    assert_eq!(Tab::connect(server.address(), "eve", None).err(), Some(401));
    assert_ne!(Token::random().unwrap().text(), Token::random().unwrap().text());
}

/// Different fields go together, the same field is a conflict with both values, and an author's undo takes back the own
/// command.
#[test]
fn two_editors_see_each_other() {
    let studio = Studio::new();
    let (mut ada, mut bo) = (studio.tab("ada"), studio.tab("bo"));
    ada.find(|message| message["authors"] == json!(["ada", "bo"]));
    let (first, second) = (studio.object(0).1, studio.object(1).1);
    ada.command(&studio.shift(0, 0.001, 0, "a1", "ada"));
    let applied = [ada.next("applied"), bo.next("applied")];
    assert_eq!((&applied[0]["client_operation_id"], &applied[0]["state"]["revision"]), (&json!("a1"), &json!(1)));
    assert_eq!(applied[0]["state"]["objects"], applied[1]["state"]["objects"]);
    assert_eq!((&applied[0]["state"]["can_undo"], &applied[1]["state"]["can_undo"]), (&json!(true), &json!(false)));
    // Given on revision 0, but of another object.
    bo.command(&studio.shift(1, 0.001, 0, "b1", "bo"));
    assert_eq!(bo.next("applied")["state"]["revision"], json!(2));
    bo.command(&studio.shift(0, 0.002, 0, "b2", "bo"));
    let conflict = bo.next("conflict");
    assert_eq!(conflict["client_operation_id"], json!("b2"));
    assert_eq!(conflict["conflict"]["revision"], json!(1));
    assert_ne!(conflict["conflict"]["mine"], conflict["conflict"]["theirs"]);
    // Sent again after a lost answer.
    let log = studio.file.with_extension("edits.jsonl");
    let before = fs::read(&log).unwrap();
    let again = studio.post(&studio.scenario_path("/commands"), &studio.shift(1, 0.0, 0, "b1", "bo"));
    assert_eq!((again.status, &again.json()["state"]["revision"]), (200, &json!(2)));
    assert_eq!(fs::read(&log).unwrap(), before);
    let stamp =
        |author: &str, id: &str| json!({ "author": author, "client_operation_id": id, "at": "2026-01-01T00:00:01Z" });
    let mut undo = stamp("ada", "a2");
    undo["type"] = json!("undo");
    ada.send(&undo);
    let state = ada.find(|message| message["client_operation_id"] == "a2")["state"].clone();
    assert_eq!(state["objects"][0]["pose"], first);
    assert_ne!(state["objects"][1]["pose"], second);
    assert_eq!((&state["can_undo"], &state["can_redo"]), (&json!(false), &json!(true)));
    let undone = studio.post(&studio.scenario_path("/undo"), &stamp("bo", "b3")).json();
    assert_eq!(undone["state"]["objects"][1]["pose"], second);
    assert_eq!(studio.post(&studio.scenario_path("/undo"), &stamp("bo", "b4")).status, 422);
    assert_eq!(fs::read(&studio.file).unwrap(), fs::read(suite_scenario()).unwrap());
    let history = studio.get(&studio.scenario_path("/history")).json();
    let undoes: Vec<&Value> = history.as_array().unwrap().iter().map(|line| &line["undoes"]).collect();
    assert_eq!(undoes, [&Value::Null, &Value::Null, &json!(1), &json!(2)]);
    drop(bo);
    ada.find(|message| message["authors"] == json!(["ada"]));
}

#[test]
fn a_restarted_server_knows_every_edit() {
    let studio = Studio::new();
    let command = studio.shift(0, 0.001, 0, "a1", "ada");
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &command).status, 200);
    let (bytes, studio) = (fs::read(&studio.file).unwrap(), studio.restarted());
    assert_eq!(studio.get("/api/scenarios").json()[0]["revision"], json!(1));
    let again = studio.post(&studio.scenario_path("/commands"), &command);
    assert_eq!((again.status, &again.json()["state"]["revision"]), (200, &json!(1)));
    assert_eq!(fs::read(&studio.file).unwrap(), bytes);
}

#[test]
fn nonsense_is_refused_and_the_server_goes_on() {
    let studio = Studio::new();
    let mut tab = studio.tab("ada");
    let command = studio.shift(0, 0.001, 0, "a1", "ada");
    let unknown =
        json!({ "op": "explode", "args": {}, "base_revision": 0, "client_operation_id": "x", "author": "a", "at": "" });
    for text in ["", "{", "[]", "{\"type\":\"none\"}", "{\"type\":\"preview\",\"objects\":7}", &"[".repeat(100_000)] {
        tab.send_raw(Message::text(text.to_owned())).unwrap();
        assert!(tab.next("refused")["error"]["message"].as_str().unwrap().len() > 5, "{text:.20}");
    }
    tab.send_raw(Message::binary(vec![0, 255])).unwrap();
    tab.next("refused");
    tab.command(&unknown);
    assert_eq!(tab.next("refused")["client_operation_id"], json!("x"));
    for body in [json!(null), json!([]), json!({}), unknown, json!({ "op": "place" })] {
        for what in ["/commands", "/undo", "/repairs", "/snapshots"] {
            assert_eq!(studio.post(&studio.scenario_path(what), &body).status, 422, "{what} {body}");
        }
    }
    let mut far = command.clone();
    far["args"]["objects"][0]["pose"]["orientation_wxyz"] = json!([0, 0, 0, 0]);
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &far).status, 422);
    let huge = json!({ "text": "x".repeat(2 << 20) });
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &huge).status, 422);
    let _ = tab.send_raw(Message::text("x".repeat(2 << 20)));
    assert!(tab.is_closed());
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &command).status, 200);
}

#[test]
fn a_frozen_scenario_is_copied_by_its_first_edit() {
    let folder = tempfile::tempdir().unwrap();
    let parent = suite_scenario();
    let before = fs::read(&parent).unwrap();
    let server = serve(folder.path(), std::slice::from_ref(&parent), None);
    let studio =
        Studio { server, key: parent.file_stem().unwrap().to_str().unwrap().into(), file: parent.clone(), folder };
    assert_eq!(studio.get("/api/scenarios").json()[0]["read_only"], json!(true));
    let mut tab = studio.tab("ada");
    tab.command(&studio.shift(0, 0.001, 0, "a1", "ada"));
    let copy = tab.find(|message| message["type"] == "scene" && message["key"] != json!(studio.key));
    assert_eq!((&copy["parent"], &copy["read_only"]), (&json!(studio.key), &json!(false)));
    assert_eq!(tab.next("applied")["state"]["key"], copy["key"]);
    // Another editor of the parent gets the same copy.
    let second = studio.post(&studio.scenario_path("/commands"), &studio.shift(1, 0.001, 0, "b1", "bo"));
    assert_eq!((&second.json()["state"]["key"], &second.json()["state"]["revision"]), (&copy["key"], &json!(2)));
    assert_eq!(fs::read(&parent).unwrap(), before);
    let file = studio.folder.path().join("out/genmanip-200-rc").join(parent.file_name().unwrap());
    assert!(file.is_file() && file.with_extension("edits.jsonl").is_file());
    assert_eq!(studio.get("/api/scenarios").json().as_array().unwrap().len(), 2);
}

#[test]
fn verdicts_come_for_the_newest_revision() {
    let studio = Studio::new();
    let mut tab = studio.tab("ada");
    tab.find(|message| message["type"] == "verdict" && message["done"] == true && message["revision"] == 0);
    tab.command(&studio.shift(0, 0.001, 0, "a1", "ada"));
    tab.next("applied");
    tab.command(&studio.shift(0, 0.002, 1, "a2", "ada"));
    tab.find(|message| message["client_operation_id"] == "a2");
    let last = tab.find(|message| message["type"] == "verdict" && message["done"] == true && message["revision"] == 2);
    assert_eq!(last["stage"], "goal");
    assert_eq!(studio.get(&studio.scenario_path("/verdict")).json()["revision"], json!(2));
    let (id, pose) = studio.object(0);
    tab.send(&json!({ "type": "preview", "objects": [{ "id": id, "pose": pose }] }));
    let preview = tab.find(|message| message["preview"] == true && message["done"] == true);
    assert_eq!((&preview["stage"], &preview["revision"]), (&json!("collision"), &json!(2)));
    assert_eq!(studio.get(&studio.scenario_path("/history")).json().as_array().unwrap().len(), 2);
}

#[test]
fn cameras_show_shares_and_objects_fall() {
    let studio = Studio::new();
    let image = studio.get(&studio.scenario_path("/images/overview?revision=0"));
    assert!(image.status == 200 && image.body.starts_with(&[0xff, 0xd8]), "{}", image.head);
    let shares = image.head.lines().find_map(|line| line.strip_prefix("x-visible-shares: ")).unwrap();
    let shares: std::collections::BTreeMap<String, f64> = serde_json::from_str(shares).unwrap();
    assert!(!shares.is_empty() && shares.values().all(|share| (0.0..=1.0).contains(share)), "{shares:?}");
    assert!(shares.values().any(|&share| share > 0.9), "{shares:?}");
    assert_eq!(studio.get(&studio.scenario_path("/images/none")).status, 422);
    let (id, pose) = studio.object(0);
    let mut lifted = pose.clone();
    lifted["position_m"][2] = json!(pose["position_m"][2].as_f64().unwrap() + 0.03);
    let dropped =
        studio.post(&studio.scenario_path("/settle"), &json!({ "objects": [{ "id": id, "pose": lifted }] })).json();
    let placed = dropped["args"]["objects"].as_array().unwrap().iter().find(|one| one["id"] == json!(id)).unwrap();
    let height = |pose: &Value| pose["position_m"][2].as_f64().unwrap();
    assert!((height(&placed["pose"]) - height(&pose)).abs() < 0.003, "{dropped}");
    let found = studio.get("/api/catalogue?query=red%20mug&graspable=true&limit=5").json();
    assert!(found.as_array().unwrap().len() <= 5 && found[0]["name"].as_str().unwrap().contains("Mug"), "{found}");
    let thumbnail = studio.get(found[0]["thumbnail"].as_str().unwrap());
    assert!(thumbnail.body.starts_with(&[0xff, 0xd8]));
}

#[test]
fn a_file_changed_outside_stops_editing() {
    let studio = Studio::new();
    let mut tab = studio.tab("ada");
    let first = studio.post(&studio.scenario_path("/commands"), &studio.shift(0, 0.001, 0, "a1", "ada"));
    assert_eq!(first.status, 200);
    let ours = fs::read(&studio.file).unwrap();
    let mut theirs = ours.clone();
    theirs.extend(b"\n");
    fs::write(&studio.file, &theirs).unwrap();
    let command = studio.shift(0, 0.002, 1, "a2", "ada");
    let refused = studio.post(&studio.scenario_path("/commands"), &command);
    assert_eq!(refused.status, 503, "{}", refused.text());
    assert!(tab.next("stopped")["message"].as_str().unwrap().contains("another program"));
    assert_eq!(fs::read(&studio.file).unwrap(), theirs);
    // The command goes through once the file is as it was.
    fs::write(&studio.file, &ours).unwrap();
    assert_eq!(studio.post(&studio.scenario_path("/commands"), &command).status, 200);
}
