//! A person answers a model's questions over HTTP while the one who asked waits.

use genmanip_llm::{ChatModel, ChatRequest, FolderChat, FolderSettings, Image, Message, Part, ReplySchema};
use serde_json::{Value, json};

use crate::client::Studio;

/// As much of an image as the client looks at.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and the rest";

fn asked() -> ChatRequest {
    let parts = [Part::Text("Which number marks the cup?".into()), Part::Image(Image::new(PNG.to_vec()).unwrap())];
    let schema = json!({"type": "object", "properties": {"number": {"type": "integer", "enum": [-1, 1, 2]}}});
    ChatRequest {
        reply_schema: Some(ReplySchema::new("object", schema)),
        ..ChatRequest::new("any", vec![Message::user_parts(parts)])
    }
}

#[test]
fn a_person_answers_in_place_of_a_model() {
    let studio = Studio::new();
    let list = || studio.get("/api/questions").json();
    assert_eq!(list()["questions"], json!([]));
    let folder = studio.folder.path().join("questions");
    let settings =
        FolderSettings { folder: folder.clone(), timeout_s: 20.0, poll_s: 0.01, ..FolderSettings::default() };
    let reply = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| FolderChat::new(settings).unwrap().chat(&asked()));
        while list()["questions"] == json!([]) {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert_eq!(list()["questions"], json!([{"name": "001", "is_answered": false, "duration_s": null}]));
        let shown = studio.get("/api/questions/001").json();
        assert_eq!(shown["answer"], Value::Null);
        assert_eq!(shown["question"]["messages"][0]["parts"][1], json!({"image": "picture_1.png"}));
        assert_eq!(studio.get("/api/questions/001/images/picture_1.png").body, PNG);
        for (path, status) in [
            ("/api/questions/002", 404),
            ("/api/questions/x01", 404),
            ("/api/questions/..%2f", 404),
            ("/api/questions/001/images/question.json", 404),
            ("/api/questions/001/images/..%2f001%2fpicture_1.png", 404),
        ] {
            assert_eq!(studio.get(path).status, status, "{path}");
        }
        let said = |answer: Value, duration_s: f64| {
            let body =
                json!({"answer": answer, "author": "ada", "duration_s": duration_s, "at": "2026-01-01T00:00:00Z"});
            studio.post("/api/questions/001/answer", &body).status
        };
        assert_eq!((said(json!(" "), 1.0), said(json!({"number": 2}), -1.0)), (422, 422));
        assert_eq!(said(json!({"number": 2}), 7.5), 200);
        assert_eq!(said(json!({"number": 1}), 1.0), 409, "answers are never replaced");
        waiting.join().unwrap()
    });
    let answer: Value = serde_json::from_str(&reply.unwrap().text).unwrap();
    assert_eq!(answer, json!({"number": 2}));
    assert_eq!(list()["questions"], json!([{"name": "001", "is_answered": true, "duration_s": 7.5}]));
    // A damaged question is named, the others stay.
    std::fs::create_dir_all(folder.join("002")).unwrap();
    std::fs::write(folder.join("002/question.json"), "{").unwrap();
    let damaged = studio.get("/api/questions/002");
    assert_eq!(damaged.status, 422);
    assert!(damaged.json()["error"]["message"].as_str().unwrap().starts_with("question 002 cannot be read"));
}
