//! Cameras: pinhole projection in OpenCV conventions.
//!
//! Optical axes: x right, y down, z forward. Pixel centres are at integer coordinates.
//! Resizing by a factor s maps a coordinate c to (c + 0.5) · s - 0.5.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{CameraSensor, Distortion, Intrinsics, Pose};

/// A camera: mount, pose and projection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Camera {
    /// Name, unique in the rig, e.g. `static`.
    pub name: String,
    /// Frame that the camera is fixed to.
    pub mount: CameraMount,
    /// Optical frame in the frame of the mount.
    pub mount_from_camera: Pose,
    /// Pinhole projection, in pixels.
    pub intrinsics: Intrinsics,
    /// Lens distortion; `None` for an ideal pinhole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Sensor model; `None` for an ideal sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<CameraSensor>,
}

/// Frame that a camera is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraMount {
    /// The world frame: a fixed camera.
    World,
    /// The robot's hand link (wrist camera).
    Hand,
}

impl CameraMount {
    /// Pose of an optical frame at `eye` that looks at `target`, both in the frame of the mount, m.
    ///
    /// The upper edge of the image lies towards +z of the world for a world camera, and towards +x of the hand for a
    /// hand camera; if the view direction is parallel to that axis, towards the other of these two axes.
    pub fn pose_looking_at(self, eye: DVec3, target: DVec3) -> Pose {
        let forward = (target - eye).normalize();
        let [up, other] = match self {
            Self::World => [DVec3::Z, DVec3::X],
            Self::Hand => [DVec3::X, DVec3::Z],
        };
        let up = if forward.cross(up).length() < 1e-6 { other } else { up };
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        Pose::from_axes(eye, right, down, forward)
    }
}

impl Camera {
    /// A camera fixed in the world at `eye`, looking at `target`, image upright against world +z.
    pub fn looking_at(name: &str, eye: DVec3, target: DVec3, intrinsics: Intrinsics) -> Self {
        Self::new(name, CameraMount::World, Self::pose_looking_at(eye, target), intrinsics)
    }

    /// An ideal camera: no distortion, no sensor model.
    pub fn new(name: &str, mount: CameraMount, mount_from_camera: Pose, intrinsics: Intrinsics) -> Self {
        Self { name: name.into(), mount, mount_from_camera, intrinsics, distortion: None, sensor: None }
    }

    /// Pose of an optical frame at `eye` that looks at `target`, image upright against +z.
    pub fn pose_looking_at(eye: DVec3, target: DVec3) -> Pose {
        CameraMount::World.pose_looking_at(eye, target)
    }

    /// `world_from_camera`, given the pose of the hand link.
    pub fn world_from_camera(&self, world_from_hand: &Pose) -> Pose {
        match self.mount {
            CameraMount::World => self.mount_from_camera,
            CameraMount::Hand => *world_from_hand * self.mount_from_camera,
        }
    }
}

/// A commercial camera as a pinhole with square pixels.
///
/// Colour and depth of one device are two presets because their fields of view differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CameraPreset {
    /// Name on the command line and in world files, e.g. `d435`.
    pub name: &'static str,
    /// Device and stream that the preset models.
    pub what: &'static str,
    /// Width and height of the image, pixels.
    pub size_px: [u32; 2],
    /// Horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
    /// Source of the field of view.
    pub source: &'static str,
}

const REALSENSE: &str =
    "Intel RealSense Product Family D400 Series datasheet, 337029, field of view at 16:9, +-3 degrees";

/// Commercial cameras that worlds can name.
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
        // Focal length 528 px at a width of 1280: 2 atan(640 / 528).
        horizontal_fov_deg: 100.96,
        source: "focal length of rectified ZED 2 images at HD720, about 528 px (2.1 mm lens, 4 um binned pixels)",
    },
    CameraPreset {
        name: "droid_wrist",
        what: "wrist camera of DROID, a ZED Mini at HD720",
        size_px: [1280, 720],
        // Focal length 700 px at a width of 1280: 2 atan(640 / 700).
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
        what: "the paper's images as policies receive them: 1280x720 resized to 512x288",
        size_px: [512, 288],
        horizontal_fov_deg: 90.0,
        source: "camera1 of the released GenManip; the released exporter resizes to 512x288",
    },
];

impl CameraPreset {
    /// Preset with this name; `None` if there is none.
    pub fn named(name: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.name == name)
    }

    /// Names of all presets.
    pub fn names() -> [&'static str; PRESETS.len()] {
        PRESETS.map(|preset| preset.name)
    }

    /// Intrinsics at the preset's own size; use [`Intrinsics::filling`] for another size.
    pub fn intrinsics(&self) -> Intrinsics {
        let [width, height] = self.size_px;
        Intrinsics::from_horizontal_fov(width, height, self.horizontal_fov_deg.to_radians())
    }
}
