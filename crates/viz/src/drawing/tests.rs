use genmanip_core::{
    Annotations, AssetRef, Atom, Goal, GraphEdge, GraphNode, ObjectCard, ReferenceId, Relation, SceneGraph, Task,
    TaskKind, Workspace, glam,
};
use proptest::prelude::*;

use super::floor_plan::{DrawnEdge, EdgeRole, Footprint, PlaceWindow, PlanScene, TopView, layout_svg};
use super::graph::{Panel, graph_svg};
use super::svg::{Area, text_width, wrap};

fn card(uid: &str, name: &str) -> ObjectCard {
    ObjectCard {
        uid: uid.into(),
        asset: AssetRef::builtin(uid, 1),
        name: name.into(),
        description: String::new(),
        category: String::new(),
        general_category: String::new(),
        colors: vec!["red".into()],
        materials: vec![],
        shape: String::new(),
        size_m: glam::DVec3::splat(0.08),
        mass_kg: 0.1,
        is_container: true,
        is_articulated: false,
        states: vec![],
        can_grasp: true,
        annotations: Annotations::default(),
    }
}

fn edge(subject: &str, relation: Relation, reference: &str) -> GraphEdge {
    GraphEdge { subject: subject.parse().unwrap(), relation, reference: reference.into(), second_reference: None }
}

fn task(names: &[&str], edges: Vec<GraphEdge>, alternatives: Vec<Vec<Atom>>) -> Task {
    let uids: Vec<String> = (0..names.len()).map(|index| format!("u{index}")).collect();
    Task {
        id: "t".into(),
        kind: TaskKind::Spatial,
        instruction: "Do it.".into(),
        goal: Goal { alternatives },
        scene_graph: SceneGraph {
            description: String::new(),
            nodes: uids.iter().map(|uid| GraphNode::of(&card(uid, uid))).collect(),
            edges,
        },
        objects: uids.iter().zip(names).map(|(uid, name)| card(uid, name).into()).collect(),
        surfaces: Vec::new(),
        interchangeable: Vec::new(),
        source: "test".into(),
    }
}

/// No overlaps, and a label on every arrow.
fn check_panel(panel: &Panel) {
    for (index, area) in panel.boxes.iter().enumerate() {
        for other in &panel.boxes[index + 1..] {
            assert!(!area.overlaps(other), "boxes {area:?} and {other:?} overlap");
        }
    }
    for (index, routed) in panel.routed.iter().enumerate() {
        for area in &panel.boxes {
            assert!(!routed.label.overlaps(area), "label {:?} covers box {area:?}", routed.label);
        }
        for other in &panel.routed[index + 1..] {
            assert!(!routed.label.overlaps(&other.label), "labels {:?} and {:?} overlap", routed.label, other.label);
        }
    }
}

/// Share of directional edges drawn in the direction they mean.
fn faithful(task: &Task, panel: &Panel) -> f64 {
    let center = |id: &ReferenceId| {
        let at = task.scene_graph.index_of(id).unwrap();
        panel.boxes[at].center()
    };
    let right = |edge: &&GraphEdge| {
        let ([ax, ay], [bx, by]) = (center(&edge.subject), center(&edge.reference));
        match edge.relation {
            Relation::Left => ax < bx,
            Relation::Right => ax > bx,
            Relation::Front => ay < by,
            Relation::Back => ay > by,
            _ => true,
        }
    };
    let edges = &task.scene_graph.edges;
    edges.iter().filter(right).count() as f64 / edges.len().max(1) as f64
}

#[test]
fn recorded_tasks_are_drawn_without_overlaps_and_true_to_their_meaning() {
    let values: Vec<serde_json::Value> = serde_json::from_str(include_str!("../../testdata/tasks.json")).unwrap();
    for value in values {
        let task: Task = genmanip_core::Document::from_value(value).unwrap();
        let start = Panel::start(&task, &[]);
        check_panel(&start);
        assert_eq!(faithful(&task, &start), 1.0, "{}", task.id);
        for alternative in 0..task.goal.alternatives.len() {
            check_panel(&Panel::goal(&task, alternative));
        }
        assert_eq!(graph_svg(&task), graph_svg(&task));
    }
}

#[test]
fn odd_graphs_are_drawn_too() {
    let cases = [
        ("empty", task(&[], vec![], vec![])),
        ("no goal", task(&["Mug"], vec![], vec![])),
        ("goal of nothing", task(&["Mug"], vec![], vec![vec![]])),
        ("itself", task(&["Mug"], vec![edge("u0", Relation::Left, "u0")], vec![])),
        (
            "unknown",
            task(&["Mug"], vec![edge("u0", Relation::Left, "u7")], vec![vec![edge("u9", Relation::On, "u8").atom()]]),
        ),
        (
            "cycle of top",
            task(
                &["A", "B", "C"],
                vec![edge("u0", Relation::Top, "u1"), edge("u1", Relation::Top, "u2"), edge("u2", Relation::Top, "u0")],
                vec![],
            ),
        ),
        (
            "contradiction",
            task(&["A", "B"], vec![edge("u0", Relation::Left, "u1"), edge("u0", Relation::Right, "u1")], vec![]),
        ),
        (
            "markup in a name",
            task(
                &["<script>alert(1)</script>", "\"&'"],
                vec![edge("u0", Relation::Near, "u1")],
                vec![vec![Atom::State { object: "u0".parse().unwrap(), state: "<b>".into() }]; 28],
            ),
        ),
    ];
    for (name, task) in cases {
        let svg = graph_svg(&task);
        assert!(!svg.as_str().contains("<script") && !svg.as_str().contains("<b>"), "{name}");
        check_panel(&Panel::start(&task, &[]));
    }
}

