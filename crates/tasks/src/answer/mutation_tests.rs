//! Random changes to valid answers are detected or provably harmless.
//!
//! Harmless means that the resulting task satisfies every rule according to an independent brute-force checker
//! (`violations`) and has the same meaning as the changed text. If the changed text can be read literally, the verdict
//! must equal the checker's.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{
    Atom, Goal, GraphEdge, GraphNode, InstanceId, ObjectCard, ReferenceId, Relation, SceneGraph, Seed, Task, TaskKind,
};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};
use serde_json::{Value, json};

use super::tests::{catalogue, recorded};
use super::*;

/// A relation between uids.
type Fact = (String, Relation, String);

/// All facts implied by one relation of a pair, from both sides.
fn facts_of((subject, relation, reference): &Fact) -> Vec<Fact> {
    let mut facts = vec![(subject.clone(), *relation, reference.clone())];
    let beside = match relation {
        Relation::Left => Some(Relation::Right),
        Relation::Right => Some(Relation::Left),
        Relation::Front => Some(Relation::Back),
        Relation::Back => Some(Relation::Front),
        _ => None,
    };
    if let Some(inverse) = beside {
        facts.push((reference.clone(), inverse, subject.clone()));
    }
    if beside.is_some() || *relation == Relation::Near {
        facts.push((subject.clone(), Relation::Near, reference.clone()));
        facts.push((reference.clone(), Relation::Near, subject.clone()));
    }
    if matches!(relation, Relation::On | Relation::In) {
        facts.push((subject.clone(), Relation::Top, reference.clone()));
    }
    facts
}

/// True if the relations are contradictory: two different ones for a pair, or a cycle.
fn contradict(relations: &[Fact]) -> bool {
    let uids: Vec<&String> = relations.iter().flat_map(|(one, _, other)| [one, other]).collect();
    let orders = [vec![Relation::Left], vec![Relation::Front], vec![Relation::Top, Relation::On, Relation::In]];
    let turned = |relation| match relation {
        Relation::Right => Some(Relation::Left),
        Relation::Back => Some(Relation::Front),
        _ => None,
    };
    let mut kinds: BTreeMap<BTreeSet<&String>, BTreeSet<usize>> = BTreeMap::new();
    for (order, words) in orders.iter().enumerate() {
        let mut reach: BTreeSet<(&String, &String)> = BTreeSet::new();
        for (one, relation, other) in relations {
            if words.contains(relation) {
                reach.insert((one, other));
            } else if turned(*relation).is_some_and(|relation| words.contains(&relation)) {
                reach.insert((other, one));
            } else {
                continue;
            }
            kinds.entry([one, other].into()).or_default().insert(order);
        }
        for middle in &uids {
            for from in &uids {
                for to in &uids {
                    if reach.contains(&(from, middle)) && reach.contains(&(middle, to)) {
                        reach.insert((from, to));
                    }
                }
            }
        }
        if uids.iter().any(|uid| reach.contains(&(uid, uid))) {
            return true;
        }
    }
    for (one, _, other) in relations.iter().filter(|(_, relation, _)| *relation == Relation::Near) {
        kinds.entry([one, other].into()).or_default().insert(3);
    }
    kinds.values().any(|kinds| kinds.is_superset(&[0, 1].into()) || (kinds.contains(&2) && kinds.len() > 1))
}

