//! Sets of views from which no camera is calibrated.

use thiserror::Error;

/// Reason why a set of views is refused, with the motion or fact that is missing.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CalibrationError {
    /// Fewer views than unknowns need.
    #[error("{count} views have a robot state and a board; expected at least {needed}, better 15 to 20")]
    FewViews {
        /// Views with both.
        count: usize,
        /// Fewest views.
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
    /// Views share a few orientations.
    #[error("the views have {count} different orientations of the hand; expected at least 3, 10 degrees apart")]
    FewRotations {
        /// Different orientations.
        count: usize,
    },
    /// All turns are half turns, whose axes are ambiguous.
    #[error("the hand turns by about 180 degrees or hardly at all; add views with turns of 20 to 90 degrees")]
    HalfTurns,
    /// All turns have one axis.
    #[error(
        "all turns of the hand are about one axis ({x:.2}, {y:.2}, {z:.2}) of the {frame}; also turn it by 20 degrees or \
         more about an axis across: without that, the camera's position along the axis stays unknown"
    )]
    ParallelAxes {
        /// Frame of the axis.
        frame: &'static str,
        /// Axis.
        x: f64,
        /// Axis.
        y: f64,
        /// Axis.
        z: f64,
    },
    /// Two poses of the board explain each view equally well.
    #[error(
        "in {ambiguous} of {views} views the board could be tilted either way; move closer, use a larger board, or tilt \
         it by 20 to 45 degrees against the image"
    )]
    PlanarFlip {
        /// Ambiguous views.
        ambiguous: usize,
        /// All views.
        views: usize,
    },
    /// Camera and board are mounted the other way round.
    #[error(
        "the views fit a camera mounted as {other} ({other_px:.2} px), not as {stated} ({stated_px:.2} px); correct \
         `mounting`"
    )]
    OtherMounting {
        /// Mounting that was stated.
        stated: &'static str,
        /// The other mounting.
        other: &'static str,
        /// Error of the stated one, px.
        stated_px: f64,
        /// Error of the other one, px.
        other_px: f64,
    },
    /// Board and robot disagree on lengths.
    #[error(
        "the robot's travel says that the board is {scale:.4} times as large as stated; measure the spacing of its \
         corners, and check the focal length"
    )]
    Scale {
        /// True size over stated size.
        scale: f64,
    },
    /// Views contradict each other.
    #[error(
        "the views contradict each other ({rms_px:.1} px, robot poses off by {robot_mm:.1} mm); expected poses of the \
         hand link in the base, read while the arm stood still, under the ids of their images; worst: {worst}"
    )]
    Inconsistent {
        /// Error of all corners, px.
        rms_px: f64,
        /// Correction of the robot poses, mm.
        robot_mm: f64,
        /// Id of the worst view.
        worst: String,
    },
    /// Robot states of other shape than the arm.
    #[error("view {view}: {reason}")]
    Joints {
        /// Id of the view.
        view: String,
        /// Reason.
        reason: String,
    },
}
