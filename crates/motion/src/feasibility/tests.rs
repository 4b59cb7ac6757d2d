use genmanip_core::{
    Grasp, Piece, Pose, Seed, Shape,
    glam::{DQuat, DVec3},
};
use std::f64::consts::{FRAC_PI_2, PI};

use super::*;
use crate::collision::{Attached, CollisionWorld};
use crate::path::Path;
use crate::test_robot::test_panda;
use crate::{PlannerSettings, PlanningScene};

const CUBE_M: f64 = 0.05;
const CUBE: &str = "cube";

fn planner() -> Planner {
    Planner::new(test_panda(), PlannerSettings::default()).unwrap()
}

fn cuboid(half_extents: DVec3) -> Vec<Piece> {
    vec![Piece::at(DVec3::ZERO, Shape::Box { half_extents })]
}

fn cube() -> Vec<Piece> {
    cuboid(DVec3::splat(CUBE_M / 2.0))
}

/// A grasp from above, closing along an axis of the cube with yaw `yaw` (rad).
fn from_above(yaw: f64) -> Grasp {
    let pose = Pose::from_position_yaw(DVec3::ZERO, yaw)
        * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(PI) };
    Grasp { pose, width: CUBE_M, score: 1.0 }
}

/// A 5 cm cube on a table with other obstacles.
struct Scene {
    world: CollisionWorld,
    world_from_cube: Pose,
}

impl Scene {
    fn with(others: &[(&str, Vec<Piece>, DVec3)], cube_at: DVec3) -> Self {
        let mut world = CollisionWorld::new();
        world
            .add("table", &cuboid(DVec3::new(0.5, 0.8, 0.05)), &Pose::from_position(DVec3::new(0.55, 0.0, -0.05)))
            .unwrap();
        let world_from_cube = Pose::from_position(cube_at);
        world.add(CUBE, &cube(), &world_from_cube).unwrap();
        for (name, pieces, at) in others {
            world.add(name, pieces, &Pose::from_position(*at)).unwrap();
        }
        Self { world, world_from_cube }
    }

    fn search(
        &self,
        planner: &Planner,
        goals: &[PlaceGoal],
        settings: &FeasibilitySettings,
        candidates: &[Grasp],
    ) -> (Vec<FeasibleGrasp>, GraspRejections) {
        let pieces = cube();
        let query = self.query(planner, &pieces, goals, settings);
        let mut search = query.grasps(candidates.iter().cloned());
        let found = search.by_ref().collect();
        (found, search.rejections())
    }

    fn query<'a>(
        &'a self,
        planner: &'a Planner,
        pieces: &'a [Piece],
        goals: &'a [PlaceGoal],
        settings: &'a FeasibilitySettings,
    ) -> PickQuery<'a> {
        let object = PickedObject { name: CUBE, world_from_object: self.world_from_cube, pieces };
        PickQuery { planner, world: &self.world, object, goals, arm: &planner.robot().home, settings }
    }
}

const MIDDLE: DVec3 = DVec3::new(0.5, 0.0, CUBE_M / 2.0);

fn goal_at(position: DVec3) -> PlaceGoal {
    PlaceGoal { world_from_object: Pose::from_position(position), highest_release_m: 0.02, clear_height_m: 0.0 }
}

/// Test case: obstacles, goals, and expected numbers of grasps found and rejected by reason for one candidate.
fn check(name: &str, scene: &Scene, goals: &[PlaceGoal], expected: impl Fn(&[FeasibleGrasp], &GraspRejections)) {
    let planner = planner();
    for settings in
        [FeasibilitySettings::default(), FeasibilitySettings { wanted: 100, ..FeasibilitySettings::reach_only() }]
    {
        let (found, rejections) = scene.search(&planner, goals, &settings, &[from_above(0.0)]);
        let again = scene.search(&planner, goals, &settings, &[from_above(0.0)]);
        assert_eq!((&found, &rejections), (&again.0, &again.1), "{name}: not deterministic");
        let counted = rejections.out_of_reach + rejections.blocked_count() + rejections.no_use + rejections.no_approach;
        assert_eq!(found.len() + counted, 2, "{name}: the grasp and its half turn are found or counted");
        for grasp in &found {
            let reached = planner.tcp_pose(&grasp.config);
            let wanted = scene.world_from_cube * grasp.object_from_tcp.pose;
            assert!(reached.position.distance(wanted.position) < 1e-8, "{name}: {reached:?}, wanted {wanted:?}");
            assert_eq!(grasp.release_height_m.is_some(), !goals.is_empty(), "{name}");
        }
        expected(&found, &rejections);
    }
}

