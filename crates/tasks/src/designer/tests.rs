//! Properties of every design, for any seed.

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{
    AssetUid, Atom, GraphNode, InstanceId, ObjectCard, ReferenceId, Relation, SceneGraph, Seed, Task, TaskKind,
};
use proptest::prelude::*;

use super::knowledge::{Decides, handling, is_of, needs};
use super::naming::has_looks;
use super::phrasing::{capitalised, fill};
use super::things::{is_movable, things};
use super::{DesignError, DesignReport, DesignSettings, Missing, Series, design, design_many, measure};
use crate::references::{self, Mismatch, ReadAtom};
use crate::wording::changed;

fn cards() -> &'static [ObjectCard] {
    Catalogue::builtin().cards()
}

fn report(seed: u64, count: usize) -> DesignReport {
    measure(cards(), count, Seed::new(seed), &DesignSettings::default(), &mut || 0.0).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    /// Tasks are valid, understood and short, and all kinds and relations are near their quotas.
    #[test]
    fn any_seed_gives_good_tasks(seed in 0u64..1 << 40) {
        let report = report(seed, 120);
        prop_assert_eq!(&report.flaws, &Vec::<String>::new());
        prop_assert_eq!((report.tasks, report.valid), (120, 120));
        prop_assert_eq!(report.references, report.references_unique);
        prop_assert!(report.words_max <= 30);
        prop_assert!(report.distinct_instructions == 120);
        prop_assert!(report.worst_quota_deviation < 0.1, "{:?}", report.relations);
    }

    /// Single designs are as good, and objects to move can be grasped and carried.
    #[test]
    fn any_single_task_can_be_done(seed in 0u64..1 << 40, kind in 0usize..6) {
        let task = design(TaskKind::ALL[kind], cards(), Seed::new(seed), &DesignSettings::default()).unwrap();
        prop_assert!((3..=10).contains(&task.objects.len()));
        for atom in task.goal.alternatives.iter().flatten() {
            let card = task.card(atom.subject()).unwrap();
            prop_assert!(is_movable(card) || card.is_articulated, "{}", task.instruction);
        }
        for alternative in &task.goal.alternatives {
            let moved: BTreeSet<&InstanceId> = alternative.iter().map(genmanip_core::Atom::subject).collect();
            prop_assert!(moved.len() == alternative.len(), "one condition per object: {}", task.instruction);
        }
    }
}

#[test]
fn same_seed_same_tasks() {
    let batch =
        |seed, count| design_many(&TaskKind::ALL, count, cards(), Seed::new(seed), &DesignSettings::default()).unwrap();
    let (long, short) = (batch(4, 40), batch(4, 20));
    assert_eq!(long, batch(4, 40));
    assert_eq!(long.tasks[..20], short.tasks[..], "a longer batch begins with the shorter one");
    assert_ne!(long.tasks[0].instruction, batch(5, 1).tasks[0].instruction);
}

/// Tasks of the spatial kinds need their positions: every one refers to an object through another one.
#[test]
fn kinds_are_what_they_are_called() {
    let batch = design_many(&TaskKind::ALL, 360, cards(), Seed::new(6), &DesignSettings::default()).unwrap();
    for task in &batch.tasks {
        let text = task.instruction.to_lowercase();
        let goal = &task.goal.alternatives;
        match task.kind {
            TaskKind::Spatial => {
                let marks = ["that is", "that lies", "that stands", "whatever is", "farthest", "nearest", "middle one"];
                assert!(marks.iter().any(|mark| text.contains(mark)), "{text}");
            }
            TaskKind::Appearance => {
                for object in references::intended(task) {
                    let name = task.card(&object).unwrap().name.to_lowercase();
                    assert!(!text.contains(&format!("the {name} ")), "{text} names the {name}");
                }
            }
            TaskKind::CommonSense => assert!(text.matches(['.', '?']).count() >= 2, "{text} has no need"),
            TaskKind::LongHorizon => assert!(goal.iter().all(|steps| (2..=4).contains(&steps.len())), "{text}"),
            TaskKind::PickAndPlace | TaskKind::Articulated => {}
        }
    }
    let choices = |kind| batch.tasks.iter().filter(|t| t.kind == kind && t.goal.alternatives.len() > 1).count();
    for kind in [TaskKind::PickAndPlace, TaskKind::LongHorizon, TaskKind::Articulated] {
        assert!(choices(kind) > 0, "no choices among {} tasks", kind.name());
    }
}

