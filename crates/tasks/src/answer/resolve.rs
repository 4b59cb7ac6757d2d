//! Resolution of names, uids, positions and states.

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{
    Atom, Goal, GraphEdge, GraphNode, InstanceId, NamedSurface, ReferenceId, Relation, RelationKind, SceneGraph,
    Support, Task,
};

use super::TaskRequest;
use super::decode::{RawAnswer, RawCondition, RawEdge, RawNode, RawObject};
use super::flaw::{Findings, FlawKind};
use super::words::{is_table, relation, relation_words, same_name, shortened};

/// A resolved answer; objects are indices into the offered ids. Unresolvable parts are omitted, each with its flaw, so
/// that the rules can check the rest.
pub(super) struct Draft {
    pub instruction: String,
    pub description: String,
    pub alternatives: Vec<Vec<Condition>>,
    pub edges: Vec<Edge>,
    pub nodes: Vec<Node>,
    /// Number of conditions per alternative as written, including omitted ones.
    pub written_conditions: Vec<usize>,
    /// Number of nodes as written, including omitted ones.
    pub written_nodes: usize,
    /// True if an edge was omitted because of an unknown object.
    pub lost_edges: bool,
    /// Objects with a dropped edge that put them on the table: they count as placed.
    pub on_table: Vec<usize>,
}

/// A condition with exactly one test.
pub(super) struct Condition {
    pub subject: usize,
    pub test: Test,
    /// State given beside a relation, `None` if there is none; allowed only if it is the initial state.
    pub beside: Option<String>,
    pub path: String,
}

/// Relation or state that a condition requires.
#[derive(Clone, PartialEq)]
pub(super) enum Test {
    /// Relation, reference and, for `between`, the second reference.
    Relation(Relation, usize, Option<usize>),
    State(String),
}

/// A relation of the initial graph.
pub(super) struct Edge {
    pub subject: usize,
    pub relation: Relation,
    pub reference: usize,
    /// Second reference of `between`; `None` for all other relations.
    pub second: Option<usize>,
    pub path: String,
}

/// An object of the initial graph.
pub(super) struct Node {
    pub object: usize,
    pub state: Option<String>,
    pub path: String,
}

impl Draft {
    /// Ids of the offered objects in the task: the plain uid if only one instance of the asset is in the scene.
    fn instances(&self, request: &TaskRequest) -> Vec<InstanceId> {
        let uid = |index: usize| request.offered.get(index).map(|card| &card.uid);
        let alone = |index: usize| self.nodes.iter().filter(|node| uid(node.object) == uid(index)).count() == 1;
        let ids = request.instances().into_iter().enumerate();
        ids.map(|(index, id)| if alone(index) { InstanceId::new(&id.asset(), 1) } else { id }).collect()
    }

    /// Surfaces to which goal and graph refer, in the order of the request.
    fn surfaces(&self, request: &TaskRequest) -> Vec<NamedSurface> {
        let goal = self.alternatives.iter().flatten().filter_map(|condition| match condition.test {
            Test::Relation(_, reference, _) => Some(reference),
            Test::State(_) => None,
        });
        let named: BTreeSet<usize> = goal.chain(self.edges.iter().map(|edge| edge.reference)).collect();
        let surfaces = request.surfaces.iter().enumerate();
        surfaces
            .filter(|(index, _)| named.contains(&(request.offered.len() + index)))
            .map(|(_, one)| one.clone())
            .collect()
    }

