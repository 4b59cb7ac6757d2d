//! Errors of a calibration: sets of views that do not determine the camera's pose.

use thiserror::Error;

/// Reason why a set of views is refused; names the missing motion or the wrong input.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CalibrationError {
    /// There are fewer views than the unknowns need.
    #[error("{count} views have a robot state and a board; expected at least {needed}, better 15 to 20")]
    FewViews {
        /// Number of views with both corners and robot state.
        count: usize,
        /// Minimum number of views for a calibration.
        needed: usize,
    },
    /// All orientations of the hand are nearly the same.
    #[error(
        "the hand turns by {largest_deg:.1} degrees at most between views; turn it by 20 to 40 degrees about at least two \
         axes"
    )]
    LittleRotation {
        /// Largest angle between two views, degrees.
        largest_deg: f64,
    },
    /// The views share too few orientations of the hand.
    #[error("the views have {count} different orientations of the hand; expected at least 3, 10 degrees apart")]
    FewRotations {
        /// Number of distinct orientations of the hand.
        count: usize,
    },
    /// All relative rotations are near half a turn, whose axis is ambiguous.
    #[error("the hand turns by about 180 degrees or hardly at all; add views with turns of 20 to 90 degrees")]
    HalfTurns,
    /// All relative rotations have nearly the same axis.
    #[error(
        "all turns of the hand are about one axis ({x:.2}, {y:.2}, {z:.2}) of the {frame}; also turn it by 20 degrees or \
         more about an axis across: without that, the camera's position along the axis stays unknown"
    )]
    ParallelAxes {
        /// Name of the frame in which the axis is given.
        frame: &'static str,
        /// x component of the unit axis.
        x: f64,
        /// y component of the unit axis.
        y: f64,
        /// z component of the unit axis.
        z: f64,
    },
    /// The board's pose is ambiguous in too many views: its flipped pose explains them equally well.
    #[error(
        "in {ambiguous} of {views} views the board could be tilted either way; move closer, use a larger board, or tilt \
         it by 20 to 45 degrees against the image"
    )]
    PlanarFlip {
        /// Number of views with an ambiguous pose.
        ambiguous: usize,
        /// Number of all views.
        views: usize,
    },
    /// The views fit the other mounting: camera and board are swapped.
    #[error(
        "the views fit a camera mounted as {other} ({other_px:.2} px), not as {stated} ({stated_px:.2} px); correct \
         `mounting`"
    )]
    OtherMounting {
        /// Name of the stated mounting.
        stated: &'static str,
        /// Name of the mounting that fits better.
        other: &'static str,
        /// Reprojection error with the stated mounting, px.
        stated_px: f64,
        /// Reprojection error with the other mounting, px.
        other_px: f64,
    },
    /// The board's size contradicts the robot's motion.
    #[error(
        "the robot's travel says that the board is {scale:.4} times as large as stated; measure the spacing of its \
         corners, and check the focal length"
    )]
    Scale {
        /// Estimated size of the board divided by its stated size.
        scale: f64,
    },
    /// The views contradict each other beyond their noise.
    #[error(
        "the views contradict each other ({rms_px:.1} px, robot poses off by {robot_mm:.1} mm); expected poses of the \
         hand link in the base, read while the arm stood still, under the ids of their images; worst: {worst}"
    )]
    Inconsistent {
        /// Root-mean-square reprojection error of all corners, px.
        rms_px: f64,
        /// Root-mean-square correction of the robot's positions, mm.
        robot_mm: f64,
        /// Id of the view with the largest error.
        worst: String,
    },
    /// The joint positions of a view do not fit the arm.
    #[error("view {view}: {reason}")]
    Joints {
        /// Id of the view in the input.
        view: String,
        /// Error of the forward kinematics.
        reason: String,
    },
}
