//! Picking: a grasp that can be reached, that also works where the object is to go, and the motions to take it.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use genmanip_core::glam::DVec3;
use genmanip_core::{Failure, FailureCause, Grasp, Pose, Seed};
use genmanip_layout::{GoalPose, Move, is_in_reach, surroundings};
use genmanip_motion::{Allowed, Attached, CollisionWorld, GeometryError, PlanError, PlanningScene};
use genmanip_scene::relations::PosedScene;

use super::{Expert, commands};

/// A planned pick.
pub(super) struct Pick {
    /// Approach, close, lift.
    pub commands: Vec<Vec<f32>>,
    /// Opening with which the hand approaches and later lets go.
    pub open_width: f64,
    /// Width commanded while holding: narrower than the object, so that the drive presses.
    pub hold_width: f64,
}

/// A grasp with an arm configuration that takes it.
struct Candidate {
    grasp: Grasp,
    config: Vec<f64>,
    open_width: f64,
    hold_width: f64,
    /// Least height above a goal pose at which the hand has room to let go, metres.
    release_m: f64,
}

/// What is in the way of a pick: everything, and everything but the object itself.
struct Worlds {
    occupied: CollisionWorld,
    free: CollisionWorld,
}

/// Plans a pick, or says what stood in the way.
pub(super) fn plan(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    arm: &[f64],
    width: f64,
    seed: Seed,
) -> Result<Pick, Failure> {
    let name = expert.stage.name(step.object);
    let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
    let usable = |goal: &Pose| is_in_reach(&expert.planner, goal.position + DVec3::Z * height);
    let goals = expert.goals(scene, step, &usable, seed);
    if goals.is_empty() {
        let evidence = format!("no free place for {name} where every condition on it holds");
        return Err(Failure { cause: FailureCause::NoGoalPose, evidence });
    }
    let worlds =
        Worlds { occupied: surroundings::world(scene, None), free: surroundings::world(scene, Some(step.object)) };
    let [roomy, tight] = expert.settings.hand_clearances_m;
    let at = |clearance_m: f64| candidates(expert, scene, step, arm, &goals, &worlds, clearance_m, seed);
    // Flat things can only be taken with the fingers close above the table.
    let candidates = at(roomy).or_else(|_| at(tight))?;
    let mut problem = None;
    for candidate in &candidates {
        match motions(expert, scene, step, arm, width, candidate, &worlds, seed) {
            Ok(commands) => {
                return Ok(Pick { commands, open_width: candidate.open_width, hold_width: candidate.hold_width });
            }
            Err(error) => problem = Some(error),
        }
    }
    let evidence = format!(
        "{} grasps of {name} can be reached, none by a free motion: {}",
        candidates.len(),
        problem.map_or_else(String::new, |error| error.to_string())
    );
    Err(Failure { cause: FailureCause::Planning, evidence })
}

/// Grasps, best first, that the arm can take here, with this much room around the hand, and let go of at some goal pose.
#[allow(clippy::too_many_arguments)] // read-only context of one try
fn candidates(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    arm: &[f64],
    goals: &[GoalPose],
    worlds: &Worlds,
    clearance_m: f64,
    seed: Seed,
) -> Result<Vec<Candidate>, Failure> {
    let name = expert.stage.name(step.object);
    let (planner, settings) = (&expert.planner, &expert.settings);
    let flawed = |error: GeometryError| Failure { cause: FailureCause::NoGrasp, evidence: format!("{name}: {error}") };
    let tried = surroundings::tried_grasps(planner, scene, step.object, expert.tried(step.object)).map_err(flawed)?;
    // What has no volume has no grasps.
    let generated = || surroundings::generated_grasps(planner, scene, step.object, seed).unwrap_or_default();
    let mut grasps = tried.into_iter().chain(std::iter::once_with(generated).flatten()).peekable();
    if grasps.peek().is_none() {
        let evidence = format!("{name} has no grasp that fits the hand as it lies");
        return Err(Failure { cause: FailureCause::NoGrasp, evidence });
    }
    let Some(object) = scene.objects().nth(step.object) else { return Ok(Vec::new()) };
    let nothing = Allowed::none();
    let (mut out_of_reach, mut useless) = (0, 0);
    let mut obstacles: Vec<String> = Vec::new();
    let mut candidates = Vec::new();
    for grasp in grasps.take(settings.grasps).flat_map(|grasp| [grasp.clone(), grasp.flipped()]) {
        let wide = (grasp.width + settings.finger_clearance_m).min(expert.stage.robot.gripper.max_width);
        // In a ring or beside a rim there may be room for the opening that the grasp was tested with and no more.
        let beside = |open_width: f64, config: &[f64]| {
            let around =
                PlanningScene { world: &worlds.occupied, attached: None, allowed: &nothing, gripper_width: open_width };
            planner.checker(&around, settings.object_clearance_m).is_free(config)
        };
        let around = PlanningScene { world: &worlds.free, attached: None, allowed: &nothing, gripper_width: wide };
        let checker = planner.checker(&around, clearance_m);
        let configs = planner.ik(&(object.pose * grasp.pose), arm);
        if configs.is_empty() {
            out_of_reach += 1;
            continue;
        }
        let Some(config) = configs.iter().find(|config| checker.is_free(config)).cloned() else {
            obstacles.extend(configs.first().and_then(|config| checker.check(config)).map(|report| report.other));
            continue;
        };
        let Some(open_width) = [wide, planner.opening(&grasp)].into_iter().find(|&width| beside(width, &config)) else {
            obstacles.push(object.id.clone());
            continue;
        };
        let is_free_at = |goal: &GoalPose, height_m: f64| {
            let raised = goal.world_from_object.position + DVec3::Z * height_m;
            let raised = Pose { position: raised, ..goal.world_from_object };
            planner.ik_each(&(raised * grasp.pose), &config).take(4).any(|config| checker.is_free(&config))
        };
        let release_m = settings.release_heights_m.iter().copied().find(|&height_m| {
            goals.iter().any(|goal| expert.may_release(goal, height_m) && is_free_at(goal, height_m))
        });
        let Some(release_m) = release_m else {
            useless += 1;
            continue;
        };
        let hold_width = (grasp.width - settings.squeeze_m).max(0.0);
        candidates.push(Candidate { grasp, config, open_width, hold_width, release_m });
        if candidates.len() >= settings.planned_grasps {
            break;
        }
    }
    if candidates.is_empty() {
        let blocked = obstacles.len();
        let cause = if out_of_reach >= blocked + useless { FailureCause::NoIk } else { FailureCause::NoGrasp };
        let evidence = format!(
            "no grasp of {name} works: {out_of_reach} out of reach, {blocked} blocked where it lies{}, {useless} of no \
             use at the goal",
            by(&obstacles)
        );
        return Err(Failure { cause, evidence });
    }
    // Rather a worse grasp than a long fall.
    candidates.sort_by_key(|candidate| candidate.release_m > settings.max_open_release_m);
    Ok(candidates)
}