#[test]
fn grasps_are_found_or_refused_with_the_reason() {
    check("alone", &Scene::with(&[], MIDDLE), &[], |found, rejections| {
        assert_eq!(found.len(), 2);
        assert_eq!(*rejections, GraspRejections::default());
    });
    check("far away", &Scene::with(&[], DVec3::new(1.4, 0.0, 0.025)), &[], |found, rejections| {
        assert_eq!((found.len(), rejections.out_of_reach), (0, 2));
    });
    let lid = ("shelf", cuboid(DVec3::new(0.3, 0.3, 0.005)), MIDDLE + DVec3::Z * 0.04);
    check("under a shelf", &Scene::with(&[lid], MIDDLE), &[], |found, rejections| {
        assert_eq!((found.len(), rejections.obstacles()), (0, vec![("shelf", 2)]));
    });
    // Fingers of 1.5 cm depth do not fit into a gap of 4 mm.
    let walls = [("left", 1.0), ("right", -1.0)].map(|(name, side)| {
        let at = MIDDLE + DVec3::Y * side * (CUBE_M / 2.0 + 0.004 + 0.01);
        (name, cuboid(DVec3::new(0.1, 0.01, 0.05)), at)
    });
    check("between walls", &Scene::with(&walls, MIDDLE), &[], |found, rejections| {
        assert_eq!((found.len(), rejections.blocked_count()), (0, 2), "{rejections:?}");
        assert!(rejections.blocked.keys().all(|name| name == "left" || name == "right"), "{rejections:?}");
    });
}

#[test]
fn a_grasp_must_also_work_at_a_goal() {
    let scene = Scene::with(&[], MIDDLE);
    check("free goal", &scene, &[goal_at(MIDDLE + DVec3::Y * 0.2)], |found, _| {
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|grasp| grasp.release_height_m == Some(0.003)), "the lowest height will do");
    });
    check("goal out of reach", &scene, &[goal_at(DVec3::new(1.4, 0.0, 0.025))], |found, rejections| {
        assert_eq!((found.len(), rejections.no_use), (0, 2));
    });
    check("one of two goals", &scene, &[goal_at(DVec3::X * 2.0), goal_at(MIDDLE + DVec3::Y * 0.2)], |found, _| {
        assert_eq!(found.len(), 2);
    });
    // The cube may be released at its current pose: it does not block itself.
    check("where it is", &scene, &[goal_at(MIDDLE)], |found, _| assert_eq!(found.len(), 2));
    // 1 cm beside the cube and 4 cm high: too close for a finger, too low for a release from 3 cm.
    let frame = ("frame", cuboid(DVec3::new(0.1, 0.005, 0.02)), DVec3::new(0.5, 0.24, 0.02));
    let beside = Scene::with(&[frame], MIDDLE);
    let goal = goal_at(DVec3::new(0.5, 0.20, 0.025));
    check("low goal beside a frame", &beside, &[goal], |found, rejections| {
        assert_eq!((found.len(), rejections.no_use), (0, 2));
    });
    let from_above_it = PlaceGoal { highest_release_m: f64::INFINITY, ..goal };
    check("the same from higher up", &beside, &[from_above_it], |found, _| {
        assert!(found.iter().all(|grasp| grasp.release_height_m.is_some_and(|height_m| height_m > 0.02)), "{found:?}");
        assert_eq!(found.len(), 2);
    });
}