/// All words in the tables exist in the catalogue. A misspelt one would silently never be used.
#[test]
fn tables_and_catalogue_agree() {
    let all = Catalogue::full().cards();
    let classes: BTreeSet<&String> = all.iter().filter_map(|card| Some(&things().kind(card)?.class)).collect();
    for card in all {
        assert!(things().kind(card).is_some(), "{} has no kind", card.category);
        assert!(has_looks(card), "{} has no looks", card.name);
    }
    for need in needs() {
        let known = |sort: &&String| all.iter().any(|card| is_of(sort, card));
        let unknown: Vec<&String> = need.serves.iter().chain(&need.rivals).filter(|sort| !known(sort)).collect();
        assert!(unknown.is_empty(), "nothing is {unknown:?} of {:?}", need.says);
        let unmoved: Vec<&String> =
            need.movers.iter().filter(|mover| !known(mover) && !classes.contains(mover)).collect();
        assert!(unmoved.is_empty(), "nothing is {unmoved:?} of {:?}", need.says);
    }
    for handling in handling() {
        let card = all.iter().find(|card| card.category == handling.category).unwrap();
        for state in handling.from.iter().chain([&handling.to]) {
            assert!(card.states.contains(state), "{} has no state {state}", card.name);
        }
    }
}

/// A request alone is ambiguous, the need before it makes it unique, and another need gives it another meaning.
#[test]
fn needs_decide() {
    assert!(needs().len() >= 100, "{} needs", needs().len());
    let mut used = BTreeSet::new();
    for (cards, count) in [(cards(), 60), (Catalogue::full().cards(), 240)] {
        let kinds = [TaskKind::CommonSense];
        let batch = design_many(&kinds, count, cards, Seed::new(11), &DesignSettings::default()).unwrap();
        for task in &batch.tasks {
            let text = &task.instruction;
            let (index, said) = needs()
                .iter()
                .enumerate()
                .find_map(|(index, need)| Some((index, need.says.iter().find(|said| text.starts_with(*said))?)))
                .unwrap_or_else(|| panic!("{text} has no need"));
            used.insert(index);
            let request = text[said.len()..].trim();
            let heard = |instruction: String| references::check(&Task { instruction, ..task.clone() });
            let alone = heard(request.to_owned());
            assert!(matches!(alone, Err(Mismatch::Ambiguous { .. })), "{request}: {alone:?}");
            let mut others =
                needs().iter().flat_map(|need| &need.says).filter(|other| !needs()[index].says.contains(other));
            let is_turned =
                others.any(|other| matches!(heard(format!("{other} {request}")), Err(Mismatch::OtherGoal { .. })));
            assert!(is_turned, "no other need changes what `{request}` asks for");
        }
    }
    assert!(used.len() > 100, "only {} needs are used", used.len());
}

/// The independent reader resolves every sentence of every need to the object that meets it, among objects that do not.
#[test]
fn every_need_is_understood() {
    let all = Catalogue::full().cards();
    for need in needs() {
        let met = all.iter().find(|card| need.is_met_by(card) && (need.decides == Decides::Place || is_movable(card)));
        let met = met.unwrap_or_else(|| panic!("{:?} cannot be met", need.says));
        let strangers = all.iter().filter(|card| !need.is_doubtful(card)).step_by(97).take(8);
        let cards: Vec<Arc<ObjectCard>> = std::iter::once(met).chain(strangers).cloned().map(Arc::new).collect();
        let nodes = cards.iter().map(|card| genmanip_core::GraphNode::of(card)).collect();
        let graph = genmanip_core::SceneGraph { nodes, ..Default::default() };
        for said in &need.says {
            let heard = references::read(&format!("{said} Put what I need near the right thing."), &cards, &graph);
            let phrases = heard.map(|reading| reading.phrases);
            let expected =
                ["what i need", "right thing"].map(|words| (words.to_owned(), vec![InstanceId::new(&met.uid, 1)]));
            assert_eq!(phrases, Ok(expected.to_vec()), "{said}");
        }
    }
}

/// The independent reader reads every sentence for a change of state as that change, and steps have words for it.
#[test]
fn every_change_of_state_is_understood() {
    let all = Catalogue::full().cards();
    for handling in handling() {
        let card = Arc::new(all.iter().find(|card| card.category == handling.category).unwrap().clone());
        let noun = format!("the {}", things().words(&card).unwrap().noun);
        for from in &handling.from {
            let node = GraphNode { state: Some(from.clone()), ..GraphNode::of(&card) };
            let graph = SceneGraph { nodes: vec![node], ..SceneGraph::default() };
            let expected = ReadAtom::State { object: card.uid.as_str().parse().unwrap(), state: handling.to.clone() };
            for say in &handling.say {
                let said = format!("{}.", capitalised(&fill(say, &[("y", &noun)])));
                let goal = references::read(&said, std::slice::from_ref(&card), &graph).map(|reading| reading.goal);
                assert_eq!(goal, Ok(vec![vec![expected.clone()]]), "{said} from {from}");
            }
            let step = changed(&noun, &handling.to, Some(from));
            assert!(!step.starts_with("Bring"), "{} {from} to {}: {step}", card.name, handling.to);
        }
    }
}

