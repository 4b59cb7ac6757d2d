//! Photographs as scene-linear images that world points are looked up in.

use base64::Engine;
use genmanip_core::{Camera, CameraMount, Intrinsics, Projection};
use glam::{DVec3, Vec2, Vec3A};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Scene-linear image of the empty workspace by a fixed camera.
#[derive(Debug)]
pub struct LinearPhotograph {
    projection: Projection,
    /// Radiance by pixel, row by row.
    radiance: Vec<Vec3A>,
}

impl LinearPhotograph {
    /// Photograph of a fixed camera from the radiance of its pixels; `None` for another number of pixels or a camera
    /// that is not fixed.
    pub fn new(camera: &Camera, radiance: Vec<Vec3A>) -> Option<Self> {
        let Intrinsics { width, height, .. } = camera.intrinsics;
        let fits = radiance.len() == width as usize * height as usize && camera.mount == CameraMount::World;
        let projection = Projection::of(camera, &genmanip_core::Pose::IDENTITY);
        fits.then_some(Self { projection, radiance })
    }

    /// Radiance at a world point (m), as it is seen when the workspace is empty; `None` outside the image.
    pub fn at(&self, point: Vec3A) -> Option<Vec3A> {
        let ray = self.projection.to_camera(point.as_dvec3());
        self.along(ray)
    }

    /// Radiance along a ray in camera axes, of any length; `None` outside the image.
    pub fn along(&self, ray: DVec3) -> Option<Vec3A> {
        let pixel = match self.projection.distortion {
            // Saves the check of the inverse, which an undistorted image does not need.
            None => (ray.z > 1e-9).then(|| self.projection.intrinsics.project(ray))??,
            Some(_) => self.projection.pixel_of_ray(ray)?,
        };
        self.projection.is_in_image(pixel).then(|| self.sample(pixel.as_vec2()))
    }

    /// True if the photograph is the given camera's, whatever its image size, lens and name.
    pub fn is_of(&self, camera: &Camera) -> bool {
        camera.mount == CameraMount::World && camera.mount_from_camera == self.projection.world_from_camera
    }

    /// Bilinear interpolation at a pixel position; the border pixel is repeated.
    fn sample(&self, place: Vec2) -> Vec3A {
        let Intrinsics { width, height, .. } = self.projection.intrinsics;
        let last = Vec2::new((width - 1) as f32, (height - 1) as f32);
        let place = place.clamp(Vec2::ZERO, last);
        let low = place.floor();
        let share = place - low;
        let next = (low + 1.0).min(last);
        let at = |x: f32, y: f32| self.radiance[y as usize * width as usize + x as usize];
        let top = at(low.x, low.y).lerp(at(next.x, low.y), share.x);
        let bottom = at(low.x, next.y).lerp(at(next.x, next.y), share.x);
        top.lerp(bottom, share.y)
    }
}

/// 8-bit RGB and size (width, height) of the base64 of a JPEG file.
///
/// # Errors
/// For text that is no base64, bytes that are no JPEG, and images above 8192 pixels a side.
pub fn decoded(base64_jpeg: &str) -> Result<(Vec<u8>, [u32; 2]), String> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(base64_jpeg);
    let bytes = bytes.map_err(|error| format!("its photograph is no base64: {error}"))?;
    let options =
        DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB).set_max_width(8192).set_max_height(8192);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes), options);
    let rgb = decoder.decode().map_err(|error| format!("its photograph is no JPEG: {error}"))?;
    let (width, height) = decoder.dimensions().ok_or("its photograph has no size")?;
    match rgb.len() == width * height * 3 {
        true => Ok((rgb, [width as u32, height as u32])),
        false => Err("its photograph has another number of pixels than its size says".into()),
    }
}
