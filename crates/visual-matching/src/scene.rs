//! Scene of a photograph: which light falls on its table under a candidate light.

use std::sync::Arc;

use genmanip_core::{Camera, Intrinsics};
use genmanip_render::{
    Channels, FrameBuffers, FrameState, LinearPhotograph, RenderAssets, RenderError, RenderVariation, Renderer,
    Response, TABLE, ViewJob, color::linear_from_srgb8, sensor,
};
use glam::Vec3A;

use crate::error::MatchError;

/// Base colour of the table in these images: that of a light table, which matters in corners only.
const BASE: f32 = 0.5;
/// Exposure at which unshadowed table does not reach white.
const EXPOSURE: f64 = 1.7;
/// Largest distance of a point from the plane of the table that counts as its top, m.
const ON_TOP_M: f64 = 0.01;

/// A candidate key light: unit direction towards it, world frame, and its angular radius, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyLight {
    /// Unit direction from the scene towards the light.
    pub direction: glam::DVec3,
    /// Angular radius, rad.
    pub radius_rad: f64,
}

/// A scene seen by a camera, at the resolution of the fit.
pub struct SeenScene {
    assets: Arc<RenderAssets>,
    frame: FrameState,
    camera: Camera,
    /// True for pixels of the table's top that is not next to anything else.
    pub is_table: Vec<bool>,
}

/// Shares of key light and of ambient light that reach the table, by pixel, relative to a table in the open.
pub struct Shares {
    /// Share of the key light.
    pub key: Vec<f32>,
    /// Share of the ambient light.
    pub ambient: Vec<f32>,
}

impl SeenScene {
    /// Scene of posed assets seen by a camera.
    ///
    /// # Errors
    /// When the camera cannot be rendered.
    pub fn new(assets: &Arc<RenderAssets>, frame: FrameState, camera: &Camera) -> Result<Self, MatchError> {
        let mut renderer = Renderer::new(Arc::clone(assets), RenderVariation::default());
        let geometry = pictured(&mut renderer, &frame, camera, Channels::GEOMETRY)?;
        let is_table = table_top(&geometry, camera, &assets.world_from_hand(&frame));
        Ok(Self { assets: Arc::clone(assets), frame, camera: camera.clone(), is_table })
    }

    /// Light on the table under a key light; values elsewhere mean nothing.
    ///
    /// # Errors
    /// When the camera cannot be rendered.
    pub fn shares(&self, light: &KeyLight) -> Result<Shares, MatchError> {
        let facing = light.direction.z.max(0.05) as f32;
        Ok(Shares { key: self.lit(light, 1.0 / facing, 0.0)?, ambient: self.lit(light, 0.0, 1.0)? })
    }

    fn lit(&self, light: &KeyLight, key: f32, ambient: f32) -> Result<Vec<f32>, MatchError> {
        let response = genmanip_core::CameraResponse { exposure: EXPOSURE, ..Default::default() };
        let response = Response::new(&response).map(Arc::new);
        let count = self.camera.intrinsics.width as usize * self.camera.intrinsics.height as usize;
        // A photograph of constant brightness makes the table matt and of one colour.
        let fixed = Camera { mount: genmanip_core::CameraMount::World, ..self.camera.clone() };
        let even = LinearPhotograph::new(&fixed, vec![Vec3A::splat(BASE); count]).map(Arc::new);
        let looks = response.map(|response| genmanip_render::CameraLook {
            camera: self.camera.name.clone(),
            response,
            photograph: even,
        });
        let variation = RenderVariation {
            light_direction: light.direction.as_vec3().to_array(),
            light_color: [1.0; 3],
            light_intensity: key,
            light_angular_radius: light.radius_rad as f32,
            sky_color: [1.0; 3],
            ground_color: [1.0; 3],
            ambient_intensity: ambient,
            exposure: 1.0,
            looks: looks.into_iter().collect(),
            ..RenderVariation::default()
        };
        let mut renderer = Renderer::new(Arc::clone(&self.assets), variation);
        let image = pictured(&mut renderer, &self.frame, &self.camera, Channels::RGB)?;
        let full = BASE * EXPOSURE as f32;
        Ok(image.rgb.chunks_exact(3).map(|rgb| linear_from_srgb8([rgb[0], rgb[1], rgb[2]]).y / full).collect())
    }
}

/// Image of a camera through its lens, without noise.
///
/// # Errors
/// When the camera cannot be rendered.
pub fn pictured(
    renderer: &mut Renderer,
    frame: &FrameState,
    camera: &Camera,
    channels: Channels,
) -> Result<FrameBuffers, MatchError> {
    let drawn = |error: RenderError| MatchError::NotDrawn { camera: camera.name.clone(), source: error };
    let pinhole = sensor::pinhole(camera).map_err(drawn)?;
    let mut out = [FrameBuffers::default()];
    renderer.render(&[ViewJob::new(frame, &pinhole, channels)], &mut out).map_err(drawn)?;
    let [image] = out;
    sensor::through_lens(camera, image).map_err(drawn)
}

/// The camera with an image that is smaller by a whole factor; remaining rows and columns are cut off.
pub fn reduced(camera: &Camera, factor: u32) -> Camera {
    let Intrinsics { width, height, fx, fy, cx, cy } = camera.intrinsics;
    let share = f64::from(factor);
    let intrinsics = Intrinsics {
        width: (width / factor).max(1),
        height: (height / factor).max(1),
        fx: fx / share,
        fy: fy / share,
        cx: (cx + 0.5) / share - 0.5,
        cy: (cy + 0.5) / share - 0.5,
    };
    Camera { intrinsics, ..camera.clone() }
}

/// Means over blocks of an image, for the camera [`reduced`] by the same factor.
pub fn block_means(values: &[Vec3A], width: u32, factor: u32) -> Vec<Vec3A> {
    let (width, factor) = (width as usize, factor as usize);
    let (columns, rows) = (width / factor, values.len() / width / factor);
    let mean = |index: usize| {
        let (column, row) = (index % columns * factor, index / columns * factor);
        let block = (0..factor * factor).map(|at| values[(row + at / factor) * width + column + at % factor]);
        block.sum::<Vec3A>() / (factor * factor) as f32
    };
    (0..columns * rows).map(mean).collect()
}

/// Pixels that show the table's top, without those next to anything else.
fn table_top(geometry: &FrameBuffers, camera: &Camera, world_from_hand: &genmanip_core::Pose) -> Vec<bool> {
    let projection = genmanip_core::Projection::of(camera, world_from_hand);
    let (width, height) = (geometry.width as usize, geometry.height as usize);
    let shows = |column: usize, row: usize| {
        let at = row * width + column;
        let pixel = glam::DVec2::new(column as f64, row as f64);
        geometry.instance[at] == TABLE
            && projection.point(pixel, f64::from(geometry.depth_m[at])).is_some_and(|point| point.z.abs() < ON_TOP_M)
    };
    let alone: Vec<bool> = (0..width * height).map(|at| shows(at % width, at / width)).collect();
    let inner = |at: usize| {
        let (column, row) = (at % width, at / width);
        column > 0
            && row > 0
            && column + 1 < width
            && row + 1 < height
            && (row - 1..=row + 1).all(|row| (column - 1..=column + 1).all(|column| alone[row * width + column]))
    };
    (0..width * height).map(inner).collect()
}