/// An imported object of a category that the table does not list is used by its category's name, and the independent
/// reader understands every task with it.
#[test]
fn imported_objects_of_unknown_categories_are_used() {
    let mug = cards().iter().find(|card| card.category == "mug").unwrap();
    let foreign = |category: &str, number: usize| ObjectCard {
        uid: format!("{}-0a1b2c{number}", category.replace(' ', "-")).into(),
        asset: genmanip_core::AssetRef::Imported { hash: "0a1b2c".into() },
        name: capitalised(category),
        category: category.into(),
        general_category: "imported".into(),
        ..mug.clone()
    };
    let presses = ["garlic press", "gnome", "scissors"].map(|category| foreign(category, 0));
    let others = presses.iter().flat_map(|press| (1..8).map(|number| foreign(&press.category, number)));
    let listed = cards().iter().filter(|card| card.category != "mug").step_by(10).cloned();
    let all: Vec<ObjectCard> = listed.chain(presses.iter().cloned()).chain(others).collect();
    let settings = DesignSettings::default();
    let tasks = design_many(&[TaskKind::Spatial], 60, &all, Seed::new(5), &settings).unwrap();
    for press in &presses {
        let involved = |task: &&Task| {
            let atoms = task.goal.alternatives.iter().flatten();
            atoms
                .map(genmanip_core::Atom::subject)
                .any(|id| task.card(id).is_some_and(|card| card.category == press.category))
        };
        let named = tasks.tasks.iter().filter(involved).filter(|task| task.instruction.contains(&press.category));
        assert!(named.count() > 0, "{}", press.category);
    }
    // The same card of the catalogue itself would be a mistake in the table.
    assert!(things().kind(&ObjectCard { asset: mug.asset.clone(), ..presses[0].clone() }).is_none());
    assert_eq!(things().words(&presses[2]).map(|words| words.plural.as_str()), Some("scissors"));
}

/// The independent reader resolves the designer's words for an object to that object, for nearly the whole catalogue.
/// Designs with the rest are rejected and drawn again.
#[test]
fn everything_has_words() {
    let all = Catalogue::full().cards();
    let stapler = all.iter().find(|card| card.name == "Stapler").unwrap();
    let (mut said, mut misheard) = (0, Vec::new());
    let mut understood = BTreeSet::new();
    for card in all.iter().filter(|card| card.category != stapler.category) {
        let cards = [card, stapler].map(|card| Arc::new(card.clone()));
        let nodes = cards.iter().map(|card| genmanip_core::GraphNode::of(card)).collect();
        let graph = genmanip_core::SceneGraph { nodes, ..Default::default() };
        for words in card.annotations.looks.iter().chain([&things().words(card).unwrap().noun]) {
            let heard = references::read(&format!("Put the {words} near the stapler."), &cards, &graph);
            let means = heard.as_ref().ok().and_then(|reading| reading.phrases.first()).map(|(_, ids)| ids.clone());
            said += 1;
            if means == Some(vec![card.uid.as_str().parse().unwrap()]) {
                understood.insert((card.category.as_str(), card.annotations.looks.contains(words)));
            } else {
                misheard.push(format!("{}: {words}: {:?}", card.uid, heard.err()));
            }
        }
    }
    let share = misheard.len() as f64 / f64::from(said);
    assert!(share < 0.03, "{:.1} %: {}", 100.0 * share, misheard.join("\n"));
    for card in all.iter().filter(|card| card.category != stapler.category) {
        let by = |looks: bool| understood.contains(&(card.category.as_str(), looks));
        assert!(by(false) && by(true), "{}: by noun {}, by looks {}", card.category, by(false), by(true));
    }
}

/// All families of the catalogue occur in designed tasks.
#[test]
fn all_of_the_catalogue_is_used() {
    let all = Catalogue::full().cards();
    let batch = design_many(&TaskKind::ALL, 600, all, Seed::new(12), &DesignSettings::default()).unwrap();
    let used: BTreeSet<&str> =
        batch.tasks.iter().flat_map(|task| &task.objects).map(|card| card.category.as_str()).collect();
    let families = genmanip_assets::instances::generated_instances().iter().map(|one| one.card.category.as_str());
    let unused: BTreeSet<&str> = families.filter(|one| !used.contains(one)).collect();
    assert!(unused.is_empty(), "{unused:?}");
}

