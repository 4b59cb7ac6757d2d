use std::time::{Duration, Instant};

use genmanip_core::Seed;
use genmanip_llm::fake::{Behaviour, FakeServer, completion};
use genmanip_llm::{ChatError, ChatModel, HttpChat, ServerSettings, Structure};

use crate::{client, impatient, question, structured_question};

fn answer() -> Behaviour {
    Behaviour::Answer("hello".into())
}

fn status(status: u16, headers: &[(&str, &str)], body: &str) -> Behaviour {
    let headers = headers.iter().map(|(name, value)| (String::from(*name), String::from(*value))).collect();
    Behaviour::Status(status, headers, body.into())
}

fn always(behaviour: Behaviour) -> Vec<Behaviour> {
    vec![behaviour; 9]
}

fn slow(seconds: f64) -> Behaviour {
    Behaviour::Slow(Duration::from_secs_f64(seconds), Box::new(answer()))
}

/// Sends a request to a scripted server; returns the text or the error with its causes, and the number of requests.
fn ask(script: Vec<Behaviour>, change: impl Fn(&mut ServerSettings)) -> (Result<String, ChatError>, usize) {
    let server = FakeServer::scripted(script).unwrap();
    let mut settings = impatient(server.base_url());
    change(&mut settings);
    let result = HttpChat::new(settings, None, Seed::new(1)).unwrap().chat(&question("?"));
    (result.map(|reply| reply.text), server.seen().len())
}

fn check(script: Vec<Behaviour>, expected: &str, requests: usize) {
    let shown = format!("{script:.200?}");
    // Short only in timeout tests: other requests may be slow on a busy machine.
    let is_slow = |behaviour: &Behaviour| matches!(behaviour, Behaviour::Slow(..) | Behaviour::Drip { .. });
    let total_timeout_s = if script.iter().any(is_slow) { 0.5 } else { 20.0 };
    let (result, seen) = ask(script, |settings| settings.total_timeout_s = total_timeout_s);
    let got = result.unwrap_or_else(|error| error.to_string());
    assert!(got.contains(expected), "{shown}: expected {expected:?}, got {got:?}");
    assert_eq!(seen, requests, "{shown}");
}

