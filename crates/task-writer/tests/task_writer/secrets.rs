use genmanip_core::{Document, Seed, TaskKind};
use genmanip_llm::fake::{Behaviour, FakeServer, completion};
use genmanip_llm::{CassetteMode, CassetteSettings};
use genmanip_task_writer::{Designer, LlmSettings};

use crate::{catalogue, impatient};

/// The key is read from the variable named in the settings (here one that cargo sets).
#[test]
fn the_key_comes_from_the_environment() {
    let value = std::env::var("CARGO_MANIFEST_DIR").unwrap();
    let server = FakeServer::start(|_| Behaviour::Body("application/json".into(), completion("no task"))).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut settings = impatient(server.base_url());
    settings.server.api_key_env = Some("CARGO_MANIFEST_DIR".into());
    settings.cassettes =
        CassetteSettings { mode: CassetteMode::Record, folder: folder.path().into(), note: String::new() };
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    let outcomes = designer.generate(&[(TaskKind::Spatial, 1)], Seed::new(1), &catalogue(), &|_| {});
    assert_eq!(server.seen()[0].headers["authorization"], format!("Bearer {value}"));
    assert!(!outcomes[0].to_json().contains(&value));
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        assert!(!std::fs::read_to_string(entry.unwrap().path()).unwrap().contains(&value));
    }
    // Replay needs neither the key nor the server.
    settings.server.api_key_env = Some("GENMANIP_TEST_KEY_THAT_IS_NOT_SET".into());
    let missing = Designer::open(&settings, Seed::new(1)).err().unwrap();
    assert!(missing.to_string().contains("GENMANIP_TEST_KEY_THAT_IS_NOT_SET"), "{missing}");
    drop(server);
    settings.cassettes.mode = CassetteMode::Replay;
    let replayed = Designer::open(&settings, Seed::new(1)).unwrap();
    let replayed = replayed.generate(&[(TaskKind::Spatial, 1)], Seed::new(1), &catalogue(), &|_| {});
    assert_eq!(replayed[0].to_json(), outcomes[0].to_json(), "a replay writes the same bytes");
}

/// All settings are validated, without showing what may be a key.
#[test]
fn settings_do_not_take_or_show_keys() {
    let check = |toml: &str, part: &str| {
        let error = LlmSettings::from_toml(toml).unwrap_err().to_string();
        assert!(error.contains(part), "{toml}: {error}");
        assert!(!error.contains("s3cret"), "{error}");
    };
    check("[server]\napi_key = \"s3cretkey\"", "api_key_env");
    check("[server]\nmax_retries = \"s3cretkey\"", "line 2: invalid type: string (value hidden)");
    check("[generation]\nprompts = s3cret", "line 2");
    check("[server]\nbase_url = \"https://host/v1?key=s3cret\"", "no user");
    check("[server.parameters]\nmessages = \"s3cret\"", "server.parameters");
    check("[cassettes]\nmode = \"s3cret\"", "value hidden");
    check("[generation]\nworkers = 0", "generation.workers");
    check("[generation]\nmin_objects = 9", "generation.min_objects");
    check("[prices.m]\ninput_per_million = -1.0\noutput_per_million = 1.0", "prices");
    assert_eq!(LlmSettings::from_toml("").unwrap(), LlmSettings::default());
}
