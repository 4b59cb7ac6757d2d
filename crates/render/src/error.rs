//! Errors of render jobs.

/// Reasons why a job cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A mesh with a vertex index out of range.
    #[error("the mesh of part `{part}` of `{body}` names corner {index}, but it has only {corners} corners")]
    BadMesh {
        /// Link or object.
        body: String,
        /// Visual part.
        part: String,
        /// Offending index.
        index: u32,
        /// Number of vertices.
        corners: usize,
    },
    /// More parts or triangles than a visibility id can hold.
    #[error("the scene has {got} {what}, expected at most {limit}")]
    TooLarge {
        /// Counted item.
        what: &'static str,
        /// Their number.
        got: usize,
        /// Largest possible number.
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
    /// A pose or projection that is not finite.
    #[error("{what} is not finite")]
    NotFinite {
        /// The value that is not finite.
        what: String,
    },
    /// A camera without pixels, with a non-positive focal length, or with too large an image.
    #[error("camera `{camera}`: {problem}")]
    BadCamera {
        /// Name of the camera.
        camera: String,
        /// The problem, with expected and actual values.
        problem: String,
    },
    /// The number of buffers differs from the number of jobs.
    #[error("got {got} frame buffers for {expected} jobs")]
    BufferCount {
        /// Jobs.
        expected: usize,
        /// Buffers.
        got: usize,
    },
}