/// Objects are put where they belong by use, size and height.
#[test]
fn things_go_where_they_belong() {
    let card = |name: &str| cards().iter().find(|card| card.name == name).unwrap();
    let cases = [
        ("Salad Bowl", "Green Apple", Relation::In, true),
        ("Rice Bowl", "Banana", Relation::In, false),
        ("Frying Pan", "Carrot", Relation::In, false),
        ("Red Apple", "Porcelain Plate", Relation::On, false),
        ("Porcelain Plate", "Hammer", Relation::Top, false),
        ("Cutting Board", "Bread Loaf", Relation::On, true),
        ("Cutting Board", "Bread Loaf", Relation::In, false),
        ("Cardboard Box", "Water Bottle", Relation::In, false),
        ("Serving Tray", "Water Bottle", Relation::Top, true),
        ("Blue Cube", "Red Cube", Relation::On, true),
        ("Red Cube", "Blue Cube", Relation::On, false),
        ("Green Dictionary", "Red Cube", Relation::On, false),
        ("Saucer", "White Mug", Relation::Top, true),
    ];
    for (host, item, relation, expected) in cases {
        assert_eq!(things().may_carry(card(host), card(item), relation), expected, "{item} {relation:?} {host}");
    }
}

/// An object *in* another one has more than half of its surface there.
#[test]
fn what_stands_out_of_a_hollow_is_not_put_in_it() {
    let card = |uid: &str| Catalogue::full().cards().iter().find(|card| card.uid == uid).unwrap();
    for (host, item, expected, why) in [
        ("box-8", "yoghurt-cup-7", false, "89 mm tall, 79 mm deep"),
        ("basket-9", "toilet-roll-8", false, "92 mm tall, 68 mm deep"),
        ("basket-9", "torch-3", true, "45 mm tall, 68 mm deep"),
        ("box-11", "yoghurt-cup-7", true, "89 mm tall, 91 mm deep"),
    ] {
        assert_eq!(things().may_carry(card(host), card(item), Relation::In), expected, "{item} in {host}: {why}");
    }
}

/// Tasks do not require taking objects from below the rim of a cavity that is too narrow for the gripper.
#[test]
fn things_are_taken_from_where_the_hand_gets_to() {
    let card = |uid: &str| Catalogue::full().cards().iter().find(|card| card.uid == uid).unwrap();
    let cases = [
        ("box-11", "paint-brush-4", false, "75 mm below the rim, 154 by 199 mm inside"),
        ("box-11", "die-7", false, "49 mm below it"),
        ("box-11", "chess-piece-1", true, "14 mm below it"),
        ("basket-3", "apple-6", true, "11 mm below it"),
        ("basket-2", "cube-9", true, "54 mm below it, 184 by 234 mm inside"),
        ("plate-1", "apple-6", true, "above it"),
        ("coaster-1", "mug-1", false, "not one of those that things are taken from"),
    ];
    for (host, item, expected, why) in cases {
        assert_eq!(things().may_be_taken_from(card(host), card(item)), expected, "{item} from {host}: {why}");
    }
}

/// No tall object, and none that may be open, is on the robot's side of an articulated object.
#[test]
fn the_hand_gets_to_joints() {
    let settings = DesignSettings::default();
    let batch = design_many(&[TaskKind::Articulated], 60, Catalogue::full().cards(), Seed::new(17), &settings).unwrap();
    let mut pairs = 0;
    for task in &batch.tasks {
        for edge in &task.scene_graph.edges {
            let (nearer, farther): (&ReferenceId, &ReferenceId) = match edge.relation {
                Relation::Back => (&edge.subject, &edge.reference),
                Relation::Front => (&edge.reference, &edge.subject),
                _ => continue,
            };
            let (nearer, farther) = (task.card(nearer).unwrap(), task.card(farther).unwrap());
            pairs += usize::from(farther.is_articulated);
            let is_clear = !nearer.is_articulated && nearer.size_m.z <= farther.size_m.z;
            assert!(is_clear || !farther.is_articulated, "{}: {} before {}", task.id, nearer.name, farther.name);
        }
    }
    assert!(pairs > 5, "only {pairs} things stand before one with joints");
}