#[test]
fn the_search_is_lazy_and_keeps_the_order_of_candidates() {
    let (planner, scene) = (planner(), Scene::with(&[], MIDDLE));
    let candidates = [from_above(0.0), from_above(FRAC_PI_2)];
    let search = |wanted: usize, half_turn: HalfTurn| {
        let settings = FeasibilitySettings { wanted, half_turn, ..FeasibilitySettings::default() };
        let pieces = cube();
        let mut asked = 0;
        let counted = candidates.iter().cloned().inspect(|_| asked += 1);
        let found: Vec<_> = scene.query(&planner, &pieces, &[], &settings).grasps(counted).collect();
        (found, asked)
    };
    let (all, _) = search(100, HalfTurn::Both);
    let poses: Vec<Pose> = all.iter().map(|grasp| grasp.object_from_tcp.pose).collect();
    let expected: Vec<Pose> = candidates.iter().flat_map(|grasp| [grasp.pose, grasp.flipped().pose]).collect();
    assert_eq!(poses, expected);
    for wanted in 1..=3 {
        let (found, asked) = search(wanted, HalfTurn::Both);
        assert_eq!((found.as_slice(), asked), (&all[..wanted], wanted.div_ceil(2)));
    }
    let home = &planner.robot().home;
    let far = |grasp: &FeasibleGrasp| crate::path::distance(&grasp.config, home);
    let (nearer, _) = search(100, HalfTurn::Nearer);
    let expected: Vec<_> =
        all.chunks(2).map(|pair| if far(&pair[1]) < far(&pair[0]) { &pair[1] } else { &pair[0] }).collect();
    assert_eq!(nearer.iter().collect::<Vec<_>>(), expected);
}

#[test]
fn more_configurations_of_one_grasp_are_returned_when_wanted() {
    let (planner, scene) = (planner(), Scene::with(&[], MIDDLE));
    let settings = FeasibilitySettings { configurations: 6, configurations_kept: 3, ..FeasibilitySettings::default() };
    let (found, _) = scene.search(&planner, &[], &settings, &[from_above(0.0)]);
    let of_first: Vec<_> = found.iter().filter(|grasp| grasp.object_from_tcp == from_above(0.0)).collect();
    assert_eq!(of_first.len(), 3);
    assert!(of_first.windows(2).all(|pair| pair[0].config != pair[1].config));
}

/// True if all states of a path are free.
fn assert_free(name: &str, planner: &Planner, around: &PlanningScene, path: &Path) {
    let checker = planner.checker(around, 0.0);
    for state in path.states(0.02) {
        assert!(checker.is_free(&state), "{name}: {:?}", checker.check(&state));
    }
}

#[test]
fn motions_lead_from_the_arm_to_the_grasp_and_on_to_the_goal() {
    let (planner, scene) = (planner(), Scene::with(&[], MIDDLE));
    let (pieces, settings) = (cube(), FeasibilitySettings::default());
    let goals = [goal_at(MIDDLE + DVec3::new(0.05, 0.25, 0.0))];
    let query = scene.query(&planner, &pieces, &goals, &settings);
    let grasp = query.grasps(std::iter::once(from_above(0.0))).next().unwrap();
    let PickMotions { reach, approach, lift } = query.motions(&grasp, Seed::new(1)).unwrap();

    assert_eq!((reach.start(), reach.goal()), (&*planner.robot().home, approach.start()));
    assert_eq!((approach.goal(), lift.start()), (&*grasp.config, &*grasp.config));
    let rise = planner.tcp_pose(lift.goal()).position - planner.tcp_pose(lift.start()).position;
    assert!((rise - DVec3::Z * settings.lift_m).length() < 1e-6, "{rise}");
    let nothing = AllowedCollisions::none();
    let open = PlanningScene { world: &scene.world, attached: None, allowed: &nothing, gripper_width: grasp.opening_m };
    assert_free("reach", &planner, &open, &reach);
    assert_free("approach", &planner, &open, &approach);

    let mut others = scene.world.clone();
    assert!(others.remove(CUBE));
    let tcp_from_object = grasp.object_from_tcp.pose.inverse();
    let place = PlaceQuery {
        planner: &planner,
        world: &others,
        name: CUBE,
        pieces: &pieces,
        tcp_from_object,
        arm: lift.goal(),
        held_width_m: CUBE_M,
        open_width_m: grasp.opening_m,
        settings: &settings,
        searches: usize::MAX,
        searches_per_goal: usize::MAX,
    };
    assert!(place.reaches(&goals[0].world_from_object, 0.01));
    assert!(!place.reaches(&Pose::from_position(DVec3::X * 2.0), 0.01));
    let (goal, Release { carry, lower, retreat }) = place.first(&goals, Seed::new(1)).unwrap();
    assert_eq!(goal, 0);
    assert_eq!((carry.start(), carry.goal()), (lift.goal(), lower.start()));
    assert_eq!(lower.goal(), retreat.start());
    let let_go = planner.tcp_pose(lower.goal()) * tcp_from_object;
    let wanted = goals[0].world_from_object.position + DVec3::Z * settings.release_heights_m[0];
    assert!(let_go.position.distance(wanted) < 1e-6, "{let_go:?}");
    let held = Attached::new(CUBE, &pieces, &tcp_from_object).unwrap();
    let carrying = PlanningScene { world: &others, attached: Some(&held), allowed: &nothing, gripper_width: CUBE_M };
    assert_free("carry", &planner, &carrying, &carry);
    assert_free("lower", &planner, &carrying, &lower);

    // The fingers leave a wide object with the clearance with which they may approach it.
    let widest_m = |object_clearance_m: f64| {
        let settings = FeasibilitySettings { object_clearance_m: Some(object_clearance_m), ..settings.clone() };
        let is_left = |width_m: f64| {
            let wide = cuboid(DVec3::new(CUBE_M, width_m, CUBE_M) / 2.0);
            let place =
                PlaceQuery { pieces: &wide, held_width_m: width_m, open_width_m: 0.08, settings: &settings, ..place };
            place.first(&goals, Seed::new(1)).is_ok()
        };
        (0..100).map(|step| 0.06 + 0.0005 * f64::from(step)).take_while(|width_m| is_left(*width_m)).last().unwrap()
    };
    let more_m = widest_m(0.0005) - widest_m(settings.clearance_m);
    assert!(more_m > 0.004, "{more_m} m");

    let high = [PlaceGoal { highest_release_m: 0.0, ..goals[0] }];
    assert_eq!(place.first(&high, Seed::new(1)), Err(None), "no height is allowed");
    let far = goal_at(DVec3::new(1.4, 0.0, 0.025));
    assert!(matches!(place.first(&[far], Seed::new(1)), Err(Some(PlanError::Unreachable { .. }))));
    // The first goal is possible from 12 cm only; the second one, tried low before, wins.
    let under = Pose { position: goals[0].world_from_object.position - DVec3::Z * 0.1, ..goals[0].world_from_object };
    let sunk = PlaceGoal { world_from_object: under, highest_release_m: f64::INFINITY, clear_height_m: 0.25 };
    assert_eq!(place.first(&[sunk, goals[0]], Seed::new(1)).unwrap().0, 1);
    assert_eq!(place.first(&[sunk], Seed::new(1)).unwrap().0, 0);
}

