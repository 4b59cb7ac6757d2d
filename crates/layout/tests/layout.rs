//! Layouts of example tasks: the whole graph holds, the goal does not, nothing moves, the same seed gives the same
//! bytes.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

use std::sync::OnceLock;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{AssetError, AssetSource, Catalogue, GraspFile, GraspLibrary, panda};
use genmanip_core::{AssetRef, Atom, Document, Goal, GraphEdge, GraphNode, Pose, Relation, Scenario, Seed, Task};
use genmanip_layout::{LayoutError, LayoutSettings, Rejection, audit, lay_out, moves};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_relations::{
    PosedObject, PosedScene, RelationSettings, Rest, ShapeCache, judge_edges, judge_goal, measure_pair,
};
use genmanip_tasks::answer::{RecordedAnswer, check_answer};

fn planner() -> &'static Planner {
    static PLANNER: OnceLock<Planner> = OnceLock::new();
    PLANNER.get_or_init(|| Planner::new(panda(), PlannerSettings::default()).unwrap())
}

/// All example tasks, by file name.
fn tasks() -> Vec<Task> {
    let folder = format!("{}/../../examples/tasks", env!("CARGO_MANIFEST_DIR"));
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let read = |path: std::path::PathBuf| {
        let recorded = RecordedAnswer::from_json(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let request = recorded.request(path.file_stem().unwrap().to_str().unwrap(), Catalogue::builtin().cards());
        check_answer(&recorded.response, &request.unwrap()).task.unwrap()
    };
    paths.into_iter().map(read).collect()
}

fn task(id: &str) -> Task {
    tasks().into_iter().find(|task| task.id == id).unwrap()
}

fn layout_of(task: &Task, seed: u64) -> Result<Scenario, LayoutError> {
    lay_out(
        task,
        Catalogue::builtin(),
        &default_world(),
        planner(),
        GraspLibrary::builtin(),
        Seed::new(seed),
        &LayoutSettings::default(),
    )
}

/// Posed scene built from the scenario file alone.
fn posed(scenario: &Scenario) -> PosedScene {
    let objects = scenario.objects.iter().map(|placed| PosedObject {
        id: placed.id.clone(),
        model: Catalogue::builtin().instance(placed).unwrap(),
        pose: placed.pose,
        joint_positions: placed.joint_positions.clone(),
    });
    PosedScene::new(objects.collect(), &scenario.world.surfaces, &mut ShapeCache::default())
}

/// Checks all guarantees of a layout.
fn check(scenario: &Scenario) {
    let (id, task, relations) = (&scenario.id, &scenario.task, RelationSettings::default());
    let scene = posed(scenario);
    let ids = |scenario: &Scenario| scenario.objects.iter().map(|object| object.id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(scenario), task.scene_graph.nodes.iter().map(|node| node.id.clone()).collect::<Vec<_>>());

    let verdicts = judge_edges(&scene, &task.scene_graph, &relations);
    let edges: Vec<Atom> = task.scene_graph.edges.iter().map(GraphEdge::atom).collect();
    assert_eq!(verdicts.iter().map(|verdict| verdict.atom.clone()).collect::<Vec<_>>(), edges, "{id}");
    for verdict in verdicts {
        assert!(verdict.holds, "{id}: {} does not hold: {}", verdict.atom, verdict.explanation);
    }
    let goal = judge_goal(&scene, &task.goal, &Rest::default(), &relations);
    assert_eq!(goal.alternatives.len(), task.goal.alternatives.len());
    for alternative in goal.alternatives {
        assert!(alternative.iter().any(|atom| !atom.holds), "{id}: an alternative of the goal holds at the start");
    }

    let report = audit(scenario, Catalogue::builtin(), &panda(), &LayoutSettings::default(), 2.0).unwrap();
    assert!(report.penetration_m < 1e-3 && report.drift_m < 1e-3, "{id}: {report:?}");
    let states = task.scene_graph.nodes.iter().filter(|node| node.state.is_some()).count();
    assert_eq!((report.checked, report.failed.len()), (edges.len() + states, 0), "{id}: {report:?}");

    let workspace = scenario.world.workspace;
    for index in 0..scenario.objects.len() {
        let bounds = scene.bounds(index).unwrap();
        let inside = bounds.min.x >= workspace.x[0]
            && bounds.max.x <= workspace.x[1]
            && bounds.min.y >= workspace.y[0]
            && bounds.max.y <= workspace.y[1];
        assert!(inside, "{id}: object {index} leaves the table area: {bounds:?}");
        assert!(bounds.min.z > -1e-3, "{id}: object {index} sinks into the table");
    }
    // Objects without a support relation are far enough apart for a finger.
    let support_of = |index: usize| {
        let id = &scenario.objects[index].id;
        let edge = task.scene_graph.edges.iter().find(|edge| edge.subject == *id && edge.relation.is_support());
        edge.map(|edge| edge.reference.clone())
    };
    for a in 0..scenario.objects.len() {
        for b in (0..a).filter(|&b| support_of(a) == support_of(b)) {
            let gap = measure_pair(&scene, a, b, &relations).unwrap().gap_m;
            assert!(gap > 0.015, "{id}: objects {a} and {b} are {gap} m apart");
        }
    }
    assert_eq!(Scenario::from_json(&scenario.to_json()).unwrap(), *scenario, "{id}: the file is the scenario");
}

fn check_all(seed: u64) {
    for task in tasks() {
        let scenario = layout_of(&task, seed).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        check(&scenario);
    }
}

// Two tests, so that they run side by side.
#[test]
fn every_task_is_laid_out_with_seeds_1_and_2() {
    [1, 2].into_iter().for_each(check_all);
}

#[test]
fn every_task_is_laid_out_with_seeds_3_and_4() {
    [3, 4].into_iter().for_each(check_all);
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_another_layout() {
    for id in ["017_pick_and_place", "021_spatial", "024_appearance"] {
        let task = task(id);
        let [first, again, other] = [7, 7, 8].map(|seed| layout_of(&task, seed).unwrap());
        assert_eq!(first.to_json(), again.to_json());
        let poses = |scenario: &Scenario| scenario.objects.iter().map(|object| object.pose).collect::<Vec<_>>();
        assert_ne!(poses(&first), poses(&other));
    }
}

fn node(uid: &str) -> GraphNode {
    GraphNode { id: uid.parse().unwrap(), asset: AssetRef::builtin(uid, 2).into(), state: None }
}

fn edge(subject: &str, relation: Relation, reference: &str) -> GraphEdge {
    GraphEdge { subject: subject.parse().unwrap(), relation, reference: reference.into(), second_reference: None }
}

/// A task with a custom graph; its goal, a cube on a cube, is never reached.
fn with_graph(nodes: &[&str], edges: Vec<GraphEdge>) -> Task {
    let mut task = task("024_appearance");
    task.scene_graph.nodes = nodes.iter().map(|uid| node(uid)).collect();
    task.scene_graph.edges = edges;
    task
}

/// Tray, basket, box, board, pot and bowl cannot all stand directly left of one small cube.
#[test]
fn a_graph_without_room_is_refused_with_the_edges_in_conflict() {
    let large = ["011", "051", "052", "014", "013", "006"];
    let nodes: Vec<&str> = ["047"].into_iter().chain(large).collect();
    let task = with_graph(&nodes, large.iter().map(|uid| edge(uid, Relation::Left, "047")).collect());
    let settings = LayoutSettings { max_restarts: 20, ..LayoutSettings::default() };
    let error = lay_out(
        &task,
        Catalogue::builtin(),
        &default_world(),
        planner(),
        GraspLibrary::builtin(),
        Seed::new(1),
        &settings,
    )
    .unwrap_err();
    let message = error.to_string();
    let LayoutError::Infeasible { task: id, restarts, rejections, .. } = error else { panic!("{message}") };
    assert_eq!((id.as_str(), restarts), (task.id.as_str(), 20));
    let edges: Vec<String> = rejections.conflicting_edges().iter().map(|(edge, _)| edge.to_string()).collect();
    assert!(!edges.is_empty(), "{message}");
    for edge in &edges {
        assert!(edge.ends_with(" left 047"), "{edge} is not in conflict");
    }
    let found_none = |(reason, count): &(&Rejection, usize)| match reason {
        Rejection::NoPlace(object) => nodes.contains(&object.id.as_str()) && *count > 0,
        _ => false,
    };
    assert!(rejections.reasons().iter().any(found_none), "{message}");
    assert!(message.contains("20 attempts") && message.contains("conflicting edges: "), "{message}");
    assert!(message.contains(&edges[0]) && message.len() < 800, "{message}");
}

/// Eight objects in a bin for three are rejected before sampling, with the message of a failed search.
#[test]
fn what_surely_finds_no_room_is_refused_at_once() {
    let things = ["027", "028", "030", "031", "034", "046", "047", "048"];
    let nodes: Vec<&str> = ["053"].into_iter().chain(things).collect();
    let task = with_graph(&nodes, things.iter().map(|uid| edge(uid, Relation::In, "053")).collect());
    let error = layout_of(&task, 1).unwrap_err();
    let message = error.to_string();
    let LayoutError::Infeasible { restarts: 0, rejections, furthest, .. } = error else { panic!("{message}") };
    assert!(message.contains("too close to a neighbour") && message.contains("no free pose for "), "{message}");
    let edges = rejections.conflicting_edges();
    assert!(edges.len() == 8 && edges.iter().all(|(edge, _)| edge.to_string().ends_with(" in 053")), "{message}");
    assert_eq!(furthest.map(|furthest| furthest.placed.len()), Some(9), "there is something to draw");
}

/// A goal that nearly every random layout meets, and a fruit visible in only some poses in its bin: the backtracking
/// search avoids both where rejection sampling of whole layouts failed.
#[test]
fn rare_layouts_are_found() {
    for text in [include_str!("../testdata/near_by_chance.json"), include_str!("../testdata/pear_in_a_bin.json")] {
        let task = Task::from_json(text).unwrap();
        for seed in [1, 2] {
            check(&layout_of(&task, seed).unwrap_or_else(|error| panic!("{}, seed {seed}: {error}", task.id)));
        }
    }
}

/// Infeasible graphs report the conflicting edges, and the partial layout can be rendered.
#[test]
fn infeasible_graphs_name_the_edges_in_conflict() {
    use Relation::{In, Left, Top};
    let between = |subject: &str, one: &str, other: &str| GraphEdge {
        second_reference: Some(other.into()),
        ..edge(subject, Relation::Between, one)
    };
    let fruits = ["027", "028", "030", "031", "034"];
    let on_saucer = fruits.map(|fruit| edge(fruit, Top, "009"));
    type Case<'a> = (&'a str, &'a [&'a str], Vec<GraphEdge>, &'a [&'a str]);
    let cases: [Case; 4] = [
        ("crowded saucer", &["009", "027", "028", "030", "031", "034", "047", "046"], on_saucer.to_vec(), &["top 009"]),
        (
            "circle through a chain",
            &["001", "007", "051", "046"],
            vec![
                edge("001", Left, "007"),
                edge("007", Left, "051"),
                edge("051", Left, "046"),
                edge("046", Left, "001"),
            ],
            &["001 left 007", "007 left 051", "051 left 046", "046 left 001"],
        ),
        ("too large for its container", &["005", "051", "047"], vec![edge("051", In, "005")], &["051 in 005"]),
        (
            "no room between neighbours",
            &["057", "059", "011", "047"],
            vec![edge("057", Left, "059"), between("011", "057", "059")],
            &["011 between 057 and 059", "057 left 059"],
        ),
    ];
    let settings = LayoutSettings { max_restarts: 6, ..LayoutSettings::default() };
    for (name, nodes, edges, expected) in cases {
        let task = with_graph(nodes, edges);
        let error = lay_out(
            &task,
            Catalogue::builtin(),
            &default_world(),
            planner(),
            GraspLibrary::builtin(),
            Seed::new(1),
            &settings,
        )
        .unwrap_err();
        let LayoutError::Infeasible { rejections, furthest, .. } = error else { panic!("{name}: {error}") };
        let named: Vec<String> = rejections.conflicting_edges().iter().map(|(edge, _)| edge.to_string()).collect();
        for wanted in expected {
            assert!(named.iter().any(|edge| edge.ends_with(wanted)), "{name}: {wanted} is not among {named:?}");
        }
        assert!(named.iter().all(|edge| expected.iter().any(|known| edge.ends_with(known))), "{name}: {named:?}");
        let furthest = furthest.unwrap_or_else(|| panic!("{name}: nothing to draw"));
        assert!(nodes.contains(&furthest.object.as_str()) && !furthest.placed.is_empty(), "{name}: {furthest:?}");
    }
}

