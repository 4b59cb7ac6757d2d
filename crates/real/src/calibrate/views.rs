//! Input of a calibration: views of a board, with robot states.

use std::collections::BTreeMap;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, CameraMount, Distortion, Document, DocumentError, Intrinsics, Pose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::CalibrationError;
use crate::boards::{Charuco, Layout, TagGrid};

/// Maximum number of views: the cost of solving grows with the cube of their number.
const MAX_VIEWS: usize = 150;
/// Maximum number of corners of a board. Bounds the time for hostile input.
const MAX_CORNERS: usize = 2_000;
/// Minimum number of corners from which a view's board pose is estimated; four in general position suffice, more
/// average the noise.
const MIN_CORNERS: usize = 6;

/// Document `genmanip.board_views/1`: robot states and detected corners, both by view id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoardViews {
    /// Projection of the camera: name, intrinsics, distortion.
    pub camera: CameraModel,
    /// Mounting of the camera: on the hand or beside the robot.
    pub mounting: Mounting,
    /// Board seen in the views.
    pub board: Board,
    /// Robot states by view id.
    pub robot: BTreeMap<String, RobotState>,
    /// Detected corners by view id: id of the corner, then pixel u and v. An image without a board has an empty list.
    /// Absent if the corners have yet to be detected in images.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub detections: BTreeMap<String, Vec<(u32, f64, f64)>>,
}

/// Projection of a camera whose pose is to be calibrated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    /// Name of the camera in the world file.
    pub name: String,
    /// Pinhole intrinsics, pixels.
    pub intrinsics: Intrinsics,
    /// Lens distortion; absent for an ideal pinhole camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

/// Mounting of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mounting {
    /// Camera on the hand, board fixed in the robot's surroundings.
    EyeInHand,
    /// Camera fixed beside the robot, board held by the hand.
    EyeToHand,
}

/// Flat board with numbered corners.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Board {
    /// Corners of a chessboard or ChArUco board, numbered row by row.
    Grid {
        /// Number of corners per row.
        columns: u32,
        /// Number of rows of corners.
        rows: u32,
        /// Spacing of neighbouring corners, metres.
        spacing_m: f64,
    },
    /// Corners at given x and y on the board, metres; a corner's id is its index.
    PointsM(Vec<[f64; 2]>),
    /// ChArUco board, which can be detected in images.
    Charuco(Charuco),
    /// Grid of tags, which can be detected in images.
    Tags(TagGrid),
}

/// State of the robot when an image was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RobotState {
    /// Pose of the hand link in the robot's base frame.
    BaseFromHand(Pose),
    /// Joint positions of the arm, rad.
    JointsRad(Vec<f64>),
}

/// Robot pose with the corners seen from it.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Id of the view in the input.
    pub id: String,
    /// Pose of the hand link in the robot's base frame.
    pub base_from_hand: Pose,
    /// Corners: position on the board (m), and pixel.
    pub corners: Vec<(DVec3, DVec2)>,
}

/// A view that is not used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Skipped {
    /// Id of the view in the input.
    pub id: String,
    /// Reason why the view is not used.
    pub reason: String,
}

impl Mounting {
    /// Frame that the camera is fixed to.
    pub const fn mount(self) -> CameraMount {
        match self {
            Self::EyeInHand => CameraMount::Hand,
            Self::EyeToHand => CameraMount::World,
        }
    }

    /// The mounting with camera and board swapped.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::EyeInHand => Self::EyeToHand,
            Self::EyeToHand => Self::EyeInHand,
        }
    }

    /// Name of the mounting in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::EyeInHand => "eye_in_hand",
            Self::EyeToHand => "eye_to_hand",
        }
    }

    /// Frame that the camera is fixed to, as words for messages.
    pub const fn camera_frame(self) -> &'static str {
        match self {
            Self::EyeInHand => "hand",
            Self::EyeToHand => "base",
        }
    }

    /// Frame that the board is fixed to, as words for messages.
    pub const fn board_frame(self) -> &'static str {
        self.other().camera_frame()
    }
}

impl CameraModel {
    /// Camera of a world file with this projection, at a pose in the frame that it is fixed to.
    pub fn placed(&self, mounting: Mounting, mount_from_camera: Pose) -> Camera {
        let camera = Camera::new(&self.name, mounting.mount(), mount_from_camera, self.intrinsics);
        Camera { distortion: self.distortion, ..camera }
    }

    /// Pixel of a point in the camera frame (m); `None` behind the camera.
    pub fn pixel(&self, point: DVec3) -> Option<DVec2> {
        let on_plane = (point.z > 1e-6).then(|| point.truncate() / point.z)?;
        let shown = self.distortion.map_or(on_plane, |lens| lens.distort(on_plane));
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        Some(DVec2::new(fx * shown.x + cx, fy * shown.y + cy))
    }

    /// Point at z = 1 in the camera frame that projects to a pixel; `None` where the distortion model is not
    /// invertible.
    pub fn on_plane(&self, pixel: DVec2) -> Option<DVec2> {
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let shown = DVec2::new((pixel.x - cx) / fx, (pixel.y - cy) / fy);
        self.distortion.map_or(Some(shown), |lens| lens.undistort(shown))
    }
}

