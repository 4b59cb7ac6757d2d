//! Extraction of the answer's JSON object from the model's text.

use genmanip_core::lenient_json::{self, Failure, Parsed, Wanted};
use serde_json::Value;

use super::MAX_ANSWER_BYTES;
use super::flaw::{Findings, FlawKind};

/// Maximum number of JSON values parsed in a text; an answer has a few hundred.
const MAX_VALUES: usize = 10_000;

/// Keys of which an answer has at least one.
const ANSWER_KEYS: [&str; 3] = ["instruction", "goal_conditions", "scene_graph"];

/// The answer's object, extracted from code fences, prose and wrapping objects; `None` after reporting why there is
/// none.
pub(super) fn find_answer(raw: &str, findings: &mut Findings) -> Option<Value> {
    if raw.len() > MAX_ANSWER_BYTES {
        findings.reject(
            FlawKind::TooLarge,
            "$",
            format!("expected at most {MAX_ANSWER_BYTES} bytes, got {}", raw.len()),
            "an answer needs a few kilobytes",
        );
        return None;
    }
    let raw = &lenient_json::decoded(raw);
    let mut answers: Vec<Parsed> = Vec::new();
    let mut failures: Vec<Failure> = Vec::new();
    let mut other_objects = 0;
    for found in lenient_json::find(raw, Wanted::Objects, MAX_VALUES) {
        match found {
            Ok(parsed) if looks_like_answer(&parsed.value) => answers.push(parsed),
            Ok(_) => other_objects += 1,
            Err(failure) => failures.push(failure),
        }
    }
    if answers.is_empty() {
        note_failure(raw, &failures, other_objects, findings);
        return None;
    }
    let first = answers.remove(0);
    if answers.iter().any(|other| other.value != first.value) {
        findings.reject(
            FlawKind::SeveralAnswers,
            "$",
            format!("expected one answer, got {} different ones", answers.len() + 1),
            "send the final JSON object only",
        );
        return None;
    }
    for (what, at) in &first.sloppy {
        let message = format!("expected strict JSON, got a {what}");
        findings.repair(FlawKind::SloppyJson, position(raw, *at), message, format!("read past: {what}"));
    }
    Some(unwrap(first.value, findings))
}

fn looks_like_answer(value: &Value) -> bool {
    let has_key = |value: &Value| ANSWER_KEYS.iter().any(|key| value.get(key).is_some());
    has_key(value) || wrapped(value).is_some_and(has_key)
}

/// The value of an object with a single key; `None` for all other values.
fn wrapped(value: &Value) -> Option<&Value> {
    value.as_object().filter(|map| map.len() == 1).and_then(|map| map.values().next())
}

/// Extracts the answer from an object like `{"task": {…}}`.
fn unwrap(value: Value, findings: &mut Findings) -> Value {
    if ANSWER_KEYS.iter().any(|key| value.get(key).is_some()) {
        return value;
    }
    match wrapped(&value) {
        Some(inner) => {
            let key = value.as_object().and_then(|map| map.keys().next()).cloned().unwrap_or_default();
            let message = format!("expected the answer's keys, got the single key `{key}`");
            findings.repair(FlawKind::WrongNesting, "$", message, format!("took the object under `{key}`"));
            inner.clone()
        }
        None => value,
    }
}

fn note_failure(raw: &str, failures: &[Failure], other_objects: usize, findings: &mut Findings) {
    let again = "send one complete JSON object";
    // The failure farthest into the text is the most informative one.
    match failures.iter().max_by_key(|failure| failure.at()) {
        Some(Failure::Truncated { at }) => findings.reject(
            FlawKind::TruncatedJson,
            position(raw, *at),
            "expected the object to be closed, got the end of the text",
            again,
        ),
        Some(Failure::Malformed { at, message }) => {
            findings.reject(FlawKind::MalformedJson, position(raw, *at), message, again);
        }
        Some(Failure::DuplicateKey { at, key }) => findings.reject(
            FlawKind::DuplicateKey,
            position(raw, *at),
            format!("key `{key}` occurs twice with different values"),
            again,
        ),
        Some(Failure::TooManyValues { at }) => findings.reject(
            FlawKind::TooLarge,
            position(raw, *at),
            format!("expected at most {MAX_VALUES} JSON values, got more"),
            again,
        ),
        None if other_objects > 0 => findings.reject(
            FlawKind::MissingField,
            "$",
            format!("expected the keys {ANSWER_KEYS:?}, got an object with none of them"),
            again,
        ),
        None => findings.reject(FlawKind::NoJson, "$", "expected a JSON object, got none", again),
    }
}

/// Line and column of a byte position, from 1, as text.
fn position(raw: &str, at: usize) -> String {
    let before = raw.get(..at).unwrap_or(raw);
    let line = before.bytes().filter(|&byte| byte == b'\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1;
    format!("line {line}, column {column}")
}
