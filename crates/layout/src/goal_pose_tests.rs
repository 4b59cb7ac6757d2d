//! Goal poses of several objects on one carrier, over several seeds.

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, Pose, Relation, Seed};
use genmanip_relations::{PosedObject, PosedScene, RelationSettings, ShapeCache, judge_atom, measure_pair};

use crate::{GoalOrder, GoalPoseSettings, GoalSearch, Move};

/// A rotated carrier in the middle and objects far from it.
fn scene(carrier: &str, turn: f64, objects: &[&str]) -> PosedScene {
    let posed = |(index, uid): (usize, &str)| {
        let model = Catalogue::builtin().build(uid).unwrap();
        let bounds = model.world_bounds(&Pose::IDENTITY, &vec![0.0; model.joint_count()]);
        let pose = if index == 0 { DVec3::new(0.45, 0.0, 0.0) } else { DVec3::new(0.0, 2.0 + index as f64, 0.0) };
        PosedObject {
            id: uid.parse().unwrap(),
            pose: Pose::from_position_yaw(pose - DVec3::Z * bounds.min.z, turn),
            joint_positions: vec![0.0; model.joint_count()],
            model,
        }
    };
    let uids = [carrier].into_iter().chain(objects.iter().copied());
    PosedScene::new(uids.enumerate().map(posed).collect(), &default_world().surfaces, &mut ShapeCache::default())
}

/// Places the objects one after the other, each search knowing the later ones.
fn check(carrier: &str, relation: Relation, objects: &[&str]) {
    for order in [GoalOrder::Margin, GoalOrder::Middle] {
        check_in(order, carrier, relation, objects);
    }
}

fn check_in(order: GoalOrder, carrier: &str, relation: Relation, objects: &[&str]) {
    let (relations, settings) = (RelationSettings::default(), GoalPoseSettings::default());
    let steps: Vec<Move> = (1..=objects.len())
        .map(|object| Move {
            object,
            atoms: vec![Atom::Relation {
                subject: objects[object - 1].parse().unwrap(),
                relation,
                reference: carrier.into(),
                second_reference: None,
            }],
        })
        .collect();
    for seed in 0..3 {
        let mut scene_now = scene(carrier, 0.9 * seed as f64, objects);
        let upright: Vec<_> = scene_now.objects().map(|object| object.pose.rotation).collect();
        for (index, step) in steps.iter().enumerate() {
            let search = GoalSearch {
                scene: &scene_now,
                upright: &upright,
                workspace: &default_world().workspace,
                relations: &relations,
                settings: &settings,
                order,
            };
            let poses = search.goal_poses(step, &steps[index + 1..], &|_| true, Seed::new(seed));
            let name = objects[index];
            // Any goal pose leaves space for the next object: use the last one.
            let pose = poses.last().unwrap_or_else(|| panic!("seed {seed}: no place for {name} on {carrier}"));
            let joints = scene_now.objects().nth(step.object).unwrap().joint_positions.clone();
            scene_now.set_pose(step.object, pose.world_from_object, &joints);
            assert!(judge_atom(&scene_now, &step.atoms[0], &relations).holds, "seed {seed}: {name} on {carrier}");
            for other in 1..step.object {
                let gap = measure_pair(&scene_now, step.object, other, &relations).unwrap().gap_m;
                assert!(gap >= settings.clearance_m, "seed {seed}: {name} is {gap} m from {}", objects[other - 1]);
            }
        }
    }
}

#[test]
fn what_comes_first_leaves_room_for_what_comes_next() {
    let (board, tray, basket) = ("014", "011", "051");
    check(board, Relation::On, &["032", "029"]);
    check(board, Relation::On, &["035", "031"]);
    check(board, Relation::On, &["027", "028", "029"]);
    check(tray, Relation::Top, &["022", "024"]);
    check(basket, Relation::Top, &["030", "034"]);
}

#[test]
fn from_the_middle_the_first_goal_pose_is_the_same_for_every_seed() {
    for (carrier, relation, object) in [("014", Relation::On, "032"), ("051", Relation::Top, "030")] {
        let scene = scene(carrier, 0.4, &[object]);
        let atoms = vec![Atom::Relation {
            subject: object.parse().unwrap(),
            relation,
            reference: carrier.into(),
            second_reference: None,
        }];
        let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
        let first = |order: GoalOrder, seed: u64| {
            let search = GoalSearch {
                scene: &scene,
                upright: &upright,
                workspace: &default_world().workspace,
                relations: &RelationSettings::default(),
                settings: &GoalPoseSettings::default(),
                order,
            };
            let step = Move { object: 1, atoms: atoms.clone() };
            let poses = search.goal_poses(&step, &[], &|_| true, Seed::new(seed));
            poses[0].world_from_object
        };
        let middle = first(GoalOrder::Middle, 1);
        assert_eq!(middle, first(GoalOrder::Middle, 2), "{object} on {carrier}");
        assert_ne!(first(GoalOrder::Margin, 1), first(GoalOrder::Margin, 2), "{object} on {carrier}");
        assert!(middle.rotation.angle_between(upright[1]) < 1e-9, "the object keeps its heading");
    }
}