/// Rules that a task violates, determined without any code of the validator.
fn violations(task: &Task, request: &TaskRequest) -> Vec<String> {
    let mut broken = Vec::new();
    let mut rule = |holds: bool, name: &str| {
        if !holds {
            broken.push(name.to_owned());
        }
    };
    let card = |uid: &str| request.offered.iter().find(|card| card.uid == uid);
    let words = task.instruction.split(char::is_whitespace).filter(|word| !word.is_empty()).count();
    rule((1..=30).contains(&words), "instruction of 1 to 30 words");
    let nodes = &task.scene_graph.nodes;
    let state_of: BTreeMap<&str, Option<&str>> =
        nodes.iter().map(|node| (node.id.as_str(), node.state.as_deref())).collect();
    rule(state_of.len() == nodes.len(), "one node per object");
    rule(nodes.len() >= request.min_objects, "enough nodes");
    let known_state = |uid: &str, state: &str| card(uid).is_some_and(|card| card.states.iter().any(|own| own == state));
    for node in nodes {
        rule(card(node.id.as_str()).is_some(), "offered");
        rule(node.state.as_deref().is_none_or(|state| known_state(node.id.as_str(), state)), "state of the object");
    }
    let fact = |subject: &InstanceId, relation: Relation, reference: &ReferenceId| {
        (subject.to_string(), relation, reference.to_string())
    };
    let edges: Vec<Fact> =
        task.scene_graph.edges.iter().map(|edge| fact(&edge.subject, edge.relation, &edge.reference)).collect();
    for (index, edge) in task.scene_graph.edges.iter().enumerate().filter(|(_, edge)| edge.relation.is_support()) {
        let is_other = |other: &&GraphEdge| {
            other.subject == edge.subject && other.relation.is_support() && other.reference != edge.reference
        };
        rule(!task.scene_graph.edges[..index].iter().any(|other| is_other(&other)), "one support");
    }
    let mut sound_relation = |(subject, relation, reference): &Fact| {
        rule(
            state_of.contains_key(subject.as_str()) && state_of.contains_key(reference.as_str()),
            "nodes of a relation",
        );
        rule(subject != reference, "two objects");
        rule(*relation != Relation::In || card(reference).is_some_and(|card| card.is_container), "container");
    };
    edges.iter().for_each(&mut sound_relation);
    let initial: BTreeSet<Fact> = edges.iter().flat_map(facts_of).collect();
    let mut alternatives = Vec::new();
    for conjunction in &task.goal.alternatives {
        let (mut relations, mut states) = (Vec::new(), Vec::new());
        for atom in conjunction {
            match atom {
                Atom::Relation { subject, relation, reference, .. } => {
                    relations.push(fact(subject, *relation, reference))
                }
                Atom::State { object, state } => states.push((object.as_str(), state.as_str())),
            }
        }
        relations.iter().for_each(&mut sound_relation);
        alternatives.push((relations, states));
    }
    rule(!contradict(&edges), "consistent graph");
    rule(!alternatives.is_empty(), "a goal");
    for (relations, states) in &alternatives {
        rule(!(relations.is_empty() && states.is_empty()), "a condition");
        let already = |fact: &Fact| initial.contains(fact);
        let carried = |(subject, ..): &Fact| card(subject).is_some_and(|card| card.can_grasp);
        rule(relations.iter().all(|fact| already(fact) || carried(fact)), "graspable");
        rule(!contradict(relations), "consistent goal");
        for (object, state) in states {
            rule(known_state(object, state), "state of the object");
            rule(state_of.get(object).is_some_and(Option::is_some), "initial state");
            rule(states.iter().all(|(other, own)| other != object || own == state), "one state at a time");
        }
        let holds = relations.iter().all(already)
            && states.iter().all(|(object, state)| state_of.get(object) == Some(&Some(*state)));
        rule(!holds, "false at the start");
        let fits = match request.kind {
            TaskKind::Articulated => !states.is_empty(),
            TaskKind::LongHorizon => relations.len() + states.len() >= 2,
            _ => states.is_empty(),
        };
        rule(fits, "kind");
    }
    broken
}