#[test]
fn distractors_mean_nothing_to_the_task_and_spoil_nothing() {
    for id in ["017_pick_and_place", "024_appearance", "016_common_sense"] {
        let task = task(id);
        let settings = LayoutSettings { distractors: 3, ..LayoutSettings::default() };
        let scenario = lay_out(
            &task,
            Catalogue::builtin(),
            &default_world(),
            planner(),
            GraspLibrary::builtin(),
            Seed::new(5),
            &settings,
        )
        .unwrap();
        let (known, added) = scenario.objects.split_at(task.scene_graph.nodes.len());
        assert_eq!(added.len(), 3, "{id}");
        for placed in added {
            let card = Catalogue::builtin().card(placed.id.as_str()).unwrap();
            assert!(
                task.objects.iter().all(|other| other.name != card.name && other.category != card.category),
                "{id}"
            );
            assert!(known.iter().all(|other| other.id != placed.id), "{id}");
        }
        let report = audit(&scenario, Catalogue::builtin(), &panda(), &LayoutSettings::default(), 2.0).unwrap();
        assert!(report.failed.is_empty() && !report.goal_holds && report.hidden.is_none(), "{id}: {report:?}");
        assert!(report.penetration_m < 1e-3 && report.drift_m < 1e-3, "{id}: {report:?}");
        let plain = layout_of(&task, 5).unwrap();
        assert_eq!(plain.objects.len(), known.len(), "none unless asked");
    }
}

