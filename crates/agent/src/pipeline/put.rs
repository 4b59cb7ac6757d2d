//! Putting down what is in the hand: carried, lowered, let go of, left.

use genmanip_core::{Pose, Seed};
use genmanip_motion::{
    Allowed, Attached, CollisionWorld, FeasibleGrasp, Path, PlaceGoal, PlaceQuery, PlanError, PlanningScene, Release,
    commands,
};
use glam::{DQuat, DVec3};

use super::Agent;
use super::hand::{self, Hand, THING};
use super::job::Job;
use crate::ask::FailedStage;
use crate::settings::MotionSettings;
use crate::sight::Placing;

/// Searches for a free motion to one place that may find nothing: the arm's other configurations end near the first.
/// Chosen.
const SEARCHES_PER_PLACE: usize = 2;

/// What was taken, and how.
#[derive(Clone)]
pub(super) struct Held {
    pub job: Job,
    /// The grasp, in the thing's frame.
    pub grasp: FeasibleGrasp,
    /// Everything else above the table.
    pub points: Vec<DVec3>,
}

/// A planned placement: motions, and the pose at which the thing comes to rest.
type Planned = (Vec<Path>, Release, Pose);

impl Held {
    /// Whether something keeps the fingers apart.
    pub(super) fn is_held(&self, hand: &Hand, motion: &MotionSettings) -> bool {
        let commanded = hold_width(&self.grasp, motion);
        // Thin things are narrower than the margin.
        hand.width_m > commanded + motion.held_m.min(self.grasp.object_from_tcp.width * 0.3)
    }
}

/// Width commanded while holding, m: narrower than the thing, so that the drive presses.
pub(super) fn hold_width(grasp: &FeasibleGrasp, motion: &MotionSettings) -> f64 {
    (grasp.object_from_tcp.width - motion.squeeze_m).max(0.0)
}

/// Poses at which the thing may be let go of, the ones that turn it least first.
pub(super) fn goals(agent: &Agent, job: &Job) -> Vec<PlaceGoal> {
    let turns: Vec<f64> = match job.way.last() {
        Some((_, last)) => vec![last.yaw_deg],
        None => agent.settings.turns_deg.clone(),
    };
    let points: Vec<DVec3> = std::iter::once(job.placing.point).chain(job.placing.others.iter().copied()).collect();
    let all = turns.iter().flat_map(|turn| points.iter().map(move |point| (*turn, *point)));
    all.map(|(turn, point)| goal(agent, &job.placing, point, turn)).collect()
}

fn goal(agent: &Agent, placing: &Placing, point: DVec3, turn_deg: f64) -> PlaceGoal {
    let motion = &agent.settings.motion;
    PlaceGoal {
        world_from_object: turned(point, turn_deg),
        highest_release_m: if placing.hollow { f64::INFINITY } else { motion.max_open_release_m },
        clear_height_m: (placing.rim_m - point.z).max(0.0) + motion.rim_clearance_m,
    }
}

/// The thing's pose over a point, turned against how it stood.
fn turned(point: DVec3, turn_deg: f64) -> Pose {
    Pose { position: point, rotation: DQuat::from_rotation_z(turn_deg.to_radians()) }
}

/// Carries the thing to where it belongs, lets go and returns home.
pub(super) fn plan(
    agent: &Agent,
    held: &Held,
    hand: &Hand,
    seed: Seed,
) -> Result<(Vec<Vec<f32>>, String), FailedStage> {
    let goals = goals(agent, &held.job);
    let planned = planned(agent, held, hand, &goals, &held.job.way, seed);
    let (way, release, pose) = planned.map_err(|error| {
        let evidence = format!("no free motion brings {} to its place: {error}", held.job.name);
        FailedStage::new("motion", "blocked", evidence)
    })?;
    let at = pose.position;
    let words =
        format!("at ({:.3}, {:.3}, {:.3}) m, turned by {:.0} degrees", at.x, at.y, at.z, pose.yaw().to_degrees());
    Ok((commands(agent, held, hand, &way, &release, &pose), words))
}

/// Puts the thing back to where it stood.
pub(super) fn back(agent: &Agent, held: &Held, hand: &Hand, seed: Seed) -> Result<Vec<Vec<f32>>, PlanError> {
    let point = held.job.thing.pose.position;
    let placing = Placing { point, others: Vec::new(), hollow: false, rim_m: point.z };
    let goals = [goal(agent, &placing, point, 0.0)];
    let (way, release, pose) = planned(agent, held, hand, &goals, &[], seed.fork("back"))?;
    Ok(commands(agent, held, hand, &way, &release, &pose))
}

/// Opens the fingers where they are and returns home.
pub(super) fn drop(agent: &Agent, held: &Held, hand: &Hand, seed: Seed) -> Vec<Vec<f32>> {
    let motion = &agent.settings.motion;
    let open = agent.planner.robot().gripper.max_width;
    let mut all = commands::fingers(&hand.arm, hold_width(&held.grasp, motion), open, motion.finger_steps);
    let world = world(agent, held);
    all.extend(home(agent, &world, &hand.arm, open, &Allowed::none(), seed));
    all
}

