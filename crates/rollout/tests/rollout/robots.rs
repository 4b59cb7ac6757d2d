//! Another arm and another gripper, added by data alone.

use std::sync::Arc;

use genmanip_assets::{Catalogue, GraspLibrary, robots, worlds};
use genmanip_core::Seed;
use genmanip_layout::LayoutSettings;
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_rollout::collect::{Attempt, Resources};
use genmanip_rollout::expert::{Expert, ExpertSettings};
use genmanip_rollout::{RolloutSettings, Stage, replay, run_episode};

use crate::{TASKS, task};

/// A fruit on a plate by a UR5e with a 2F-85: six joints that turn by more than a circle, numeric inverse kinematics,
/// grasps of no file, and an episode that replays to the bit.
#[test]
fn a_ur5e_with_a_2f85_picks_and_places() {
    let world = worlds::with_robot(&worlds::default_world(), "ur5e_2f85").unwrap();
    let robot = robots::of_world(&world).unwrap();
    let planner = Arc::new(Planner::new(robot, PlannerSettings::default()).unwrap());
    let (task, resources) = (task(TASKS[0]), Resources::builtin(&planner));
    let attempt = Attempt::of(&task, 0, Seed::new(11));
    let scenario = attempt.scenario(resources, &world, &LayoutSettings::default()).unwrap();
    let stage = Stage::open(Arc::new(scenario), Catalogue::builtin(), planner.robot()).unwrap();
    let mut expert = Expert::new(&stage, &planner, GraspLibrary::builtin(), ExpertSettings::default()).unwrap();
    let episode = run_episode(&stage, &mut expert, "ur5e", Seed::new(11), &RolloutSettings::default()).unwrap();
    assert!(episode.result.success, "{:?}", episode.result.failures);
    let check = replay::check(&stage, &episode).unwrap();
    assert!(check.identical, "{check:?}");
    assert!(episode.frames.iter().all(|frame| frame.joint_position.len() == 6 && frame.command.len() == 7));
    let widest = episode.frames.iter().map(|frame| frame.gripper_width).fold(0.0, f64::max);
    assert!((0.08..0.087).contains(&widest), "{widest} m");
    assert!(episode.result.max_stray_contact_n < 5.0, "{:?}", episode.result.stray_contact);
}
