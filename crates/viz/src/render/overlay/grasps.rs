//! Selection of the grasps to be displayed.

use genmanip_assets::GraspLibrary;
use genmanip_core::glam::DVec3;
use genmanip_core::{Episode, Grasp, Pose};
use genmanip_rollout::Stage;

use genmanip_workspace::WorkspaceError;

/// Maximum number of drawn grasps per object. Chosen by hand: more would hide the object.
const PER_OBJECT: usize = 3;
/// Minimum distance between drawn grasps of one object, m. Chosen by hand: half a finger's length.
const APART_M: f64 = 0.02;
/// Minimum success rate of a drawn grasp in its trials. Chosen by hand: grasps that the expert would use.
const HELD: f64 = 0.5;
/// Minimum cosine between the approach direction and straight down. Chosen by hand: at most 60 degrees, so that the arm
/// stays above the table.
const STEEP: f64 = 0.5;

/// Grasp to be drawn, with its object.
pub(super) struct DrawnGrasp {
    /// Index of the object in the scenario.
    pub(super) object: usize,
    /// Grasp in the world frame.
    pub(super) grasp: Grasp,
}

/// Grasps with the highest success rates in trials, for each object of a scenario; only steep ones at a distance from
/// each other.
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

/// Grasps that were executed in an episode, with the gripper pose at the first frame in which the object is grasped.
pub(super) fn made(episode: &Episode) -> Vec<DrawnGrasp> {
    let held = episode.frames.iter().map(|frame| frame.grasped);
    let before = std::iter::once(None).chain(held);
    let begins = episode.frames.iter().zip(before).filter(|(frame, before)| frame.grasped != *before);
    let made = |(frame, _): (&genmanip_core::Frame, _)| {
        let pose: Pose = frame.tcp;
        Some(DrawnGrasp { object: frame.grasped?, grasp: Grasp { pose, width: frame.gripper_width, score: 1.0 } })
    };
    let mut drawn: Vec<DrawnGrasp> = begins.filter_map(made).collect();
    // Fingers that lose contact for a step grasp again at the same place; that counts as one grasp.
    drawn.dedup_by(|later, first| {
        later.object == first.object && later.grasp.pose.position.distance(first.grasp.pose.position) < APART_M
    });
    drawn
}