fn world(agent: &Agent, held: &Held) -> CollisionWorld {
    hand::with_points(&agent.settings, &held.points, agent.planner.settings().depth.radius_m)
}

fn planned(
    agent: &Agent,
    held: &Held,
    hand: &Hand,
    goals: &[PlaceGoal],
    way: &[(DVec3, crate::ask::PathCell)],
    seed: Seed,
) -> Result<Planned, PlanError> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let world = world(agent, held);
    let thing = &held.job.thing;
    let tcp_from_object = held.grasp.object_from_tcp.pose.inverse();
    let mut arm = hand.arm.clone();
    let mut carried = Vec::new();
    for (index, (point, cell)) in way.iter().enumerate().take(way.len().saturating_sub(1)) {
        let attached = Attached::new(THING, &thing.pieces, &tcp_from_object)
            .map_err(|error| PlanError::Unreachable { what: error.to_string() })?;
        let nothing = Allowed::none();
        let carrying =
            PlanningScene { world: &world, attached: Some(&attached), allowed: &nothing, gripper_width: hand.width_m };
        let over = turned(*point + DVec3::Z * cell.height_m, cell.yaw_deg) * held.grasp.object_from_tcp.pose;
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
        name: THING,
        pieces: &thing.pieces,
        tcp_from_object,
        arm: &arm,
        held_width_m: hand.width_m,
        open_width_m: held.grasp.opening_m,
        settings: &motion.feasibility,
        searches: SEARCHES_PER_PLACE,
    };
    let (mut problem, mut in_vain) = (None, 0);
    let short = motion.short();
    for settings in [&motion.feasibility, &short] {
        let query = PlaceQuery { settings, ..query };
        for (index, goal) in goals.iter().enumerate() {
            if in_vain >= motion.searches {
                break;
            }
            match query.first(std::slice::from_ref(goal), seed.fork("put").fork_index(index as u64)) {
                Ok(release) => return Ok((carried, release, goal.world_from_object)),
                Err(error) => {
                    in_vain += usize::from(matches!(error, Some(PlanError::Exhausted { .. })));
                    // The place that is tried first is seldom the one that nearly works.
                    problem = error.or(problem);
                }
            }
        }
    }
    Err(problem.unwrap_or(PlanError::Unreachable { what: "the place where to let go".into() }))
}

/// Carry, lower, let go, back off, home.
fn commands(agent: &Agent, held: &Held, hand: &Hand, way: &[Path], release: &Release, pose: &Pose) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let (hold, open) = (hold_width(&held.grasp, motion), held.grasp.opening_m);
    let Release { carry, lower, retreat } = release;
    let mut all = commands::wait(&hand.arm, hold, 1);
    for path in way.iter().chain([carry]) {
        all.extend(commands::follow(planner, path, hold, motion.loaded_speed));
    }
    all.extend(commands::follow(planner, lower, hold, motion.careful_speed));
    all.extend(commands::wait(lower.goal(), hold, motion.rest_steps));
    all.extend(commands::fingers(lower.goal(), hold, open, motion.finger_steps));
    all.extend(commands::follow(planner, retreat, open, motion.careful_speed));
    let mut world = world(agent, held);
    // The same pieces were accepted before.
    let _ = world.add(THING, &held.job.thing.pieces, pose);
    let leaving = Allowed::none().and_gripper(planner.robot(), THING);
    all.extend(home(agent, &world, retreat.goal(), open, &leaving, agent.seed.fork("home")));
    all
}

/// Back to where the robot began, so that it hides nothing, and the fingers opened.
fn home(
    agent: &Agent,
    world: &CollisionWorld,
    arm: &[f64],
    width_m: f64,
    allowed: &Allowed,
    seed: Seed,
) -> Vec<Vec<f32>> {
    let (planner, motion) = (&*agent.planner, &agent.settings.motion);
    let around = PlanningScene { world, attached: None, allowed, gripper_width: width_m };
    let goal = planner.robot().home.clone();
    let direct = planner.plan_joint(&around, arm, std::slice::from_ref(&goal), seed).map(|path| vec![path]);
    let paths = direct.or_else(|problem| {
        // Something is nearer than motions like it: first straight up.
        let from = planner.tcp_pose(arm);
        let up = Pose { position: from.position + DVec3::Z * motion.feasibility.lift_m, ..from };
        let empty = CollisionWorld::new();
        let rise = planner.straight(&PlanningScene { world: &empty, ..around }, arm, &up).map_err(|_| problem)?;
        let on = planner.plan_joint(&around, rise.goal(), &[goal], seed)?;
        Ok::<_, PlanError>(vec![rise, on])
    });
    // Where there is no way home, the arm stays: the next look then has it in the picture.
    let Ok(paths) = paths else { return commands::wait(arm, width_m, motion.rest_steps) };
    let open = planner.robot().gripper.max_width;
    let end = paths.last().map_or(arm, |path| path.goal()).to_vec();
    let mut all: Vec<Vec<f32>> =
        paths.iter().flat_map(|path| commands::follow(planner, path, width_m, motion.empty_speed)).collect();
    all.extend(commands::fingers(&end, width_m, open, motion.finger_steps));
    all.extend(commands::wait(&end, open, motion.rest_steps));
    all
}
