//! Images of an arm motion: the whole motion in one image, or as a video.

use std::path::Path;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, ImageChannels, Intrinsics, Pose, RgbdImage};
use genmanip_data::video::mux_mp4;
use genmanip_data::{VideoEncoder, VideoSettings};
use genmanip_render::ROBOT;
use genmanip_rollout::Stage;
use genmanip_rollout::images::{Exposure, StageRenderer};

use crate::scene_images;
use genmanip_workspace::WorkspaceError;

/// Width of images and videos, pixels.
const WIDTH: u32 = 960;
/// Number of configurations of the arm in one image. Chosen by hand.
const POSTURES: usize = 6;
/// Opacity of earlier configurations, 0-1.
const GHOST: f32 = 0.4;
/// Frame rate of videos, Hz.
const FPS: u32 = 30;
/// Colour of the gripper's path, 8-bit sRGB.
const WAY: [u8; 3] = [235, 90, 20];
/// Colour of a configuration in collision, 8-bit sRGB.
const BLOCKED: [u8; 3] = [215, 25, 40];

/// Motion to be rendered.
pub struct MotionView<'a> {
    /// Scenario with objects and robot.
    pub stage: &'a Stage,
    /// Trajectory of the arm: joint positions at the control rate, rad.
    pub configs: &'a [Vec<f64>],
    /// Position of the tool centre point (TCP) at each configuration, world frame, metres.
    pub tcp: Vec<DVec3>,
    /// Opening width of the gripper, metres.
    pub gripper_width: f64,
    /// Goal configuration if it is in collision, drawn in red; `None` otherwise.
    pub blocked: Option<&'a [f64]>,
}

/// Image of the arm at several moments, all but the last one transparent, with the path of the TCP. PNG or JPEG by the
/// extension of `path`; `camera` names one of the world's cameras, `None` for a view of the whole workspace.
pub fn picture(drawn: &MotionView, path: &Path, camera: Option<&str>) -> Result<Vec<u8>, WorkspaceError> {
    let as_jpeg = match path.extension().and_then(|ending| ending.to_str()) {
        Some("png") => false,
        Some("jpg" | "jpeg") => true,
        _ => return Err(ending(path, "a picture is written as .png or .jpg")),
    };
    let mut view = View::new(drawn, camera)?;
    let last = drawn.configs.len().saturating_sub(1);
    let at = |index: usize| &drawn.configs[last * index / (POSTURES - 1)];
    let mut canvas = view.render(at(POSTURES - 1))?;
    if last > 0 {
        for index in 0..POSTURES - 1 {
            let ghost = view.render(at(index))?;
            blend(&mut canvas, &ghost, None);
        }
    }
    if let Some(blocked) = drawn.blocked {
        let ghost = view.render(blocked)?;
        blend(&mut canvas, &ghost, Some(BLOCKED));
    }
    view.draw_way(&mut canvas, &drawn.tcp);
    let (width, height) = (canvas.width(), canvas.height());
    let encoded = match as_jpeg {
        true => genmanip_render::encode::jpeg_rgb(width, height, &canvas.rgb, 90),
        false => genmanip_render::encode::png_rgb(width, height, &canvas.rgb),
    };
    encoded.map_err(|error| WorkspaceError::broken("cannot encode the picture", error))
}

/// Video of the motion in real time as MP4, with the path of the TCP up to each moment. `camera` as in [`picture`].
pub fn animation(drawn: &MotionView, path: &Path, camera: Option<&str>) -> Result<Vec<u8>, WorkspaceError> {
    if path.extension().is_none_or(|ending| ending != "mp4") {
        return Err(ending(path, "an animation is written as .mp4"));
    }
    let failed = |error| WorkspaceError::broken("cannot encode the animation", error);
    let mut view = View::new(drawn, camera)?;
    let (width, height) = (view.camera.intrinsics.width, view.camera.intrinsics.height);
    let mut encoder = VideoEncoder::new(width, height, FPS, &VideoSettings::default()).map_err(failed)?;
    let stride = (drawn.stage.control_rate_hz() / f64::from(FPS)).round().max(1.0) as usize;
    let last = drawn.configs.len().saturating_sub(1);
    // The last configuration is shown for another half second.
    let shown = (0..=last).step_by(stride).chain(std::iter::repeat_n(last, FPS as usize / 2));
    for index in shown {
        let mut canvas = view.render(&drawn.configs[index])?;
        view.draw_way(&mut canvas, &drawn.tcp[..=index]);
        encoder.push(&canvas.rgb).map_err(failed)?;
    }
    mux_mp4([&encoder.finish()]).map_err(failed)
}

