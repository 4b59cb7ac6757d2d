//! Inverse kinematics, collision checks and motion planning of the Panda arm beside a box.

use divan::{Bencher, black_box};
use genmanip::assets::robots::panda;
use genmanip::core::glam::DVec3;
use genmanip::core::{Piece, Pose, Seed, Shape};
use genmanip::motion::{AllowedCollisions, CollisionWorld, Planner, PlannerSettings, PlanningScene};

/// The planner, a world with a box in front of the arm, and configurations on both sides of it.
fn set_up() -> (Planner, CollisionWorld, [Vec<f64>; 2]) {
    let robot = panda();
    let sides = [0.9, -0.9].map(|turn| {
        let mut config = robot.home.clone();
        config[0] = turn;
        config
    });
    let mut world = CollisionWorld::default();
    let block = Piece::at(DVec3::new(0.5, 0.0, 0.2), Shape::Box { half_extents: DVec3::new(0.05, 0.05, 0.2) });
    world.add("block", &[block], &Pose::IDENTITY).expect("a valid box");
    (Planner::new(robot, PlannerSettings::default()).expect("a known arm"), world, sides)
}

fn around<'a>(world: &'a CollisionWorld, allowed: &'a AllowedCollisions) -> PlanningScene<'a> {
    PlanningScene { world, attached: None, allowed, gripper_width: 0.08 }
}

/// All solutions for one pose of the tool.
#[divan::bench]
fn inverse_kinematics(bencher: Bencher) {
    let (planner, _, [start, _]) = set_up();
    let pose = planner.tcp_pose(&start);
    bencher.bench_local(|| planner.ik(black_box(&pose), &start));
}

/// One configuration against the arm itself and the world.
#[divan::bench]
fn collision_check(bencher: Bencher) {
    let (planner, world, [start, _]) = set_up();
    let allowed = AllowedCollisions::none();
    let scene = around(&world, &allowed);
    bencher.bench_local(|| planner.check(&scene, black_box(&start)));
}

/// A path around the box.
#[divan::bench(sample_count = 20)]
fn joint_path(bencher: Bencher) {
    let (planner, world, [start, goal]) = set_up();
    let allowed = AllowedCollisions::none();
    let scene = around(&world, &allowed);
    bencher
        .bench_local(|| planner.plan_joint(&scene, &start, std::slice::from_ref(&goal), Seed::new(7)).expect("a path"));
}
