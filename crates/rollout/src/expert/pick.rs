//! Picking: selects a reachable grasp that is also feasible at the goal, and plans the motions.

use genmanip_core::glam::DVec3;
use genmanip_core::{ExpertStyle, Failure, FailureCause, Grasp, Pose, Seed};
use genmanip_layout::{Move, obstacles};
use genmanip_motion::commands;
use genmanip_motion::{
    FeasibilitySettings, FeasibleGrasp, GeometryError, GraspRejections, HalfTurn, PickMotions, PickQuery, PickedObject,
    PlaceGoal,
};
use genmanip_relations::PosedScene;

use super::Expert;

/// Angle within which two directions count as equal, rad: less than what a policy resolves.
const SAME_DIRECTION_RAD: f64 = 0.02;

/// A planned pick as commands.
pub(super) struct Pick {
    /// Commands for approach, closing and lift.
    pub commands: Vec<Vec<f32>>,
    /// Gripper opening of the approach and the release, metres.
    pub open_width: f64,
    /// Gripper opening commanded while holding, metres: narrower than the object, so that the drive presses.
    pub hold_width: f64,
}

/// Plans a pick; `seen` restricts it to grasps from images (object frame, best first).
pub(super) fn plan(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    (arm, width): (&[f64], f64),
    seen: Option<Vec<Grasp>>,
    seed: Seed,
) -> Result<Pick, Failure> {
    let name = expert.stage.name(step.object);
    let planner = &*expert.planner;
    let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
    let usable = |goal: &Pose| planner.reaches_from_above(goal.position + DVec3::Z * height);
    let goals: Vec<PlaceGoal> =
        expert.goals(scene, step, &usable, seed).iter().map(|goal| expert.place_goal(scene, goal)).collect();
    let object = scene.objects().nth(step.object).filter(|_| !goals.is_empty());
    let Some(object) = object else {
        let evidence = format!("no free place for {name} where every condition on it holds");
        return Err(Failure { cause: FailureCause::NoGoalPose, evidence });
    };
    let world = obstacles::around(scene, None);
    let pieces = object.model.pieces(&object.joint_positions);
    let settings = &expert.settings;
    let tight = FeasibilitySettings { clearance_m: settings.tight_clearance_m, ..settings.feasibility.clone() };
    let query = PickQuery {
        planner,
        world: &world,
        object: PickedObject { name: object.id.as_str(), world_from_object: object.pose, pieces: &pieces },
        goals: &goals,
        arm,
        settings: &settings.feasibility,
    };
    let at = |settings: &FeasibilitySettings| {
        let query = PickQuery { settings, ..query };
        match expert.settings.style {
            ExpertStyle::Consistent => nearest(expert, scene, step.object, &query, seen.as_deref()),
            ExpertStyle::Default => None,
        }
        .map_or_else(|| feasible(expert, scene, step.object, &query, seen.as_deref(), seed), Ok)
    };
    // Flat objects can only be picked with the fingers close to the table.
    let grasps = at(&settings.feasibility).or_else(|_| at(&tight))?;
    let mut problem = None;
    for grasp in &grasps {
        match query.motions(grasp, seed.fork("reach")) {
            Ok(motions) => {
                let hold_width = (grasp.object_from_tcp.width - settings.squeeze_m).max(0.0);
                let commands = commands(expert, &query, width, grasp, &motions, hold_width);
                return Ok(Pick { commands, open_width: grasp.opening_m, hold_width });
            }
            Err(rejection) => problem = Some(rejection),
        }
    }
    let evidence = format!(
        "{} grasps of {name} can be reached, none by a free motion: {}",
        grasps.len(),
        problem.as_ref().and_then(|rejection| rejection.plan_error()).map_or_else(String::new, ToString::to_string)
    );
    Err(Failure { cause: FailureCause::Planning, evidence })
}

/// Grasps, best first, that are feasible at the object's pose and at some goal pose; or the reason why there are none.
fn feasible(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    query: &PickQuery,
    seen: Option<&[Grasp]>,
    seed: Seed,
) -> Result<Vec<FeasibleGrasp>, Failure> {
    let name = expert.stage.name(object);
    let (planner, settings) = (query.planner, &expert.settings);
    let flawed = |error: GeometryError| Failure { cause: FailureCause::NoGrasp, evidence: format!("{name}: {error}") };
    let known = match seen {
        Some(seen) => seen.to_vec(),
        None => {
            obstacles::verified_grasps(planner, scene, object, expert.precomputed_grasps(object)).map_err(flawed)?
        }
    };
    // An object without volume has no grasps.
    let generated = || match seen {
        Some(_) => Vec::new(),
        None => obstacles::generated_grasps(planner, scene, object, seed).unwrap_or_default(),
    };
    let mut candidates = known.into_iter().chain(std::iter::once_with(generated).flatten()).peekable();
    if candidates.peek().is_none() {
        let evidence = format!("{name} has no grasp that fits the hand as it lies");
        return Err(Failure { cause: FailureCause::NoGrasp, evidence });
    }
    let mut search = query.grasps(candidates.take(settings.grasps));
    let grasps: Vec<FeasibleGrasp> = search.by_ref().collect();
    if grasps.is_empty() {
        return Err(no_grasp(name, &search.rejections()));
    }
    Ok(lowest_release_first(expert, grasps))
}

