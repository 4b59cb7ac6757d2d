//! Placing: carrying what is in the hand to where its conditions hold, letting go, backing off.

use genmanip_core::glam::DVec3;
use genmanip_core::{Failure, FailureCause, Pose, Seed};
use genmanip_layout::{GoalPose, Move, surroundings};
use genmanip_motion::{Allowed, Attached, CollisionWorld, PlanError, PlanningScene};
use genmanip_scene::relations::PosedScene;

use super::{Expert, Hand, commands};

/// Carries the held object to a place where every atom of the move holds.
pub(super) fn plan(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    hand: &Hand,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    let tcp_from_object = tcp_from_object(expert, scene, step.object, hand);
    let usable = |goal: &Pose| {
        let raised = Pose { position: goal.position + DVec3::Z * 0.01, ..*goal };
        expert.planner.ik_each(&(raised * tcp_from_object.inverse()), &hand.arm).next().is_some()
    };
    let goals = expert.goals(scene, step, &usable, seed);
    if goals.is_empty() {
        let name = expert.stage.name(step.object);
        let evidence = format!("no free place for {name} where every condition on it holds");
        return Err(Failure { cause: FailureCause::NoGoalPose, evidence });
    }
    toward(expert, scene, step.object, hand, &goals, seed)
}

/// Puts the held object back where it was taken from.
pub(super) fn put_back(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    taken_from: &GoalPose,
    hand: &Hand,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    toward(expert, scene, object, hand, std::slice::from_ref(taken_from), seed.fork("back"))
}

fn toward(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    hand: &Hand,
    goals: &[GoalPose],
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    let free = surroundings::world(scene, Some(object));
    let mut problem = None;
    // What falls far tips over and meets the hand again: every place is tried low before any is tried from higher up.
    for &height in &expert.settings.release_heights_m {
        for (index, goal) in goals.iter().enumerate().filter(|(_, goal)| expert.may_release(goal, height)) {
            match motions(expert, scene, object, hand, goal, height, &free, seed.fork_index(index as u64)) {
                Ok(commands) => return Ok(commands),
                Err(error) => problem = problem.or(Some(error)),
            }
        }
    }
    let name = expert.stage.name(object);
    let reason = problem.map_or_else(|| "no goal".to_owned(), |error| error.to_string());
    let evidence = format!("no free motion brings {name} to any of {} places: {reason}", goals.len());
    Err(Failure { cause: FailureCause::Planning, evidence })
}

/// Free motion to above the place, straight down, let go, back off.
#[allow(clippy::too_many_arguments)] // read-only context of one try
fn motions(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    hand: &Hand,
    goal: &GoalPose,
    height: f64,
    free: &CollisionWorld,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, PlanError> {
    let (planner, settings) = (&expert.planner, &expert.settings);
    let unusable = |error: genmanip_motion::GeometryError| PlanError::Unreachable { what: error.to_string() };
    let Some(held) = scene.objects().nth(object) else { return Ok(Vec::new()) };
    let pieces = held.model.pieces(&held.joint_positions);
    let tcp_from_object = tcp_from_object(expert, scene, object, hand);
    let attached = Attached::new(&held.id, &pieces, &tcp_from_object).map_err(unusable)?;
    let nothing = Allowed::none();
    let carrying =
        PlanningScene { world: free, attached: Some(&attached), allowed: &nothing, gripper_width: hand.width };

    let raised = |by: f64| Pose { position: goal.world_from_object.position + DVec3::Z * by, ..goal.world_from_object };
    let tcp_at = |world_from_object: Pose| world_from_object * tcp_from_object.inverse();
    let release = tcp_at(raised(height));
    // High enough to come in over the rim of whatever receives the object.
    let rim = goal.support.and_then(|carrier| scene.bounds(carrier)).map_or(0.0, |bounds| bounds.max.z);
    let above = tcp_at(raised((rim + 0.03 - goal.bounds.min.z).max(settings.lift_m)));

    // Once let go, the object is an obstacle.
    let mut occupied = free.clone();
    occupied.add(&held.id, &pieces, &raised(height)).map_err(unusable)?;
    let opened = PlanningScene { world: &occupied, attached: None, allowed: &nothing, gripper_width: hand.open_width };
    let hand_alone = PlanningScene { world: free, ..opened };
    let checker = planner.checker(&hand_alone, settings.hand_clearances_m[0]);
    let back = release.transform_vector(DVec3::NEG_Z) * settings.approach_m;
    let retreated = Pose { position: release.position + back, ..release };

    let mut problem = PlanError::Unreachable { what: "the place where to let go".into() };
    for config in planner.ik(&release, &hand.arm).iter().filter(|config| checker.is_free(config)).take(4) {
        let tried = (|| {
            let lower = planner.straight(&carrying, config, &above)?.reversed();
            let retreat = planner.straight(&opened, config, &retreated)?;
            let carry = planner.plan_joint(&carrying, &hand.arm, &[lower.start().to_vec()], seed.fork("carry"))?;
            Ok((carry, lower, retreat))
        })();
        match tried {
            Ok((carry, lower, retreat)) => {
                let mut commands = commands::follow(planner, &carry, hand.hold_width, settings.loaded_speed);
                commands.extend(commands::follow(planner, &lower, hand.hold_width, settings.careful_speed));
                commands.extend(commands::wait(config, hand.hold_width, settings.rest_steps));
                commands.extend(commands::fingers(config, hand.hold_width, hand.open_width, settings.open_steps));
                commands.extend(commands::follow(planner, &retreat, hand.open_width, settings.careful_speed));
                return Ok(commands);
            }
            Err(error) => problem = error,
        }
    }
    Err(problem)
}

/// How the held object sits in the hand, whatever the grasp was planned to be.
fn tcp_from_object(expert: &Expert, scene: &PosedScene, object: usize, hand: &Hand) -> Pose {
    let world_from_tcp = expert.planner.tcp_pose(&hand.arm);
    scene.objects().nth(object).map_or(Pose::IDENTITY, |held| world_from_tcp.inverse() * held.pose)
}
