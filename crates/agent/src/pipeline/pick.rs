//! Taking hold: grasps from the points of the thing near the grab point, and the motions to take it.

use genmanip_core::{Grasp, Pose, Seed};
use genmanip_motion::{
    Allowed, FeasibilitySettings, FeasibleGrasp, GraspRejections, Path, PickQuery, PickedObject, PlaceGoal, PlanError,
    PlanningScene, commands,
};
use glam::DVec3;

use super::hand::{self, Hand, THING};
use super::job::Job;
use super::{Agent, put};
use crate::ask::FailedStage;
use crate::services::{GraspError, GraspQuestion};
use crate::sight::Sight;

/// A planned pick.
pub(super) struct Pick {
    /// Reach, approach, close, lift.
    pub commands: Vec<Vec<f32>>,
    /// The grasp, in the thing's frame.
    pub grasp: FeasibleGrasp,
    /// Obstacles but the thing.
    pub points: Vec<DVec3>,
    /// What was chosen, for the transcript.
    pub words: String,
}

pub(super) fn plan(agent: &Agent, sight: &Sight, job: &Job, hand: &Hand, seed: Seed) -> Result<Pick, FailedStage> {
    let (planner, settings) = (&*agent.planner, &agent.settings);
    let motion = &settings.motion;
    let candidates = near_grab_point(agent, sight, job)?;
    let radius_m = planner.settings().depth.radius_m;
    let mut world = hand::with_points(settings, &job.around, radius_m);
    let flawed = |error: &dyn std::fmt::Display| FailedStage::new("grasp", "unsuited", error.to_string());
    world.add(THING, &job.thing.pieces, &job.thing.pose).map_err(|error| flawed(&error))?;
    let goals: Vec<PlaceGoal> = put::goals(agent, job);
    let query = PickQuery {
        planner,
        world: &world,
        object: PickedObject { name: THING, world_from_object: job.thing.pose, pieces: &job.thing.pieces },
        goals: &goals,
        arm: &hand.arm,
        settings: &motion.feasibility,
    };
    let tight = FeasibilitySettings { clearance_m: motion.tight_clearance_m, ..motion.feasibility.clone() };
    let short = motion.short();
    let (mut problem, mut in_vain) = (None, 0);
    for settings in [&motion.feasibility, &tight, &short] {
        let query = PickQuery { settings, ..query };
        let mut search = query.grasps(candidates.iter().cloned());
        let mut tried = 0;
        while in_vain < motion.searches
            && let Some(grasp) = search.next()
        {
            tried += 1;
            let planned = query
                .approach(&grasp)
                .and_then(|approach| Ok((query.reach(&grasp, &approach, seed.fork("reach"))?, approach)))
                .and_then(|(reach, approach)| Ok((reach, approach, lift(&query, &grasp)?)));
            match planned {
                Ok(motions) => {
                    let words = format!(
                        "grasp of {:.0} mm at {:.0} mm from the point, score {:.2}",
                        grasp.object_from_tcp.width * 1e3,
                        (job.thing.pose * grasp.object_from_tcp.pose).position.distance(job.grab) * 1e3,
                        grasp.object_from_tcp.score,
                    );
                    let commands = commands(agent, hand, &grasp, &motions);
                    return Ok(Pick { commands, grasp, points: job.around.clone(), words });
                }
                Err(error) => {
                    in_vain += usize::from(matches!(error, PlanError::Exhausted { .. }));
                    let words = format!("grasps of {} in reach, none by a free motion: {error}", job.name);
                    problem = Some(FailedStage::new("motion", "blocked", words));
                }
            }
        }
        if tried == 0 {
            problem = problem.or_else(|| Some(no_grasp(&job.name, candidates.len(), &search.rejections())));
        }
    }
    Err(problem.unwrap_or_else(|| FailedStage::new("grasp", "none", format!("{} has no grasp", job.name))))
}