/// ` (by 057 12, table 3)`: what stands in the way and how often, the most frequent first; nothing when nothing does.
fn by(obstacles: &[String]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    obstacles.iter().for_each(|name| *counts.entry(name).or_default() += 1);
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|&(_, count)| Reverse(count));
    let told: Vec<String> = counts.iter().map(|(name, count)| format!("{name} {count}")).collect();
    if told.is_empty() { String::new() } else { format!(" (by {})", told.join(", ")) }
}

/// Free motion to the approach, straight in, close, straight up.
#[allow(clippy::too_many_arguments)] // read-only context of one try
fn motions(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    arm: &[f64],
    width: f64,
    candidate: &Candidate,
    worlds: &Worlds,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, PlanError> {
    let (planner, settings) = (&expert.planner, &expert.settings);
    let Candidate { grasp, config, open_width, hold_width, .. } = candidate;
    let Some(object) = scene.objects().nth(step.object) else { return Ok(Vec::new()) };
    let nothing = Allowed::none();
    // The object itself is an obstacle too: the open fingers must come in around it.
    let open = PlanningScene { world: &worlds.occupied, attached: None, allowed: &nothing, gripper_width: *open_width };

    let world_from_tcp = planner.tcp_pose(config);
    let before = Pose {
        position: world_from_tcp.position - grasp_direction(&world_from_tcp) * settings.approach_m,
        ..world_from_tcp
    };
    // Wide things leave the fingers less room than motions keep elsewhere, but they are not to be touched either.
    let around_it = nothing.clone().and_gripper(planner.robot(), &object.id);
    let beside = PlanningScene { allowed: &around_it, ..open };
    let straight = planner.straight(&open, config, &before).or_else(|problem| {
        let path = planner.straight(&beside, config, &before)?;
        let exact = planner.checker(&open, settings.object_clearance_m);
        if path.states(0.005).iter().all(|state| exact.is_free(state)) { Ok(path) } else { Err(problem) }
    });
    let approach = straight?.reversed();
    let reach = planner.plan_joint(&open, arm, &[approach.start().to_vec()], seed.fork("reach"))?;

    let lifted = Pose { position: world_from_tcp.position + DVec3::Z * settings.lift_m, ..world_from_tcp };
    let pieces = object.model.pieces(&object.joint_positions);
    let attached = Attached::new(&object.id, &pieces, &grasp.pose.inverse())
        .map_err(|error| PlanError::Unreachable { what: error.to_string() })?;
    let holding =
        PlanningScene { world: &worlds.free, attached: Some(&attached), allowed: &nothing, gripper_width: grasp.width };
    let lift = planner.straight(&holding, config, &lifted)?;

    let mut commands = expert.reach(&worlds.occupied, &reach, width, *open_width);
    commands.extend(commands::follow(planner, &approach, *open_width, settings.careful_speed));
    commands.extend(commands::wait(config, *open_width, settings.rest_steps));
    commands.extend(commands::fingers(config, *open_width, *hold_width, settings.close_steps));
    commands.extend(commands::follow(planner, &lift, *hold_width, settings.careful_speed));
    commands.extend(commands::wait(lift.goal(), *hold_width, settings.rest_steps));
    Ok(commands)
}

/// Direction in which the hand moves towards what it grasps.
pub(super) fn grasp_direction(world_from_tcp: &Pose) -> DVec3 {
    world_from_tcp.transform_vector(DVec3::Z)
}
