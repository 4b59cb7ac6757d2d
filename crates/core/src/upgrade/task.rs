//! Tasks of version 1: at most one instance per asset, named by its uid.

use serde_json::{Map, Value, json};

use super::{lacks, object, objects, text};
use crate::{DocumentError, Upgrade};

/// Upgrade of a task of version 1 to version 2.
pub const FROM_1: Upgrade = Upgrade { schema: "genmanip.task/1", upgrade: from_1 };

/// Version of the built-in objects at the time of version 1 tasks, which do not record it.
const BUILTIN_VERSION: u32 = 2;

/// Adds the asset to every node and card, and sorts the cards into node order.
pub(super) fn from_1(task: &mut Map<String, Value>) -> Result<(), DocumentError> {
    let mut uids = Vec::new();
    let graph = object(task, "scene_graph", "$")?;
    for (index, node) in objects(graph, "nodes", "$.scene_graph")?.into_iter().enumerate() {
        let uid = text(node, "uid", &format!("$.scene_graph.nodes[{index}]"))?;
        let state = node.get("state").cloned();
        *node = Map::from_iter([("id".to_owned(), uid.as_str().into()), ("asset".to_owned(), builtin(&uid))]);
        node.extend(state.map(|state| ("state".to_owned(), state)));
        uids.push(uid);
    }
    for (index, card) in objects(task, "objects", "$")?.into_iter().enumerate() {
        let uid = text(card, "uid", &format!("$.objects[{index}]"))?;
        card.insert("asset".into(), builtin(&uid));
    }
    // Cards used to be looked up by uid; now they are indexed like the nodes.
    let cards = task.get_mut("objects").and_then(Value::as_array_mut).map(std::mem::take).unwrap_or_default();
    let of = |uid: &String| cards.iter().find(|card| card["uid"] == uid.as_str()).cloned();
    let sorted = uids.iter().enumerate().map(|(index, uid)| {
        of(uid).ok_or_else(|| lacks(&format!("$.scene_graph.nodes[{index}]"), &format!("a card of object {uid}")))
    });
    task.insert("objects".into(), Value::Array(sorted.collect::<Result<_, _>>()?));
    Ok(())
}

pub(super) fn builtin(uid: &str) -> Value {
    json!({"source": "builtin", "uid": uid, "version": BUILTIN_VERSION})
}
