//! Decoding of a JSON object into the exchange format.

use std::borrow::Cow;

use genmanip_core::Relation;
use serde_json::{Map, Value};

use super::flaw::{Findings, FlawKind};

/// Keys of the second reference of `between`.
const SECOND_KEYS: [&str; 2] = ["obj3", "obj3_uid"];

/// Maximum number of entries of a list in an answer. Chosen by hand: a table holds a dozen objects.
const MAX_ITEMS: usize = 256;

/// An answer in the words of the exchange format; `"none"`, `null` and empty texts become `None`.
pub(super) struct RawAnswer {
    pub instruction: String,
    pub alternatives: Vec<Vec<RawCondition>>,
    pub description: String,
    pub edges: Vec<RawEdge>,
    pub nodes: Vec<RawNode>,
}

/// Object reference of the answer.
pub(super) struct RawObject {
    pub name: Option<String>,
    pub uid: Option<String>,
    /// JSON path of the uid.
    pub path: String,
}

/// One condition of the goal.
pub(super) struct RawCondition {
    pub subject: RawObject,
    pub state: Option<String>,
    pub reference: RawObject,
    /// Second reference of `between`; `None` unless the request allows this position.
    pub second: Option<RawObject>,
    pub position: Option<String>,
    pub path: String,
}

/// One edge of the initial graph.
pub(super) struct RawEdge {
    pub subject: RawObject,
    pub position: Option<String>,
    pub reference: RawObject,
    /// Second reference of `between`; `None` unless the request allows this position.
    pub second: Option<RawObject>,
    pub path: String,
}

/// One node of the initial graph.
pub(super) struct RawNode {
    pub object: RawObject,
    pub state: Option<String>,
    pub path: String,
}

/// Decodes all parts; `None` if an indispensable part is missing.
pub(super) fn decode(value: &Value, between: bool, findings: &mut Findings) -> Option<RawAnswer> {
    let answer = value.as_object()?;
    let graph = scene_graph(answer, findings);
    let answer_keys: &[&str] = &["instruction", "goal_conditions", "scene_graph"];
    if answer.contains_key("scene_graph") {
        note_unknown_keys(answer, answer_keys, "$", findings);
    }
    let instruction = required_text(answer, "instruction", "$", findings);
    let alternatives = alternatives(answer, between, findings);
    let graph = graph?;
    note_unknown_keys(&graph, &["description", "edges", "nodes"], "$.scene_graph", findings);
    let description = required_text(&graph, "description", "$.scene_graph", findings);
    let edges = objects(&graph, "edges", findings);
    let nodes = objects(&graph, "nodes", findings);
    let edges = edges?.into_iter().map(|(map, path)| edge(map, path, between, findings)).collect();
    let nodes = nodes?.into_iter().map(|(map, path)| node(map, path, findings)).collect();
    Some(RawAnswer { instruction: instruction?, alternatives: alternatives?, description: description?, edges, nodes })
}

/// The scene graph, also if its parts are one level too high; `None` after recording its flaw.
fn scene_graph<'a>(answer: &'a Map<String, Value>, findings: &mut Findings) -> Option<Cow<'a, Map<String, Value>>> {
    match answer.get("scene_graph") {
        Some(Value::Object(graph)) => Some(Cow::Borrowed(graph)),
        Some(other) => {
            wrong_type("$.scene_graph", "an object", other, findings);
            None
        }
        None if answer.contains_key("edges") && answer.contains_key("nodes") => {
            findings.repair(
                FlawKind::WrongNesting,
                "$",
                "expected `edges` and `nodes` inside `scene_graph`, got them beside it",
                "moved into `scene_graph`",
            );
            let parts = answer.iter().filter(|(key, _)| ["description", "edges", "nodes"].contains(&key.as_str()));
            Some(Cow::Owned(parts.map(|(key, part)| (key.clone(), part.clone())).collect()))
        }
        None => {
            missing("$", "scene_graph", findings);
            None
        }
    }
}

