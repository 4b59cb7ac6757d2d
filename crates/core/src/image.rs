//! Images with what is needed to place them in space, and what is asked of a camera.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Distortion, Intrinsics, Pose, Projection};

/// One camera's image: what policies, depth perception and recorders speak.
///
/// All channels are row by row from the top left; one that was not asked for is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdImage {
    /// Projection, at the size of this image.
    pub intrinsics: Intrinsics,
    /// How the lens bent it; a pinhole without.
    pub distortion: Option<Distortion>,
    /// Where the camera was; x right, y down, z forward.
    pub world_from_camera: Pose,
    /// Colour, 8-bit sRGB, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Metres along the optical axis at the pixels' centres; where it is not positive and finite, nothing was seen.
    pub depth_m: Vec<f32>,
    /// What each pixel sees, by the renderer's instance ids; 0 where nothing was seen.
    pub ids: Vec<u16>,
    /// Unit surface normals in the camera's frame times 127, towards the camera; zero where nothing was seen.
    pub normals: Vec<[i8; 3]>,
    /// Points in the world, metres, one per pixel; not a number where nothing was seen.
    pub points_m: Vec<[f32; 3]>,
}

/// What is asked of one camera.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraRequest {
    /// Name of the camera in the scenario.
    pub name: String,
    /// Pixels per row and rows; `None` for the camera's own size.
    ///
    /// The whole image is resized: another aspect ratio gives pixels that are not square, as K says.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// What is wanted.
    #[serde(default)]
    pub channels: ImageChannels,
}

/// The channels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageChannels {
    /// Colour.
    pub rgb: bool,
    /// Distance along the optical axis.
    pub depth: bool,
    /// Which object each pixel sees: simulator truth, for privileged policies only.
    pub ids: bool,
    /// Which way the surface faces.
    pub normals: bool,
    /// The point in the world that each pixel sees.
    pub points: bool,
}

impl ImageChannels {
    /// Colour only.
    pub const RGB: Self = Self { rgb: true, depth: false, ids: false, normals: false, points: false };
    /// Colour and depth.
    pub const RGBD: Self = Self { depth: true, ..Self::RGB };
}

impl Default for ImageChannels {
    fn default() -> Self {
        Self::RGB
    }
}

impl CameraRequest {
    /// A camera at its own size.
    pub fn new(name: &str, channels: ImageChannels) -> Self {
        Self { name: name.into(), size: None, channels }
    }

    /// The same camera at another size.
    #[must_use]
    pub fn sized(self, width: u32, height: u32) -> Self {
        Self { size: Some([width, height]), ..self }
    }
}

impl RgbdImage {
    /// A depth image alone.
    pub fn of_depth(intrinsics: Intrinsics, world_from_camera: Pose, depth_m: Vec<f32>) -> Self {
        Self {
            intrinsics,
            distortion: None,
            world_from_camera,
            rgb: Vec::new(),
            depth_m,
            ids: Vec::new(),
            normals: Vec::new(),
            points_m: Vec::new(),
        }
    }

    /// Pixels per row.
    pub fn width(&self) -> u32 {
        self.intrinsics.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.intrinsics.height
    }

    /// The camera that took the image.
    pub fn projection(&self) -> Projection {
        let Self { intrinsics, distortion, world_from_camera, .. } = *self;
        Projection { intrinsics, distortion, world_from_camera }
    }

    /// The point in the world that a pixel sees, by its index; `None` where nothing was seen or there is no depth.
    pub fn point(&self, index: usize) -> Option<DVec3> {
        let depth_m = *self.depth_m.get(index).filter(|depth_m| **depth_m > 0.0 && depth_m.is_finite())?;
        let width = (self.intrinsics.width as usize).max(1);
        let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
        self.projection().point(pixel, f64::from(depth_m))
    }

    /// Where the image shows a point of the world, in pixels, which may lie outside of it; `None` behind the camera.
    pub fn pixel_of(&self, point: DVec3) -> Option<DVec2> {
        self.projection().pixel(point).map(|(pixel, _)| pixel)
    }

    /// The same camera, without a channel.
    #[must_use]
    pub fn without_pixels(&self) -> Self {
        Self { distortion: self.distortion, ..Self::of_depth(self.intrinsics, self.world_from_camera, Vec::new()) }
    }

    /// Depth alone, as a pinhole with the same K would have it, for those who look for obstacles; 0 where the lens showed
    /// nothing of it.
    #[must_use]
    pub fn pinhole_depth(&self) -> Self {
        let Some(lens) = self.distortion else {
            return Self::of_depth(self.intrinsics, self.world_from_camera, self.depth_m.clone());
        };
        let (k, [width, height]) = (self.intrinsics, [self.width(), self.height()]);
        let depth_at = |index: u32| {
            let pixel = DVec2::new(f64::from(index % width), f64::from(index / width));
            let ray = k.unproject(pixel, 1.0);
            let shown = k.project(lens.distort(ray.truncate()).extend(1.0)).unwrap_or(DVec2::NEG_INFINITY).round();
            let is_inside = shown.cmpge(DVec2::ZERO).all() && shown.x < f64::from(width) && shown.y < f64::from(height);
            let index = is_inside.then(|| shown.y as usize * width as usize + shown.x as usize);
            index.and_then(|index| self.depth_m.get(index)).copied().unwrap_or(0.0)
        };
        Self::of_depth(k, self.world_from_camera, (0..width * height).map(depth_at).collect())
    }

    /// Fills in [`RgbdImage::points_m`] from the depth.
    #[must_use]
    pub fn with_points(mut self) -> Self {
        let point = |index| self.point(index).map_or([f32::NAN; 3], |point| point.as_vec3().to_array());
        self.points_m = (0..self.depth_m.len()).map(point).collect();
        self
    }
}