#[test]
fn motions_that_cannot_be_made_say_which_and_why() {
    let (planner, scene, pieces) = (planner(), Scene::with(&[], MIDDLE), cube());
    let refused = |settings: FeasibilitySettings, start: &dyn Fn(&FeasibleGrasp) -> Vec<f64>| {
        let query = scene.query(&planner, &pieces, &[], &settings);
        let grasp = query.grasps(std::iter::once(from_above(0.0))).next().unwrap();
        let arm = start(&grasp);
        let rejection = PickQuery { arm: &arm, ..query }.motions(&grasp, Seed::new(1)).unwrap_err();
        let mut counted = GraspRejections::default();
        counted.count(&rejection);
        (rejection, counted)
    };
    let home = |_: &FeasibleGrasp| planner.robot().home.clone();
    let defaults = FeasibilitySettings::default;
    let (rejection, counted) = refused(FeasibilitySettings { approach_m: 1.2, ..defaults() }, &home);
    assert!(matches!(rejection, GraspRejection::NoApproach(PlanError::Unreachable { .. })), "{rejection}");
    assert_eq!(counted, GraspRejections { no_approach: 1, ..GraspRejections::default() });
    let (rejection, counted) = refused(FeasibilitySettings { lift_m: 1.2, ..defaults() }, &home);
    assert!(matches!(rejection, GraspRejection::NoLift(PlanError::Unreachable { .. })), "{rejection}");
    assert_eq!(counted, GraspRejections { no_lift: 1, ..GraspRejections::default() });
    let in_the_table = |grasp: &FeasibleGrasp| {
        let tcp = planner.tcp_pose(&grasp.config);
        planner.ik(&Pose { position: tcp.position - DVec3::Z * 0.06, ..tcp }, &grasp.config)[0].clone()
    };
    let (rejection, counted) = refused(defaults(), &in_the_table);
    assert!(matches!(rejection, GraspRejection::NoReach(PlanError::StartInCollision(_))), "{rejection}");
    assert_eq!(counted, GraspRejections { no_reach: 1, ..GraspRejections::default() });
}
