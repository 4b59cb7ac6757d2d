//! Restrictive JSON Schema of an answer, for servers that convert a schema to a grammar: limited list lengths and one
//! shape per kind of condition and object, so that many flaws cannot occur.

use genmanip_core::{ObjectCard, ReferenceId, TaskKind};
use genmanip_tasks::answer::TaskRequest;
use serde_json::{Value, json};

/// Relation words of the exchange format.
const POSITIONS: [&str; 6] = ["front", "back", "left", "right", "near", "top"];
/// Maximum number of edges per offered object.
const EDGES_PER_OBJECT: usize = 2;
/// Maximum number of alternatives of a goal.
const MAX_ALTERNATIVES: usize = 4;
/// Maximum number of offered objects for which each subject has its own shape without itself as reference; the grammar
/// grows with their square.
const MAX_SUBJECTS: usize = 16;

/// The schema; `None` if no condition of the requested kind is possible with the offered objects.
pub(crate) fn reply_grammar(request: &TaskRequest) -> Option<Value> {
    let objects = Objects { ids: request.ids(), offered: &request.offered };
    let (least, most) = match request.kind {
        TaskKind::LongHorizon => (2, 6),
        TaskKind::Articulated => (1, 2),
        TaskKind::PickAndPlace | TaskKind::Spatial | TaskKind::Appearance | TaskKind::CommonSense => (1, 3),
    };
    let conditions = objects.conditions(request.kind);
    if conditions.is_empty() {
        return None;
    }
    let offered = request.offered.len();
    let min_objects = request.min_objects.min(offered);
    let conjunction = list(any_of(conditions), least, most);
    Some(closed(&[
        (
            "scene_graph",
            closed(&[
                ("description", text()),
                ("edges", list(objects.edge(), min_objects.div_ceil(2), EDGES_PER_OBJECT * offered)),
                ("nodes", list(objects.node(), min_objects, offered)),
            ]),
        ),
        ("instruction", text()),
        ("goal_conditions", list(conjunction, 1, MAX_ALTERNATIVES)),
    ]))
}

/// The offered objects, and the ids of objects and surfaces.
struct Objects<'a> {
    ids: Vec<ReferenceId>,
    offered: &'a [ObjectCard],
}

impl Objects<'_> {
    fn edge(&self) -> Value {
        let shape = |subjects: &[&str], references: &[&str]| {
            closed(&[
                ("obj1", text()),
                ("obj1_uid", one_of(subjects)),
                ("position", one_of(&POSITIONS)),
                ("obj2", text()),
                ("obj2_uid", one_of(references)),
            ])
        };
        any_of(self.by_subject(&|_| true, &shape))
    }

    fn node(&self) -> Value {
        let (stateless, others): (Vec<_>, Vec<_>) = self.known().partition(|(_, card)| card.states.is_empty());
        let node = |ids: &[&str], states: &[&str]| closed(&[("obj_uid", one_of(ids)), ("state", one_of(states))]);
        let ids: Vec<&str> = stateless.iter().map(|(id, _)| *id).collect();
        let plain = (!ids.is_empty()).then(|| node(&ids, &["none"]));
        any_of(plain.into_iter().chain(others.iter().map(|(id, card)| node(&[*id], &states(card)))).collect())
    }

    /// Schemas of the conditions that a kind of task may have.
    fn conditions(&self, kind: TaskKind) -> Vec<Value> {
        let place = |subjects: &[&str], references: &[&str]| {
            closed(&[
                ("obj1", text()),
                ("obj1_uid", one_of(subjects)),
                ("obj1_state", one_of(&["none"])),
                ("obj2", text()),
                ("obj2_uid", one_of(references)),
                ("position", one_of(&POSITIONS)),
            ])
        };
        let state = |(id, card): (&str, &ObjectCard)| {
            closed(&[
                ("obj1", text()),
                ("obj1_uid", one_of(&[id])),
                ("obj1_state", one_of(&states(card))),
                ("obj2", one_of(&["none"])),
                ("obj2_uid", one_of(&["none"])),
                ("position", one_of(&["none"])),
            ])
        };
        let places = || self.by_subject(&|card| card.can_grasp && !card.is_articulated, &place);
        let states = || self.known().filter(|(_, card)| !card.states.is_empty()).map(state).collect::<Vec<_>>();
        match kind {
            TaskKind::Articulated => states(),
            TaskKind::LongHorizon => [places(), states()].concat(),
            TaskKind::PickAndPlace | TaskKind::Spatial | TaskKind::Appearance | TaskKind::CommonSense => places(),
        }
    }

    /// Offered objects, each with its id.
    fn known(&self) -> impl Iterator<Item = (&str, &ObjectCard)> {
        self.ids.iter().map(ReferenceId::as_str).zip(self.offered)
    }

    /// Schemas of relations between two different objects, one per subject up to [`MAX_SUBJECTS`].
    fn by_subject(
        &self,
        is_subject: &dyn Fn(&ObjectCard) -> bool,
        shape: &dyn Fn(&[&str], &[&str]) -> Value,
    ) -> Vec<Value> {
        let subjects: Vec<&str> = self.known().filter(|(_, card)| is_subject(card)).map(|(id, _)| id).collect();
        if subjects.is_empty() || self.ids.len() < 2 {
            return Vec::new();
        }
        let others = |subject: Option<&str>| -> Vec<&str> {
            self.ids.iter().map(ReferenceId::as_str).filter(|id| Some(*id) != subject).collect()
        };
        match subjects.len() <= MAX_SUBJECTS {
            true => subjects.iter().map(|&subject| shape(&[subject], &others(Some(subject)))).collect(),
            false => vec![shape(&subjects, &others(None))],
        }
    }
}

fn states(card: &ObjectCard) -> Vec<&str> {
    card.states.iter().map(String::as_str).collect()
}

fn text() -> Value {
    json!({"type": "string"})
}

fn one_of(values: &[&str]) -> Value {
    json!({"type": "string", "enum": values})
}

fn list(items: Value, least: usize, most: usize) -> Value {
    json!({"type": "array", "items": items, "minItems": least, "maxItems": most})
}

/// Schema of a JSON object with exactly these fields, in this order.
fn closed(fields: &[(&str, Value)]) -> Value {
    let properties: serde_json::Map<String, Value> =
        fields.iter().map(|(name, schema)| ((*name).to_owned(), schema.clone())).collect();
    let required: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
    json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
}

fn any_of(mut shapes: Vec<Value>) -> Value {
    match shapes.len() {
        1 => shapes.remove(0),
        _ => json!({"anyOf": shapes}),
    }
}
