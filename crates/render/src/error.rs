//! Errors of render jobs.

/// Reasons why a job cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A mesh with a vertex index out of range.
    #[error("the mesh of part `{part}` of `{body}` names corner {index}, but it has only {corners} corners")]
    BadMesh {
        /// Name of the robot link or fixture, or uid of the object.
        body: String,
        /// Name of the visual part.
        part: String,
        /// Index that is out of range.
        index: u32,
        /// Number of the mesh's vertices; valid indices are smaller.
        corners: usize,
    },
    /// More parts or triangles than a visibility id can hold.
    #[error("the scene has {got} {what}, expected at most {limit}")]
    TooLarge {
        /// Kind of the counted items, e.g. triangles.
        what: &'static str,
        /// Number of items in the scene.
        got: usize,
        /// Largest number that a visibility id can hold.
        limit: usize,
    },
    /// The number of body poses in a frame does not match the assets.
    #[error("the frame poses {got} bodies, expected {expected} (every robot link, then every link of every object)")]
    BodyCount {
        /// Number of bodies in the assets.
        expected: usize,
        /// Number of poses in the frame.
        got: usize,
    },
    /// The number of object poses does not match the assets.
    #[error("got poses of {got} objects, expected {expected}")]
    ObjectCount {
        /// Number of objects in the assets.
        expected: usize,
        /// Number of objects whose poses were given.
        got: usize,
    },
    /// A pose or projection that is not finite.
    #[error("{what} is not finite")]
    NotFinite {
        /// Name of the value that is not finite.
        what: String,
    },
    /// A camera without pixels, with a non-positive focal length, or with too large an image.
    #[error("camera `{camera}`: {problem}")]
    BadCamera {
        /// Name of the camera.
        camera: String,
        /// Description of the problem, with expected and actual values.
        problem: String,
    },
    /// The number of buffers differs from the number of jobs.
    #[error("got {got} frame buffers for {expected} jobs")]
    BufferCount {
        /// Number of jobs.
        expected: usize,
        /// Number of buffers; each job needs one.
        got: usize,
    },
}