#[test]
fn what_is_wrong_with_a_graph_is_named() {
    let cases = [
        (with_graph(&["047", "101"], vec![]), "no object has uid \"101\"; near misses: 001 (Red Mug)"),
        (with_graph(&["047", "cube"], vec![]), "046 (Red Cube)"),
        (
            with_graph(&["047", "046"], vec![edge("046", Relation::Left, "048")]),
            "edge `046 left 048` refers to 048, which is not a node of the scene graph",
        ),
        (
            with_graph(
                &["047", "046", "048"],
                vec![edge("046", Relation::On, "048"), edge("048", Relation::On, "046")],
            ),
            "support cycle: 046 → 048",
        ),
    ];
    for (task, wanted) in cases {
        let error = layout_of(&task, 1).unwrap_err();
        assert!(error.to_string().contains(wanted), "{error}");
    }
    let error = layout_of(&with_graph(&["101"], vec![]), 1).unwrap_err();
    let LayoutError::UnknownObject(AssetError::UnknownUid { got, near }) = error else { panic!("{error}") };
    assert_eq!((got.as_str(), near.len()), ("101", 1));
}

/// Grasps tested with different physics are an error with the object's name; grasps of another robot are ignored and
/// new ones sampled.
#[test]
fn stale_grasps_are_a_defect_and_those_of_another_robot_are_not_used() {
    let task = task("024_appearance");
    let lay_out_with = |change: &dyn Fn(&mut GraspFile)| {
        let mut file = GraspFile::builtin().clone();
        change(&mut file);
        let library = GraspLibrary::new([file]);
        lay_out(
            &task,
            Catalogue::builtin(),
            &default_world(),
            planner(),
            &library,
            Seed::new(1),
            &LayoutSettings::default(),
        )
    };
    let known = lay_out_with(&|_| ()).unwrap();
    let error = lay_out_with(&|file| file.objects.get_mut("047").unwrap().physics_hash = "v2:0".into()).unwrap_err();
    assert!(error.is_defect() && matches!(error, LayoutError::StaleGrasps(_)), "{error:?}");
    let message = error.to_string();
    assert!(message.contains("object 047") && message.contains("genmanip grasps bake"), "{message}");
    let sampled = lay_out_with(&|file| file.made_by.robot = "another arm".into()).unwrap();
    let none = lay_out_with(&|file| file.objects.clear()).unwrap();
    assert_eq!(sampled.to_json(), none.to_json());
    assert_eq!(known.objects.len(), none.objects.len());
}

