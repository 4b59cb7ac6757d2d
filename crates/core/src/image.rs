//! RGB-D images with camera parameters, and requests for them.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Distortion, Intrinsics, Pose, Projection};

/// One camera image: the exchange type of policies, perception and recorders.
///
/// All channels are row-major from the top left; channels that were not requested are empty.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdImage {
    /// Intrinsics at the size of this image.
    pub intrinsics: Intrinsics,
    /// Lens distortion; `None` for a pinhole image.
    pub distortion: Option<Distortion>,
    /// Camera pose; x right, y down, z forward.
    pub world_from_camera: Pose,
    /// Colour, 8-bit sRGB, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Depth along the optical axis at pixel centres, metres; not positive or not finite where nothing was measured.
    pub depth_m: Vec<f32>,
    /// Instance id of each pixel as assigned by the renderer; 0 for background.
    pub ids: Vec<u16>,
    /// Unit surface normals in the camera frame times 127, towards the camera; zero for background.
    pub normals: Vec<[i8; 3]>,
    /// Points in the world frame, metres, one per pixel; NaN where there is no depth.
    pub points_m: Vec<[f32; 3]>,
}

/// An image request for one camera.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraRequest {
    /// Name of the camera in the scenario.
    pub name: String,
    /// Width and height; `None` for the camera's own size.
    ///
    /// The whole image is resized: a different aspect ratio gives non-square pixels, as reflected in K.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// Channels that the image must contain.
    #[serde(default)]
    pub channels: ImageChannels,
}

/// The channels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageChannels {
    /// True for colour.
    pub rgb: bool,
    /// True for depth along the optical axis.
    pub depth: bool,
    /// True for instance ids: simulator ground truth, for privileged policies only.
    pub ids: bool,
    /// True for surface normals.
    pub normals: bool,
    /// True for world points.
    pub points: bool,
}

impl ImageChannels {
    /// Colour without other channels.
    pub const RGB: Self = Self { rgb: true, depth: false, ids: false, normals: false, points: false };
    /// Colour and depth without other channels.
    pub const RGBD: Self = Self { depth: true, ..Self::RGB };
}

impl Default for ImageChannels {
    fn default() -> Self {
        Self::RGB
    }
}

impl CameraRequest {
    /// Request for a camera at its own size.
    pub fn new(name: &str, channels: ImageChannels) -> Self {
        Self { name: name.into(), size: None, channels }
    }

    /// The same request at another size, pixels.
    #[must_use]
    pub fn sized(self, width: u32, height: u32) -> Self {
        Self { size: Some([width, height]), ..self }
    }
}

impl RgbdImage {
    /// An image with depth (m) as its only channel, from a camera without distortion.
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

    /// Image width, pixels.
    pub fn width(&self) -> u32 {
        self.intrinsics.width
    }

    /// Image height, pixels.
    pub fn height(&self) -> u32 {
        self.intrinsics.height
    }

    /// Projection of the camera for this image.
    pub fn projection(&self) -> Projection {
        let Self { intrinsics, distortion, world_from_camera, .. } = *self;
        Projection { intrinsics, distortion, world_from_camera }
    }

    /// World point of a pixel, by pixel index; `None` without valid depth.
    pub fn point(&self, index: usize) -> Option<DVec3> {
        let depth_m = *self.depth_m.get(index).filter(|depth_m| **depth_m > 0.0 && depth_m.is_finite())?;
        let width = (self.intrinsics.width as usize).max(1);
        let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
        self.projection().point(pixel, f64::from(depth_m))
    }

    /// Pixel of a world point, which may lie outside the image; `None` behind the camera and where the distortion folds
    /// over.
    pub fn pixel_of(&self, point: DVec3) -> Option<DVec2> {
        self.projection().pixel(point).map(|(pixel, _)| pixel)
    }

    /// The same camera without any channel.
    #[must_use]
    pub fn without_pixels(&self) -> Self {
        Self { distortion: self.distortion, ..Self::of_depth(self.intrinsics, self.world_from_camera, Vec::new()) }
    }

    /// Depth resampled to an undistorted pinhole image with the same K, for obstacle detection; 0 where the distorted
    /// image has no data.
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

    /// Fills [`RgbdImage::points_m`] from the depth.
    #[must_use]
    pub fn with_points(mut self) -> Self {
        let point = |index| self.point(index).map_or([f32::NAN; 3], |point| point.as_vec3().to_array());
        self.points_m = (0..self.depth_m.len()).map(point).collect();
        self
    }
}

/// Depth in whole millimetres, the unit of 16-bit depth images: rounded; 0 for depths that are not positive or not
/// finite (nothing measured); 65535 for 65.535 m and beyond.
#[inline(always)]
pub fn depth_to_mm(depth_m: f32) -> u16 {
    /// 2^52: an `f64` above it has no fraction bits, so adding it rounds and leaves the integer in the lowest mantissa
    /// bits.
    const SHIFT: f64 = (1_u64 << 52) as f64;
    // Product and sum are exact wherever the sum could reach the next millimetre, so its integer part equals that of
    // `f64::round`, without the range checks of a float-to-int conversion.
    let mm = f64::from(depth_m) * 1000.0 + 0.5;
    let mm = if mm > 0.0 && depth_m < f32::INFINITY { mm } else { 0.0 };
    let mm = if mm < 65_535.0 { mm } else { 65_535.0 };
    let nearest = (mm + SHIFT) - SHIFT;
    let whole = if nearest > mm { nearest - 1.0 } else { nearest };
    (whole + SHIFT).to_bits() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks that `depth_to_mm` equals `f64::round`, around every half millimetre and across all magnitudes.
    #[test]
    fn millimetres_are_rounded_and_saturate() {
        for (depth_m, expected) in [
            (65.534, 65_534),
            (65.535, 65_535),
            (65.6, 65_535),
            (1e9, 65_535),
            (-1.0, 0),
            (f32::NAN, 0),
            (f32::INFINITY, 0),
        ] {
            assert_eq!(depth_to_mm(depth_m), expected, "{depth_m} m");
        }
        let halves = (0..=140_000).flat_map(|half| {
            let bits = (half as f32 / 2000.0).to_bits();
            (bits.saturating_sub(2)..=bits + 2).map(f32::from_bits)
        });
        let scales = (0..=u32::MAX >> 12).map(|bits| f32::from_bits(bits << 12));
        for depth_m in halves.chain(scales) {
            let expected = if depth_m.is_finite() { (f64::from(depth_m) * 1000.0).round() as u16 } else { 0 };
            assert_eq!(depth_to_mm(depth_m), expected, "{depth_m} m");
        }
    }
}
