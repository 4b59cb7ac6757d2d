//! Grasps for demonstrations from rendered depth images, by the built-in sampler or a grasp server.

use std::sync::Arc;

use genmanip_agent::services::{GraspError, GraspQuestion, GraspSource};
use genmanip_core::{Grasp, PolicyError};
use genmanip_motion::Planner;
use genmanip_rollout::collect::MESH;
use genmanip_rollout::expert::{GraspProposer, ObservedObject};

use crate::GraspChoice;
use genmanip_workspace::WorkspaceError;

/// Grasp source of the expert by name: `mesh` (`None`, grasps from object geometry), `rgbd` or `http:URL`.
///
/// # Errors
/// An unknown name, or an unusable URL.
pub fn choice(name: &str) -> Result<Option<GraspChoice>, WorkspaceError> {
    if name == MESH {
        return Ok(None);
    }
    GraspChoice::named(name, &[MESH, "rgbd", "http:URL"]).map(Some)
}

/// Grasp proposer for the gripper of a planner.
pub fn source(choice: &GraspChoice, planner: &Arc<Planner>) -> Arc<dyn GraspProposer> {
    Arc::new(OfCloud(choice.source(planner)))
}

struct OfCloud(Arc<dyn GraspSource>);

impl GraspProposer for OfCloud {
    fn grasps(&self, seen: &ObservedObject) -> Result<Vec<Grasp>, PolicyError> {
        let ObservedObject { points, scene, world_from_camera, camera_positions, table_height } = seen;
        let question = GraspQuestion {
            points,
            scene,
            world_from_camera: *world_from_camera,
            camera_positions,
            table_height: *table_height,
        };
        match self.0.grasps(&question) {
            Ok(grasps) => Ok(grasps),
            // The visible surface has too few points for a grasp.
            Err(GraspError::Unsuited(_)) => Ok(Vec::new()),
            Err(error @ GraspError::Service(_)) => Err(PolicyError::Unreachable(error.to_string())),
        }
    }
}
