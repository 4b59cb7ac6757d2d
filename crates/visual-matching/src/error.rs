//! Errors of a match.

use genmanip_render::RenderError;

/// Reasons why a workspace cannot be matched.
#[derive(Debug, thiserror::Error)]
pub enum MatchError {
    /// A photograph of a camera that the world does not have, or that is mounted on the hand.
    #[error("photograph of camera `{camera}`: the world has no fixed camera of this name, only {known}")]
    UnknownCamera {
        /// Name with the photograph.
        camera: String,
        /// Names of the world's fixed cameras.
        known: String,
    },
    /// A photograph with another size than its camera's images.
    #[error("the photograph of camera `{camera}` has {got}, expected {expected} pixels as the calibrated camera")]
    WrongSize {
        /// Name of the camera.
        camera: String,
        /// Width × height of the photograph.
        got: String,
        /// Width × height of the camera.
        expected: String,
    },
    /// Nothing to match.
    #[error("there is no photograph of the empty workspace")]
    NoPhotograph,
    /// A second photograph of the same kind by one camera.
    #[error("there are two photographs of the same kind from camera `{camera}`")]
    TwoPhotographs {
        /// Name of the camera.
        camera: String,
    },
    /// A chart that cannot be read.
    #[error("the colour chart in the photograph of camera `{camera}` cannot be used: {problem}")]
    BadChart {
        /// Name of the camera.
        camera: String,
        /// Problem of the chart.
        problem: String,
    },
    /// A photograph that shows no usable part of the table.
    #[error("camera `{camera}` sees no usable part of the table: all of it is hidden, too dark or overexposed")]
    NoTable {
        /// Name of the camera.
        camera: String,
    },
    /// A view that cannot be rendered.
    #[error("the view of camera `{camera}` cannot be rendered")]
    NotDrawn {
        /// Name of the camera.
        camera: String,
        /// Reason.
        source: RenderError,
    },
    /// An image that cannot be encoded.
    #[error("the background of camera `{camera}` cannot be encoded")]
    NotEncoded {
        /// Name of the camera.
        camera: String,
        /// Reason.
        source: genmanip_render::encode::EncodeError,
    },
}
