//! From the world to pixels and back.
//!
//! ```text
//! world (m) ──to_camera──▶ camera (m; x right, y down, z ahead) ──pixel_of_ray──▶ pixel (u right, v down; centres whole)
//!           ◀──to_world───                                      ◀──────ray──────
//! ```

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, Distortion, Intrinsics, Pose};

/// How far back from the lens a point may land from where it was, at a distance of 1; chosen: far below a pixel.
const FOLDED: f64 = 1e-6;

/// A camera at its place in the world: which pixel shows a point, and which points a pixel shows.
///
/// A round trip is exact to rounding (about 1e-9 of a pixel), with a lens too.
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
    /// Pinhole, pixels.
    pub intrinsics: Intrinsics,
    /// How the lens bends the picture; a pinhole without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Optical frame in the world: x right, y down, z ahead.
    pub world_from_camera: Pose,
}

impl Projection {
    /// A camera of a rig, given the pose of the hand, which only cameras on it need.
    pub fn of(camera: &Camera, world_from_hand: &Pose) -> Self {
        let (intrinsics, distortion) = (camera.intrinsics, camera.distortion);
        Self { intrinsics, distortion, world_from_camera: camera.world_from_camera(world_from_hand) }
    }

    /// A point of the world in the camera's frame, metres.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.world_from_camera.inverse().transform_point(point)
    }

    /// A point of the camera's frame in the world, metres.
    pub fn to_world(&self, point: DVec3) -> DVec3 {
        self.world_from_camera.transform_point(point)
    }

    /// Direction that a pixel looks in, camera frame, with z = 1; `None` where the lens shows no single point.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.intrinsics.unproject(pixel, 1.0);
        match self.distortion {
            None => Some(ray),
            Some(lens) => lens.undistort(ray.truncate()).map(|pinhole| pinhole.extend(1.0)),
        }
    }

    /// The pixel that looks in a direction of the camera's frame, of any length; it may lie outside of the picture.
    /// `None` behind the camera, and where the lens folds its picture over.
    pub fn pixel_of_ray(&self, ray: DVec3) -> Option<DVec2> {
        let on_plane = (ray.z > 1e-9).then(|| ray.truncate() / ray.z)?;
        let shown = match self.distortion {
            None => on_plane,
            // A point far outside may be folded into the image by the formula, and never by the lens.
            Some(lens) => Some(lens.distort(on_plane))
                .filter(|&shown| lens.undistort(shown).is_some_and(|back| back.distance(on_plane) < FOLDED))?,
        };
        self.intrinsics.project(shown.extend(1.0))
    }

    /// Point of the world that a pixel shows at a depth along the optical axis, metres; `None` as [`Projection::ray`].
    pub fn point(&self, pixel: DVec2, depth_m: f64) -> Option<DVec3> {
        self.ray(pixel).map(|ray| self.to_world(ray * depth_m))
    }

    /// The pixel that shows a point of the world, and the point's depth along the optical axis, metres;
    /// `None` as [`Projection::pixel_of_ray`].
    pub fn pixel(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let seen = self.to_camera(point);
        self.pixel_of_ray(seen).map(|pixel| (pixel, seen.z))
    }

    /// Where the sight of a pixel begins and its unit direction, both in the world; `None` as [`Projection::ray`].
    pub fn sight(&self, pixel: DVec2) -> Option<(DVec3, DVec3)> {
        let direction = self.world_from_camera.transform_vector(self.ray(pixel)?).normalize();
        Some((self.world_from_camera.position, direction))
    }

    /// Whether a pixel lies in the picture; pixel 0 covers -0.5 to 0.5.
    pub fn is_in_picture(&self, pixel: DVec2) -> bool {
        let size = DVec2::new(f64::from(self.intrinsics.width), f64::from(self.intrinsics.height));
        pixel.cmpge(DVec2::splat(-0.5)).all() && pixel.cmplt(size - 0.5).all()
    }
}