    /// The task; `None` if an essential part could not be resolved.
    pub fn to_task(&self, request: &TaskRequest) -> Option<Task> {
        let instances = self.instances(request);
        let instance = |index: usize| instances.get(index).cloned();
        let reference = |index: usize| match instance(index) {
            Some(id) => Some(id.into()),
            None => request.surfaces.get(index - instances.len()).map(|surface| surface.id.clone().into()),
        };
        let atom = |condition: &Condition| match &condition.test {
            Test::Relation(relation, first, second) => Some(Atom::Relation {
                subject: instance(condition.subject)?,
                relation: *relation,
                reference: reference(*first)?,
                second_reference: second.and_then(reference),
            }),
            Test::State(state) => Some(Atom::State { object: instance(condition.subject)?, state: state.clone() }),
        };
        let alternatives = self
            .alternatives
            .iter()
            .map(|conjunction| conjunction.iter().map(atom).collect::<Option<Vec<_>>>())
            .collect::<Option<Vec<_>>>()?;
        let edges = self.edges.iter().map(|edge| {
            Some(GraphEdge {
                subject: instance(edge.subject)?,
                relation: edge.relation,
                reference: reference(edge.reference)?,
                second_reference: edge.second.and_then(reference),
            })
        });
        let nodes = self
            .nodes
            .iter()
            .map(|node| {
                Some(GraphNode {
                    id: instance(node.object)?,
                    state: node.state.clone(),
                    ..GraphNode::of(request.offered.get(node.object)?)
                })
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Task {
            id: request.id.clone(),
            kind: request.kind,
            instruction: self.instruction.clone(),
            goal: Goal { alternatives },
            scene_graph: SceneGraph {
                description: self.description.clone(),
                nodes,
                edges: edges.collect::<Option<Vec<_>>>()?,
            },
            objects: self
                .nodes
                .iter()
                .filter_map(|node| Some(Arc::new(request.offered.get(node.object)?.clone())))
                .collect(),
            surfaces: self.surfaces(request),
            interchangeable: Vec::new(),
            source: request.source.clone(),
        })
    }
}

/// Resolves every part of an answer.
pub(super) fn resolve(answer: RawAnswer, request: &TaskRequest, findings: &mut Findings) -> Draft {
    let mut resolver =
        Resolver { request, ids: request.ids(), names: request.names(), seen: BTreeSet::new(), findings };
    let written_conditions = answer.alternatives.iter().map(Vec::len).collect();
    let alternatives = answer
        .alternatives
        .iter()
        .map(|conjunction| conjunction.iter().filter_map(|raw| resolver.condition(raw)).collect())
        .collect();
    let mut draft = Draft {
        instruction: answer.instruction,
        description: answer.description,
        alternatives,
        edges: Vec::new(),
        nodes: answer.nodes.iter().filter_map(|raw| resolver.node(raw)).collect(),
        written_conditions,
        written_nodes: answer.nodes.len(),
        lost_edges: false,
        on_table: Vec::new(),
    };
    for raw in &answer.edges {
        match resolver.edge(raw) {
            EdgeReading::Edge(edge) => draft.edges.push(edge),
            EdgeReading::OnTable(objects) => draft.on_table.extend(objects),
            EdgeReading::Dropped => {}
            EdgeReading::Unreadable => draft.lost_edges = true,
        }
    }
    draft
}

/// Meaning of an object reference in an answer.
enum Named {
    Object(usize),
    Table,
    Absent,
    /// Invalid reference whose flaw is already recorded.
    Unreadable,
}

/// Error value for an invalid part whose flaw is already recorded.
struct Noted;

/// Meaning of an edge in an answer.
enum EdgeReading {
    Edge(Edge),
    OnTable(Vec<usize>),
    Dropped,
    Unreadable,
}

struct Resolver<'a> {
    request: &'a TaskRequest,
    /// Ids of the offered objects and surfaces.
    ids: Vec<ReferenceId>,
    /// Names of the offered objects and surfaces.
    names: Vec<&'a str>,
    /// Flaws already recorded, so that a wrong uid is one flaw however often it occurs.
    seen: BTreeSet<(FlawKind, String)>,
    findings: &'a mut Findings,
}

