//! What can be wrong with a request for a picture.

/// Why nothing was drawn.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A mesh refers to corners it does not have.
    #[error("the mesh of part `{part}` of `{body}` names corner {index}, but it has only {corners} corners")]
    BadMesh {
        /// Link or object.
        body: String,
        /// Visual part.
        part: String,
        /// Offending index.
        index: u32,
        /// Number of corners.
        corners: usize,
    },
    /// More than the ids of the visibility buffer can tell apart.
    #[error("the scene has {got} {what}, expected at most {limit}")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        got: usize,
        /// How many are possible.
        limit: usize,
    },
    /// The frame does not belong to these assets.
    #[error("the frame poses {got} bodies, expected {expected} (every robot link, then every link of every object)")]
    BodyCount {
        /// Bodies of the assets.
        expected: usize,
        /// Bodies of the frame.
        got: usize,
    },
    /// The number of object poses does not match the assets.
    #[error("got poses of {got} objects, expected {expected}")]
    ObjectCount {
        /// Objects of the assets.
        expected: usize,
        /// Objects given.
        got: usize,
    },
    /// A pose or a projection that cannot be drawn.
    #[error("{what} is not finite")]
    NotFinite {
        /// What is wrong.
        what: String,
    },
    /// A camera without pixels or with a focal length that is not positive, or too large an image.
    #[error("camera `{camera}`: {problem}")]
    BadCamera {
        /// Name of the camera.
        camera: String,
        /// What is wrong, with expected and got.
        problem: String,
    },
    /// One buffer per job is needed.
    #[error("got {got} frame buffers for {expected} jobs")]
    BufferCount {
        /// Jobs.
        expected: usize,
        /// Buffers.
        got: usize,
    },
}
