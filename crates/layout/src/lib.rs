//! From a task to a scenario: where every object stands before the robot moves.
//!
//! Objects are placed in topological order of support, each candidate is checked against every edge to what is
//! already placed, the whole is settled in physics without a robot, and everything is validated afterwards:
//! every edge of the initial graph holds, no alternative of the goal holds yet, nothing penetrates or moves,
//! what must be moved can be reached and is seen by a camera.
//! Attempts are bounded and every rejection is counted by its reason.

pub mod articulation;
mod audit;
mod error;
mod goal_pose;
mod moves;
mod order;
mod placement;
mod reach;
mod settings;
pub mod surroundings;
mod visibility;

pub use audit::{AuditError, LayoutAudit, audit};
pub use error::{LayoutError, Rejections};
pub use goal_pose::{GoalPose, GoalPoseSettings, goal_poses};
pub use moves::{Move, moves, references};
pub use reach::is_in_reach;
pub use settings::LayoutSettings;

use genmanip_assets::Catalogue;
use genmanip_core::{Camera, ObjectModel, PlacedObject, RobotModel, Scenario, Seed, Task, Workspace};
use genmanip_motion::Planner;
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings, Rest, ShapeCache, judge_edges, judge_goal};

/// Lays a task out for the planner's robot.
///
/// Same task, seed and settings: the same scenario, byte for byte.
///
/// # Errors
/// [`LayoutError::UnknownObject`] for a uid that is not in the catalogue; [`LayoutError::Infeasible`] when every
/// bounded attempt was rejected, with the counted reasons and the edges that were hardest to satisfy.
pub fn lay_out(
    task: &Task,
    catalogue: &Catalogue,
    planner: &Planner,
    seed: Seed,
    settings: &LayoutSettings,
) -> Result<Scenario, LayoutError> {
    let models = task
        .scene_graph
        .nodes
        .iter()
        .map(|node| catalogue.build(&node.uid).map_err(LayoutError::from))
        .collect::<Result<Vec<_>, _>>()?;
    let relations = RelationSettings::default();
    let plan = order::PlacementPlan::new(task, &models)?;
    let mut rejections = Rejections::default();

    let context = placement::Context { task, models: &models, plan: &plan, settings, relations: &relations };
    let mut shapes = ShapeCache::default();
    for restart in 0..settings.max_restarts {
        let attempt = seed.fork("layout").fork_index(restart as u64);
        let Some(mut scene) = placement::place_all(&context, attempt, &mut shapes, &mut rejections) else { continue };
        if let Err(reason) = audit::settle(&mut scene, settings) {
            rejections.count(reason);
            continue;
        }
        let broken = judge_edges(&scene, &task.scene_graph, &relations).into_iter().find(|verdict| !verdict.holds);
        if let Some(verdict) = broken {
            rejections.count_edge("an edge does not hold after settling", &verdict.atom);
            continue;
        }
        if judge_goal(&scene, &task.goal, &Rest::default(), &relations).success {
            rejections.count("the goal holds already");
            continue;
        }
        let reach = reach::unreachable(task, &scene, planner, &relations, attempt);
        if let Some(reason) = reach.or_else(|| visibility::hidden(&scene, planner.robot(), settings)) {
            rejections.count(reason);
            continue;
        }
        return Ok(scenario(task, seed, &scene, planner.robot()));
    }
    Err(LayoutError::Infeasible { task: task.id.clone(), restarts: settings.max_restarts, rejections })
}

fn scenario(task: &Task, seed: Seed, scene: &PosedScene, robot: &RobotModel) -> Scenario {
    Scenario {
        id: format!("{}-{seed}", task.id),
        task: task.clone(),
        seed,
        objects: scene.objects().map(placed_object).collect(),
        robot: robot.name.clone(),
        robot_home: robot.home.clone(),
        cameras: Camera::default_rig(),
        workspace: Workspace::default(),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    }
}

fn placed_object(object: &PosedObject) -> PlacedObject {
    let model: &ObjectModel = &object.model;
    PlacedObject {
        uid: model.card.uid.clone(),
        family: model.family.clone(),
        seed: model.seed,
        generator_version: model.generator_version,
        physics_hash: model.physics_hash(),
        pose: object.pose,
        joint_positions: object.joint_positions.clone(),
    }
}
