//! Plans placements: carry, lower, release, retreat, return home.

use genmanip_core::{AgentStage, FailedStage, Pose, Seed, StageCause};
use genmanip_motion::{
    AllowedCollisions, Attached, CollisionWorld, FeasibleGrasp, Path, PlaceGoal, PlaceQuery, PlanError, PlanningScene,
    Release, commands,
};
use glam::{DQuat, DVec3};

use super::Agent;
use super::arm_state::{self, ArmState, OBJECT};
use super::subtask::Subtask;
use crate::perception::PlacementTarget;
use crate::settings::{Asks, MotionSettings};

/// Maximum failed motion searches per placement pose; further arm configurations rarely help. Chosen by hand.
const SEARCHES_PER_PLACE: usize = 2;

/// The held object and its grasp.
#[derive(Clone)]
pub(super) struct HeldObject {
    pub subtask: Subtask,
    /// The grasp, in the object frame.
    pub grasp: FeasibleGrasp,
    /// Obstacle points above the table other than the object, world frame.
    pub points: Vec<DVec3>,
}

/// A planned placement: carry paths, release motions, and final object pose in the world frame.
type Planned = (Vec<Path>, Release, Pose);

impl HeldObject {
    /// True if the fingers stay wider than commanded, so an object must be between them.
    pub(super) fn is_grasped(&self, state: &ArmState, motion: &MotionSettings) -> bool {
        let commanded = hold_width(&self.grasp, motion);
        // Thin objects are narrower than the margin.
        state.width_m > commanded + motion.held_m.min(self.grasp.object_from_tcp.width * 0.3)
    }
}

/// Gripper width to command while holding (m); smaller than the object so that the gripper applies force.
pub(super) fn hold_width(grasp: &FeasibleGrasp, motion: &MotionSettings) -> f64 {
    (grasp.object_from_tcp.width - motion.squeeze_m).max(0.0)
}

/// Sets of goal poses of the held object at rest; the first set with a feasible placement is used.
///
/// A goal pose combines a yaw change with the target point or one of its alternatives. The yaw change is that of the
/// path's last cell; without a path, the answered one comes first, then those of `turns_deg`. On an open surface the
/// answered yaw is a set of its own. With [`Asks::Needed`], all goals of a set are tried from a low height before any
/// is tried from a greater one, so that a long object is aligned with the long side of a box.
pub(super) fn release_goals(agent: &Agent, subtask: &Subtask) -> Vec<Vec<PlaceGoal>> {
    let target = &subtask.target;
    let points: Vec<DVec3> = std::iter::once(target.point).chain(target.others.iter().copied()).collect();
    let with_turns = |turns: Vec<f64>| -> Vec<PlaceGoal> {
        let all = turns.iter().flat_map(|turn| points.iter().map(move |point| (*turn, *point)));
        all.map(|(turn, point)| release_goal(agent, target, point, turn)).collect()
    };
    let sets = match subtask.path.last() {
        Some((_, last)) => vec![vec![last.yaw_deg]],
        None => turn_sets(subtask.placement.turn_deg(), &agent.settings.turns_deg, target.hollow),
    };
    sets.into_iter().map(with_turns).collect()
}

/// Sets of yaw changes (degrees) with the answered one first. In a hollow receiver, into which objects may be released
/// from any height, all are one set: a low release at another yaw comes before a high one at the answered yaw.
fn turn_sets(asked: Option<f64>, usual: &[f64], is_hollow: bool) -> Vec<Vec<f64>> {
    let others: Vec<f64> = usual.iter().copied().filter(|turn| Some(*turn) != asked).collect();
    match asked {
        Some(turn) if !is_hollow => vec![vec![turn], others],
        _ => vec![asked.into_iter().chain(others).collect()],
    }
}

fn release_goal(agent: &Agent, target: &PlacementTarget, point: DVec3, turn_deg: f64) -> PlaceGoal {
    let motion = &agent.settings.motion;
    PlaceGoal {
        world_from_object: pose_with_yaw(point, turn_deg),
        highest_release_m: if target.hollow { f64::INFINITY } else { motion.max_open_release_m },
        clear_height_m: (target.rim_m - point.z).max(0.0) + motion.rim_clearance_m,
    }
}

/// Object pose over a point with a yaw relative to its initial pose.
fn pose_with_yaw(point: DVec3, turn_deg: f64) -> Pose {
    Pose { position: point, rotation: DQuat::from_rotation_z(turn_deg.to_radians()) }
}