/// Grasps in their order, except that those with a low release come before those with a long drop.
fn lowest_release_first(expert: &Expert, mut grasps: Vec<FeasibleGrasp>) -> Vec<FeasibleGrasp> {
    let highest_m = expert.settings.max_open_release_m;
    grasps.sort_by_key(|grasp| grasp.release_height_m.is_some_and(|height_m| height_m > highest_m));
    grasps
}

/// Feasible grasps in the order of their distance from the gripper's orientation, independent of the seed; `None` if
/// there are none.
fn nearest(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    query: &PickQuery,
    seen: Option<&[Grasp]>,
) -> Option<Vec<FeasibleGrasp>> {
    let planner = query.planner;
    let towards = planner.tcp_pose(query.arm).rotation;
    let known = match seen {
        Some(seen) => seen.to_vec(),
        None => {
            let known = obstacles::verified_grasps(planner, scene, object, expert.precomputed_grasps(object)).ok()?;
            let generated = obstacles::generated_grasps(planner, scene, object, Seed::new(0)).ok()?;
            obstacles::grasps_towards(planner, scene, object, known.into_iter().chain(generated).collect(), towards)
                .ok()?
        }
    };
    let world_from_object = query.object.world_from_object.rotation;
    let distance = |grasp: &Grasp| {
        let angle = (world_from_object * grasp.pose.rotation).angle_between(towards);
        (angle / SAME_DIRECTION_RAD).round() as u32
    };
    let mut candidates: Vec<(u32, Grasp)> =
        known.into_iter().flat_map(|grasp| [grasp.flipped(), grasp]).map(|grasp| (distance(&grasp), grasp)).collect();
    candidates.sort_by_key(|(distance, _)| *distance);
    let settings = FeasibilitySettings { half_turn: HalfTurn::Neither, ..query.settings.clone() };
    let query = PickQuery { settings: &settings, ..*query };
    let grasps: Vec<FeasibleGrasp> =
        query.grasps(candidates.into_iter().map(|(_, grasp)| grasp).take(expert.settings.grasps)).collect();
    (!grasps.is_empty()).then(|| lowest_release_first(expert, grasps))
}

/// Failure with the rejection counts of an object's grasps.
fn no_grasp(name: &str, rejections: &GraspRejections) -> Failure {
    let (out_of_reach, blocked, no_use) = (rejections.out_of_reach, rejections.blocked_count(), rejections.no_use);
    let cause = if out_of_reach >= blocked + no_use { FailureCause::NoIk } else { FailureCause::NoGrasp };
    let obstacles: Vec<String> =
        rejections.obstacles().iter().map(|(obstacle, count)| format!("{obstacle} {count}")).collect();
    let by = if obstacles.is_empty() { String::new() } else { format!(" (by {})", obstacles.join(", ")) };
    let evidence = format!(
        "no grasp of {name} works: {out_of_reach} out of reach, {blocked} blocked where it lies{by}, {no_use} of no \
         use at the goal"
    );
    Failure { cause, evidence }
}

/// Free motion to the pregrasp pose, straight approach, closing, straight lift.
fn commands(
    expert: &Expert,
    query: &PickQuery,
    width: f64,
    grasp: &FeasibleGrasp,
    motions: &PickMotions,
    hold_width: f64,
) -> Vec<Vec<f32>> {
    let (planner, settings) = (query.planner, &expert.settings);
    let PickMotions { reach, approach, lift } = motions;
    let open_width = grasp.opening_m;
    let mut commands = expert.reach(query.world, reach, width, open_width);
    commands.extend(commands::follow(planner, approach, open_width, settings.careful_speed));
    commands.extend(commands::wait(&grasp.config, open_width, settings.rest_steps));
    commands.extend(commands::fingers(&grasp.config, open_width, hold_width, settings.close_steps));
    commands.extend(commands::follow(planner, lift, hold_width, settings.careful_speed));
    commands.extend(commands::wait(lift.goal(), hold_width, settings.rest_steps));
    commands
}

/// Approach direction of the gripper.
pub(super) fn grasp_direction(world_from_tcp: &Pose) -> DVec3 {
    world_from_tcp.transform_vector(DVec3::Z)
}