/// The audit detects a manipulated layout.
#[test]
fn the_audit_notices_a_lifted_and_a_sunk_object() {
    let scenario = layout_of(&task("024_appearance"), 1).unwrap();
    let shifted = |z: f64| {
        let mut scenario = scenario.clone();
        scenario.objects[0].pose.position.z += z;
        audit(&scenario, Catalogue::builtin(), &panda(), &LayoutSettings::default(), 2.0).unwrap()
    };
    assert!(shifted(0.03).drift_m > 0.02, "it falls");
    assert!(shifted(-0.005).penetration_m > 0.004, "it starts inside the table");
}

/// Filling a closed container opens it, even if the goal does not say so.
#[test]
fn a_shut_container_is_opened_before_it_is_filled() {
    let placed = |relation: Relation, uid: &str| Atom::Relation {
        subject: "046".parse().unwrap(),
        relation,
        reference: uid.into(),
        second_reference: None,
    };
    let state = |uid: &str, state: &str| Atom::State { object: uid.parse().unwrap(), state: state.into() };
    let (inside, top) = (Relation::In, Relation::Top);
    let cases = [
        ("a drawer", inside, "057", vec![0.0, 0.0], vec![], vec!["057 is top_open", "046 in 057"]),
        ("an open drawer", inside, "057", vec![0.0, 0.085], vec![], vec!["046 in 057"]),
        ("a lid", inside, "060", vec![0.0], vec![], vec!["060 is open", "046 in 060"]),
        (
            "said",
            inside,
            "057",
            vec![0.0, 0.0],
            vec![state("057", "both_open")],
            vec!["057 is both_open", "046 in 057"],
        ),
        ("shut later", inside, "060", vec![1.9], vec![state("060", "closed")], vec!["046 in 060", "060 is closed"]),
        ("upon it", top, "057", vec![0.0, 0.0], vec![], vec!["046 top 057"]),
        ("nothing to open", inside, "001", vec![], vec![], vec!["046 in 001"]),
    ];
    for (name, relation, uid, joints, said, expected) in cases {
        let posed = [(uid, 0.0, joints), ("046", 0.3, Vec::new())].map(|(uid, y, joint_positions)| PosedObject {
            id: uid.parse().unwrap(),
            model: Catalogue::builtin().build(uid).unwrap(),
            pose: Pose::from_position(glam::DVec3::new(0.5, y, 0.0)),
            joint_positions,
        });
        let scene = PosedScene::new(posed.to_vec(), &[], &mut ShapeCache::default());
        let goal = Goal { alternatives: vec![[vec![placed(relation, uid)], said].concat()] };
        let found = moves(&goal, &scene);
        let told: Vec<String> = found[0].iter().flat_map(|step| &step.atoms).map(ToString::to_string).collect();
        assert_eq!(told, expected, "{name}");
    }
}
