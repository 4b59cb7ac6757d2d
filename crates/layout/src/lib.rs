//! From a task to a scenario: where every object stands before the robot moves.
//!
//! Objects are placed in topological order of support, each candidate is checked against every edge to what is
//! already placed, the whole is settled in physics without a robot, and everything is validated afterwards:
//! every edge of the initial graph holds, no alternative of the goal holds yet, nothing penetrates or moves,
//! what must be moved can be reached and is seen by a camera.
//! Attempts are bounded and every rejection is counted by its reason.

mod audit;
mod error;
mod order;
mod placement;
mod reach;
mod settings;
mod visibility;

pub use audit::{AuditError, LayoutAudit, audit};
pub use error::{LayoutError, Rejections};
pub use settings::LayoutSettings;

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{Camera, ObjectModel, PlacedObject, RobotModel, Scenario, Seed, Task, Workspace};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings, Rest, judge_edges, judge_goal};

/// Lays a task out.
///
/// Same task, seed and settings: the same scenario, byte for byte.
///
/// # Errors
/// [`LayoutError::UnknownObject`] for a uid that is not in the catalogue; [`LayoutError::Infeasible`] when every
/// bounded attempt was rejected, with the counted reasons and the edges that were hardest to satisfy.
pub fn lay_out(
    task: &Task,
    catalogue: &Catalogue,
    robot: &Arc<RobotModel>,
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

    for restart in 0..settings.max_restarts {
        let attempt = seed.fork("layout").fork_index(restart as u64);
        let Some(placed) = placement::place_all(&plan, task, &models, attempt, settings, &relations, &mut rejections)
        else {
            continue;
        };
        let settled = match audit::settle(&placed, settings) {
            Ok(settled) => settled,
            Err(reason) => {
                rejections.count(reason);
                continue;
            }
        };
        let scene = PosedScene::new(settled);
        if let Some(edge) = judge_edges(&scene, &task.scene_graph.edges, &relations).iter().find(|v| !v.holds) {
            rejections.count_edge("an edge of the graph does not hold after settling", &edge.atom);
            continue;
        }
        if judge_goal(&scene, &task.goal, &Rest::at_rest(scene.objects().len()), &relations).success {
            rejections.count("the goal holds already");
            continue;
        }
        if let Some(reason) = reach::unreachable(task, &scene, robot, settings) {
            rejections.count(reason);
            continue;
        }
        if let Some(reason) = visibility::hidden(&scene, robot, settings) {
            rejections.count(reason);
            continue;
        }
        return Ok(scenario(task, seed, restart, &scene, robot));
    }
    Err(LayoutError::Infeasible { task: task.id.clone(), restarts: settings.max_restarts, rejections })
}

fn scenario(task: &Task, seed: Seed, _restart: usize, scene: &PosedScene, robot: &RobotModel) -> Scenario {
    Scenario {
        id: format!("{}-{seed}", task.id),
        task: task.clone(),
        seed,
        objects: scene.objects().iter().map(placed_object).collect(),
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