impl Resolver<'_> {
    fn condition(&mut self, raw: &RawCondition) -> Option<Condition> {
        let subject = self.object(&raw.subject);
        let reference = self.object(&raw.reference);
        let relation = raw.position.as_deref().map(|word| self.relation(word, &raw.path));
        let incomplete = |findings: &mut Findings, message: &str| {
            let hint = "a condition is a relation (obj1, position, obj2) or a state (obj1, obj1_state)";
            findings.reject(FlawKind::IncompleteCondition, raw.path.as_str(), message, hint);
        };
        let subject = match subject {
            Named::Object(index) => index,
            Named::Unreadable => return None,
            Named::Absent => {
                incomplete(self.findings, "expected an object in obj1, got none");
                return None;
            }
            Named::Table => return self.goal_on_table(&raw.subject.path),
        };
        let mut beside = None;
        let test = match (relation, reference, &raw.state) {
            (Some(None), ..) | (_, Named::Unreadable, _) => return None,
            (_, Named::Table, _) => return self.goal_on_table(&raw.reference.path),
            (Some(Some(relation)), Named::Object(reference), state) => {
                if let Some(state) = state {
                    beside = Some(self.state(subject, state, &raw.path)?);
                }
                let second = self.second(relation, raw.second.as_ref(), &raw.path).ok()?;
                let relation = self.check_surfaces(subject, relation, [Some(reference), second], &raw.path).ok()?;
                Test::Relation(relation, reference, second)
            }
            (None, Named::Absent, Some(state)) => Test::State(self.state(subject, state, &raw.path)?),
            (None, Named::Absent, None) => {
                incomplete(self.findings, "expected a relation or a state, got neither");
                return None;
            }
            (Some(Some(_)), Named::Absent, _) => {
                incomplete(self.findings, "expected an object in obj2 for the position, got none");
                return None;
            }
            (None, Named::Object(_), _) => {
                incomplete(self.findings, "expected a position for obj2, got none");
                return None;
            }
        };
        Some(Condition { subject, test, beside, path: raw.path.clone() })
    }

    fn edge(&mut self, raw: &RawEdge) -> EdgeReading {
        let subject = self.object(&raw.subject);
        let reference = self.object(&raw.reference);
        if matches!(subject, Named::Table) || matches!(reference, Named::Table) {
            let message = "expected two objects, got an edge to the table";
            self.findings.repair(
                FlawKind::EdgeOnTable,
                raw.path.as_str(),
                message,
                "dropped: objects stand on the table",
            );
            let objects = [subject, reference].into_iter().filter_map(|named| match named {
                Named::Object(index) => Some(index),
                _ => None,
            });
            return EdgeReading::OnTable(objects.collect());
        }
        if matches!(subject, Named::Absent) || matches!(reference, Named::Absent) {
            let message = "expected two objects, got an edge with \"none\"";
            self.findings.repair(FlawKind::MissingEdgeObject, raw.path.as_str(), message, "dropped");
            return EdgeReading::Dropped;
        }
        let Some(position) = raw.position.as_deref() else {
            let message = "expected a position, got none";
            self.findings.reject(FlawKind::MissingRelation, raw.path.as_str(), message, relation_words());
            return EdgeReading::Unreadable;
        };
        match (subject, self.relation(position, &raw.path), reference) {
            (Named::Object(subject), Some(relation), Named::Object(reference)) => {
                let Ok(second) = self.second(relation, raw.second.as_ref(), &raw.path) else {
                    return EdgeReading::Unreadable;
                };
                match self.check_surfaces(subject, relation, [Some(reference), second], &raw.path) {
                    Ok(relation) => {
                        EdgeReading::Edge(Edge { subject, relation, reference, second, path: raw.path.clone() })
                    }
                    Err(Noted) => EdgeReading::Unreadable,
                }
            }
            _ => EdgeReading::Unreadable,
        }
    }

    /// The second reference; `None` for relations to one reference.
    fn second(&mut self, relation: Relation, raw: Option<&RawObject>, path: &str) -> Result<Option<usize>, Noted> {
        if !relation.has_two_references() {
            return Ok(None);
        }
        match raw.map(|raw| self.object(raw)) {
            Some(Named::Object(second)) => Ok(Some(second)),
            Some(Named::Unreadable) => Err(Noted),
            Some(Named::Table | Named::Absent) | None => {
                let message = format!("expected a second object in obj3 for `{}`, got none", relation.name());
                let hint = format!("{} takes obj1, obj2 and obj3", relation.name());
                self.findings.reject(FlawKind::IncompleteCondition, path, message, hint);
                Err(Noted)
            }
        }
    }

    /// Rejects relations that a surface cannot have: it does not move, and objects can only be on or near it; `top` of
    /// one is changed to `on`, since a surface has no inside.
    fn check_surfaces(
        &mut self,
        subject: usize,
        relation: Relation,
        references: [Option<usize>; 2],
        path: &str,
    ) -> Result<Relation, Noted> {
        let is_surface = |index: &usize| self.request.is_surface(*index);
        if is_surface(&subject) {
            let message = format!("expected an object in obj1, got the {}", self.names[subject]);
            self.findings.reject(FlawKind::NotGraspable, path, message, "a support surface stays: name it in obj2");
            return Err(Noted);
        }
        let fits = match relation.kind() {
            RelationKind::Support(support) => support != Support::In,
            RelationKind::Around => true,
            RelationKind::Side(_) | RelationKind::Between => false,
        };
        let Some(index) = references.into_iter().flatten().find(is_surface) else { return Ok(relation) };
        if !fits {
            let message =
                format!("expected `on`, `top` or `near` with the {}, got `{}`", self.names[index], relation.name());
            self.findings.reject(FlawKind::UnknownRelation, path, message, "other relations are between objects");
            return Err(Noted);
        }
        Ok(if relation == Relation::Top { Relation::On } else { relation })
    }

    fn node(&mut self, raw: &RawNode) -> Option<Node> {
        let object = match self.object(&raw.object) {
            Named::Object(index) if self.request.is_surface(index) => {
                let message = format!("expected an object, got the {}", self.names[index]);
                let what = "dropped: support surfaces are always there";
                self.findings.repair(FlawKind::EdgeOnTable, raw.path.as_str(), message, what);
                return None;
            }
            Named::Object(index) => index,
            Named::Absent => {
                let message = "expected a uid, got none";
                self.findings.reject(FlawKind::MissingUid, raw.object.path.as_str(), message, "");
                return None;
            }
            Named::Table => {
                let message = "expected an object, got the table";
                self.findings.repair(
                    FlawKind::EdgeOnTable,
                    raw.path.as_str(),
                    message,
                    "dropped: the table is always there",
                );
                return None;
            }
            Named::Unreadable => return None,
        };
        // An invalid state is recorded; the node still represents its object.
        let state =
            raw.state.as_ref().map(|state| self.state(object, state, &raw.path).unwrap_or_else(|| state.clone()));
        Some(Node { object, state, path: raw.path.clone() })
    }

    fn object(&mut self, raw: &RawObject) -> Named {
        let Some(uid) = raw.uid.as_deref() else {
            return self.object_by_name(raw);
        };
        let exact = self.ids.iter().position(|id| id == uid);
        let index = match exact.or_else(|| self.respelt_uid(uid)) {
            Some(index) => index,
            None if is_table(uid) || raw.name.as_deref().is_some_and(is_table) => return Named::Table,
            None => {
                if self.first_time(FlawKind::UnknownUid, uid) {
                    let offered = &self.ids;
                    let named = raw.name.as_deref().map_or(String::new(), |name| format!(" (`{}`)", shortened(name)));
                    let message =
                        format!("expected one of the offered uids {offered:?}, got `{}`{named}", shortened(uid));
                    self.findings.reject(FlawKind::UnknownUid, raw.path.as_str(), message, "use offered objects only");
                }
                return Named::Unreadable;
            }
        };
        if exact.is_none() && self.first_time(FlawKind::UidSpelling, uid) {
            let meant = &self.ids[index];
            let message = format!("expected an offered uid, got `{}`", shortened(uid));
            self.findings.repair(FlawKind::UidSpelling, raw.path.as_str(), message, format!("read as `{meant}`"));
        }
        self.check_name(raw, index)
    }

    /// Resolves an object without a uid; unambiguous only if exactly one offered object has this name.
    fn object_by_name(&mut self, raw: &RawObject) -> Named {
        let Some(name) = raw.name.as_deref() else {
            return Named::Absent;
        };
        let named: Vec<usize> = (0..self.names.len()).filter(|&index| same_name(self.names[index], name)).collect();
        match named.as_slice() {
            [index] => {
                let message = format!("expected the uid of `{}`, got none", shortened(name));
                let what = format!("read as `{}`", self.ids[*index]);
                self.findings.repair(FlawKind::MissingUid, raw.path.as_str(), message, what);
                Named::Object(*index)
            }
            _ if is_table(name) => Named::Table,
            _ => {
                let message = format!("expected the uid of `{}`, got none", shortened(name));
                self.findings.reject(
                    FlawKind::MissingUid,
                    raw.path.as_str(),
                    message,
                    "the uid decides which object is meant",
                );
                Named::Unreadable
            }
        }
    }

    /// Rejects a name that is exactly that of another object than the uid's; shortened and reworded names are accepted.
    fn check_name(&mut self, raw: &RawObject, index: usize) -> Named {
        let Some(name) = raw.name.as_deref().filter(|name| !same_name(self.names[index], name)) else {
            return Named::Object(index);
        };
        let Some(other) = self.names.iter().position(|other| same_name(other, name)) else {
            return Named::Object(index);
        };
        let (own, other) = (&self.ids[index], &self.ids[other]);
        let message = format!("expected `{}` for uid `{own}`, got `{name}`, which is `{other}`", self.names[index]);
        if self.seen.insert((FlawKind::UidNameMismatch, format!("{own}\u{0}{other}"))) {
            self.findings.reject(FlawKind::UidNameMismatch, raw.path.as_str(), message, "name and uid must agree");
        }
        Named::Unreadable
    }

    /// Offered object whose uid differs only in case, leading zeros or O for 0; `None` if there is none or several.
    fn respelt_uid(&self, uid: &str) -> Option<usize> {
        let canonical = |text: &str| {
            let text: String = text.trim().to_ascii_lowercase();
            let (text, copy) = text.split_once('#').map_or((text.as_str(), ""), |(uid, copy)| (uid, copy));
            let digits = text.replace('o', "0");
            if !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit()) {
                let bare = digits.trim_start_matches('0');
                return (if bare.is_empty() { "0".to_owned() } else { bare.to_owned() }, copy.to_owned());
            }
            (text.to_owned(), copy.to_owned())
        };
        let wanted = canonical(uid);
        let mut matches = (0..self.ids.len()).filter(|&index| canonical(self.ids[index].as_str()) == wanted);
        matches.next().filter(|_| matches.next().is_none())
    }

    fn relation(&mut self, word: &str, path: &str) -> Option<Relation> {
        let path = format!("{path}.position");
        let is_offered = |relation: &Relation| self.request.between || !relation.has_two_references();
        if let Some(relation) = Relation::named(word).filter(is_offered) {
            return Some(relation);
        }
        let plain = word.to_ascii_lowercase().replace(['_', '-'], " ");
        let plain = plain.split_whitespace().collect::<Vec<_>>().join(" ");
        match relation(&plain) {
            Some(relation) => {
                let message = format!("expected {}, got `{}`", relation_words(), shortened(word));
                let what = format!("read as `{}`", relation.name());
                self.findings.repair(FlawKind::RelationSpelling, path, message, what);
                Some(relation)
            }
            None => {
                let message = format!("expected {}, got `{}`", relation_words(), shortened(word));
                self.findings.reject(FlawKind::UnknownRelation, path, message, "");
                None
            }
        }
    }

    fn state(&mut self, object: usize, state: &str, path: &str) -> Option<String> {
        let states = self.request.offered.get(object).map_or(&[][..], |card| &card.states);
        if states.iter().any(|known| known == state) {
            return Some(state.to_owned());
        }
        let plain = |text: &str| text.to_ascii_lowercase().replace([' ', '-'], "_");
        let mut meant = states.iter().filter(|known| plain(known) == plain(state));
        if let (Some(known), None) = (meant.next(), meant.next()) {
            let message = format!("expected one of {states:?}, got `{}`", shortened(state));
            self.findings.repair(FlawKind::StateSpelling, path, message, format!("read as `{known}`"));
            return Some(known.clone());
        }
        if self.first_time(FlawKind::UnknownState, &format!("{object}\u{0}{state}")) {
            let expected = if states.is_empty() { "none".into() } else { format!("one of {states:?}") };
            let message = format!(
                "expected {expected} as state of `{}` ({}), got `{}`",
                self.ids[object],
                self.names[object],
                shortened(state)
            );
            self.findings.reject(FlawKind::UnknownState, path, message, "states come from the object's own list");
        }
        None
    }

    fn goal_on_table(&mut self, path: &str) -> Option<Condition> {
        let message = "expected an offered object, got the table";
        self.findings.reject(FlawKind::GoalOnTable, path, message, "say where through another object");
        None
    }

    fn first_time(&mut self, kind: FlawKind, what: &str) -> bool {
        self.seen.insert((kind, what.to_owned()))
    }
}