/// The goal in disjunctive normal form, `None` after recording its flaw; a single condition or a flat list is one
/// conjunction.
fn alternatives(answer: &Map<String, Value>, between: bool, findings: &mut Findings) -> Option<Vec<Vec<RawCondition>>> {
    const PATH: &str = "$.goal_conditions";
    let conjunction = "read as one conjunction";
    let Some(goal) = answer.get("goal_conditions") else {
        missing("$", "goal_conditions", findings);
        return None;
    };
    if let Value::Object(only) = goal {
        let message = "expected a list of lists of conditions, got one condition";
        findings.repair(FlawKind::FlatDnf, PATH, message, conjunction);
        return Some(vec![vec![condition(only, PATH.into(), between, findings)]]);
    }
    let Some(items) = goal.as_array().filter(|items| fits(items, PATH, findings)) else {
        if goal.is_array() {
            return None;
        }
        wrong_type(PATH, "a list of lists of conditions", goal, findings);
        return None;
    };
    if !items.is_empty() && items.iter().all(Value::is_object) {
        let message = "expected a list of lists of conditions, got a flat list of conditions";
        findings.repair(FlawKind::FlatDnf, PATH, message, conjunction);
        return Some(vec![conditions(items, PATH, between, findings)?]);
    }
    let deeper = match items.as_slice() {
        [Value::Array(inner)] if !inner.is_empty() && inner.iter().all(Value::is_array) => Some(inner),
        _ => None,
    };
    if deeper.is_some() {
        let message = "expected a list of lists of conditions, got one more list around it";
        findings.repair(FlawKind::WrongNesting, PATH, message, "took the inner list");
    }
    let mut alternatives = Vec::new();
    for (index, item) in deeper.unwrap_or(items).iter().enumerate() {
        let path = if deeper.is_some() { format!("{PATH}[0][{index}]") } else { format!("{PATH}[{index}]") };
        match item.as_array() {
            Some(list) => alternatives.push(conditions(list, &path, between, findings)?),
            None => {
                wrong_type(&path, "a list of conditions", item, findings);
                return None;
            }
        }
    }
    Some(alternatives)
}

fn conditions(items: &[Value], path: &str, between: bool, findings: &mut Findings) -> Option<Vec<RawCondition>> {
    let mut list = Vec::new();
    if !fits(items, path, findings) {
        return None;
    }
    for (index, item) in items.iter().enumerate() {
        let path = format!("{path}[{index}]");
        match item.as_object() {
            Some(map) => list.push(condition(map, path, between, findings)),
            None => {
                wrong_type(&path, "a condition", item, findings);
                return None;
            }
        }
    }
    Some(list)
}

fn condition(map: &Map<String, Value>, path: String, between: bool, findings: &mut Findings) -> RawCondition {
    let second = second_reference(map, &path, between, findings);
    let mut keys = vec!["obj1", "obj1_uid", "obj1_state", "obj2", "obj2_uid", "position"];
    keys.extend(second.iter().flat_map(|_| SECOND_KEYS));
    note_unknown_keys(map, &keys, &path, findings);
    RawCondition {
        subject: object(map, "obj1", &path, findings),
        state: text(map, "obj1_state", &path, findings),
        reference: object(map, "obj2", &path, findings),
        second,
        position: text(map, "position", &path, findings),
        path,
    }
}

fn edge(map: &Map<String, Value>, path: String, between: bool, findings: &mut Findings) -> RawEdge {
    let second = second_reference(map, &path, between, findings);
    let mut keys = vec!["obj1", "obj1_uid", "position", "obj2", "obj2_uid"];
    keys.extend(second.iter().flat_map(|_| SECOND_KEYS));
    note_unknown_keys(map, &keys, &path, findings);
    RawEdge {
        subject: object(map, "obj1", &path, findings),
        position: text(map, "position", &path, findings),
        reference: object(map, "obj2", &path, findings),
        second,
        path,
    }
}

/// Second reference of a condition or edge; `None` unless the option is on and the position is `between`.
fn second_reference(map: &Map<String, Value>, path: &str, between: bool, findings: &mut Findings) -> Option<RawObject> {
    let named = map.get("position").and_then(Value::as_str).and_then(Relation::named);
    let asks = named.is_some_and(Relation::has_two_references);
    (between && asks).then(|| object(map, "obj3", path, findings))
}

