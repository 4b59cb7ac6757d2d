//! The reader resolves correct sentences and rejects wrong and ambiguous ones.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{
    AssetRef, Atom, GraphEdge, GraphNode, InstanceId, ObjectCard, ReferenceId, Relation, SceneGraph, Seed, Task,
    TaskKind,
};

use super::words::PLACES;
use super::{Clue, Mismatch, check, intended, interchangeable, is_needless, read, resolved};
use crate::designer::{DesignSettings, design_many};

fn card(uid: &str) -> Arc<ObjectCard> {
    Arc::new(Catalogue::builtin().card(uid).unwrap().clone())
}

/// Parses a scene from statements such as `001 left 002`, `030 between 001 002`, `057=closed`.
fn scene(facts: &[&str]) -> (Vec<Arc<ObjectCard>>, SceneGraph) {
    let mut graph = SceneGraph::default();
    let mut cards: Vec<Arc<ObjectCard>> = Vec::new();
    for fact in facts {
        let words: Vec<&str> = fact.split([' ', '=']).collect();
        for id in words.iter().filter(|word| word.chars().all(|c| c.is_ascii_digit() || c == '#')) {
            let id: InstanceId = id.parse().unwrap();
            if graph.index_of(&id).is_none() {
                let card = card(id.asset().as_str());
                graph.nodes.push(GraphNode { id, ..GraphNode::of(&card) });
                cards.push(card);
            }
        }
        if let [uid, state] = words.as_slice() {
            graph.nodes.iter_mut().find(|node| node.id == *uid).unwrap().state = Some((*state).into());
            continue;
        }
        graph.edges.push(GraphEdge {
            subject: words[0].parse().unwrap(),
            relation: serde_json::from_value(words[1].into()).unwrap(),
            reference: words[2].into(),
            second_reference: words.get(3).map(|uid| (*uid).into()),
        });
    }
    (cards, graph)
}

/// The goal that is read, as `subject relation references`, or the mismatch.
fn read_goal(instruction: &str, facts: &[&str]) -> String {
    let (cards, graph) = scene(facts);
    match read(instruction, &cards, &graph) {
        Err(mismatch) => mismatch.to_string(),
        Ok(reading) => {
            let atom = |atom: &super::ReadAtom| match atom {
                super::ReadAtom::Place { subject, relations, references } => {
                    let words: Vec<&str> = relations.iter().map(|relation| relation.name()).collect();
                    format!("{subject} {} {}", words.join("/"), references.join(" "))
                }
                super::ReadAtom::State { object, state } => format!("{object} is {state}"),
            };
            let all = |atoms: &Vec<super::ReadAtom>| atoms.iter().map(atom).collect::<Vec<_>>().join(" and ");
            reading.goal.iter().map(all).collect::<Vec<_>>().join(" or ")
        }
    }
}

