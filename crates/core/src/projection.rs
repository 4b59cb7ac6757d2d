//! Projection between world and pixel coordinates.
//!
//! ```text
//! world (m) ──to_camera──▶ camera (m; x right, y down, z ahead) ──pixel_of_ray──▶ pixel (u right, v down; centres whole)
//!           ◀──to_world───                                      ◀──────ray──────
//! ```

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, Distortion, Intrinsics, Pose};

/// Largest round-trip error of a distorted point on the normalised image plane; chosen far below a pixel.
const MAX_ROUND_TRIP_ERROR: f64 = 1e-6;

/// A posed camera: projects world points to pixels and unprojects pixels to world points.
///
/// Round trips are exact to rounding (about 1e-9 of a pixel), also with lens distortion.
///
/// ```
/// use genmanip_core::{Camera, Distortion, Intrinsics, Pose, Projection, glam::DVec3};
/// let intrinsics = Intrinsics::from_vertical_fov(512, 288, 0.8);
/// let mut camera = Camera::looking_at("front", DVec3::new(1.5, 0.2, 0.9), DVec3::new(0.5, 0.0, 0.0), intrinsics);
/// camera.distortion = Some(Distortion { k1: -0.1, k2: 0.01, p1: 0.001, p2: 0.0, k3: 0.0 });
///
/// let projection = Projection::of(&camera, &Pose::IDENTITY);
/// let corner = DVec3::new(0.45, 0.1, 0.02);
/// let (pixel, depth_m) = projection.pixel(corner).unwrap();
/// assert!(projection.point(pixel, depth_m).unwrap().distance(corner) < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Projection {
    /// Pinhole intrinsics, pixels.
    pub intrinsics: Intrinsics,
    /// Lens distortion; `None` for a pinhole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Optical frame in the world: x right, y down, z forward.
    pub world_from_camera: Pose,
}

impl Projection {
    /// Projection of a rig's camera, given the pose of the hand link (used by wrist cameras only).
    pub fn of(camera: &Camera, world_from_hand: &Pose) -> Self {
        let (intrinsics, distortion) = (camera.intrinsics, camera.distortion);
        Self { intrinsics, distortion, world_from_camera: camera.world_from_camera(world_from_hand) }
    }

    /// Transforms a world point to the camera frame, metres.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.world_from_camera.inverse().transform_point(point)
    }

    /// Transforms a point of the camera frame to the world, metres.
    pub fn to_world(&self, point: DVec3) -> DVec3 {
        self.world_from_camera.transform_point(point)
    }

    /// View ray of a pixel in the camera frame with z = 1; `None` where the distortion has no unique inverse.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.intrinsics.unproject(pixel, 1.0);
        match self.distortion {
            None => Some(ray),
            Some(lens) => lens.undistort(ray.truncate()).map(|pinhole| pinhole.extend(1.0)),
        }
    }

    /// Pixel of a view ray in the camera frame, of any length; the pixel may lie outside the image. `None` behind the
    /// camera and where the distortion folds over.
    pub fn pixel_of_ray(&self, ray: DVec3) -> Option<DVec2> {
        let on_plane = (ray.z > 1e-9).then(|| ray.truncate() / ray.z)?;
        let shown = match self.distortion {
            None => on_plane,
            // The polynomial may fold a point far outside back into the image; a real lens does not.
            Some(lens) => Some(lens.distort(on_plane)).filter(|&shown| {
                lens.undistort(shown).is_some_and(|back| back.distance(on_plane) < MAX_ROUND_TRIP_ERROR)
            })?,
        };
        self.intrinsics.project(shown.extend(1.0))
    }

    /// World point of a pixel at a depth along the optical axis, metres; `None` as [`Projection::ray`].
    pub fn point(&self, pixel: DVec2, depth_m: f64) -> Option<DVec3> {
        self.ray(pixel).map(|ray| self.to_world(ray * depth_m))
    }

    /// Pixel of a world point, and the point's depth along the optical axis, metres; `None` as
    /// [`Projection::pixel_of_ray`].
    pub fn pixel(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let seen = self.to_camera(point);
        self.pixel_of_ray(seen).map(|pixel| (pixel, seen.z))
    }

    /// Origin and unit direction of a pixel's view ray in the world; `None` as [`Projection::ray`].
    pub fn view_ray(&self, pixel: DVec2) -> Option<(DVec3, DVec3)> {
        let direction = self.world_from_camera.transform_vector(self.ray(pixel)?).normalize();
        Some((self.world_from_camera.position, direction))
    }

    /// True if a pixel lies inside the image; pixel 0 covers -0.5 to 0.5.
    pub fn is_in_image(&self, pixel: DVec2) -> bool {
        let size = DVec2::new(f64::from(self.intrinsics.width), f64::from(self.intrinsics.height));
        pixel.cmpge(DVec2::splat(-0.5)).all() && pixel.cmplt(size - 0.5).all()
    }
}
