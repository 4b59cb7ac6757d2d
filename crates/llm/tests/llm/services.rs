use std::time::Duration;

use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{CassetteMode, CassetteSettings, ChatError, HttpService, RecordedService, Service, ServiceSettings};
use serde_json::json;

/// A client with short timeouts.
fn service(server: &FakeServer) -> HttpService {
    HttpService::new(ServiceSettings {
        url: format!("{}/segment", server.base_url()),
        connect_timeout_s: 2.0,
        total_timeout_s: 0.5,
        max_request_bytes: 1000,
        max_body_bytes: 100_000,
        max_retries: 1,
        first_backoff_s: 0.01,
    })
    .unwrap()
}

fn body(text: &str) -> Behaviour {
    Behaviour::Body("application/json".into(), text.into())
}

#[test]
fn questions_are_posted_and_answers_read() {
    let server = FakeServer::scripted([Behaviour::Status(503, vec![], "{}".into()), body("{\"masks\": []}")]).unwrap();
    assert_eq!(service(&server).ask(&json!({"rgb": "AA=="})).unwrap(), json!({"masks": []}));
    let seen = server.seen();
    assert_eq!(seen.len(), 2, "asked again after 503");
    assert_eq!((seen[1].target.as_str(), &seen[1].body), ("POST /v1/segment", &json!({"rgb": "AA=="})));
}

#[test]
fn bad_servers_give_one_clear_error() {
    let slow = Behaviour::Slow(Duration::from_secs(2), Box::new(body("{}")));
    let status = Behaviour::Status(422, vec![], "{\"detail\": \"no depth\"}".into());
    let cases = [
        (body("<html>"), "expected JSON from "),
        (status, "answered 422: no depth"),
        (Behaviour::Flood { bytes: 300_000, announced: true }, "is larger than 100000 bytes"),
        (Behaviour::Flood { bytes: 300_000, announced: false }, "is larger than 100000 bytes"),
        (Behaviour::CutOff("{\"masks\"".into()), "gave up after 2 requests; the last failure: the response of "),
        (Behaviour::HangUp, "gave up after 2 requests; the last failure: the response of "),
        (slow, "gave up after 2 requests; the last failure: no complete response from "),
    ];
    for (behaviour, expected) in cases {
        let server = FakeServer::scripted([behaviour.clone(), behaviour]).unwrap();
        let error = service(&server).ask(&json!({})).unwrap_err().to_string();
        assert!(error.contains(expected) && error.len() < 300, "{error}");
    }
    let server = FakeServer::scripted([]).unwrap();
    let error = service(&server).ask(&json!("x".repeat(2000))).unwrap_err();
    assert!(matches!(error, ChatError::RequestTooLarge { .. }) && server.seen().is_empty(), "{error}");
    let settings = ServiceSettings::at("127.0.0.1:8091");
    let error = HttpService::new(settings).unwrap_err().to_string();
    assert_eq!(error, "`service.url`: expected an address that begins with http:// or https://");
}

#[test]
fn answers_are_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted([body("{\"grasps\": [[1, 2.5]]}")]).unwrap();
    let cassettes = |mode| CassetteSettings { mode, folder: folder.path().into(), ..CassetteSettings::default() };
    let recording = RecordedService::new(service(&server), cassettes(CassetteMode::Record));
    let answer = recording.ask(&json!({"a": 1, "b": 2})).unwrap();
    assert_eq!(recording.ask(&json!({"b": 2, "a": 1})).unwrap(), answer, "the second time from the folder");
    let replay = RecordedService::replay(folder.path());
    assert_eq!(replay.ask(&json!({"a": 1, "b": 2})).unwrap(), json!({"grasps": [[1, 2.5]]}));
    let missing = replay.ask(&json!({"a": 2})).unwrap_err();
    assert!(matches!(missing, ChatError::CassetteMiss { .. }), "{missing}");
    assert_eq!(server.seen().len(), 1);
}
