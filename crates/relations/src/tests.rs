use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use genmanip_core::{
    AssetRef, Atom, BetweenReading, Goal, InstanceId, Joint, JointKind, JointState, MassProperties, ObjectCard,
    ObjectLink, ObjectModel, Piece, Pose, Relation, Shape,
};
use glam::{DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::*;

fn model(uid: &str, pieces: Vec<Piece>, cavity: Vec<Piece>) -> Arc<ObjectModel> {
    let card: ObjectCard = serde_json::from_value(serde_json::json!({
        "uid": uid, "asset": {"source": "builtin", "uid": uid, "version": 1}, "name": uid, "description": "", "category": "", "general_category": "", "colors": [],
        "materials": [], "shape": "", "size_m": [0, 0, 0], "mass_kg": 0.1, "is_container": false,
        "is_articulated": false, "states": [], "can_grasp": true,
    }))
    .unwrap();
    Arc::new(ObjectModel {
        card,
        family: uid.into(),
        asset: AssetRef::builtin(uid, 1),
        links: vec![ObjectLink { cavity, ..link("base", None, pieces) }],
        friction: 0.5,
        joint_states: Vec::new(),
    })
}

fn link(name: &str, joint: Option<Joint>, pieces: Vec<Piece>) -> ObjectLink {
    let mass = MassProperties { mass_kg: 0.1, center: DVec3::ZERO, inertia: DMat3::IDENTITY };
    ObjectLink { name: name.into(), joint, visual: Vec::new(), pieces, cavity: Vec::new(), mass }
}

fn block(uid: &str, x: f64, y: f64, z: f64) -> Arc<ObjectModel> {
    let half_extents = DVec3::new(x, y, z) * 0.5;
    model(uid, vec![Piece::at(DVec3::Z * (z * 0.5), Shape::Box { half_extents })], Vec::new())
}

fn ball(uid: &str, radius: f64) -> Arc<ObjectModel> {
    model(uid, vec![Piece::at(DVec3::Z * radius, Shape::Sphere { radius })], Vec::new())
}

/// A round wall of 16 blocks on a round bottom.
fn cup(uid: &str, radius: f64, height: f64, bottom: f64, cavity: bool) -> Arc<ObjectModel> {
    let wall = 0.004;
    let base = Shape::Cylinder { radius, half_height: bottom * 0.5 };
    let mut pieces = vec![Piece::at(DVec3::Z * (bottom * 0.5), base)];
    let half_extents = DVec3::new(wall * 0.5, radius * (PI / 16.0).tan(), (height - bottom) * 0.5);
    pieces.extend((0..16).map(|index| {
        let turn = DQuat::from_rotation_z(TAU * f64::from(index) / 16.0);
        let position = turn * DVec3::X * (radius - wall * 0.5) + DVec3::Z * ((height + bottom) * 0.5);
        Piece { shape: Shape::Box { half_extents }, link_from_piece: Pose::new(position, turn) }
    }));
    let inner = Shape::Cylinder { radius: radius - wall, half_height: (height - bottom) * 0.5 };
    let hollow = Piece::at(DVec3::Z * ((height + bottom) * 0.5), inner);
    model(uid, pieces, if cavity { vec![hollow] } else { Vec::new() })
}

fn drawer() -> Arc<ObjectModel> {
    let joint = Joint {
        name: "slide".into(),
        parent: 0,
        kind: JointKind::Prismatic,
        parent_from_joint: Pose::IDENTITY,
        axis: -DVec3::X,
        range: [0.0, 0.2],
        damping: 1.0,
        friction_loss: 0.0,
        stiffness: 0.0,
        spring_reference: 0.0,
    };
    let half_extents = DVec3::splat(0.05);
    let cube = || vec![Piece::at(DVec3::Z * 0.05, Shape::Box { half_extents })];
    let mut model = Arc::unwrap_or_clone(block("drawer", 0.1, 0.1, 0.1));
    model.links = vec![link("case", None, cube()), link("drawer", Some(joint), cube())];
    model.joint_states = vec![
        JointState { name: "closed".into(), intervals: vec![("slide".into(), [0.0, 0.01])], nominal: vec![0.0] },
        JointState { name: "open".into(), intervals: vec![("slide".into(), [0.1, 0.2])], nominal: vec![0.15] },
    ];
    Arc::new(model)
}

fn scene(objects: &[(&Arc<ObjectModel>, Pose)]) -> PosedScene {
    let posed = objects.iter().map(|(model, pose)| PosedObject {
        id: InstanceId::new(&model.card.uid, 1),
        model: Arc::clone(model),
        pose: *pose,
        joint_positions: vec![0.0; model.joint_count()],
    });
    PosedScene::new(posed.collect(), &[], &mut ShapeCache::default())
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::from_position(DVec3::new(x, y, z))
}

fn relation(subject: &str, relation: Relation, reference: &str) -> Atom {
    Atom::Relation { subject: subject.parse().unwrap(), relation, reference: reference.into(), second_reference: None }
}

/// Compares the label of the first object relative to the second, and all relations that the label implies.
fn check(objects: &[(&Arc<ObjectModel>, Pose)], expected: Option<Label>) -> PairVerdict {
    let settings = RelationSettings::default();
    let scene = scene(objects);
    let pair = label_pair(&scene, 0, 1, &settings).unwrap();
    assert_eq!(pair.a_to_b, expected, "{pair:#?}");
    assert_eq!(label_pair(&scene, 1, 0, &settings).unwrap().a_to_b, expected.map(Label::inverse));
    for word in Relation::OF_PAIRS {
        let atom = relation(objects[0].0.card.uid.as_str(), word, objects[1].0.card.uid.as_str());
        let verdict = judge_atom(&scene, &atom, &settings);
        let implied = match word {
            Relation::Top => matches!(expected, Some(Label::On | Label::In)),
            Relation::Near => !matches!(expected, None | Some(Label::On | Label::In | Label::Beneath | Label::OutOf)),
            _ => serde_json::to_value(expected).unwrap() == serde_json::to_value(word).unwrap(),
        };
        assert_eq!(verdict.holds, implied, "{}\n{pair:#?}", verdict.explanation);
        assert!(if verdict.holds { verdict.margin >= 0.0 } else { verdict.margin <= 0.0 }, "{verdict:#?}");
        assert!(verdict.margin.is_finite() && !verdict.measurements.is_empty());
    }
    pair
}

/// One place of a small block at which each relation to a cup holds, and one at which it does not; a post stands on the
/// robot's right of the cup.
#[test]
fn every_relation_holds_here_and_not_there() {
    let (coin, cup, post) =
        (block("coin", 0.02, 0.02, 0.02), cup("cup", 0.05, 0.06, 0.01, true), block("post", 0.04, 0.04, 0.06));
    let settings = RelationSettings::default();
    let holds = |relation: Relation, [x, y, z]: [f64; 3]| {
        let scene = scene(&[(&coin, at(x, y, z)), (&cup, at(0.5, 0.0, 0.0)), (&post, at(0.5, -0.3, 0.0))]);
        let second_reference = relation.has_two_references().then(|| "post".into());
        let atom =
            Atom::Relation { subject: "coin".parse().unwrap(), relation, reference: "cup".into(), second_reference };
        judge_atom(&scene, &atom, &settings).holds
    };
    let cases = [
        (Relation::Front, [0.6, 0.0, 0.0], [0.4, 0.0, 0.0]),
        (Relation::Back, [0.4, 0.0, 0.0], [0.6, 0.0, 0.0]),
        (Relation::Left, [0.5, 0.1, 0.0], [0.5, -0.1, 0.0]),
        (Relation::Right, [0.5, -0.1, 0.0], [0.5, 0.1, 0.0]),
        (Relation::Near, [0.5, 0.1, 0.0], [0.5, 0.0, 0.01]),
        (Relation::Top, [0.5, 0.0, 0.01], [0.5, 0.1, 0.0]),
        (Relation::On, [0.548, 0.0, 0.06], [0.5, 0.0, 0.01]),
        (Relation::In, [0.5, 0.0, 0.01], [0.548, 0.0, 0.06]),
        (Relation::Between, [0.5, -0.15, 0.0], [0.5, 0.15, 0.0]),
    ];
    for relation in Relation::ALL {
        let case = cases.iter().find(|(of, _, _)| *of == relation);
        let (_, here, there) = case.unwrap_or_else(|| panic!("`{}` has no case in this test", relation.name()));
        assert_eq!([holds(relation, *here), holds(relation, *there)], [true, false], "{}", relation.name());
    }
}

#[test]
fn neighbours() {
    let (a, b) = (block("a", 0.06, 0.06, 0.06), block("b", 0.06, 0.06, 0.1));
    let pair = check(&[(&a, at(0.5, 0.1, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Left));
    assert!((pair.geometry.gap_m - 0.04).abs() < 1e-12);
    check(&[(&a, at(0.5, -0.1, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Right));
    check(&[(&a, at(0.6, 0.0, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Front));
    check(&[(&a, at(0.4, 0.0, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Back));
    check(&[(&a, at(0.6, 0.1, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Near));
    check(&[(&a, at(0.5, 0.22, 0.0)), (&b, at(0.5, 0.0, 0.0))], None);
    check(&[(&a, at(0.5, 0.209, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Left));
    check(&[(&a, at(0.5, 0.06, 0.0)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Left));
}

#[test]
fn resting() {
    let (a, b) = (block("a", 0.05, 0.05, 0.05), block("b", 0.1, 0.1, 0.1));
    let pair = check(&[(&a, at(0.5, 0.0, 0.1)), (&b, at(0.5, 0.0, 0.0))], Some(Label::On));
    assert!(pair.supporting && pair.geometry.a_over_b.unwrap().gap_m.abs() < 2e-6);
    check(&[(&a, at(0.5, 0.0, 0.119)), (&b, at(0.5, 0.0, 0.0))], Some(Label::On));
    check(&[(&a, at(0.5, 0.0, 0.121)), (&b, at(0.5, 0.0, 0.0))], Some(Label::Near));
    check(&[(&a, at(0.5, 0.0, 0.099)), (&b, at(0.5, 0.0, 0.0))], Some(Label::On));
    assert!(!check(&[(&a, at(0.5, 0.06, 0.1)), (&b, at(0.5, 0.0, 0.0))], Some(Label::On)).supporting);
    assert!(!check(&[(&b, at(0.5, 0.0, 0.05)), (&a, at(0.5, 0.0, 0.0))], Some(Label::On)).supporting);
}

#[test]
fn a_mug_on_a_saucer_is_on_it_although_the_rim_is_higher() {
    let saucer = cup("saucer", 0.075, 0.02, 0.006, false);
    let mug = cup("mug", 0.035, 0.09, 0.005, true);
    let pair = check(&[(&mug, at(0.5, 0.0, 0.006)), (&saucer, at(0.5, 0.0, 0.0))], Some(Label::On));
    assert!(pair.geometry.a_over_b.unwrap().gap_m.abs() < 2e-6);
}

#[test]
fn a_lemon_in_a_bowl_is_in_it_with_or_without_a_known_cavity() {
    for cavity in [true, false] {
        let bowl = cup("bowl", 0.06, 0.055, 0.005, cavity);
        let lemon = ball("lemon", 0.025);
        check(&[(&lemon, at(0.5, 0.01, 0.005)), (&bowl, at(0.5, 0.0, 0.0))], Some(Label::In));
        // A large orange stands out of the same bowl: it rests on it, which `top` accepts.
        let orange = ball("orange", 0.054);
        check(&[(&orange, at(0.5, 0.0, 0.005)), (&bowl, at(0.5, 0.0, 0.0))], Some(Label::On));
    }
}

#[test]
fn in_a_drawer_follows_the_drawer() {
    let mut chest = Arc::unwrap_or_clone(drawer());
    let hollow = Shape::Box { half_extents: DVec3::splat(0.045) };
    chest.links[1].cavity = vec![Piece::at(DVec3::Z * 0.05, hollow)];
    let (chest, coin) = (Arc::new(chest), block("coin", 0.02, 0.02, 0.01));
    let settings = RelationSettings::default();
    let holds = |x: f64, drawn: f64| {
        let mut scene = scene(&[(&coin, at(x, 0.0, 0.02)), (&chest, at(0.5, 0.0, 0.0))]);
        scene.set_pose(1, at(0.5, 0.0, 0.0), &[drawn]);
        judge_atom(&scene, &relation("coin", Relation::In, "drawer"), &settings).holds
    };
    for (x, drawn, expected) in [(0.5, 0.0, true), (0.35, 0.15, true), (0.5, 0.15, false), (0.35, 0.0, false)] {
        assert_eq!(holds(x, drawn), expected, "coin at {x}, drawn by {drawn}");
    }
}

#[test]
fn under_an_overhang_is_beside() {
    // The rim of a funnel extends over a low block, which is no support at any gap.
    let funnel = model(
        "funnel",
        vec![
            Piece::at(DVec3::Z * 0.02, Shape::Cylinder { radius: 0.02, half_height: 0.02 }),
            Piece::at(DVec3::Z * 0.045, Shape::Cylinder { radius: 0.06, half_height: 0.005 }),
        ],
        Vec::new(),
    );
    let low = block("low", 0.03, 0.03, 0.01);
    check(&[(&low, at(0.5, 0.045, 0.0)), (&funnel, at(0.5, 0.0, 0.0))], Some(Label::Near));
}

#[test]
fn between_three() {
    let (a, c) = (block("a", 0.05, 0.05, 0.05), block("c", 0.05, 0.05, 0.05));
    let (low, tall) = (block("low", 0.05, 0.05, 0.05), block("tall", 0.05, 0.05, 0.30));
    // Half-way between centres 10 cm away, 3 cm aside bends the way by 33 degrees, 5 cm by 53, 12.5 cm up by 103.
    let check = |subject: &Arc<ObjectModel>, x: f64, [plane, space]: [bool; 2]| {
        let scene = scene(&[(subject, at(x, 0.0, 0.0)), (&a, at(0.5, 0.1, 0.0)), (&c, at(0.5, -0.1, 0.0))]);
        let atom = Atom::Relation {
            subject: subject.card.uid.as_str().parse().unwrap(),
            relation: Relation::Between,
            reference: "a".into(),
            second_reference: Some("c".into()),
        };
        let judged = |between| judge_atom(&scene, &atom, &RelationSettings { between, ..RelationSettings::default() });
        let [by_plane, by_space] = [BetweenReading::Plane, BetweenReading::Space].map(judged);
        assert_eq!([by_plane.holds, by_space.holds], [plane, space], "{by_plane:#?} {by_space:#?}");
        assert_eq!(by_plane.other_readings, by_space.measurements);
        assert_eq!(by_space.other_readings, by_plane.measurements);
    };
    check(&low, 0.5, [true, true]);
    check(&low, 0.53, [true, true]);
    check(&low, 0.55, [false, false]);
    check(&low, 0.7, [false, false]);
    check(&tall, 0.5, [true, false]);
    check(&tall, 0.53, [true, false]);
    check(&tall, 0.55, [false, false]);
}

#[test]
fn states_have_hysteresis() {
    let drawer = drawer();
    let settings = RelationSettings::default();
    let mut scene = scene(&[(&drawer, at(0.5, 0.0, 0.0))]);
    let mut check = |position: f64, previous: Option<&str>, expected: Option<&str>| {
        scene.set_pose(0, at(0.5, 0.0, 0.0), &[position]);
        scene.set_previous_states([previous.map(String::from)]);
        assert_eq!(joint_state(&scene, 0, &settings).as_deref(), expected);
        for state in ["open", "closed"] {
            let atom = Atom::State { object: "drawer".parse().unwrap(), state: state.into() };
            assert_eq!(judge_atom(&scene, &atom, &settings).holds, expected == Some(state), "{position} {state}");
        }
    };
    check(0.0, None, Some("closed"));
    check(0.05, None, None);
    check(0.15, None, Some("open"));
    check(0.095, None, None);
    check(0.095, Some("open"), Some("open"));
    check(0.085, Some("open"), None);
}

#[test]
fn what_is_held_or_moving_or_absent_satisfies_nothing() {
    let (a, b) = (block("a", 0.05, 0.05, 0.05), block("b", 0.05, 0.05, 0.05));
    let scene = scene(&[(&a, at(0.5, 0.1, 0.0)), (&b, at(0.5, 0.0, 0.0))]);
    let goal = |subject: &str| Goal {
        alternatives: vec![
            vec![relation(subject, Relation::Left, "b"), relation(subject, Relation::Near, "b")],
            vec![relation(subject, Relation::Top, "b")],
        ],
    };
    let check = |subject: &str, rest: Rest, score: f64| {
        let verdict = judge_goal(&scene, &goal(subject), &rest, &RelationSettings::default());
        assert_eq!(verdict.score, score, "{verdict:#?}");
        assert_eq!(verdict.success, score == 1.0);
        // Verdicts are stored as JSON and must be identical when read back.
        let text = serde_json::to_string(&verdict).unwrap();
        assert_eq!(serde_json::from_str::<genmanip_core::GoalVerdict>(&text).unwrap(), verdict);
    };
    check("a", Rest::default(), 1.0);
    check("a", Rest { held: Some(0), moving: vec![] }, 0.0);
    check("a", Rest { held: None, moving: vec![true, false] }, 0.0);
    check("a", Rest { held: None, moving: vec![false, true] }, 0.0);
    check("nobody", Rest::default(), 0.0);
    check("b", Rest::default(), 0.0);
}

#[test]
fn explanations_read_well() {
    let (a, b) = (block("a", 0.06, 0.06, 0.06), block("b", 0.06, 0.06, 0.1));
    let told = |pose: Pose, word: Relation| {
        let scene = scene(&[(&a, pose), (&b, at(0.5, 0.0, 0.0))]);
        judge_atom(&scene, &relation("a", word, "b"), &RelationSettings::default()).explanation
    };
    insta::assert_snapshot!(told(at(0.51, 0.1, 0.0), Relation::Left), @"left: clearance towards that side 0.040 m ≥ 0.000 m; overlap along x 0.050 m > 0.000 m; gap in the plane 0.040 m ≤ 0.150 m");
    insta::assert_snapshot!(told(at(0.5, 0.3, 0.0), Relation::Left), @"not left: gap in the plane 0.240 m, not ≤ 0.150 m");
    insta::assert_snapshot!(told(at(0.5, 0.0, 0.13), Relation::Top), @"not top: vertical gap 0.030 m, not ≤ 0.020 m");
    insta::assert_snapshot!(told(at(0.5, 0.0, 0.1), Relation::On), @"on: sinking -0.000 m ≤ 0.005 m; vertical gap 0.000 m ≤ 0.020 m; height of its middle over the other's 0.080 m > 0.000 m");
}

/// Performance requirement for judging at every control step: shapes are prepared once, and outlines only where needed.
#[test]
fn a_goal_prepares_nothing_twice_and_outlines_only_what_it_names() {
    let cups: Vec<_> = (0..10).map(|index| cup(&format!("cup{index}"), 0.04, 0.08, 0.005, index % 2 == 0)).collect();
    let mut shapes = ShapeCache::default();
    let mut posed = || {
        let objects = cups.iter().enumerate().map(|(index, model)| PosedObject {
            id: InstanceId::new(&model.card.uid, 1),
            model: Arc::clone(model),
            pose: at(0.3 + 0.12 * (index / 5) as f64, -0.2 + 0.1 * (index % 5) as f64, 0.0),
            joint_positions: Vec::new(),
        });
        PosedScene::new(objects.collect(), &[], &mut shapes)
    };
    let (scene, again) = (posed(), posed());
    for ((one, other), object) in scene.bodies.iter().zip(&again.bodies).zip(scene.objects()) {
        assert!(Arc::ptr_eq(&one.shape, &other.shape), "{} was prepared twice", object.id);
    }
    let atom = |index: usize, word, other: usize| relation(&format!("cup{index}"), word, &format!("cup{other}"));
    let goal = Goal {
        alternatives: vec![
            vec![atom(0, Relation::Left, 1), atom(0, Relation::Near, 2)],
            vec![atom(5, Relation::Top, 2)],
        ],
    };
    judge_goal(&scene, &goal, &Rest::default(), &RelationSettings::default());
    let outlined: Vec<usize> = (0..10).filter(|&index| scene.bodies[index].is_outlined()).collect();
    assert_eq!(outlined, [0, 1, 2, 5]);
}

/// Two different bodies at random poses, close enough to each other for every relation to occur.
fn pair_strategy() -> impl Strategy<Value = (Vec<Arc<ObjectModel>>, [Pose; 2])> {
    let body = |uid: &'static str| {
        (0..4usize, 0.02..0.1f64, 0.02..0.1f64, 0.02..0.08f64).prop_map(move |(kind, x, y, z)| match kind {
            0 => block(uid, x, y, z),
            1 => ball(uid, x * 0.5),
            2 => cup(uid, x, z + 0.01, 0.004, true),
            _ => {
                let radii = DVec3::new(x, y, z) * 0.5;
                model(uid, vec![Piece::at(DVec3::Z * radii.z, Shape::Ellipsoid { radii })], Vec::new())
            }
        })
    };
    let pose = |spread: f64| {
        (-spread..spread, -spread..spread, 0.0..0.1f64, -PI..PI, prop::bool::weighted(0.3), -1.0..1.0f64).prop_map(
            |(x, y, z, yaw, tilted, tilt)| {
                let tilt = if tilted { DQuat::from_rotation_x(tilt) } else { DQuat::IDENTITY };
                Pose::new(DVec3::new(0.5 + x, y, z), DQuat::from_rotation_z(yaw) * tilt)
            },
        )
    };
    (body("a"), body("b"), pose(0.15), pose(0.02)).prop_map(|(a, b, one, other)| (vec![a, b], [one, other]))
}

/// The mirror image in the xz plane; every model is symmetric about its own xz plane.
fn mirrored(pose: &Pose) -> Pose {
    let q = pose.rotation;
    let p = pose.position;
    Pose::new(DVec3::new(p.x, -p.y, p.z), DQuat::from_xyzw(-q.x, q.y, -q.z, q.w))
}

fn label_of(models: &[Arc<ObjectModel>], poses: &[Pose]) -> PairVerdict {
    let objects: Vec<_> = models.iter().zip(poses.iter().copied()).collect();
    label_pair(&scene(&objects), 0, 1, &RelationSettings::default()).unwrap()
}

/// True if a quantity is so near its threshold that sampling and rounding decide.
fn is_near_threshold(pair: &PairGeometry, settings: &RelationSettings) -> bool {
    let near = |value: f64, threshold: f64, tolerance: f64| (value - threshold).abs() < tolerance;
    let contact = |contact: Option<Contact>| {
        contact.is_some_and(|contact| {
            near(contact.gap_m, settings.touching_gap_m, 1e-4)
                || near(contact.gap_m, -settings.sinking_m, 1e-4)
                || near(contact.rise_m, 0.0, 1e-4)
        })
    };
    near(pair.gap_m, settings.close_m, 1e-4)
        || near(pair.overlap_x_m, 0.0, 1e-4)
        || near(pair.overlap_y_m, 0.0, 1e-4)
        || near(pair.a_in_b, settings.inside_share, 0.06)
        || near(pair.b_in_a, settings.inside_share, 0.06)
        || near(pair.gap_m, 0.0, 1e-4)
        || contact(pair.a_over_b)
        || contact(pair.b_over_a)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn moving_turning_mirroring_and_swapping((models, poses) in pair_strategy(), shift in prop::array::uniform3(-1.0..1.0f64)) {
        let settings = RelationSettings::default();
        let label = label_of(&models, &poses);
        prop_assume!(!is_near_threshold(&label.geometry, &settings));

        let swapped = label_of(&[models[1].clone(), models[0].clone()], &[poses[1], poses[0]]);
        prop_assert_eq!((swapped.a_to_b, swapped.b_to_a), (label.b_to_a, label.a_to_b));

        let shifted = poses.map(|pose| Pose { position: pose.position + DVec3::from_array(shift), ..pose });
        prop_assert_eq!(label_of(&models, &shifted).a_to_b, label.a_to_b, "{:#?}", label);

        let quarter = Pose::new(DVec3::ZERO, DQuat::from_rotation_z(FRAC_PI_2));
        let turned = label_of(&models, &poses.map(|pose| quarter * pose));
        let permuted = label.a_to_b.map(|label| match label {
            Label::Front => Label::Left,
            Label::Left => Label::Back,
            Label::Back => Label::Right,
            Label::Right => Label::Front,
            other => other,
        });
        prop_assert_eq!(turned.a_to_b, permuted, "{:#?}\n{:#?}", label, turned);

        let reflected = label_of(&models, &[mirrored(&poses[0]), mirrored(&poses[1])]);
        let exchanged = label.a_to_b.map(|label| match label {
            Label::Left => Label::Right,
            Label::Right => Label::Left,
            other => other,
        });
        prop_assert_eq!(reflected.a_to_b, exchanged, "{:#?}\n{:#?}", label, reflected);
    }

    /// Compares the vertical gap with dense sampling of both bodies.
    #[test]
    fn a_ball_over_a_tilted_block(x in -0.04..0.04f64, y in -0.04..0.04f64, z in 0.1..0.2f64, tilt in -0.6..0.6f64) {
        let (top, bottom) = (ball("a", 0.02), block("b", 0.2, 0.2, 0.04));
        let tilted = Pose::new(DVec3::new(0.0, 0.0, 0.0), DQuat::from_rotation_y(tilt));
        let settings = RelationSettings::default();
        let pair = measure_pair(&scene(&[(&top, at(x, y, z)), (&bottom, tilted)]), 0, 1, &settings).unwrap();
        // The upper face is the plane n·p = 0.04 with n = (sin, 0, cos); the ball's centre is 0.02 above its origin.
        let (sin, cos) = tilt.sin_cos();
        let expected = (sin * x + cos * (z + 0.02) - 0.04 - 0.02) / cos;
        prop_assert!((pair.a_over_b.unwrap().gap_m - expected).abs() < 5e-6, "{pair:?} {expected}");
    }

    /// Every position in a window satisfies a directional relation between boxes.
    #[test]
    fn windows_hold(
        (size, anchor) in (prop::array::uniform2(0.02..0.12f64), prop::array::uniform2(0.02..0.2f64)),
        (u, v) in (0.0..=1.0f64, 0.0..=1.0f64),
        word in prop::sample::select(Relation::SIDES.to_vec()),
    ) {
        let settings = RelationSettings::default();
        let (a, b) = (block("a", size[0], size[1], 0.05), block("b", anchor[0], anchor[1], 0.05));
        let placed = scene(&[(&b, at(0.5, 0.0, 0.0))]);
        let window =
            placement_window(word, &placed.bounds(0).unwrap(), DVec3::new(size[0], size[1], 0.05), &settings).unwrap();
        let DVec2 { x, y } = window.at(u, v);
        let scene = scene(&[(&a, at(x, y, 0.0)), (&b, at(0.5, 0.0, 0.0))]);
        let verdict = judge_atom(&scene, &relation("a", word, "b"), &settings);
        prop_assert!(verdict.holds && verdict.margin >= settings.window_margin_m - 1e-9, "{verdict:#?}");
    }
}
