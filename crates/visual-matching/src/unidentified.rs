//! Parameters that photographs do not show.

use serde::Serialize;

/// A property that the photographs do not tell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unidentified {
    /// Name of the property, as `light direction`; cameras are named where it is one camera's.
    pub what: String,
    /// Reason.
    pub why: String,
    /// Photograph that would tell it.
    pub remedy: String,
}

/// Names of properties in [`Unidentified::what`].
pub mod names {
    /// Direction of the key light.
    pub const DIRECTION: &str = "light direction";
    /// Width of the key light.
    pub const SOFTNESS: &str = "softness of the light";
    /// Exposure and white balance apart from the table's colour.
    pub const EXPOSURE: &str = "exposure and white balance";
}
