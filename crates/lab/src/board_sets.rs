//! Files of calibration sets with their true poses, as input for other programs.

use std::path::Path;

use genmanip_core::{Document, Pose};
use genmanip_real::calibrate::{Board, BoardViews, RobotState, View};
use genmanip_real::synthetic::Scene;
use genmanip_workspace::{WorkspaceError, documents};
use serde::Serialize;

/// True poses of a set, the content of `truth.json`.
#[derive(Serialize)]
struct Truth<'a> {
    mount_from_camera: &'a Pose,
    base_from_hand: &'a [Pose],
}

/// Writes `views.json` and `truth.json` into a folder. For a board that is to be detected in images, the views have no
/// corners.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, scene: &Scene, board: &Board, views: &[View]) -> Result<(), WorkspaceError> {
    let corners = board.corners();
    let numbered = |view: &View| {
        let number = |point| corners.iter().position(|corner| corner == point);
        let seen = view.corners.iter().filter_map(|(point, at)| Some((number(point)? as u32, at.x, at.y)));
        (view.id.clone(), seen.collect())
    };
    let file = BoardViews {
        camera: scene.camera.clone(),
        mounting: scene.mounting,
        board: board.clone(),
        robot: views.iter().map(|view| (view.id.clone(), RobotState::BaseFromHand(view.base_from_hand))).collect(),
        detections: match board.layout() {
            Some(_) => Default::default(),
            None => views.iter().map(numbered).collect(),
        },
    };
    let truth = Truth { mount_from_camera: &scene.mount_from_camera, base_from_hand: &scene.hands };
    let truth = serde_json::to_vec_pretty(&truth).map_err(|error| WorkspaceError::broken("no JSON", error))?;
    documents::write_file(&folder.join("views.json"), file.to_json().as_bytes())?;
    documents::write_file(&folder.join("truth.json"), &truth)
}