/// Task of a text read literally; `None` if interpretation is needed. The flag is true if every object has an edge and
/// every name matches its uid.
fn read_literally(answer: &Value, request: &TaskRequest) -> Option<(Task, bool)> {
    let keys = |value: &Value, wanted: &[&str]| {
        value
            .as_object()
            .is_some_and(|map| map.len() == wanted.len() && wanted.iter().all(|key| map.contains_key(*key)))
    };
    let graph = &answer["scene_graph"];
    let shaped = keys(answer, &["instruction", "goal_conditions", "scene_graph"])
        && keys(graph, &["description", "edges", "nodes"]);
    let exact = |value: &Value, key: &str| {
        let text = value[key].as_str()?;
        (text == text.trim() && !text.is_empty()).then(|| (text != "none").then(|| text.to_owned()))
    };
    let mut names_fit = true;
    // An object by its uid; the name must not be that of another offered object.
    let mut object = |value: &Value, name: &str, uid: &str| {
        let (name, uid) = (exact(value, name)?, exact(value, uid)??);
        let card = request.offered.iter().find(|card| card.uid == uid.as_str())?;
        let is = |card: &ObjectCard| name.as_ref().is_some_and(|name| card.name.eq_ignore_ascii_case(name));
        names_fit &= is(card) || !request.offered.iter().any(is);
        Some(InstanceId::new(&card.uid, 1))
    };
    let word =
        |value: &Value| Relation::OF_PAIRS.into_iter().find(|word| value["position"].as_str() == Some(word.name()));
    let mut nodes = Vec::new();
    for node in graph["nodes"].as_array()? {
        let known = keys(node, &["obj_uid", "state"]).then(|| (exact(node, "obj_uid"), exact(node, "state")))?;
        let (uid, state) = (known.0??, known.1?);
        let card = request.offered.iter().find(|card| card.uid == uid.as_str())?;
        if state.as_ref().is_some_and(|state| !card.states.contains(state)) {
            return None;
        }
        nodes.push(GraphNode { state, ..GraphNode::of(card) });
    }
    let mut edges = Vec::new();
    for edge in graph["edges"].as_array()? {
        keys(edge, &["obj1", "obj1_uid", "position", "obj2", "obj2_uid"]).then_some(())?;
        edges.push(GraphEdge {
            subject: object(edge, "obj1", "obj1_uid")?,
            relation: word(edge)?,
            reference: object(edge, "obj2", "obj2_uid")?.into(),
            second_reference: None,
        });
    }
    // A missing node of an object without states says nothing that its edge does not say.
    for card in request.offered.iter().filter(|card| card.states.is_empty()) {
        let node = GraphNode::of(card);
        let is_in_edge = edges.iter().any(|edge| edge.subject == node.id || edge.reference == node.id);
        if is_in_edge && !nodes.iter().any(|other: &GraphNode| other.id == node.id) {
            nodes.push(node);
        }
    }
    let mut alternatives = Vec::new();
    for conjunction in answer["goal_conditions"].as_array()? {
        let mut atoms = Vec::new();
        for condition in conjunction.as_array()? {
            keys(condition, &["obj1", "obj1_uid", "obj1_state", "obj2", "obj2_uid", "position"]).then_some(())?;
            let subject = object(condition, "obj1", "obj1_uid")?;
            let absent = ["obj2", "obj2_uid", "position"].iter().all(|key| condition[*key] == "none");
            atoms.push(match exact(condition, "obj1_state")? {
                Some(state) if absent => {
                    let card = request.offered.iter().find(|card| subject == card.uid.as_str())?;
                    card.states.contains(&state).then_some(Atom::State { object: subject, state })?
                }
                None => Atom::Relation {
                    subject,
                    relation: word(condition)?,
                    reference: object(condition, "obj2", "obj2_uid")?.into(),
                    second_reference: None,
                },
                Some(_) => return None,
            });
        }
        alternatives.push(atoms);
    }
    let placed = nodes.iter().all(|node| edges.iter().any(|edge| edge.subject == node.id || edge.reference == node.id));
    let distinct = nodes.iter().map(|node| &node.id).collect::<BTreeSet<_>>().len() == nodes.len();
    let instruction = answer["instruction"].as_str()?.trim().to_owned();
    let description = graph["description"].as_str()?.trim().to_owned();
    let objects =
        nodes.iter().filter_map(|node| request.offered.iter().find(|card| node.id == card.uid.as_str()).cloned());
    let task = Task {
        id: request.id.clone(),
        kind: request.kind,
        instruction,
        goal: Goal { alternatives },
        objects: objects.map(std::sync::Arc::new).collect(),
        scene_graph: SceneGraph { description, nodes, edges },
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: request.source.clone(),
    };
    (shaped && distinct).then_some((task, placed && names_fit))
}

/// Kinds of changes.
const CHANGES: [&str; 22] = [
    "drop a uid",
    "unknown uid",
    "offered uid",
    "flip relation",
    "other relation",
    "close cycle",
    "swap ids",
    "rename",
    "delete node",
    "delete edge",
    "goal into graph",
    "graph into goal",
    "change state",
    "number",
    "wrong type",
    "long instruction",
    "repeat node",
    "drop key",
    "extra key",
    "table",
    "reverse edge",
    "delete condition",
];

