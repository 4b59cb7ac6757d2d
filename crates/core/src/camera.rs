//! Cameras: pinhole projection in OpenCV conventions.
//!
//! Optical axes: x right, y down, z forward. Pixel centres are at integer coordinates.
//! Resizing by a factor s maps a coordinate c to (c + 0.5) · s - 0.5.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Pose;

/// A camera: where it is and what it sees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Camera {
    /// Name, unique in the rig, e.g. `static`.
    pub name: String,
    /// What it is fixed to.
    pub mount: CameraMount,
    /// Optical frame in the frame of the mount.
    pub mount_from_camera: Pose,
    /// Projection.
    pub intrinsics: Intrinsics,
}

/// What a camera is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraMount {
    /// The world.
    World,
    /// The robot's hand.
    Hand,
}

/// Pinhole intrinsics, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Intrinsics {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along x.
    pub fx: f64,
    /// Focal length along y.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
}

impl Camera {
    /// A camera fixed in the world at `eye`, looking at `target`, image upright against world +z.
    pub fn looking_at(name: &str, eye: DVec3, target: DVec3, intrinsics: Intrinsics) -> Self {
        let forward = (target - eye).normalize();
        let up_hint = if forward.cross(DVec3::Z).length() < 1e-6 { DVec3::X } else { DVec3::Z };
        let right = forward.cross(up_hint).normalize();
        let down = forward.cross(right);
        Self {
            name: name.into(),
            mount: CameraMount::World,
            mount_from_camera: Pose::from_axes(eye, right, down, forward),
            intrinsics,
        }
    }

    /// `world_from_camera`, given the pose of the hand.
    pub fn world_from_camera(&self, world_from_hand: &Pose) -> Pose {
        match self.mount {
            CameraMount::World => self.mount_from_camera,
            CameraMount::Hand => *world_from_hand * self.mount_from_camera,
        }
    }

    /// The five default cameras of the benchmark: `overview`, `left`, `right` for prompt-based systems,
    /// `static` and `wrist` for data and policies; all 512×288.
    pub fn default_rig() -> Vec<Self> {
        let wide = Intrinsics::from_vertical_fov(512, 288, 42_f64.to_radians());
        let table = DVec3::new(0.46, 0.0, 0.16);
        let tilt = 20_f64.to_radians();
        vec![
            Self::looking_at("overview", DVec3::new(1.52, 0.0, 1.05), table, wide),
            Self::looking_at("left", DVec3::new(0.85, 1.12, 0.85), table, wide),
            Self::looking_at("right", DVec3::new(0.85, -1.12, 0.85), table, wide),
            Self::looking_at("static", DVec3::new(1.36, 0.50, 0.86), DVec3::new(0.45, 0.0, 0.17), wide),
            Self {
                name: "wrist".into(),
                mount: CameraMount::Hand,
                // In front of the hand, tilted so that the pads are at the lower edge of the image.
                mount_from_camera: Pose::from_axes(
                    DVec3::new(0.075, 0.0, 0.02),
                    DVec3::Y,
                    DVec3::new(-tilt.cos(), 0.0, -tilt.sin()),
                    DVec3::new(-tilt.sin(), 0.0, tilt.cos()),
                ),
                intrinsics: Intrinsics::from_vertical_fov(512, 288, 58_f64.to_radians()),
            },
        ]
    }
}

impl Intrinsics {
    /// Square pixels, principal point in the middle, the given vertical field of view in radians.
    pub fn from_vertical_fov(width: u32, height: u32, vertical_fov: f64) -> Self {
        let f = f64::from(height) / 2.0 / (vertical_fov / 2.0).tan();
        Self { width, height, fx: f, fy: f, cx: (f64::from(width) - 1.0) / 2.0, cy: (f64::from(height) - 1.0) / 2.0 }
    }

    /// Pixel of a point in the camera's frame; `None` behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 1e-9)
            .then(|| DVec2::new(self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy))
    }

    /// Point in the camera's frame seen at a pixel with a depth along the optical axis, metres.
    ///
    /// ```
    /// use genmanip_core::{Intrinsics, glam::DVec3};
    /// let k = Intrinsics::from_vertical_fov(512, 288, 0.8);
    /// let point = DVec3::new(0.1, -0.2, 1.5);
    /// let pixel = k.project(point).unwrap();
    /// assert!((k.unproject(pixel, 1.5) - point).length() < 1e-12);
    /// ```
    pub fn unproject(&self, pixel: DVec2, depth_m: f64) -> DVec3 {
        DVec3::new((pixel.x - self.cx) / self.fx * depth_m, (pixel.y - self.cy) / self.fy * depth_m, depth_m)
    }

    /// The same view at another size.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: (self.cx + 0.5) * sx - 0.5,
            cy: (self.cy + 0.5) * sy - 0.5,
        }
    }
}
