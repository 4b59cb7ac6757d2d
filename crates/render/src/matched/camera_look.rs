//! Measured response and photograph of one camera.

use std::sync::Arc;

use super::photograph::LinearPhotograph;
use super::response::Response;

/// Response and photograph of one camera.
#[derive(Clone, Debug)]
pub struct CameraLook {
    /// Name of the camera.
    pub camera: String,
    /// Response, which replaces exposure and tone mapping.
    pub response: Arc<Response>,
    /// Photograph of the empty workspace.
    pub photograph: Option<Arc<LinearPhotograph>>,
}

impl PartialEq for CameraLook {
    /// True for the same camera with the same data in memory.
    fn eq(&self, other: &Self) -> bool {
        let photographs = [self, other].map(|look| look.photograph.as_ref().map(Arc::as_ptr));
        self.camera == other.camera && Arc::ptr_eq(&self.response, &other.response) && photographs[0] == photographs[1]
    }
}