#[test]
fn sentences_mean_what_a_person_would_understand() {
    let mugs = ["001 left 008", "002 right 008", "027 front 008"];
    let row = ["019 front 020", "020 front 021", "001 left 002", "002 left 021"];
    let bowls = ["005 left 006", "028 in 006", "027 right 006"];
    let doors = ["057=closed", "059=open", "057 left 059", "062=off", "062 right 059"];
    let middle = ["001 left 030", "030 left 002", "030 between 001 002", "027 right 002"];
    let cases: [(&str, &[&str], &str); 38] = [
        ("Put the red mug on the plate.", &mugs, "001 on/top 008"),
        ("Put the mug on the plate.", &mugs, r#"`mug` may be any of ["001", "002"]"#),
        ("Put the cup with the square handle on the plate.", &mugs, "002 on/top 008"),
        (
            "Put the red cup with a belt around the middle on the plate.",
            &mugs,
            "nothing is `red cup with a belt around the middle`",
        ),
        ("Put the green mug on the plate.", &mugs, "nothing is `green mug`"),
        ("Put the mug that is to the robot's left of the plate on the apple.", &mugs, "001 on/top 027"),
        (
            "Take the mug that stands to the robot's right of the plate and put it next to the apple.",
            &mugs,
            "002 near 027",
        ),
        ("Take whatever is on the far side of the plate and put it beside the blue mug.", &mugs, "027 near 002"),
        ("Put the apple to the robot's right of the red mug.", &mugs, "027 right 001"),
        ("I want the apple to be between the two mugs.", &mugs, "027 between 001 002"),
        ("Put the apple between the red mug and the blue mug.", &mugs, "027 between 001 002"),
        ("Put the banana on the plate.", &mugs, "nothing is `banana`"),
        ("Frobnicate the mug.", &mugs, "not understood: `Frobnicate the mug.`"),
        ("Put the gizmo on the plate.", &mugs, "not understood: `gizmo`"),
        ("Take the can farthest from the robot and set it next to the red mug.", &row, "019 near 001"),
        ("Take the can nearest to the camera and set it next to the red mug.", &row, "019 near 001"),
        ("Put the apple to the camera's right of the red mug.", &mugs, "027 left 001"),
        ("Take whatever is on the camera's side of the plate and put it beside the blue mug.", &mugs, "027 near 002"),
        ("Take the can nearest to the robot and set it next to the red mug.", &row, "021 near 001"),
        ("Put the middle one of the three cans between the two mugs.", &row, "020 between 001 002"),
        ("Put the mug farthest to the robot's left next to the tomato soup can.", &row, "001 near 021"),
        ("Put the can on the plate.", &row, r#"`can` may be any of ["019", "020", "021"]"#),
        ("Put the red apple in the smaller of the two bowls.", &bowls, "027 in/top 005"),
        ("Put the red apple into the larger bowl.", &bowls, "027 in/top 006"),
        ("Put the red apple into the bowl.", &bowls, r#"`bowl` may be any of ["005", "006"]"#),
        ("Take the apple that is in the salad bowl and put it in the rice bowl.", &bowls, "028 in/top 005"),
        ("Put the red apple in the rice bowl or in the wooden bowl.", &bowls, "027 in/top 005 or 027 in/top 006"),
        ("Open the top drawer of the drawer cabinet.", &doors, "057 is top_open"),
        ("Pull out both drawers of the white cabinet.", &doors, "057 is both_open"),
        ("Close the microwave and turn the faucet on.", &doors, "059 is closed and 062 is on"),
        ("Either shut the door of the microwave or turn on the faucet.", &doors, "059 is closed or 062 is on"),
        ("Open the microwave.", &doors, "not understood: `Open microwave`"),
        ("I want to wash my hands: turn on the faucet.", &doors, "062 is on"),
        ("Turn off the faucet.", &doors, "not understood: `Off faucet`"),
        ("Put the fruit that is between the two mugs on the apple.", &middle, "030 on/top 027"),
        ("Put the fruit on the red mug.", &middle, r#"`fruit` may be any of ["030", "027"]"#),
        (
            "Put the orange next to the red mug, then the apple near the blue mug.",
            &middle,
            "030 near 001 and 027 near 002",
        ),
        ("My throat is sore.", &middle, "not understood: `My throat is sore.`"),
    ];
    for (instruction, facts, expected) in cases {
        assert_eq!(read_goal(instruction, facts), expected, "{instruction}");
    }
}

#[test]
fn the_reader_knows_the_prepositions_of_every_relation() {
    for relation in Relation::ALL {
        let facts = relation.facts();
        for said in facts.located.iter().chain(facts.directed).chain([&facts.described]) {
            let meant = PLACES.iter().find(|(preposition, _)| preposition == said);
            assert!(
                meant.is_some_and(|(_, relations)| relations.contains(&relation)),
                "PLACES in references/words.rs does not read `{said}` as `{}`",
                relation.name()
            );
        }
    }
}

/// A location that fits another object in some layout is ambiguous.
#[test]
fn what_the_graph_leaves_open_is_ambiguous() {
    let put = "Take the mug that is on the far side of the teapot and put it on the plate.";
    let open = ["001 front 010", "002 left 008", "008 left 010"];
    assert_eq!(read_goal(put, &open), "001 on/top 008", "the blue mug is left of the teapot, by way of the plate");
    let open = ["001 front 010", "002 near 008", "008 left 010"];
    assert!(read_goal(put, &open).contains("may be any of"), "the blue mug may be anywhere around the plate");
}

fn tasks(seed: u64, count: usize) -> Vec<Task> {
    let cards = Catalogue::builtin().cards();
    design_many(&TaskKind::ALL, count, cards, Seed::new(seed), &DesignSettings::default()).unwrap().tasks
}

/// Exchanges two phrases in a sentence.
fn swapped(text: &str, one: &str, other: &str) -> String {
    text.replace(one, "\u{0}").replace(other, one).replace('\u{0}', other)
}

/// Every designed task reads back to its goal; corrupted in one way, it is rejected or reads back to another goal.
#[test]
fn corrupted_tasks_are_found() {
    let mut applied = [0; 7];
    for task in tasks(17, 360) {
        assert_eq!(check(&task), Ok(()), "{}", task.instruction);
        assert_eq!(resolved(&task), intended(&task).len());
        let mut corrupted: Vec<(usize, Task)> = Vec::new();
        let mut said = |index: usize, instruction: String| {
            if instruction != task.instruction {
                corrupted.push((index, Task { instruction, ..task.clone() }));
            }
        };
        said(0, swapped(&task.instruction, "robot's left", "robot's right"));
        said(1, swapped(&task.instruction, "the far side of", "the robot's side of"));
        // Where the other object only possibly belongs to the kind, the phrase may be redundant for the reader.
        let bare = task.instruction.replacen(" farthest to the robot's left", "", 1);
        if check(&Task { instruction: bare, ..task.clone() }).is_err() {
            said(2, swapped(&task.instruction, "farthest to the robot's left", "farthest to the robot's right"));
        }
        said(3, swapped(&task.instruction, "urn on", "urn off"));
        // Adds a copy of the moved object with the same relations to everything.
        let atom = task.goal.alternatives[0].iter().find(|atom| matches!(atom, Atom::Relation { .. }));
        if let Some(atom) = atom {
            let mut twin = task.clone();
            let mut card = task.card(atom.subject()).unwrap().clone();
            card.uid = "999".into();
            card.asset = AssetRef::builtin("999", 1);
            let added = GraphNode::of(&card);
            let other = |id: &ReferenceId| if id == atom.subject() { added.id.clone().into() } else { id.clone() };
            let edges = twin.scene_graph.edges.clone();
            twin.scene_graph.edges.extend(edges.iter().map(|edge| GraphEdge {
                subject: if edge.subject == *atom.subject() { added.id.clone() } else { edge.subject.clone() },
                relation: edge.relation,
                reference: other(&edge.reference),
                second_reference: edge.second_reference.as_ref().map(other),
            }));
            twin.scene_graph.nodes.push(added);
            twin.objects.push(Arc::new(card));
            corrupted.push((4, twin));
        }
        // Changes the goal instead of the sentence.
        let mut other = task.clone();
        match &mut other.goal.alternatives[0][0] {
            Atom::Relation { relation, .. } => {
                *relation = if *relation == Relation::Near { Relation::In } else { Relation::Near };
            }
            Atom::State { object, .. } => *object = InstanceId::new(&"999".into(), 1),
        }
        corrupted.push((5, other));
        if task.goal.alternatives.len() > 1 {
            let mut fewer = task.clone();
            fewer.goal.alternatives.pop();
            corrupted.push((6, fewer));
        }
        for (index, corrupted) in corrupted {
            // A sentence with both sides as alternatives means the same if the sides are exchanged.
            let offers_both = index < 2 && task.goal.alternatives.len() > 1;
            if !offers_both {
                applied[index] += 1;
                assert!(
                    check(&corrupted).is_err(),
                    "mutant {index} of {:?}: {}",
                    task.instruction,
                    corrupted.instruction
                );
            }
        }
    }
    assert!(applied.iter().all(|count| *count > 0), "{applied:?}");
}

/// A phrase that fits several identical copies leaves the choice open; a relation singles one out.
#[test]
fn identical_copies_are_one_thing_to_say_and_two_to_choose_from() {
    let mugs = ["001 left 008", "001#2 right 008", "027 front 008"];
    for (instruction, goal, groups) in [
        ("Put the red mug on the far side of the apple.", "001 front 027", "001/001#2"),
        ("Put the mug that is to the robot's left of the plate near the apple.", "001 near 027", ""),
        ("Put the mug farthest to the robot's right near the apple.", "001#2 near 027", ""),
        ("Put the apple near the red mug.", "027 near 001", "001/001#2"),
        ("Put the apple near the mug that is to the robot's right of the plate.", "027 near 001#2", ""),
    ] {
        let (objects, scene_graph) = scene(&mugs);
        let reading = read(instruction, &objects, &scene_graph);
        assert_eq!(read_goal(instruction, &mugs), goal, "{instruction}: {reading:?}");
        let words: Vec<&str> = goal.split(' ').collect();
        let atom = Atom::Relation {
            subject: words[0].parse().unwrap(),
            relation: serde_json::from_value(words[1].into()).unwrap(),
            reference: words[2].into(),
            second_reference: None,
        };
        let mut task = Task {
            id: "t".into(),
            kind: TaskKind::PickAndPlace,
            instruction: instruction.into(),
            goal: genmanip_core::Goal { alternatives: vec![vec![atom]] },
            scene_graph,
            objects,
            surfaces: Vec::new(),
            interchangeable: Vec::new(),
            source: String::new(),
        };
        let found: Vec<String> = interchangeable(&task).iter().map(|group| group.join("/")).collect();
        assert_eq!(found.join(" "), groups, "{instruction}");
        assert_eq!(check(&task), Ok(()), "{instruction}");
        // Copies may be exchanged in the goal only where nothing distinguishes them.
        let [one, other] = [1, 2].map(|copy| InstanceId::new(&"001".into(), copy));
        let swap = std::collections::BTreeMap::from([(&*one, &other), (&*other, &one)]);
        task.goal.alternatives[0][0] = task.goal.alternatives[0][0].renamed(&swap);
        assert_eq!(check(&task).is_ok(), !groups.is_empty(), "{instruction}");
    }
}

/// An exchanged colour refers to another object or to none.
#[test]
fn another_colour_is_noticed() {
    let mut changed = 0;
    let cards = Catalogue::builtin().cards();
    let batch = design_many(&[TaskKind::Appearance], 60, cards, Seed::new(18), &DesignSettings::default()).unwrap();
    for task in &batch.tasks {
        for (one, other) in [(" red ", " blue "), (" white ", " black "), (" green ", " red "), (" brown ", " green ")]
        {
            let core = task.instruction.find(" with ").unwrap_or(task.instruction.len());
            if task.instruction[..core].contains(one) {
                let instruction = task.instruction.replacen(one, other, 1);
                let mutant = Task { instruction, ..task.clone() };
                assert!(check(&mutant).is_err(), "{}", mutant.instruction);
                changed += 1;
            }
        }
    }
    assert!(changed > 5, "{changed}");
}

#[test]
fn a_mismatch_is_one_sentence() {
    let mismatch =
        Mismatch::Ambiguous { phrase: "mug".into(), ids: vec!["001".parse().unwrap(), "002".parse().unwrap()] };
    assert_eq!(mismatch.to_string(), r#"`mug` may be any of ["001", "002"]"#);
    assert_eq!(mismatch.reason(), "an ambiguous phrase");
}

/// Redundant clues are found.
#[test]
fn clues_that_nobody_needs_are_found() {
    let two_mugs = ["001 left 008", "002 right 008", "027 front 008"];
    let one_mug = ["001 left 008", "019 right 008", "027 front 008"];
    let left = "Put the mug that is to the robot's left of the plate on the apple.";
    let farthest = "Put the mug farthest to the robot's left on the apple.";
    for (instruction, facts, clue, needless) in [
        (left, two_mugs, Clue::Place, false),
        (left, one_mug, Clue::Place, true),
        (farthest, two_mugs, Clue::Place, false),
        (farthest, one_mug, Clue::Place, true),
        ("Put the red mug on the apple.", two_mugs, Clue::Trait, false),
        ("Put the red mug on the apple.", one_mug, Clue::Trait, true),
        ("Put the mug with the rounded handle on the red apple.", two_mugs, Clue::Trait, false),
    ] {
        let (objects, scene_graph) = scene(&facts);
        let on = Atom::Relation {
            subject: "001".parse().unwrap(),
            relation: Relation::On,
            reference: "027".into(),
            second_reference: None,
        };
        let task = Task {
            id: "t".into(),
            kind: TaskKind::Spatial,
            instruction: instruction.into(),
            goal: genmanip_core::Goal { alternatives: vec![vec![on]] },
            scene_graph,
            objects,
            surfaces: Vec::new(),
            interchangeable: Vec::new(),
            source: "test".into(),
        };
        assert_eq!(check(&task), Ok(()), "{instruction}");
        assert_eq!(is_needless(&task, clue), needless, "{instruction} {facts:?}");
    }
}

#[test]
fn most_designed_tasks_need_what_their_kind_is_about() {
    let mut counts = std::collections::BTreeMap::new();
    for task in tasks(29, 360) {
        if let Some(clue) = Clue::of(task.kind) {
            let (needless, all) = counts.entry(task.kind).or_insert((0, 0));
            *needless += usize::from(is_needless(&task, clue));
            *all += 1;
        }
    }
    assert_eq!(counts.len(), 3);
    // The designer itself rejects tasks with a redundant need.
    assert_eq!(counts[&TaskKind::CommonSense].0, 0, "{counts:?}");
    assert!(counts.values().all(|(needless, all)| 2 * needless < *all), "{counts:?}");
}
