//! Placing: carries the held object to a pose where its conditions hold, releases it and retreats.

use genmanip_core::{Failure, FailureCause, Piece, Pose, Seed};
use genmanip_layout::{GoalPose, Move, obstacles};
use genmanip_motion::commands;
use genmanip_motion::{CollisionWorld, PlaceGoal, PlaceQuery, Release};
use genmanip_relations::PosedScene;

use super::{ArmState, Expert};

/// Height above a goal pose that must be reachable for motions to be planned at all, metres. Chosen by hand in the
/// lower part of the release heights.
const GOAL_HEIGHT_M: f64 = 0.01;

/// Held object with its obstacles.
struct Held<'a> {
    /// Index of the object in the scenario.
    object: usize,
    /// Name of the object in the collision world.
    name: &'a str,
    pieces: Vec<Piece>,
    /// Actual pose of the object in the gripper, which may differ from that of the planned grasp.
    tcp_from_object: Pose,
    /// Obstacles: everything except the object.
    world: CollisionWorld,
}

/// Carries the held object to a pose where all conditions of the move hold.
pub(super) fn plan(
    expert: &Expert,
    scene: &PosedScene,
    step: &Move,
    hand: &ArmState,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    let held = Held::of(expert, scene, step.object, hand);
    let query = held.query(expert, hand);
    let usable = |goal: &Pose| query.reaches(goal, GOAL_HEIGHT_M);
    let goals = expert.goals(scene, step, &usable, seed);
    if goals.is_empty() {
        let name = expert.stage.name(step.object);
        let evidence = format!("no free place for {name} where every condition on it holds");
        return Err(Failure { cause: FailureCause::NoGoalPose, evidence });
    }
    toward(expert, scene, &held, hand, &goals, seed)
}

/// Puts the held object back at `taken_from`.
pub(super) fn put_back(
    expert: &Expert,
    scene: &PosedScene,
    object: usize,
    taken_from: &GoalPose,
    hand: &ArmState,
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    let held = Held::of(expert, scene, object, hand);
    toward(expert, scene, &held, hand, std::slice::from_ref(taken_from), seed.fork("back"))
}

fn toward(
    expert: &Expert,
    scene: &PosedScene,
    held: &Held,
    hand: &ArmState,
    goals: &[GoalPose],
    seed: Seed,
) -> Result<Vec<Vec<f32>>, Failure> {
    let goals: Vec<PlaceGoal> = goals.iter().map(|goal| expert.place_goal(scene, goal)).collect();
    let release = held.query(expert, hand).first(&goals, seed);
    release.map(|(_, release)| commands(expert, hand, &release)).map_err(|problem| {
        let name = expert.stage.name(held.object);
        let reason = problem.map_or_else(|| "no goal".to_owned(), |error| error.to_string());
        let evidence = format!("no free motion brings {name} to any of {} places: {reason}", goals.len());
        Failure { cause: FailureCause::Planning, evidence }
    })
}

/// Free motion to above the goal, straight lowering, release, retreat.
fn commands(expert: &Expert, hand: &ArmState, release: &Release) -> Vec<Vec<f32>> {
    let (planner, settings) = (&expert.planner, &expert.settings);
    let Release { carry, lower, retreat } = release;
    let mut commands = commands::follow(planner, carry, hand.hold_width, settings.loaded_speed);
    commands.extend(commands::follow(planner, lower, hand.hold_width, settings.careful_speed));
    commands.extend(commands::wait(lower.goal(), hand.hold_width, settings.rest_steps));
    commands.extend(commands::fingers(lower.goal(), hand.hold_width, hand.open_width, settings.open_steps));
    commands.extend(commands::follow(planner, retreat, hand.open_width, settings.careful_speed));
    commands
}

impl<'a> Held<'a> {
    fn of(expert: &Expert, scene: &'a PosedScene, object: usize, hand: &ArmState) -> Self {
        let posed = scene.objects().nth(object);
        let world_from_tcp = expert.planner.tcp_pose(&hand.arm);
        Self {
            object,
            name: posed.map_or("", |held| held.id.as_str()),
            pieces: posed.map_or_else(Vec::new, |held| held.model.pieces(&held.joint_positions)),
            tcp_from_object: posed.map_or(Pose::IDENTITY, |held| world_from_tcp.inverse() * held.pose),
            world: obstacles::around(scene, Some(object)),
        }
    }

    fn query<'q>(&'q self, expert: &'q Expert, hand: &'q ArmState) -> PlaceQuery<'q> {
        PlaceQuery {
            planner: &expert.planner,
            world: &self.world,
            name: self.name,
            pieces: &self.pieces,
            tcp_from_object: self.tcp_from_object,
            arm: &hand.arm,
            held_width_m: hand.width,
            open_width_m: hand.open_width,
            settings: &expert.settings.feasibility,
            searches: usize::MAX,
            searches_per_goal: usize::MAX,
        }
    }
}
