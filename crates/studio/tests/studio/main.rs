//! Tests of the studio: operations, the log, verdicts and repairs; meshes; the server as pages and programs use it.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod client;
mod crash;
mod document;
mod glb;
mod making;
mod operations;
mod questions;
mod reviews;
mod runs;
mod server;
mod teleop;
mod ten_tabs;
mod two_authors;
mod usd;
mod verdict;

use std::path::{Path, PathBuf};

use genmanip_assets::Catalogue;
use genmanip_core::{Document, Scenario};
use genmanip_studio::edit::{Command, EditedScenario, Operation, Stamp};
use serde_json::Value;

/// A cola can and three others on the table; the goal is right of the cola can.
const CANS: &str = "009_appearance-000";
/// A scene with an articulated object.
const DRAWER: &str = "appearance-200-00055-000";

fn suite_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../suites/genmanip-200-rc/scenarios/{name}.json"))
}

fn scenario(name: &str) -> Scenario {
    Scenario::from_json(&std::fs::read_to_string(suite_file(name)).unwrap()).unwrap()
}

/// A scenario's copy in a folder of its own.
fn copy(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("{name}.json"));
    std::fs::copy(suite_file(name), &path).unwrap();
    (folder, path)
}

fn open(path: &Path) -> EditedScenario {
    EditedScenario::open(path, Catalogue::all()).unwrap_or_else(|error| panic!("{error}"))
}

fn operation(value: Value) -> Operation {
    serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{value}: {error}"))
}

fn stamp(author: &str, id: impl ToString) -> Stamp {
    Stamp { client_operation_id: id.to_string(), author: author.into(), at: "2026-11-27T12:00:00Z".into() }
}

fn command(author: &str, id: impl ToString, base_revision: u64, value: Value) -> Command {
    Command { operation: operation(value), base_revision, stamp: stamp(author, id) }
}

#[test]
fn the_schemas_of_the_logs_are_current() {
    let schemas = [
        ("edits", schemars::schema_for!(genmanip_studio::edit::CommandLine)),
        ("reviews", schemars::schema_for!(genmanip_studio::review::ReviewLine)),
    ];
    for (name, schema) in schemas {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../schemas/{name}.schema.json"));
        let text = serde_json::to_string_pretty(&schema).unwrap() + "\n";
        if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        let stored = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(stored == text, "schemas/{name}.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
    }
}