fn ending(path: &Path, expected: &str) -> WorkspaceError {
    WorkspaceError::input(format!("cannot write {}", path.display())).with_hint(expected)
}

/// Renderer of the motion through one camera.
struct View<'a> {
    drawn: &'a MotionView<'a>,
    painter: StageRenderer,
    camera: Camera,
}

impl<'a> View<'a> {
    fn new(drawn: &'a MotionView, camera: Option<&str>) -> Result<Self, WorkspaceError> {
        let whole = Camera::looking_at(
            "whole",
            DVec3::new(1.75, 1.3, 1.15),
            DVec3::new(0.31, 0.0, 0.24),
            Intrinsics::from_vertical_fov(WIDTH, WIDTH * 9 / 16, 34_f64.to_radians()),
        );
        let cameras = &drawn.stage.scenario.world.cameras;
        let find = |name| cameras.iter().find(|known| known.name == name);
        let Some(camera) = camera.map_or(Some(&whole), find) else {
            let known: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
            return Err(WorkspaceError::input(format!("scenario {} has no such camera", drawn.stage.scenario.id))
                .with_hint(format!("its cameras are {}", known.join(", "))));
        };
        let Camera { intrinsics, .. } = camera;
        // The video encoder requires an even height.
        let height = (WIDTH * intrinsics.height / intrinsics.width) & !1;
        let camera = Camera { intrinsics: intrinsics.resized(WIDTH, height), ..camera.clone() };
        let stage = drawn.stage;
        let painter = StageRenderer::new(stage).map_err(|error| scene_images::not_drawn(&stage.scenario.id, error))?;
        Ok(Self { drawn, painter, camera })
    }

    fn render(&mut self, config: &[f64]) -> Result<RgbdImage, WorkspaceError> {
        let placed = &self.drawn.stage.scenario.objects;
        let objects = placed.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let views = [(&self.camera, ImageChannels { ids: true, ..ImageChannels::RGB })];
        let still = Exposure::still(self.drawn.stage.scenario.seed);
        let images = self.painter.render_state(config, self.drawn.gripper_width, objects, &views, still);
        let mut images = images.map_err(|error| WorkspaceError::broken("cannot draw the arm", error))?;
        Ok(images.swap_remove(0))
    }

    /// Draws a line through points in the world frame, without regard to occlusion.
    fn draw_way(&self, canvas: &mut RgbdImage, points: &[DVec3]) {
        let camera_from_world = self.camera.world_from_camera(&Pose::IDENTITY).inverse();
        let pixel = |point: &DVec3| self.camera.intrinsics.project(camera_from_world.transform_point(*point));
        for pair in points.windows(2) {
            let Some((from, to)) = pixel(&pair[0]).zip(pixel(&pair[1])) else { continue };
            let steps = (to - from).abs().max_element().ceil().clamp(1.0, 2.0 * f64::from(WIDTH)) as usize;
            (0..=steps).for_each(|step| dot(canvas, from.lerp(to, step as f64 / steps as f64)));
        }
    }
}

/// Blends the robot of another image into this one with the opacity [`GHOST`], in its own colours or tinted.
fn blend(canvas: &mut RgbdImage, ghost: &RgbdImage, tint: Option<[u8; 3]>) {
    let pixels = canvas.rgb.chunks_exact_mut(3).zip(ghost.rgb.chunks_exact(3)).zip(&ghost.ids);
    for ((pixel, other), _) in pixels.filter(|(_, id)| **id == ROBOT) {
        for (channel, (value, other)) in pixel.iter_mut().zip(other).enumerate() {
            let other = tint.map_or(*other, |tint| (*other / 2).saturating_add(tint[channel] / 2));
            *value = (f32::from(*value) * (1.0 - GHOST) + f32::from(other) * GHOST).round() as u8;
        }
    }
}

/// Draws a dot three pixels wide.
fn dot(canvas: &mut RgbdImage, at: DVec2) {
    let (width, height) = (i64::from(canvas.width()), i64::from(canvas.height()));
    let (x, y) = (at.x.round() as i64, at.y.round() as i64);
    for (x, y) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))) {
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let start = 3 * (y * width + x) as usize;
            canvas.rgb[start..start + 3].copy_from_slice(&WAY);
        }
    }
}
