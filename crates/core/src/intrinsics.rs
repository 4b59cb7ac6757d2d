//! Pinhole projection.
//!
//! Pixel centres are at integer coordinates. Resizing by a factor s maps a coordinate c to (c + 0.5) · s - 0.5.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pinhole intrinsics, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Intrinsics {
    /// Image width.
    pub width: u32,
    /// Image height.
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

impl Intrinsics {
    /// Intrinsics with square pixels, a centred principal point and this vertical field of view (rad).
    pub fn from_vertical_fov(width: u32, height: u32, vertical_fov: f64) -> Self {
        let f = f64::from(height) / 2.0 / (vertical_fov / 2.0).tan();
        Self { width, height, fx: f, fy: f, cx: (f64::from(width) - 1.0) / 2.0, cy: (f64::from(height) - 1.0) / 2.0 }
    }

    /// As [`Intrinsics::from_vertical_fov`], from the horizontal field of view in rad.
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

    /// Projects a point of the camera frame (x right, y down, z forward) to a pixel; `None` if it does not lie in front
    /// of the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 1e-9)
            .then(|| DVec2::new(self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy))
    }

    /// Unprojects a pixel to a point of the camera frame; `depth_m` is along the optical axis.
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

    /// Intrinsics after resizing the image, which stretches it if the aspect ratio changes.
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

    /// Intrinsics after scaling the image to fill another size and cropping it centrally, which keeps its aspect ratio,
    /// unlike [`Intrinsics::resized`].
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