#[test]
fn what_is_not_finite_or_far_away_does_not_spoil_a_layout() {
    let square = |x: f64, y: f64| vec![[x, y], [x + 0.1, y], [x + 0.1, y + 0.1], [x, y + 0.1]];
    let footprint =
        |uid: &str, polygons| Footprint { id: uid.into(), name: uid.into(), color: [200, 60, 50], polygons };
    let picture = TopView {
        workspace: Workspace { x: [0.2, 0.9], y: [-0.5, 0.5] },
        footprints: vec![
            footprint("a", vec![square(0.4, 0.1)]),
            footprint("nan", vec![vec![[f64::NAN, 0.0], [0.5, f64::INFINITY]]]),
            footprint("far", vec![square(1e9, -1e9)]),
            footprint("none", vec![]),
        ],
        edges: ["a", "nan", "far", "none", "absent"]
            .map(|uid| DrawnEdge { edge: edge("a", Relation::Left, uid), role: EdgeRole::Conflict })
            .to_vec(),
        reach_m: vec![0.855, f64::NAN, -1.0],
        windows: vec![PlaceWindow { x: [f64::NAN, 1e12], y: [-1e12, 0.1], label: "<b>".into() }],
    };
    let svg = layout_svg(&picture);
    assert!(!svg.as_str().contains("NaN") && !svg.as_str().contains("inf"), "{svg}");
    let width: f64 = svg.as_str().split("width=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
    assert!(width < 1000.0, "{width}");
}

#[test]
fn names_break_into_lines_that_fit() {
    assert_eq!(wrap("Terracotta Deep Plate", 13.0, 92.0, 3), ["Terracotta", "Deep Plate"]);
    assert_eq!(wrap("", 13.0, 92.0, 3), Vec::<String>::new());
    for line in wrap(&"Donaudampfschifffahrtsgesellschaft ".repeat(4), 13.0, 92.0, 3) {
        assert!(text_width(&line, 13.0) < 140.0 && line.ends_with('…'), "{line}");
    }
}

/// A scene on a grid: each object stands beside or on an earlier one, with a few more relations that hold.
fn scene() -> impl Strategy<Value = Task> {
    let step = prop_oneof![
        3 => Just(Relation::Left),
        3 => Just(Relation::Right),
        3 => Just(Relation::Front),
        3 => Just(Relation::Back),
        2 => Just(Relation::Near),
        2 => Just(Relation::Top),
    ];
    proptest::collection::vec((step, 0_usize..10), 2..10).prop_map(|steps| {
        const NAMES: [&str; 10] = [
            "Red Mug",
            "Terracotta Deep Plate",
            "Pear",
            "Green Dictionary",
            "Tomato Soup Can",
            "Cube",
            "Wicker Basket",
            "Glass Tumbler",
            "Tape Roll",
            "Lidded Box",
        ];
        let mut edges = Vec::new();
        for (index, (relation, anchor)) in steps.iter().enumerate() {
            edges.push(edge(&format!("u{}", index + 1), *relation, &format!("u{}", anchor % (index + 1))));
        }
        let count = edges.len() + 1;
        let goal = vec![vec![edge("u0", Relation::Left, "u1").atom(), edge("u2", Relation::Top, "u1").atom()]];
        task(&NAMES[..count], edges, goal)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_overlaps_in_scenes_of_3_to_10_objects(task in scene()) {
        let panel = Panel::start(&task, &[]);
        check_panel(&panel);
        check_panel(&Panel::goal(&task, 0));
        prop_assert!(faithful(&task, &panel) >= 0.8, "{}", faithful(&task, &panel));
    }

    #[test]
    fn names_in_layouts_do_not_overlap(seats in proptest::collection::btree_set(0_usize..20, 3..10)) {
        let footprints = seats.iter().enumerate().map(|(index, seat)| {
            let (x, y) = (0.28 + (seat % 4) as f64 * 0.17, -0.4 + (seat / 4) as f64 * 0.2);
            Footprint {
                id: format!("u{index}").into(),
                name: ["Red Mug", "Terracotta Deep Plate", "Pear"][index % 3].into(),
                color: [200, 60, 50],
                polygons: vec![vec![[x, y], [x + 0.09, y + 0.02], [x + 0.07, y + 0.1], [x - 0.02, y + 0.08]]],
            }
        });
        let picture = TopView {
            workspace: Workspace { x: [0.2, 0.9], y: [-0.5, 0.5] },
            footprints: footprints.collect(),
            edges: vec![DrawnEdge { edge: edge("u0", Relation::Left, "u1"), role: EdgeRole::Initial }],
            reach_m: vec![],
            windows: vec![],
        };
        let scene = PlanScene::of(&picture);
        let areas: Vec<Area> = scene.names.iter().map(|(_, area)| *area).collect();
        for (index, area) in areas.iter().enumerate() {
            prop_assert!(areas[index + 1..].iter().all(|other| !area.overlaps(other)));
        }
        for (routed, _, _) in &scene.arrows {
            prop_assert!(areas.iter().all(|area| !area.overlaps(&routed.label)));
        }
    }
}