/// Plans carry, release and return to the home configuration.
pub(super) fn plan(
    agent: &Agent,
    held: &HeldObject,
    state: &ArmState,
    seed: Seed,
) -> Result<(Vec<Vec<f32>>, String), FailedStage> {
    let release_goals = release_goals(agent, &held.subtask);
    let planned = plan_motions(agent, held, state, &release_goals, &held.subtask.path, seed);
    let (carry_paths, release, pose) = planned.map_err(|error| {
        let evidence = format!("no collision-free motion to place {}: {error}", held.subtask.name);
        FailedStage::new(AgentStage::Motion, StageCause::Blocked, evidence)
    })?;
    let at = pose.position;
    let words =
        format!("at ({:.3}, {:.3}, {:.3}) m, turned by {:.0} degrees", at.x, at.y, at.z, pose.yaw().to_degrees());
    Ok((commands(agent, held, state, &carry_paths, &release, &pose), words))
}

/// Plans to put the object back at its initial pose.
pub(super) fn put_back(
    agent: &Agent,
    held: &HeldObject,
    state: &ArmState,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, PlanError> {
    let point = held.subtask.object.pose.position;
    let target =
        PlacementTarget { point, others: Vec::new(), hollow: false, rim_m: point.z, neighbours: 0, mixed: false };
    let release_goals = [vec![release_goal(agent, &target, point, 0.0)]];
    let (carry_paths, release, pose) = plan_motions(agent, held, state, &release_goals, &[], seed.fork("back"))?;
    Ok(commands(agent, held, state, &carry_paths, &release, &pose))
}

/// Plans to open the gripper in place and return home.
pub(super) fn drop(agent: &Agent, held: &HeldObject, state: &ArmState, seed: Seed) -> Vec<Vec<f32>> {
    let motion = &agent.settings.motion;
    let open = agent.planner.robot().gripper.max_width;
    let mut all = commands::fingers(&state.arm, hold_width(&held.grasp, motion), open, motion.finger_steps);
    let world = world(agent, held);
    all.extend(home(agent, &world, &state.arm, open, &AllowedCollisions::none(), seed));
    all
}

fn world(agent: &Agent, held: &HeldObject) -> CollisionWorld {
    arm_state::world_with_points(&agent.settings, &held.points, agent.planner.settings().depth.radius_m)
}

fn plan_motions(
    agent: &Agent,
    held: &HeldObject,
    state: &ArmState,
    release_goals: &[Vec<PlaceGoal>],
    path_cells: &[(DVec3, crate::ask::PathCell)],
    seed: Seed,
) -> Result<Planned, PlanError> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let world = world(agent, held);
    let object = &held.subtask.object;
    let tcp_from_object = held.grasp.object_from_tcp.pose.inverse();
    let mut arm = state.arm.clone();
    let mut carried = Vec::new();
    for (index, (point, cell)) in path_cells.iter().enumerate().take(path_cells.len().saturating_sub(1)) {
        let attached = Attached::new(OBJECT, &object.pieces, &tcp_from_object)
            .map_err(|error| PlanError::Unreachable { what: error.to_string() })?;
        let no_contact = AllowedCollisions::none();
        let carrying = PlanningScene {
            world: &world,
            attached: Some(&attached),
            allowed: &no_contact,
            gripper_width: state.width_m,
        };
        let over = pose_with_yaw(*point + DVec3::Z * cell.height_m, cell.yaw_deg) * held.grasp.object_from_tcp.pose;
        let configs: Vec<Vec<f64>> =
            planner.ik_each(&over, &arm).take(motion.feasibility.goal_configurations).collect();
        if configs.is_empty() {
            return Err(PlanError::Unreachable { what: format!("cell {} at {} m", cell.cell, cell.height_m) });
        }
        let path = planner.plan_joint(&carrying, &arm, &configs, seed.fork("way").fork_index(index as u64))?;
        arm = path.goal().to_vec();
        carried.push(path);
    }
    let query = PlaceQuery {
        planner,
        world: &world,
        name: OBJECT,
        pieces: &object.pieces,
        tcp_from_object,
        arm: &arm,
        held_width_m: state.width_m,
        open_width_m: held.grasp.opening_m,
        settings: &motion.feasibility,
        searches: motion.searches,
        searches_per_goal: SEARCHES_PER_PLACE,
    };
    // `Asks::Every` tries the goals one by one, each from all heights, as when the published answers were recorded, so
    // that replayed answers belong to the same scenes.
    let at_once = match agent.settings.asks {
        Asks::Needed => usize::MAX,
        Asks::Every => 1,
    };
    let (mut failure, mut exhausted) = (None, 0);
    let short = motion.short();
    for settings in [&motion.feasibility, &short] {
        let query = PlaceQuery { settings, ..query };
        for (index, goals) in release_goals.iter().flat_map(|set| set.chunks(at_once)).enumerate() {
            if exhausted >= motion.searches {
                break;
            }
            match query.first(goals, seed.fork("put").fork_index(index as u64)) {
                Ok((goal, release)) => return Ok((carried, release, goals[goal].world_from_object)),
                Err(error) => {
                    exhausted += usize::from(matches!(error, Some(PlanError::Exhausted { .. })));
                    failure = error.or(failure);
                }
            }
        }
    }
    Err(failure.unwrap_or(PlanError::Unreachable { what: "the release pose".into() }))
}

