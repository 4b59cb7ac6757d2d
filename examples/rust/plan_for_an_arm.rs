//! Plans a collision-free motion for an arm from its URDF, around a box:
//! `cargo run --release -p genmanip --example plan_for_an_arm -- examples/robots/six_axis.urdf path.json`

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip::core::glam::DVec3;
use genmanip::core::{Piece, Pose, Seed, Shape};
use genmanip::import::robots;
use genmanip::motion::{AllowedCollisions, CollisionWorld, Planner, PlannerSettings, PlanningScene};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let (urdf, out) = arguments.next().zip(arguments.next()).ok_or("usage: plan_for_an_arm ROBOT.urdf PATH.json")?;
    let robot = Arc::new(robots::read(&urdf, &robots::Settings::of_environment())?.model);
    let planner = Planner::new(Arc::clone(&robot), PlannerSettings::default())?;
    let mut world = CollisionWorld::default();
    let block = Piece::at(DVec3::new(0.5, 0.0, 0.2), Shape::Box { half_extents: DVec3::new(0.1, 0.1, 0.2) });
    world.add("block", &[block], &Pose::IDENTITY)?;
    let scene =
        PlanningScene { world: &world, attached: None, allowed: &AllowedCollisions::none(), gripper_width: 0.0 };
    let (mut start, mut goal) = (robot.home.clone(), robot.home.clone());
    (start[0], goal[0]) = (1.0, -1.0);
    let path = planner.plan_joint(&scene, &start, &[goal], Seed::new(7))?;
    let trajectory = planner.time(&path, 1.0);
    std::fs::write(out, serde_json::to_string(&trajectory.configs)?)?;
    Ok(())
}
