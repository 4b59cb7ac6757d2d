//! Images that look like those of a real camera: its response, and its photograph of the empty workspace.
//!
//! A photograph is turned into scene-linear light once. Divided by the light that falls on the empty surface, it is the
//! base colour of upward surfaces there, which are then shaded like any other: shadows and occlusion of robot and objects
//! fall on the photographed table. All else of surfaces and background is shown as photographed.

pub(crate) mod camera_look;
pub(crate) mod look;
pub(crate) mod photograph;
pub(crate) mod response;
#[cfg(test)]
mod tests;