/// Applies a change of the given kind; no effect if nothing of that kind exists.
fn change(answer: &mut Value, kind: &str, offered: &[ObjectCard], rng: &mut impl Rng) {
    let pick = |list: &Value, rng: &mut dyn Rng| {
        let count = list.as_array().map_or(0, Vec::len);
        (count > 0).then(|| rng.random_range(0..count))
    };
    let goal_at = |answer: &Value, rng: &mut dyn Rng| {
        let alternative = pick(&answer["goal_conditions"], rng)?;
        Some((alternative, pick(&answer["goal_conditions"][alternative], rng)?))
    };
    let uid = offered.choose(rng).map_or("001", |card| card.uid.as_str()).to_owned();
    let word = Relation::OF_PAIRS[rng.random_range(0..Relation::OF_PAIRS.len())].name();
    let (edge, node, condition) =
        (pick(&answer["scene_graph"]["edges"], rng), pick(&answer["scene_graph"]["nodes"], rng), goal_at(answer, rng));
    let in_goal = rng.random_bool(0.4);
    let edge_keys = ["obj1", "obj1_uid", "position", "obj2", "obj2_uid"];
    // An edge or a condition.
    let mut link = Value::Null;
    let link: &mut Value = match (in_goal, edge, condition) {
        (true, _, Some((one, two))) => &mut answer["goal_conditions"][one][two],
        (_, Some(edge), _) => &mut answer["scene_graph"]["edges"][edge],
        _ => &mut link,
    };
    let side = ["obj1_uid", "obj2_uid"][rng.random_range(0..2)];
    let inverse = |word: &Value| match word.as_str() {
        Some("left") => "right",
        Some("right") => "left",
        Some("front") => "back",
        Some("back") => "front",
        _ => "near",
    };
    let odd = [json!(-1), json!(1e300), json!(9_007_199_254_740_993_u64), json!(0.5), json!(27), Value::Null];
    let wrong = [json!([]), json!({}), json!(true), json!(3), Value::Null, json!("")];
    match kind {
        "drop a uid" => link[side] = json!("none"),
        "unknown uid" => link[side] = json!("999"),
        "offered uid" => link[side] = json!(uid),
        "flip relation" => link["position"] = json!(inverse(&link["position"])),
        "other relation" => link["position"] = json!(word),
        "number" => link[side] = odd[rng.random_range(0..odd.len())].clone(),
        "rename" => link["obj1"] = json!(offered.choose(rng).map_or("", |card| card.name.as_str())),
        "swap ids" | "reverse edge" => {
            let (one, other) = (link["obj1_uid"].take(), link["obj2_uid"].take());
            (link["obj1_uid"], link["obj2_uid"]) = (other, one);
            if kind == "reverse edge" {
                link["position"] = json!(inverse(&link["position"]));
            }
        }
        "table" => (link["obj2"], link["obj2_uid"]) = (json!("table"), json!("none")),
        "wrong type" => {
            let key = ["obj1", "obj1_uid", "position", "obj2"][rng.random_range(0..4)];
            link[key] = wrong[rng.random_range(0..wrong.len())].clone();
        }
        "drop key" => {
            link.as_object_mut().map(|map| map.remove(side));
        }
        "extra key" => link["confidence"] = json!(0.9),
        "close cycle" => {
            if let Some(edge) = edge {
                let mut back = answer["scene_graph"]["edges"][edge].clone();
                let (one, other) = (back["obj1_uid"].take(), back["obj2_uid"].take());
                (back["obj1_uid"], back["obj2_uid"], back["obj1"], back["obj2"]) =
                    (other, one, json!("none"), json!("none"));
                if let Some(list) = answer["scene_graph"]["edges"].as_array_mut() {
                    list.push(back)
                }
            }
        }
        "delete node" | "delete edge" | "repeat node" => {
            let (key, index) = if kind == "delete edge" { ("edges", edge) } else { ("nodes", node) };
            if let (Some(index), Some(list)) = (index, answer["scene_graph"][key].as_array_mut()) {
                if kind == "repeat node" { list.push(list[index].clone()) } else { drop(list.remove(index)) }
            }
        }
        "goal into graph" => {
            if let Some((one, two)) = condition {
                let from = &answer["goal_conditions"][one][two];
                let edge: serde_json::Map<String, Value> =
                    edge_keys.iter().map(|key| ((*key).to_owned(), from[*key].clone())).collect();
                if let Some(list) = answer["scene_graph"]["edges"].as_array_mut() {
                    list.push(edge.into())
                }
            }
        }
        "graph into goal" => {
            if let Some(edge) = edge {
                let mut copy = answer["scene_graph"]["edges"][edge].clone();
                copy["obj1_state"] = json!("none");
                if let Some(list) = answer["goal_conditions"].as_array_mut() {
                    list.push(json!([copy]))
                }
            }
        }
        "delete condition" => {
            if let Some((one, two)) = condition
                && let Some(list) = answer["goal_conditions"][one].as_array_mut()
            {
                list.remove(two);
            }
        }
        "change state" => {
            let states: Vec<&String> = offered.iter().flat_map(|card| &card.states).collect();
            let state = states.choose(rng).map_or("open", |state| state.as_str());
            match (in_goal, condition, node) {
                (true, Some((one, two)), _) => answer["goal_conditions"][one][two]["obj1_state"] = json!(state),
                (_, _, Some(node)) => answer["scene_graph"]["nodes"][node]["state"] = json!(state),
                _ => {}
            }
        }
        "long instruction" => answer["instruction"] = json!("put ".repeat(rng.random_range(0..40))),
        other => panic!("no change is called {other}"),
    }
}

