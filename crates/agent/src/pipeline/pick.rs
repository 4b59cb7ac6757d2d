//! Plans picks: grasps from the object's points near the grab point, and the motions that execute them.

use genmanip_core::{AgentStage, FailedStage, Grasp, Pose, Seed, StageCause};
use genmanip_motion::{
    AllowedCollisions, FeasibilitySettings, FeasibleGrasp, GraspRejections, Path, PickQuery, PickedObject, PlaceGoal,
    PlanError, PlanningScene, commands,
};
use glam::DVec3;

use super::arm_state::{self, ArmState, OBJECT};
use super::subtask::Subtask;
use super::{Agent, place};
use crate::perception::SegmentedViews;
use crate::services::{GraspError, GraspQuestion};

/// A planned pick as commands, with the grasp.
pub(super) struct Pick {
    /// Joint and gripper commands for reach, approach, close and lift.
    pub commands: Vec<Vec<f32>>,
    /// The grasp, in the object frame.
    pub grasp: FeasibleGrasp,
    /// Obstacle points other than the object, world frame.
    pub points: Vec<DVec3>,
    /// Description of the chosen grasp, for the transcript.
    pub words: String,
}

/// Distance (m) and angle (rad) below which two grasps count as the same: about a finger's width. Chosen by hand.
const SAME_GRASP_M: f64 = 0.015;
const SAME_GRASP_RAD: f64 = 0.35;

pub(super) fn plan(
    agent: &Agent,
    views: &SegmentedViews,
    subtask: &Subtask,
    state: &ArmState,
    seed: Seed,
) -> Result<Pick, FailedStage> {
    let (planner, settings) = (&*agent.planner, &agent.settings);
    let motion = &settings.motion;
    let candidates = near_grab_point(agent, views, subtask)?;
    let radius_m = planner.settings().depth.radius_m;
    let mut world = arm_state::world_with_points(settings, &subtask.around, radius_m);
    let unsuited =
        |error: &dyn std::fmt::Display| FailedStage::new(AgentStage::Grasp, StageCause::Unsuited, error.to_string());
    world.add(OBJECT, &subtask.object.pieces, &subtask.object.pose).map_err(|error| unsuited(&error))?;
    let sets = place::release_goals(agent, subtask);
    let all: Vec<PlaceGoal> = sets.concat();
    // Grasps with which the first set of goals can be reached come first.
    let preferred = sets.first().filter(|first| first.len() < all.len());
    let query = PickQuery {
        planner,
        world: &world,
        object: PickedObject { name: OBJECT, world_from_object: subtask.object.pose, pieces: &subtask.object.pieces },
        goals: &all,
        arm: &state.arm,
        settings: &motion.feasibility,
    };
    let tight = FeasibilitySettings { clearance_m: motion.tight_clearance_m, ..motion.feasibility.clone() };
    let short = motion.short();
    let (mut failure, mut failed_searches) = (None, 0);
    let tries = [&motion.feasibility, &tight, &short]
        .into_iter()
        .flat_map(|settings| preferred.map(|goals| (settings, goals)).into_iter().chain([(settings, &all)]));
    for (settings, goals) in tries {
        let query = PickQuery { settings, goals, ..query };
        let mut search = query.grasps(candidates.iter().cloned());
        let mut tried = 0;
        while failed_searches < motion.searches
            && let Some(grasp) = search.next()
        {
            tried += 1;
            let planned = query
                .approach(&grasp)
                .and_then(|approach| Ok((query.reach(&grasp, &approach, seed.fork("reach"))?, approach)))
                .and_then(|(reach, approach)| Ok((reach, approach, lift(&query, &grasp)?)));
            match planned {
                Ok(motions) => {
                    let at = (subtask.object.pose * grasp.object_from_tcp.pose).position;
                    let from_point = subtask.grab.map_or_else(String::new, |grab| {
                        format!(" at {:.0} mm from the point", at.distance(grab) * 1e3)
                    });
                    let Grasp { width, score, .. } = grasp.object_from_tcp;
                    let words = format!("grasp of {:.0} mm{from_point}, score {score:.2}", width * 1e3);
                    let commands = commands(agent, state, &grasp, &motions);
                    return Ok(Pick { commands, grasp, points: subtask.around.clone(), words });
                }
                Err(error) => {
                    failed_searches += usize::from(matches!(error, PlanError::Exhausted { .. }));
                    let words = format!("grasps of {} in reach but no collision-free motion: {error}", subtask.name);
                    failure = Some(FailedStage::new(AgentStage::Motion, StageCause::Blocked, words));
                }
            }
        }
        if tried == 0 && goals.len() == all.len() {
            failure = failure.or_else(|| Some(no_grasp(&subtask.name, candidates.len(), &search.rejections())));
        }
    }
    Err(failure.unwrap_or_else(|| {
        FailedStage::new(AgentStage::Grasp, StageCause::NoGrasp, format!("{} has no grasp", subtask.name))
    }))
}

