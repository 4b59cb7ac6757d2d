//! Cameras: pinhole projection in OpenCV conventions.
//!
//! Optical axes: x right, y down, z forward. Pixel centres are at integer coordinates.
//! Resizing by a factor s maps a coordinate c to (c + 0.5) · s - 0.5.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{CameraSensor, Distortion, Pose};

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
    /// How its lens bends the picture; a pinhole without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// What its sensors add to a perfect picture; nothing without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<CameraSensor>,
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
        Self::new(name, CameraMount::World, Self::pose_looking_at(eye, target), intrinsics)
    }

    /// A perfect camera: a pinhole whose sensors add nothing.
    pub fn new(name: &str, mount: CameraMount, mount_from_camera: Pose, intrinsics: Intrinsics) -> Self {
        Self { name: name.into(), mount, mount_from_camera, intrinsics, distortion: None, sensor: None }
    }

    /// Pose of an optical frame at `eye` that looks at `target`, image upright against +z.
    pub fn pose_looking_at(eye: DVec3, target: DVec3) -> Pose {
        let forward = (target - eye).normalize();
        let up_hint = if forward.cross(DVec3::Z).length() < 1e-6 { DVec3::X } else { DVec3::Z };
        let right = forward.cross(up_hint).normalize();
        let down = forward.cross(right);
        Pose::from_axes(eye, right, down, forward)
    }

    /// `world_from_camera`, given the pose of the hand.
    pub fn world_from_camera(&self, world_from_hand: &Pose) -> Pose {
        match self.mount {
            CameraMount::World => self.mount_from_camera,
            CameraMount::Hand => *world_from_hand * self.mount_from_camera,
        }
    }
}

impl Intrinsics {
    /// Square pixels, principal point in the middle, the given vertical field of view in radians.
    pub fn from_vertical_fov(width: u32, height: u32, vertical_fov: f64) -> Self {
        let f = f64::from(height) / 2.0 / (vertical_fov / 2.0).tan();
        Self { width, height, fx: f, fy: f, cx: (f64::from(width) - 1.0) / 2.0, cy: (f64::from(height) - 1.0) / 2.0 }
    }

    /// As [`Intrinsics::from_vertical_fov`], from the horizontal field of view in radians.
    pub fn from_horizontal_fov(width: u32, height: u32, horizontal_fov: f64) -> Self {
        let f = f64::from(width) / 2.0 / (horizontal_fov / 2.0).tan();
        Self { fx: f, fy: f, ..Self::from_vertical_fov(width, height, 1.0) }
    }

    /// Vertical field of view, rad.
    pub fn vertical_fov(&self) -> f64 {
        2.0 * (f64::from(self.height) / 2.0 / self.fy).atan()
    }

    /// Horizontal field of view, rad.
    pub fn horizontal_fov(&self) -> f64 {
        2.0 * (f64::from(self.width) / 2.0 / self.fx).atan()
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

    /// As much of the same view as fills another size with pixels of the same shape.
    ///
    /// Where the ratio of the sides changes, two opposite edges are cut off; [`Intrinsics::resized`] would stretch.
    #[must_use]
    pub fn filling(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        let scale = sx.max(sy);
        let moved = |c: f64, old: u32, new: u32| (c + 0.5 - f64::from(old) / 2.0) * scale + f64::from(new) / 2.0 - 0.5;
        Self {
            width,
            height,
            fx: self.fx * scale,
            fy: self.fy * scale,
            cx: moved(self.cx, self.width, width),
            cy: moved(self.cy, self.height, height),
        }
    }
}

/// A camera that can be bought, as a pinhole with square pixels.
///
/// Colour and depth of one device are two presets: they see different fields.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraPreset {
    /// Name on the command line and in world files, e.g. `d435`.
    pub name: &'static str,
    /// What it stands for.
    pub what: &'static str,
    /// Pixels per row and rows.
    pub size_px: [u32; 2],
    /// Horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
    /// Where the field of view comes from.
    pub source: &'static str,
}

const REALSENSE: &str =
    "Intel RealSense Product Family D400 Series datasheet, 337029, field of view at 16:9, +-3 degrees";

/// Known cameras.
pub const PRESETS: [CameraPreset; 8] = [
    CameraPreset {
        name: "d415",
        what: "RealSense D415, colour",
        size_px: [1280, 720],
        horizontal_fov_deg: 69.4,
        source: REALSENSE,
    },
    CameraPreset {
        name: "d415_depth",
        what: "RealSense D415, depth",
        size_px: [1280, 720],
        horizontal_fov_deg: 65.0,
        source: REALSENSE,
    },
    CameraPreset {
        name: "d435",
        what: "RealSense D435, colour",
        size_px: [1280, 720],
        horizontal_fov_deg: 69.4,
        source: REALSENSE,
    },
    CameraPreset {
        name: "d435_depth",
        what: "RealSense D435, depth",
        size_px: [1280, 720],
        horizontal_fov_deg: 87.0,
        source: REALSENSE,
    },
    CameraPreset {
        name: "droid_exterior",
        what: "exterior camera of DROID, a ZED 2 at HD720",
        size_px: [1280, 720],
        // 2 atan(640 / 528)
        horizontal_fov_deg: 100.96,
        source: "focal length of rectified ZED 2 pictures at HD720, about 528 px (2.1 mm lens, 4 um binned pixels)",
    },
    CameraPreset {
        name: "droid_wrist",
        what: "wrist camera of DROID, a ZED Mini at HD720",
        size_px: [1280, 720],
        // 2 atan(640 / 700)
        horizontal_fov_deg: 84.87,
        source: "Stereolabs, \"What is the camera focal length and field of view?\": ZED Mini, HD720, 700 px",
    },
    CameraPreset {
        name: "paper",
        what: "the paper's camera: 1280x720, focal length 640 px",
        size_px: [1280, 720],
        horizontal_fov_deg: 90.0,
        source: "camera1 of the released GenManip: focal length 5 mm, aperture 10 x 5.625 mm",
    },
    CameraPreset {
        name: "paper_small",
        what: "the paper's pictures as models get them: 1280x720 resized to 512x288",
        size_px: [512, 288],
        horizontal_fov_deg: 90.0,
        source: "camera1 of the released GenManip; the released exporter resizes to 512x288",
    },
];

impl CameraPreset {
    /// The preset of a name; `None` if there is none.
    pub fn named(name: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.name == name)
    }

    /// Names of all presets.
    pub fn names() -> [&'static str; PRESETS.len()] {
        PRESETS.map(|preset| preset.name)
    }

    /// Its projection at its own size; [`Intrinsics::filling`] gives it at another one.
    pub fn intrinsics(&self) -> Intrinsics {
        let [width, height] = self.size_px;
        Intrinsics::from_horizontal_fov(width, height, self.horizontal_fov_deg.to_radians())
    }
}