/// Number of conditions in each conjunction of a text.
fn written(answer: &Value) -> Vec<usize> {
    let count = |list: &Value| list.as_array().map_or(0, Vec::len);
    answer["goal_conditions"].as_array().map(|list| list.iter().map(count).collect()).unwrap_or_default()
}

#[test]
fn changes_to_valid_answers_are_detected_or_harmless() {
    let cards = catalogue();
    let sound: Vec<(Value, TaskRequest)> = recorded()
        .iter()
        .filter(|(_, answer)| answer.expect.as_deref() == Some("valid"))
        .map(|(name, answer)| {
            let text = &answer.response;
            let object = &text[text.find('{').unwrap()..=text.rfind('}').unwrap()];
            (serde_json::from_str(object).unwrap(), answer.request(name, &cards).unwrap())
        })
        .collect();
    let mut caught: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    let mut literal = 0;
    for index in 0..6000_u64 {
        let rng = &mut Seed::new(3).fork("mutation").fork_index(index).rng();
        let (mut answer, request) = sound.choose(rng).unwrap().clone();
        let kind = CHANGES[index as usize % CHANGES.len()];
        change(&mut answer, kind, &request.offered, rng);
        let further = [0, 0, 1, 3][rng.random_range(0..4)];
        for _ in 0..further {
            change(&mut answer, CHANGES[rng.random_range(0..CHANGES.len())], &request.offered, rng);
        }
        let report = check_answer(&answer.to_string(), &request);
        let details = || format!("{index} {kind}: {answer:#}\n{:#?}", report.flaws);
        if further == 0 {
            caught.entry(kind).or_default()[usize::from(report.task.is_none())] += 1;
        }
        if let Some(task) = &report.task {
            assert_eq!(violations(task, &request), Vec::<String>::new(), "{}", details());
            let kept: Vec<usize> = task.goal.alternatives.iter().map(Vec::len).collect();
            assert_eq!(kept, written(&answer), "a condition was lost: {}", details());
            assert_eq!(report.verdict == Verdict::Repaired, !report.repairs.is_empty(), "{}", details());
        }
        if let Some((task, placed)) = read_literally(&answer, &request) {
            literal += 1;
            let broken = violations(&task, &request);
            let agrees = crate::references::disagreement(&task).is_none();
            assert_eq!(report.task.is_some(), broken.is_empty() && placed && agrees, "{broken:?} {}", details());
            assert!(report.task.as_ref().is_none_or(|accepted| *accepted == task), "{}", details());
        }
    }
    assert!(literal > 1500, "{literal} of the changed answers could be read literally");
    for kind in ["unknown uid", "graph into goal"] {
        assert_eq!(caught[kind][0], 0, "{kind}: {caught:?}");
    }
    // A deleted node is added again unless the object has states.
    assert!(caught["delete node"].iter().all(|&count| count > 0), "{caught:?}");
    // Harmless changes are not rejected.
    for kind in ["extra key", "repeat node"] {
        assert!(caught[kind][0] > 50, "{kind}: {caught:?}");
    }
}
