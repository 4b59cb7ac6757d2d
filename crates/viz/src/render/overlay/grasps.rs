//! Selection of the grasps to display.

use genmanip_assets::GraspLibrary;
use genmanip_core::glam::DVec3;
use genmanip_core::{Episode, Grasp, Pose};
use genmanip_rollout::Stage;

use genmanip_workspace::WorkspaceError;

/// Grasps of each object; chosen: more hide what they are on.
const PER_OBJECT: usize = 3;
/// Grasps of one object are drawn when they are at least so far apart, m; chosen: half a finger's length.
const APART_M: f64 = 0.02;
/// Share of the trials that held; chosen: grasps that the expert would use.
const HELD: f64 = 0.5;
/// Minimum cosine between the approach direction and straight down; chosen: 60 degrees, so that the arm stays above
/// the table.
const STEEP: f64 = 0.5;

/// A grasp and the object that it is on.
pub(super) struct DrawnGrasp {
    /// Number of the object in the scenario, from 0.
    pub(super) object: usize,
    /// In the world.
    pub(super) grasp: Grasp,
}

/// The grasps of a scenario's objects that held most often, from above and apart from each other.
pub(super) fn tried(stage: &Stage) -> Result<Vec<DrawnGrasp>, WorkspaceError> {
    let mut drawn = Vec::new();
    for (object, (placed, model)) in stage.scenario.objects.iter().zip(&stage.models).enumerate() {
        let tried = GraspLibrary::builtin().of(&stage.robot, model);
        let tried =
            tried.map_err(|error| WorkspaceError::broken(format!("cannot draw grasps of {}", placed.id), error))?;
        let mut kept: Vec<DVec3> = Vec::new();
        for tried in tried.iter().filter(|tried| tried.share() >= HELD) {
            let grasp = Grasp { pose: placed.pose * tried.grasp.pose, ..tried.grasp.clone() };
            let place = grasp.pose.position;
            if kept.len() < PER_OBJECT
                && -grasp.approach().z >= STEEP
                && kept.iter().all(|other| other.distance(place) >= APART_M)
            {
                kept.push(place);
                drawn.push(DrawnGrasp { object, grasp });
            }
        }
    }
    Ok(drawn)
}

/// Gripper poses at which objects were grasped in an episode.
pub(super) fn made(episode: &Episode) -> Vec<DrawnGrasp> {
    let held = episode.frames.iter().map(|frame| frame.grasped);
    let before = std::iter::once(None).chain(held);
    let begins = episode.frames.iter().zip(before).filter(|(frame, before)| frame.grasped != *before);
    let made = |(frame, _): (&genmanip_core::Frame, _)| {
        let pose: Pose = frame.tcp;
        Some(DrawnGrasp { object: frame.grasped?, grasp: Grasp { pose, width: frame.gripper_width, score: 1.0 } })
    };
    let mut drawn: Vec<DrawnGrasp> = begins.filter_map(made).collect();
    // Fingers that lose touch for a step take hold again at the same place.
    drawn.dedup_by(|later, first| {
        later.object == first.object && later.grasp.pose.position.distance(first.grasp.pose.position) < APART_M
    });
    drawn
}