fn node(map: &Map<String, Value>, path: String, findings: &mut Findings) -> RawNode {
    note_unknown_keys(map, &["obj_uid", "state"], &path, findings);
    let uid = text(map, "obj_uid", &path, findings);
    RawNode {
        object: RawObject { name: None, uid, path: format!("{path}.obj_uid") },
        state: text(map, "state", &path, findings),
        path,
    }
}

fn object(map: &Map<String, Value>, key: &str, path: &str, findings: &mut Findings) -> RawObject {
    let uid_key = format!("{key}_uid");
    RawObject {
        name: text(map, key, path, findings),
        uid: text(map, &uid_key, path, findings),
        path: format!("{path}.{uid_key}"),
    }
}

/// Objects of a list, each with its JSON path; `None` after recording that there is no list.
fn objects<'a>(
    graph: &'a Map<String, Value>,
    key: &str,
    findings: &mut Findings,
) -> Option<Vec<(&'a Map<String, Value>, String)>> {
    let path = format!("$.scene_graph.{key}");
    let items = match graph.get(key) {
        Some(Value::Array(items)) => items,
        Some(other) => {
            wrong_type(&path, "a list", other, findings);
            return None;
        }
        None => {
            missing("$.scene_graph", key, findings);
            return None;
        }
    };
    if !fits(items, &path, findings) {
        return None;
    }
    let mut list = Vec::new();
    for (index, item) in items.iter().enumerate() {
        let path = format!("{path}[{index}]");
        match item.as_object() {
            Some(map) => list.push((map, path)),
            None => {
                wrong_type(&path, "an object", item, findings);
                return None;
            }
        }
    }
    Some(list)
}

/// Optional text; numbers are accepted as uids.
fn text(map: &Map<String, Value>, key: &str, path: &str, findings: &mut Findings) -> Option<String> {
    let path = format!("{path}.{key}");
    match map.get(key) {
        Some(Value::String(text)) => {
            let text = text.trim();
            let absent = text.is_empty() || ["none", "null", "n/a"].iter().any(|word| text.eq_ignore_ascii_case(word));
            (!absent).then(|| text.to_owned())
        }
        Some(Value::Null) => None,
        Some(Value::Number(number)) if key.ends_with("uid") => Some(number.to_string()),
        Some(other) => {
            wrong_type(&path, "a text", other, findings);
            None
        }
        None => {
            let message = format!("expected the key `{key}`, got none");
            findings.repair(FlawKind::MissingField, path, message, "read as \"none\"");
            None
        }
    }
}

fn required_text(map: &Map<String, Value>, key: &str, path: &str, findings: &mut Findings) -> Option<String> {
    match map.get(key) {
        Some(Value::String(text)) => Some(text.trim().to_owned()),
        Some(other) => {
            wrong_type(&format!("{path}.{key}"), "a text", other, findings);
            None
        }
        None => {
            missing(path, key, findings);
            None
        }
    }
}

fn note_unknown_keys(map: &Map<String, Value>, known: &[&str], path: &str, findings: &mut Findings) {
    for key in map.keys().filter(|key| !known.contains(&key.as_str())) {
        let message = format!("expected the keys {known:?}, got also `{key}`");
        findings.repair(FlawKind::UnknownField, format!("{path}.{key}"), message, "left out");
    }
}

/// True if a list does not exceed the maximum length.
fn fits(items: &[Value], path: &str, findings: &mut Findings) -> bool {
    if items.len() > MAX_ITEMS {
        let message = format!("expected at most {MAX_ITEMS} items, got {}", items.len());
        findings.reject(FlawKind::TooLarge, path, message, "");
    }
    items.len() <= MAX_ITEMS
}

fn missing(path: &str, key: &str, findings: &mut Findings) {
    let message = format!("expected the key `{key}`, got none");
    findings.reject(FlawKind::MissingField, path, message, "");
}

fn wrong_type(path: &str, expected: &str, got: &Value, findings: &mut Findings) {
    let got = match got {
        Value::Null => "null".into(),
        Value::Bool(value) => format!("{value}"),
        Value::Number(number) => format!("the number {number}"),
        Value::String(text) => format!("the text `{}`", text.chars().take(40).collect::<String>()),
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Object(_) => "an object".into(),
    };
    findings.reject(FlawKind::WrongType, path, format!("expected {expected}, got {got}"), "");
}
