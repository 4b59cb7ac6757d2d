use genmanip_core::Seed;
use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{
    ApiKey, CassetteChat, CassetteMode, CassetteSettings, ChatModel, HttpChat, Price, ServerSettings, SettingsError,
    from_toml,
};
use serde::Deserialize;

use crate::{impatient, question};

const KEY: &str = "sk-test-4fJ/9qLw+Zx\"7\\Tt";

/// Server behaviours that may leak the key into messages: it echoes the header in each response.
#[test]
fn the_key_is_in_no_error_reply_or_debug_text() {
    let escaped = KEY.replace('\\', "\\\\").replace('"', "\\\"").replace('/', "\\/");
    let status = |status: u16, body: String| Behaviour::Status(status, vec![], body);
    let long = "x".repeat(290);
    let cases = vec![
        status(401, format!(r#"{{"error":{{"message":"bad key {escaped}"}}}}"#)),
        status(403, format!("bad key {KEY}")),
        status(403, format!("{}{KEY}", "x".repeat(110))), // cut in the middle
        status(401, format!(r#"{{"error":{{"message":"{long}{escaped}"}}}}"#)),
        status(400, format!(r#"{{"{escaped}":1,"detail":["{escaped}"]}}"#)),
        Behaviour::Body("text/html".into(), format!("<p>{KEY}</p>")),
        Behaviour::Body(format!("text/{KEY}"), "<p>".into()),
        Behaviour::Body("application/json".into(), format!(r#"{{"error":"{escaped}"}}"#)),
        Behaviour::Body(
            "application/json".into(),
            format!(
                r#"{{"model":"{escaped}","choices":[{{"message":{{"content":"it is {escaped}"}},"finish_reason":"{escaped}"}}]}}"#
            ),
        ),
        Behaviour::Body(
            "application/json".into(),
            format!(r#"{{"choices":[{{"message":{{"refusal":"not with {escaped}"}}}}]}}"#),
        ),
    ];
    let count = cases.len();
    let server = FakeServer::scripted(cases).unwrap();
    let mut settings = impatient(server.base_url());
    settings.max_retries = 0;
    let key = ApiKey::new(KEY).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cassettes = CassetteSettings { mode: CassetteMode::Record, folder: folder.path().into(), note: String::new() };
    let http = HttpChat::new(settings, Some(key.clone()), Seed::new(1)).unwrap();
    let chat = CassetteChat::new(http, cassettes, Some(key.clone()));
    assert_clean(&format!("{key:?} {chat:?} {chat:#?}"));
    for index in 0..count {
        let result = chat.chat(&question(&index.to_string()));
        assert_clean(&format!("{result:?} {}", serde_json::to_string(&result.as_ref().err()).unwrap()));
        if let Err(error) = result {
            assert_clean(&error.to_string());
        }
    }
    assert_eq!(server.seen().len(), count);
    assert!(server.seen().iter().all(|request| request.headers["authorization"] == format!("Bearer {KEY}")));
    let recorded: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(recorded.len(), 1);
    assert_clean(&std::fs::read_to_string(recorded[0].as_ref().unwrap().path()).unwrap());
}

/// Any run of eight characters of the key counts as a leak, plain or JSON-escaped.
fn assert_clean(text: &str) {
    let escaped = KEY.replace('\\', "\\\\").replace('"', "\\\"");
    for secret in [KEY, &escaped] {
        for window in secret.as_bytes().windows(8) {
            let part = std::str::from_utf8(window).unwrap();
            assert!(!text.contains(part), "leaked {part:?} in {text}");
        }
    }
}

/// If the key is in a prompt or a model name, the exchange is not recorded.
#[test]
fn an_exchange_with_the_key_in_the_question_is_not_recorded() {
    let server = FakeServer::scripted([Behaviour::Answer("fine".into())]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cassettes = CassetteSettings { mode: CassetteMode::Record, folder: folder.path().into(), note: String::new() };
    let key = ApiKey::new(KEY).unwrap();
    let http = HttpChat::new(impatient(server.base_url()), Some(key.clone()), Seed::new(1)).unwrap();
    let error = CassetteChat::new(http, cassettes, Some(key)).chat(&question(&format!("my key is {KEY}"))).unwrap_err();
    assert!(error.to_string().contains("not recorded"), "{error}");
    assert_clean(&format!("{error} {error:?}"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A settings file as dependent crates write it.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct File {
    server: ServerSettings,
    prices: std::collections::BTreeMap<String, Price>,
}

fn read(text: &str) -> Result<File, SettingsError> {
    let file: File = from_toml(text)?;
    file.server.check()?;
    file.prices.values().try_for_each(Price::check)?;
    Ok(file)
}

/// Settings that would expose a key are rejected, without showing what may be one.
#[test]
fn settings_do_not_take_or_show_keys() {
    let check = |toml: &str, part: &str| {
        let error = read(toml).unwrap_err().to_string();
        assert!(error.contains(part), "{toml}: {error}");
        assert!(!error.contains("s3cret"), "{error}");
    };
    check("[server]\napi_key = \"s3cretkey\"", "line 2");
    check("[server]\napi_key = \"s3cretkey\"", "api_key_env");
    check("[server]\nmax_retries = \"s3cretkey\"", "line 2: invalid type: string (value hidden)");
    check("[server]\nstructure = \"s3cretkey\"", "value hidden");
    check("[server]\nstructure = \"s3cretkey", "line 2");
    check("[server]\napi_key_env = \"s3cretkey\"", "the name of a variable");
    check("[server]\nbase_url = \"https://me:s3cret@host/v1\"", "no user");
    check("[server]\nbase_url = \"https://host/v1?key=s3cret\"", "no user");
    check("[server]\nbase_url = \"s3cret\"", "http://");
    check("[server]\nbase_url = \"ftp://s3cret\"", "http://");
    check("[server]\nbase_url = \"http://10.0.0.7/v1\"\napi_key_env = \"KEY\"", "https://");
    check("[server]\nbase_url = \"http://127.0.0.1.evil.org/v1\"\napi_key_env = \"KEY\"", "https://");
    check("[server.parameters]\nmessages = \"s3cret\"", "server.parameters");
    check("[server]\ntotal_timeout_s = nan", "total_timeout_s");
    check("[server]\nfirst_backoff_s = 0.0", "first_backoff_s");
    check("[prices.m]\ninput_per_million = -1.0\noutput_per_million = 1.0", "prices");
    for fine in [
        "",
        "[server]\nbase_url = \"http://[::1]:80/v1\"\napi_key_env = \"KEY\"",
        "[server]\nbase_url = \"http://localhost/v1\"\napi_key_env = \"KEY\"",
        "[server]\nbase_url = \"https://host/v1\"\napi_key_env = \"KEY\"",
        "[server]\nbase_url = \"http://10.0.0.7/v1\"\napi_key_env = \"KEY\"\nallow_key_over_http = true",
    ] {
        read(fine).unwrap();
    }
    for bad in ["", "short", "two words of it", "tab\there-and-more", "nüchterner-schlüssel"] {
        let error = ApiKey::new(bad).unwrap_err().to_string();
        assert!(bad.is_empty() || !error.contains(bad), "{error}");
    }
}