/// Grasps in the thing's frame, best first, near enough to the grab point.
fn near_grab_point(agent: &Agent, sight: &Sight, job: &Job) -> Result<Vec<Grasp>, FailedStage> {
    let settings = &agent.settings;
    let eyes = sight.eyes();
    let question = GraspQuestion {
        points: &job.thing.points,
        scene: &job.around,
        world_from_camera: sight.shown().map_or(Pose::IDENTITY, |view| view.image.world_from_camera),
        eyes: &eyes,
        table_height: settings.table_m,
    };
    let failed = |error| match error {
        GraspError::Unsuited(why) => FailedStage::new("grasp", "unsuited", format!("{}: {why}", job.name)),
        GraspError::Service(_) => FailedStage::new("grasp", FailedStage::SERVICE, error.to_string()),
    };
    let thing_from_world = job.thing.pose.inverse();
    let (mut count, mut near) = (0, Vec::new());
    // Deep in a container, walls hide the sides of a thing from all cameras and everything counts as taken: then only
    // what is seen is in the way, and the motions are tested against that.
    for question in [question, GraspQuestion { scene: &[], ..question }] {
        let found = agent.services.grasps.grasps(&question).map_err(failed)?;
        count += found.len();
        near = found
            .into_iter()
            .filter(|grasp| grasp.pose.position.distance(job.grab) <= settings.grasp_radius_m)
            .map(|grasp| Grasp { pose: thing_from_world * grasp.pose, ..grasp })
            .take(settings.grasps)
            .collect::<Vec<Grasp>>();
        if !near.is_empty() {
            break;
        }
    }
    if near.is_empty() {
        let evidence = format!("of {count} grasps of {} none is near the grab point", job.name);
        return Err(FailedStage::new("grasp", "none", evidence));
    }
    Ok(near)
}

/// Straight up with the thing; where its hull is in the way of what it stands in, with the hand alone.
fn lift(query: &PickQuery, grasp: &FeasibleGrasp) -> Result<Path, genmanip_motion::PlanError> {
    query.lift(grasp).or_else(|problem| {
        let from = query.planner.tcp_pose(&grasp.config);
        let lifted = from.position + DVec3::Z * query.settings.lift_m;
        let allowed = Allowed::none().and_all(query.object.name);
        let around = PlanningScene {
            world: query.world,
            attached: None,
            allowed: &allowed,
            gripper_width: grasp.object_from_tcp.width,
        };
        let to = Pose { position: lifted, ..from };
        query.planner.straight(&around, &grasp.config, &to).map_err(|_| problem)
    })
}

fn no_grasp(name: &str, candidates: usize, rejections: &GraspRejections) -> FailedStage {
    let (out_of_reach, blocked, no_use) = (rejections.out_of_reach, rejections.blocked_count(), rejections.no_use);
    let cause = if out_of_reach >= blocked + no_use { "out_of_reach" } else { "blocked" };
    let obstacles: Vec<String> =
        rejections.obstacles().iter().map(|(obstacle, count)| format!("{obstacle} {count}")).collect();
    let evidence = format!(
        "no grasp of {name} works: {candidates} candidates, {out_of_reach} out of reach, {blocked} blocked ({}), \
         {no_use} of no use where it is to go",
        obstacles.join(", ")
    );
    FailedStage::new("grasp", cause, evidence)
}

fn commands(
    agent: &Agent,
    hand: &Hand,
    grasp: &FeasibleGrasp,
    (reach, approach, lift): &(Path, Path, Path),
) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let (open, hold) = (grasp.opening_m, put::hold_width(grasp, motion));
    let mut all = commands::fingers(reach.start(), hand.width_m, open.max(hand.width_m), motion.rest_steps);
    all.extend(commands::follow(planner, reach, open.max(hand.width_m), motion.empty_speed));
    all.extend(commands::fingers(reach.goal(), open.max(hand.width_m), open, motion.finger_steps));
    all.extend(commands::follow(planner, approach, open, motion.careful_speed));
    all.extend(commands::wait(&grasp.config, open, motion.rest_steps));
    all.extend(commands::fingers(&grasp.config, open, hold, motion.finger_steps));
    all.extend(commands::follow(planner, lift, hold, motion.careful_speed));
    all.extend(commands::wait(lift.goal(), hold, motion.rest_steps));
    all
}