impl Board {
    /// Positions of the corners on the board by id, metres; z = 0.
    pub fn corners(&self) -> Vec<DVec3> {
        match self {
            Self::Grid { columns, rows, spacing_m } => (0..*rows)
                .flat_map(|row| (0..*columns).map(move |column| (column, row)))
                .map(|(column, row)| DVec3::new(f64::from(column), f64::from(row), 0.0) * *spacing_m)
                .collect(),
            Self::PointsM(points) => points.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0)).collect(),
            Self::Charuco(_) | Self::Tags(_) => match self.layout() {
                Some(Ok(layout)) => layout.corners.iter().map(|corner| corner.at.extend(0.0)).collect(),
                _ => Vec::new(),
            },
        }
    }

    /// Layout of a board that can be detected in images, or why its numbers are impossible; `None` for other boards.
    pub fn layout(&self) -> Option<Result<Layout, String>> {
        match self {
            Self::Charuco(board) => Some(board.layout()),
            Self::Tags(board) => Some(board.layout()),
            Self::Grid { .. } | Self::PointsM(_) => None,
        }
    }
}

impl BoardViews {
    /// Views with both robot state and corners, and the views that lack one of them. `hand_of` is the forward
    /// kinematics of the arm: pose of the hand link in the base frame from joint positions.
    ///
    /// # Errors
    /// [`CalibrationError::Joints`] if `hand_of` refuses the joint positions of a view.
    pub fn paired(
        &self,
        hand_of: impl Fn(&[f64]) -> Result<Pose, String>,
    ) -> Result<(Vec<View>, Vec<Skipped>), CalibrationError> {
        let board = self.board.corners();
        let (mut views, mut skipped) = (Vec::new(), Vec::new());
        let mut skip = |id: &str, reason: String| skipped.push(Skipped { id: id.into(), reason });
        for id in self.robot.keys().filter(|id| !self.detections.contains_key(*id)) {
            skip(id, "a robot state without an image".into());
        }
        for (id, found) in &self.detections {
            let Some(state) = self.robot.get(id) else {
                skip(id, "an image without a robot state".into());
                continue;
            };
            if found.len() < MIN_CORNERS {
                let count = found.len();
                skip(
                    id,
                    if count == 0 { "no board in the image".into() } else { format!("{count} corners of the board") },
                );
                continue;
            }
            let base_from_hand = match state {
                RobotState::BaseFromHand(pose) => *pose,
                RobotState::JointsRad(joints) => {
                    hand_of(joints).map_err(|reason| CalibrationError::Joints { view: id.clone(), reason })?
                }
            };
            let corners = found.iter().map(|&(corner, u, v)| (board[corner as usize], DVec2::new(u, v))).collect();
            views.push(View { id: id.clone(), base_from_hand, corners });
        }
        Ok((views, skipped))
    }
}

impl Document for BoardViews {
    const SCHEMA: &'static str = "genmanip.board_views/1";

    fn check(&self) -> Result<(), DocumentError> {
        let fault = |path: &str, message: String| Err(DocumentError::Invalid { path: path.into(), message });
        let Intrinsics { fx, fy, cx, cy, .. } = self.camera.intrinsics;
        if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|value| value.is_finite())) {
            return fault("camera.intrinsics", format!("focal lengths {fx} and {fy} px; expected positive numbers"));
        }
        if let Board::Grid { columns, rows, spacing_m } = &self.board {
            if !(spacing_m.is_finite() && (1e-4..10.0).contains(spacing_m)) {
                return fault("board.grid.spacing_m", format!("{spacing_m}; expected metres, such as 0.025"));
            }
            if u64::from(*columns) * u64::from(*rows) > MAX_CORNERS as u64 || *columns < 2 || *rows < 2 {
                return fault(
                    "board.grid",
                    format!("{columns} x {rows} corners; expected 2 x 2 to {MAX_CORNERS} in all"),
                );
            }
        }
        if let Some(Err(reason)) = self.board.layout() {
            return fault("board", reason);
        }
        let corners = self.board.corners();
        let is_flat = |point: &DVec3| point.is_finite() && point.length() < 10.0;
        if corners.len() > MAX_CORNERS || corners.len() < MIN_CORNERS || !corners.iter().all(is_flat) {
            return fault(
                "board",
                format!("{} corners; expected {MIN_CORNERS} to {MAX_CORNERS}, in metres", corners.len()),
            );
        }
        if self.detections.len() > MAX_VIEWS || self.robot.len() > MAX_VIEWS {
            return fault("detections", format!("expected at most {MAX_VIEWS} views"));
        }
        for (id, found) in &self.detections {
            let path = format!("detections.{id}");
            for (index, &(corner, u, v)) in found.iter().enumerate() {
                if corner as usize >= corners.len() {
                    return fault(&path, format!("corner {corner}; the board has {}, counted from 0", corners.len()));
                }
                if !(u.abs() < 1e5 && v.abs() < 1e5) {
                    return fault(&path, format!("corner {corner} at pixel {u}, {v}"));
                }
                if found[..index].iter().any(|&(other, ..)| other == corner) {
                    return fault(&path, format!("corner {corner} stands there twice"));
                }
            }
        }
        Ok(())
    }
}