/// Grasp candidates within the grasp radius of the grab point, best first, those that the object slipped from last; in
/// the object frame.
fn near_grab_point(agent: &Agent, views: &SegmentedViews, subtask: &Subtask) -> Result<Vec<Grasp>, FailedStage> {
    let settings = &agent.settings;
    let camera_positions = views.camera_positions();
    let question = GraspQuestion {
        points: &subtask.object.points,
        scene: &subtask.around,
        world_from_camera: views.shown().map_or(Pose::IDENTITY, |view| view.image.world_from_camera),
        camera_positions: &camera_positions,
        table_height: settings.table_m,
    };
    let failed = |error| match error {
        GraspError::Unsuited(why) => {
            FailedStage::new(AgentStage::Grasp, StageCause::Unsuited, format!("{}: {why}", subtask.name))
        }
        GraspError::Service(_) => FailedStage::new(AgentStage::Grasp, StageCause::Service, error.to_string()),
    };
    let object_from_world = subtask.object.pose.inverse();
    let (mut count, mut near) = (0, Vec::new());
    // Deep in a container, the walls occlude the object's sides from every camera, and unobserved space counts as
    // occupied. If that rejects every grasp, only observed points count as obstacles; the motions are checked against
    // those.
    for question in [question, GraspQuestion { scene: &[], ..question }] {
        let found = agent.services.grasps.grasps(&question).map_err(failed)?;
        count += found.len();
        near = found
            .into_iter()
            .filter(|grasp| {
                subtask.grab.is_none_or(|grab| grasp.pose.position.distance(grab) <= settings.grasp_radius_m)
            })
            .collect::<Vec<Grasp>>();
        near.sort_by_key(|grasp| agent.slipped.iter().any(|failed| is_same_grasp(failed, &grasp.pose)));
        near.truncate(settings.grasps);
        if !near.is_empty() {
            break;
        }
    }
    if near.is_empty() {
        let missing = if subtask.grab.is_some() { "is near the grab point" } else { "is left" };
        let evidence = format!("none of {count} grasps of {} {missing}", subtask.name);
        return Err(FailedStage::new(AgentStage::Grasp, StageCause::NoGrasp, evidence));
    }
    Ok(near.into_iter().map(|grasp| Grasp { pose: object_from_world * grasp.pose, ..grasp }).collect())
}

/// True if two grasps are nearly the same, in the world frame; the fingers are interchangeable.
fn is_same_grasp(one: &Pose, other: &Pose) -> bool {
    let angle = |axis: DVec3| one.transform_vector(axis).angle_between(other.transform_vector(axis));
    let across = angle(DVec3::Y);
    one.position.distance(other.position) < SAME_GRASP_M
        && angle(DVec3::Z) < SAME_GRASP_RAD
        && across.min(std::f64::consts::PI - across) < SAME_GRASP_RAD
}

/// Plans a straight lift with the attached object. If the object's hull collides with its support or container at the
/// start, plans with the gripper alone.
fn lift(query: &PickQuery, grasp: &FeasibleGrasp) -> Result<Path, genmanip_motion::PlanError> {
    query.lift(grasp).or_else(|failure| {
        let from = query.planner.tcp_pose(&grasp.config);
        let lifted = from.position + DVec3::Z * query.settings.lift_m;
        let allowed = AllowedCollisions::none().and_all(query.object.name);
        let around = PlanningScene {
            world: query.world,
            attached: None,
            allowed: &allowed,
            gripper_width: grasp.object_from_tcp.width,
        };
        let to = Pose { position: lifted, ..from };
        query.planner.straight(&around, &grasp.config, &to).map_err(|_| failure)
    })
}

fn no_grasp(name: &str, candidates: usize, rejections: &GraspRejections) -> FailedStage {
    let (out_of_reach, blocked, unusable) = (rejections.out_of_reach, rejections.blocked_count(), rejections.no_use);
    let cause = if out_of_reach >= blocked + unusable { StageCause::OutOfReach } else { StageCause::Blocked };
    let obstacles: Vec<String> =
        rejections.obstacles().iter().map(|(obstacle, count)| format!("{obstacle} {count}")).collect();
    let evidence = format!(
        "no grasp of {name} works: {candidates} candidates, {out_of_reach} out of reach, {blocked} blocked ({}), \
         {unusable} unusable at the placement",
        obstacles.join(", ")
    );
    FailedStage::new(AgentStage::Grasp, cause, evidence)
}

fn commands(
    agent: &Agent,
    state: &ArmState,
    grasp: &FeasibleGrasp,
    (reach, approach, lift): &(Path, Path, Path),
) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let (open, hold) = (grasp.opening_m, place::hold_width(grasp, motion));
    let mut all = commands::fingers(reach.start(), state.width_m, open.max(state.width_m), motion.rest_steps);
    all.extend(commands::follow(planner, reach, open.max(state.width_m), motion.empty_speed));
    all.extend(commands::fingers(reach.goal(), open.max(state.width_m), open, motion.finger_steps));
    all.extend(commands::follow(planner, approach, open, motion.careful_speed));
    all.extend(commands::wait(&grasp.config, open, motion.rest_steps));
    all.extend(commands::fingers(&grasp.config, open, hold, motion.finger_steps));
    all.extend(commands::follow(planner, lift, hold, motion.careful_speed));
    all.extend(commands::wait(lift.goal(), hold, motion.rest_steps));
    all
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn grasps_are_the_same_within_a_finger_also_turned_by_half() {
        let grasp = |x: f64, yaw: f64| Pose {
            position: DVec3::new(x, 0.0, 0.1),
            rotation: DQuat::from_rotation_z(yaw) * DQuat::from_rotation_x(std::f64::consts::PI),
        };
        let check = |other: Pose, expected: bool| assert_eq!(is_same_grasp(&grasp(0.5, 0.0), &other), expected);
        check(grasp(0.51, 0.2), true);
        check(grasp(0.5, std::f64::consts::PI), true);
        check(grasp(0.52, 0.0), false);
        check(grasp(0.5, 1.0), false);
        check(Pose { rotation: DQuat::from_rotation_x(2.0), ..grasp(0.5, 0.0) }, false);
    }
}