#[test]
fn good_and_bad_servers() {
    let html = "<html><body>Please log in</body></html>";
    let web_page = || Behaviour::Body("text/html".into(), html.into());
    let json = |body: &str| Behaviour::Body("application/json".into(), body.into());
    let half = completion("hello")[..60].to_owned();

    check(vec![answer()], "hello", 1);
    // Transient failures are retried …
    check(vec![status(500, &[], "oops"), answer()], "hello", 2);
    check(vec![status(429, &[("retry-after", "0.1")], "busy"), answer()], "hello", 2);
    check(vec![status(503, &[], ""), status(408, &[], ""), answer()], "hello", 3);
    check(vec![Behaviour::CutOff(half.clone()), answer()], "hello", 2);
    check(vec![json(&half), answer()], "hello", 2);
    check(vec![Behaviour::HangUp, answer()], "hello", 2);
    // … but not for ever.
    check(always(status(502, &[], web_page_text())), "gave up after 3 requests", 3);
    check(always(status(500, &[], r#"{"error":{"message":"out of memory"}}"#)), "out of memory", 3);
    check(always(Behaviour::CutOff(completion("hello"))), "truncated", 3);
    check(always(Behaviour::HangUp), "truncated", 3);
    // Permanent failures are reported at once.
    check(always(status(429, &[("retry-after", "3600")], "quota")), "requests a wait of 3600 s", 1);
    check(always(status(401, &[], r#"{"error":{"message":"no such key"}}"#)), "401: no such key", 1);
    check(always(status(404, &[], r#"{"detail":"Not Found"}"#)), "404: Not Found", 1);
    check(always(status(307, &[("location", "http://127.0.0.1:1/")], "moved")), "307: moved", 1);
    check(always(web_page()), "expected JSON", 1);
    check(always(web_page()), "Please log in", 1);
    check(always(json("")), "expected JSON", 1);
    check(always(json("[1, 2")), "truncated", 3);
    check(always(json(&"[".repeat(100_000))), "expected JSON", 1);
    check(always(json(r#"{"choices": "none"}"#)), "$.choices", 1);
    check(always(json(r#"{"choices": [{"message": {"content": ""}, "finish_reason": "length"}]}"#)), "length", 1);
}

#[test]
fn slow_servers() {
    check(vec![slow(0.8), answer()], "hello", 2);
    check(always(slow(0.8)), "no complete response", 3);
}

/// Each byte arrives in time, the whole response never does.
#[test]
fn a_dripping_server() {
    check(always(Behaviour::Drip { bytes: 1000, every: Duration::from_millis(20) }), "no complete response", 3);
}

fn web_page_text() -> &'static str {
    "<html><h1>Bad gateway</h1></html>"
}

#[test]
fn a_server_is_given_the_time_it_asks_for() {
    let begin = Instant::now();
    let (result, requests) = ask(vec![status(429, &[("Retry-After", "1")], "busy"), answer()], |_| {});
    assert_eq!((result.unwrap().as_str(), requests), ("hello", 2));
    assert!(begin.elapsed() >= Duration::from_secs(1), "{:?}", begin.elapsed());
}

/// A gigabyte would exhaust the memory of a small machine; reading must stop at the limit.
#[test]
fn a_flood_is_cut_off_early() {
    for announced in [true, false] {
        let server = FakeServer::scripted(vec![Behaviour::Flood { bytes: 1 << 30, announced }]).unwrap();
        let mut settings = impatient(server.base_url());
        settings.max_body_bytes = 1 << 20;
        let error = HttpChat::new(settings, None, Seed::new(1)).unwrap().chat(&question("?")).unwrap_err();
        assert!(matches!(error, ChatError::TooLarge { limit_bytes: 1_048_576, .. }), "{error}");
        // Excess bytes are in the system's socket buffers.
        assert!(server.bytes_sent() < 64 << 20, "{} bytes", server.bytes_sent());
    }
}

#[test]
fn nobody_listens() {
    let free = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
    let settings = impatient(format!("http://{free}/v1"));
    let begin = Instant::now();
    let error = HttpChat::new(settings, None, Seed::new(1)).unwrap().chat(&question("?")).unwrap_err();
    assert!(matches!(error, ChatError::Unreachable { .. }), "{error}");
    assert!(error.hint().contains("start the server"));
    assert!(begin.elapsed() < Duration::from_secs(1), "not retried");
}

/// TLS is available, and a server without TLS is distinguished from an absent one.
#[cfg(feature = "https")]
#[test]
fn https_with_a_server_that_speaks_none() {
    let server = FakeServer::scripted([Behaviour::HangUp]).unwrap();
    let settings = impatient(server.base_url().replace("http:", "https:"));
    let error = HttpChat::new(settings, None, Seed::new(1)).unwrap().chat(&question("?")).unwrap_err();
    assert!(error.to_string().contains("https://127.0.0.1"), "{error}");
    assert!(server.seen().iter().all(|request| request.body.is_null()), "nothing was sent in the clear");
}

#[test]
fn structured_output_falls_back_and_remembers() {
    let form = |body: &serde_json::Value| match body.get("response_format") {
        Some(format) => format["type"].as_str().unwrap().to_owned(),
        None => "plain".to_owned(),
    };
    let shape = form;
    let server = FakeServer::start(move |request| match shape(&request.body).as_str() {
        "json_schema" => status(400, &[], r#"{"error":{"message":"response_format is not supported"}}"#),
        "json_object" => status(500, &[], r#"{"error":{"message":"no grammar for you"}}"#),
        _ => answer(),
    })
    .unwrap();
    let client = client(&server);
    let first = client.chat(&structured_question()).unwrap();
    assert_eq!((first.structure, first.attempts), (Structure::Plain, 3));
    let second = client.chat(&structured_question()).unwrap();
    assert_eq!((second.structure, second.attempts), (Structure::Plain, 1));
    let forms: Vec<String> = server.seen().iter().map(|request| form(&request.body)).collect();
    assert_eq!(forms, ["json_schema", "json_object", "plain", "plain"]);
}

/// A tighter schema is tried first, and not again after a refusal.
#[test]
fn a_grammar_falls_back_to_the_schema() {
    let server =
        FakeServer::start(|request| {
            match request.body["response_format"]["json_schema"]["schema"]["minItems"].is_null() {
                true => answer(),
                false => status(400, &[], r#"{"error":{"message":"response_format: `minItems` is not permitted"}}"#),
            }
        })
        .unwrap();
    let client = client(&server);
    let mut question = structured_question();
    let asked = question.reply_schema.as_mut().unwrap();
    asked.grammar = Some(serde_json::json!({"type": "array", "minItems": 1}));
    for (attempts, requests) in [(2, 2), (1, 3)] {
        let reply = client.chat(&question).unwrap();
        assert_eq!((reply.structure, reply.attempts), (Structure::JsonSchema, attempts));
        assert_eq!(server.seen().len(), requests);
    }
}

#[test]
fn a_request_that_is_wrong_anyway_reports_its_first_refusal() {
    let server = FakeServer::start(|request| {
        status(400, &[], &format!(r#"{{"error":{{"message":"refusal {}"}}}}"#, request.index))
    })
    .unwrap();
    let error = client(&server).chat(&structured_question()).unwrap_err();
    assert!(error.to_string().contains("400: refusal 0"), "{error}");
    assert_eq!(server.seen().len(), 3);
}

/// A server's refusal of a conversation that is too long is no refusal of the schema: it is asked once, and the hint is
/// about the length.
#[test]
fn a_conversation_that_is_too_long_is_not_sent_again() {
    for message in [
        "request (1469 tokens) exceeds the available context size (1024 tokens), try increasing it",
        "This model's maximum context length is 4096 tokens. However, you requested 5000 tokens.",
        "prompt is too long: 210000 tokens > 200000 maximum",
    ] {
        let body = serde_json::json!({"error": {"message": message}}).to_string();
        let server = FakeServer::start(move |_| status(400, &[], &body)).unwrap();
        let error = client(&server).chat(&structured_question()).unwrap_err();
        assert_eq!(server.seen().len(), 1, "{message}");
        assert!(error.to_string().contains(message) && error.hint().contains("context"), "{error}: {}", error.hint());
    }
    let refusal = r#"{"error":{"message":"response_format json_schema: unexpected token in schema"}}"#;
    let server = FakeServer::start(move |request| match request.index {
        0 => status(400, &[], refusal),
        _ => answer(),
    })
    .unwrap();
    assert_eq!(client(&server).chat(&structured_question()).unwrap().attempts, 2);
}

#[test]
fn what_is_sent() {
    let server = FakeServer::scripted(vec![answer()]).unwrap();
    let mut request = structured_question();
    request.parameters.insert("temperature".into(), 0.5.into());
    let reply = client(&server).chat(&request).unwrap();
    assert_eq!((reply.structure, reply.attempts), (Structure::JsonSchema, 1));
    assert_eq!(reply.usage.unwrap().prompt_tokens, 100);
    let seen = &server.seen()[0];
    assert_eq!(seen.target, "POST /v1/chat/completions");
    assert_eq!(seen.headers["content-type"], "application/json");
    assert!(!seen.headers.contains_key("authorization"));
    insta::assert_snapshot!(serde_json::to_string_pretty(&seen.body).unwrap());
}
