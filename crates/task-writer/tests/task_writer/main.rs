//! Generation against recorded answers over a server on loopback and from cassettes, prompts and settings.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod cassettes;
mod generation;
mod guide;
mod prompts;
mod secrets;

use genmanip_core::ObjectCard;
use genmanip_llm::ServerSettings;
use genmanip_task_writer::LlmSettings;
use genmanip_tasks::answer::RecordedAnswer;

/// Recorded answers of the crate `tasks`.
const TASKS_TESTDATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tasks/testdata");

/// The built-in catalogue, read as a file, since this crate does not depend on assets.
const CATALOGUE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/data/catalog.json");

fn catalogue() -> Vec<ObjectCard> {
    let text = std::fs::read_to_string(CATALOGUE).unwrap();
    let records: Vec<serde_json::Map<String, serde_json::Value>> = serde_json::from_str(&text).unwrap();
    let card = |mut record: serde_json::Map<String, serde_json::Value>| {
        let asset = serde_json::json!({"source": "builtin", "uid": record["uid"], "version": record["version"]});
        record.insert("asset".into(), asset);
        for more in ["version", "looks", "fragile", "upright_only", "affordances", "recipe"] {
            record.remove(more);
        }
        serde_json::from_value(record.into()).unwrap()
    };
    records.into_iter().map(card).collect()
}

/// File stem and answer, in order.
fn recorded_answers() -> Vec<(String, RecordedAnswer)> {
    let folder = std::fs::read_dir(format!("{TASKS_TESTDATA}/responses")).unwrap();
    let mut paths: Vec<_> = folder.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let read = |path: std::path::PathBuf| {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        (name, RecordedAnswer::from_json(&std::fs::read_to_string(&path).unwrap()).unwrap())
    };
    paths.into_iter().map(read).collect()
}

/// Settings for a loopback server with short timeouts.
fn impatient(base_url: String) -> LlmSettings {
    let server = ServerSettings {
        base_url,
        model: "scripted".into(),
        connect_timeout_s: 2.0,
        total_timeout_s: 5.0,
        max_retries: 2,
        first_backoff_s: 0.01,
        max_backoff_s: 0.02,
        max_retry_after_s: 2.0,
        ..ServerSettings::default()
    };
    LlmSettings { server, ..LlmSettings::default() }
}