/// Commands for carry, lower, release, retreat and return home.
fn commands(
    agent: &Agent,
    held: &HeldObject,
    state: &ArmState,
    carry_paths: &[Path],
    release: &Release,
    pose: &Pose,
) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let (hold, open) = (hold_width(&held.grasp, motion), held.grasp.opening_m);
    let Release { carry, lower, retreat } = release;
    let mut all = commands::wait(&state.arm, hold, 1);
    for path in carry_paths.iter().chain([carry]) {
        all.extend(commands::follow(planner, path, hold, motion.loaded_speed));
    }
    all.extend(commands::follow(planner, lower, hold, motion.careful_speed));
    all.extend(commands::wait(lower.goal(), hold, motion.rest_steps));
    all.extend(commands::fingers(lower.goal(), hold, open, motion.finger_steps));
    all.extend(commands::follow(planner, retreat, open, motion.careful_speed));
    let mut world = world(agent, held);
    // The same pieces were accepted before, so this cannot fail.
    let _ = world.add(OBJECT, &held.subtask.object.pieces, pose);
    let leaving = AllowedCollisions::none().and_gripper(planner.robot(), OBJECT);
    all.extend(home(agent, &world, retreat.goal(), open, &leaving, agent.seed.fork("home")));
    all
}

/// Commands to return to the home configuration, where the arm occludes nothing, and to open the gripper.
fn home(
    agent: &Agent,
    world: &CollisionWorld,
    arm: &[f64],
    width_m: f64,
    allowed: &AllowedCollisions,
    seed: Seed,
) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let around = PlanningScene { world, attached: None, allowed, gripper_width: width_m };
    let release_goal = planner.robot().home.clone();
    let direct = planner.plan_joint(&around, arm, std::slice::from_ref(&release_goal), seed).map(|path| vec![path]);
    let paths = direct.or_else(|failure| {
        // Obstacles violate the clearance at the start: retreat straight up first.
        let from = planner.tcp_pose(arm);
        let up = Pose { position: from.position + DVec3::Z * motion.feasibility.lift_m, ..from };
        let empty = CollisionWorld::new();
        let rise = planner.straight(&PlanningScene { world: &empty, ..around }, arm, &up).map_err(|_| failure)?;
        let rest = planner.plan_joint(&around, rise.goal(), &[release_goal], seed)?;
        Ok::<_, PlanError>(vec![rise, rest])
    });
    // If no path home exists, the arm stays and is visible in the next images.
    let Ok(paths) = paths else { return commands::wait(arm, width_m, motion.rest_steps) };
    let open = planner.robot().gripper.max_width;
    let end = paths.last().map_or(arm, |path| path.goal()).to_vec();
    let mut all: Vec<Vec<f32>> =
        paths.iter().flat_map(|path| commands::follow(planner, path, width_m, motion.empty_speed)).collect();
    all.extend(commands::fingers(&end, width_m, open, motion.finger_steps));
    all.extend(commands::wait(&end, open, motion.rest_steps));
    all
}

#[cfg(test)]
mod tests {
    use super::turn_sets;

    #[test]
    fn an_answered_turn_comes_before_others() {
        let check = |asked: Option<f64>, is_hollow: bool, expected: &[&[f64]]| {
            assert_eq!(turn_sets(asked, &[0.0, 90.0, 45.0], is_hollow), expected, "{asked:?}, hollow {is_hollow}");
        };
        check(None, false, &[&[0.0, 90.0, 45.0]]);
        check(Some(0.0), false, &[&[0.0], &[90.0, 45.0]]);
        check(Some(-30.0), false, &[&[-30.0], &[0.0, 90.0, 45.0]]);
        check(Some(90.0), true, &[&[90.0, 0.0, 45.0]]);
    }
}