#[test]
fn too_few_objects_are_an_error_with_its_reasons() {
    let few: Vec<ObjectCard> = cards().iter().filter(|card| card.category == "mug").cloned().collect();
    let settings = DesignSettings { max_draws: 20, ..DesignSettings::default() };
    let error = design(TaskKind::CommonSense, &few, Seed::new(1), &settings).unwrap_err();
    let text = "no common_sense task in 20 designs: the composition does not work out (20×)";
    assert_eq!(error.to_string(), text);
    assert_eq!(design_many(&[], 3, &few, Seed::new(1), &settings), Err(DesignError::NoKinds));
}

/// An exhausted kind leaves gaps without ending the series, and a longer series begins like a shorter one.
#[test]
fn a_series_goes_on_without_a_kind_that_ran_out() {
    // None of these objects can be opened or shut.
    let few: Vec<ObjectCard> = cards().iter().filter(|card| !card.is_articulated).cloned().collect();
    let settings = DesignSettings { max_draws: 200, ..DesignSettings::default() };
    let kinds = [TaskKind::PickAndPlace, TaskKind::Articulated];
    let series = |fill: bool, count: usize| {
        let mut series = Series::new(&kinds, &few, Seed::new(3), &settings, fill).unwrap();
        (0..count).map(|_| series.compose()).collect::<Vec<_>>()
    };
    let twelve = series(false, 12);
    assert_eq!(twelve[..8], series(false, 8));
    for (index, made) in twelve.iter().enumerate() {
        match made {
            Ok(task) => assert_eq!((task.kind, index % 2), (TaskKind::PickAndPlace, 0), "{}", task.id),
            Err(Missing { id, kind, why: DesignError::Exhausted { draws: 200, .. } }) => {
                assert_eq!((*kind, id), (TaskKind::Articulated, &format!("articulated-3-{index:05}")));
            }
            Err(missing) => panic!("{missing:?}"),
        }
    }
    let filled: Vec<_> = series(true, 12).into_iter().map(Result::unwrap).collect();
    assert!(filled.iter().all(|task| task.kind == TaskKind::PickAndPlace));
    let said: std::collections::BTreeSet<_> = filled.iter().map(|task| &task.instruction).collect();
    assert_eq!(said.len(), 12, "no two say the same");
}

/// With copies in every scene, some sentences leave the choice of the copy open and others do not; all pass the gate.
#[test]
fn scenes_with_copies_are_designed() {
    let settings = DesignSettings { copies: 1.0, ..DesignSettings::default() };
    let batch = design_many(&TaskKind::ALL, 120, cards(), Seed::new(4), &settings).unwrap();
    let with_copy = |task: &&Task| task.scene_graph.nodes.iter().any(|node| node.id.copy().is_some());
    let copied: Vec<&Task> = batch.tasks.iter().filter(with_copy).collect();
    let open = copied.iter().filter(|task| !task.interchangeable.is_empty()).count();
    let about_copies = |task: &&&Task| {
        let copies = task.scene_graph.nodes.iter().filter(|node| node.id.copy().is_some());
        let twins: Vec<AssetUid> = copies.map(|node| node.id.asset()).collect();
        let asset = |id| &task.card(id).unwrap().uid;
        task.goal.alternatives.iter().flatten().flat_map(Atom::ids).any(|id| twins.contains(asset(id)))
    };
    let singled_out = copied.iter().filter(|task| task.interchangeable.is_empty()).filter(about_copies).count();
    assert!(copied.len() > 60 && open > 10 && singled_out > 0, "{} {open} {singled_out}", copied.len());
    let report = measure(cards(), 120, Seed::new(4), &settings, &mut || 0.0).unwrap();
    assert_eq!((report.flaws, report.valid), (Vec::new(), 120));
    for task in copied {
        assert_eq!(task.check_interchangeable(), Ok(()), "{}", task.id);
        assert!(task.scene_graph.nodes.iter().zip(&task.objects).all(|(node, card)| *node.asset == card.asset));
    }
}

/// Tasks of four steps are composed; their later steps omit the verb.
#[test]
fn four_steps_are_composed_where_they_are_asked_for() {
    let settings = DesignSettings { steps: [4; 2], max_draws: 40_000, ..DesignSettings::default() };
    let task = design(TaskKind::LongHorizon, Catalogue::full().cards(), Seed::new(6), &settings).unwrap();
    assert_eq!(task.goal.alternatives.iter().map(Vec::len).collect::<Vec<_>>(), [4], "{}", task.instruction);
    assert!(task.instruction.split_whitespace().count() <= 30, "{}", task.instruction);
}
