//! Pictures of scenarios and recorded episodes, drawn again without physics: the same as before, or in another look.
//!
//! ```text
//! OUT/ID/CAMERA.mp4              colour of an episode; CAMERA.png of a scenario
//! OUT/ID/CAMERA_depth/000000.png 16-bit millimetres, 0 where nothing is seen; CAMERA_depth.png of a scenario
//! OUT/ID/CAMERA_ids/…            16-bit ids, named in render.json
//! OUT/ID/CAMERA_normals/…        camera frame, 127.5 · (n + 1) in red, green, blue; black where nothing is seen
//! OUT/ID/render.json             cameras with their poses, the look and its seed, what the ids mean
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_core::world::camera_faults;
use genmanip_core::{Camera, CameraSensor, Distortion, Episode, Frame, ImageChannels, Pose, RgbdImage, Seed};
use genmanip_data::images::variation_seed;
use genmanip_data::video::mux_mp4;
use genmanip_data::{VideoEncoder, VideoSettings};
pub use genmanip_render::Vary;
use genmanip_render::reference::ReferenceSettings;
use genmanip_render::{FIRST_OBJECT, ROBOT, RenderVariation, TABLE, encode, sampling};
use genmanip_rollout::Stage;
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::images::{Painter, sensor_seed, usual_variation};
use serde::Serialize;

use crate::error::RunError;
use crate::pictures::not_drawn;
use crate::progress::Progress;
use crate::{inputs, replay};

/// Which pictures are drawn.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Names of cameras; all of them when it is empty.
    pub cameras: Vec<String>,
    /// Pixels per row and rows; each camera's own without.
    pub size_px: Option<[u32; 2]>,
    /// What the pictures hold; points are not written.
    pub channels: ImageChannels,
    /// Pictures per second of an episode; divides its rate.
    pub fps: u32,
    /// The look; the usual one without.
    pub look: Option<Look>,
    /// Sensors of all cameras; each camera's own without.
    pub sensor: Option<CameraSensor>,
    /// Lens of all cameras; each camera's own without.
    pub distortion: Option<Distortion>,
    /// Light paths per pixel of a traced picture; rasterised without.
    pub paths: Option<u32>,
    /// Threads.
    pub workers: usize,
}

/// A look that is drawn by chance.
#[derive(Clone, Debug)]
pub struct Look {
    /// Where the chance comes from.
    pub seed: LookSeed,
    /// What differs from the usual look.
    pub vary: Vec<Vary>,
}

/// The seed of looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LookSeed {
    /// That of `collect --variation per-episode`: it follows from the seed of the episode.
    Episode,
    /// A number; each episode gets a look of its own from it.
    Number(Seed),
}

impl LookSeed {
    fn of(self, id: &str, episode: Seed) -> Seed {
        match self {
            Self::Episode => variation_seed(episode),
            Self::Number(seed) => seed.fork(id),
        }
    }
}

/// What was drawn of one episode or scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rendered {
    /// The episode or scenario.
    pub id: String,
    /// Its folder.
    pub folder: PathBuf,
    /// Pictures of each camera and channel.
    pub frames: usize,
    /// Seed of its look, if it has one of its own.
    pub variation_seed: Option<Seed>,
}

/// `render.json`.
#[derive(Serialize)]
struct Card {
    id: String,
    fps: Option<u32>,
    frames: usize,
    variation_seed: Option<Seed>,
    vary: Vec<Vary>,
    variation: RenderVariation,
    /// Light paths per pixel; null for the rasteriser.
    paths: Option<u32>,
    /// As they stood; one on the hand in the hand's frame.
    cameras: Vec<Camera>,
    /// What the ids of the pictures mean.
    ids: BTreeMap<u16, String>,
}

/// Draws a scenario file, an episode's folder, a store or a run into a folder of its own each, on several threads.
///
/// # Errors
/// When there is nothing to draw, a camera is unknown, the rate does not fit, or a file cannot be written.
pub fn render(
    path: &Path,
    out: &Path,
    options: &RenderOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<Rendered>, RunError> {
    if path.is_file() {
        let stage = inputs::read_stage(path)?;
        return Ok(vec![draw(&stage, None, out, options, options.workers)?]);
    }
    let located = replay::locate(path)?;
    progress.begin("drawing", located.ids.len());
    let rendered = in_parallel(&located.ids, options.workers, stop, &|id| {
        let episode = located.store.read(id).map_err(|error| replay::unreadable(id, error))?;
        let rendered = draw(&replay::stage(&episode)?, Some(&episode), out, options, 1)?;
        progress.advance();
        Ok::<_, RunError>(rendered)
    })?;
    progress.end();
    Ok(rendered)
}

/// Draws a scenario or an episode; `threads` are for traced pictures, others need one.
fn draw(
    stage: &Stage,
    episode: Option<&Episode>,
    out: &Path,
    options: &RenderOptions,
    threads: usize,
) -> Result<Rendered, RunError> {
    let scenario = &stage.scenario;
    let (id, seed) = episode.map_or((&scenario.id, scenario.seed), |it| (&it.result.id, it.result.seed));
    let folder = out.join(id);
    let look = options.look.as_ref().map(|look| (look.seed.of(id, seed), &look.vary[..]));
    let usual = usual_variation(stage);
    let variation = look.map_or_else(
        || usual.clone(),
        |(seed, vary)| sampling::varied(&usual, &genmanip_core::Look::new(seed, vary.to_vec())),
    );
    let cameras = cameras(stage, options)?.into_iter().map(|camera| match look {
        Some((seed, vary)) => sampling::moved(&camera, seed, vary),
        None => camera,
    });
    let cameras: Vec<Camera> = cameras.collect();
    let broken = |error| not_drawn(id, error);
    let reference = options.paths.map(|paths| ReferenceSettings { paths, seed: seed.fork("light paths"), threads });
    let mut painter = Painter::in_variation(stage, variation.clone()).map_err(broken)?.tracing(reference);
    let frames = episode.map(|episode| chosen(episode, options.fps)).transpose()?;
    let count = frames.as_ref().map_or(1, Vec::len);
    let mut writers = cameras
        .iter()
        .map(|camera| Writer::new(&folder, camera, options, frames.is_some()))
        .collect::<Result<Vec<_>, _>>()?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, options.channels)).collect();
    for index in 0..count {
        let frame = frames.as_ref().map(|frames| frames[index]);
        let (arm, width, objects) = moment(stage, frame.map(|(_, frame)| frame));
        let noise = sensor_seed(seed, frame.map_or(0, |(number, _)| number));
        let placed = objects.iter().map(|(pose, joints)| (*pose, joints.as_slice()));
        let images = painter.paint_state(&arm, width, placed, &views, noise).map_err(broken)?;
        for (writer, image) in writers.iter_mut().zip(&images) {
            writer.push(index, image)?;
        }
    }
    writers.into_iter().try_for_each(Writer::finish)?;
    let mut ids = BTreeMap::from([(TABLE, "table".to_owned()), (ROBOT, "robot".to_owned())]);
    ids.extend(scenario.objects.iter().zip(FIRST_OBJECT..).map(|(placed, number)| (number, placed.id.clone())));
    let variation_seed = look.map(|(seed, _)| seed);
    let vary = look.map_or_else(Vec::new, |(_, vary)| vary.to_vec());
    let fps = episode.map(|_| options.fps);
    let card = Card {
        id: id.clone(),
        fps,
        frames: count,
        variation_seed,
        vary,
        variation,
        paths: options.paths,
        cameras,
        ids,
    };
    let text = serde_json::to_string_pretty(&card).map_err(|error| RunError::broken("cannot write render.json", error));
    inputs::write_file(&folder.join("render.json"), text?.as_bytes())?;
    Ok(Rendered { id: id.clone(), folder, frames: count, variation_seed })
}

/// The cameras that are asked for, at the size that is asked for.
fn cameras(stage: &Stage, options: &RenderOptions) -> Result<Vec<Camera>, RunError> {
    let known = &stage.scenario.world.cameras;
    let names: Vec<&str> = known.iter().map(|camera| camera.name.as_str()).collect();
    if let Some(unknown) = options.cameras.iter().find(|name| !names.contains(&name.as_str())) {
        return Err(RunError::unknown("camera", "cameras", unknown, &names));
    }
    let asked = |camera: &&Camera| options.cameras.is_empty() || options.cameras.contains(&camera.name);
    let sized = |camera: &Camera| {
        let [width, height] = options.size_px.unwrap_or([camera.intrinsics.width, camera.intrinsics.height]);
        Camera {
            intrinsics: camera.intrinsics.filling(width, height),
            sensor: options.sensor.or(camera.sensor),
            distortion: options.distortion.or(camera.distortion),
            ..camera.clone()
        }
    };
    let cameras: Vec<Camera> = known.iter().filter(asked).map(sized).collect();
    match &camera_faults(&cameras)[..] {
        [] => Ok(cameras),
        [fault, ..] => Err(RunError::input(format!("scenario {}: {fault}", stage.scenario.id))),
    }
}

/// The frames of an episode that are drawn with their numbers, as `collect` chooses them.
fn chosen(episode: &Episode, fps: u32) -> Result<Vec<(usize, &Frame)>, RunError> {
    let rate = episode.result.control_rate_hz;
    let stride = rate / f64::from(fps);
    if stride < 1.0 || (stride - stride.round()).abs() > 1e-9 {
        return Err(RunError::input(format!("--fps {fps} does not divide the rate of {}", episode.result.id))
            .with_hint(format!("expected a divisor of {rate} Hz, e.g. 15 or 30")));
    }
    Ok(episode.frames.iter().enumerate().step_by(stride.round() as usize).collect())
}

/// Pose and joint positions of an object.
type Posed = (Pose, Vec<f64>);

/// Joint positions of the arm, opening, and the objects: at a frame, or before anything moves.
fn moment(stage: &Stage, frame: Option<&Frame>) -> (Vec<f64>, f64, Vec<Posed>) {
    match frame {
        Some(frame) => {
            let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.clone()));
            (frame.joint_position.clone(), frame.gripper_width, objects.collect())
        }
        None => {
            let objects = stage.scenario.objects.iter().map(|placed| (placed.pose, placed.joint_positions.clone()));
            (stage.robot.home.clone(), stage.robot.gripper.max_width, objects.collect())
        }
    }
}

/// The files of one camera.
struct Writer {
    /// Without an ending.
    stem: PathBuf,
    film: Option<VideoEncoder>,
    is_film: bool,
}

impl Writer {
    fn new(folder: &Path, camera: &Camera, options: &RenderOptions, is_film: bool) -> Result<Self, RunError> {
        let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
        if is_film && options.channels.rgb && (width % 2 != 0 || height % 2 != 0) {
            return Err(RunError::input(format!("camera {} has {width}x{height} pixels", camera.name))
                .with_hint("films need even sides; choose another --size"));
        }
        let film = (is_film && options.channels.rgb)
            .then(|| VideoEncoder::new(width, height, options.fps, &VideoSettings::default()))
            .transpose();
        let film = film.map_err(|error| RunError::broken("cannot encode the film", error))?;
        Ok(Self { stem: folder.join(&camera.name), film, is_film })
    }

    fn push(&mut self, index: usize, image: &RgbdImage) -> Result<(), RunError> {
        let unencoded = |error: encode::EncodeError| RunError::broken("cannot encode a picture", error);
        let (width, height) = (image.width(), image.height());
        if let Some(film) = &mut self.film {
            film.push(&image.rgb).map_err(|error| RunError::broken("cannot encode the film", error))?;
        } else if !image.rgb.is_empty() {
            let png = encode::png_rgb(width, height, &image.rgb).map_err(unencoded)?;
            inputs::write_file(&self.stem.with_extension("png"), &png)?;
        }
        if !image.depth_m.is_empty() {
            self.write("depth", index, &encode::png_depth_mm(width, height, &image.depth_m).map_err(unencoded)?)?;
        }
        if !image.ids.is_empty() {
            self.write("ids", index, &encode::png_u16(width, height, &image.ids).map_err(unencoded)?)?;
        }
        if !image.normals.is_empty() {
            let color = |normal: &[i8; 3]| match normal {
                [0, 0, 0] => [0; 3],
                normal => normal.map(|axis| (f32::from(axis) / 127.0 * 127.5 + 127.5).round() as u8),
            };
            let rgb: Vec<u8> = image.normals.iter().flat_map(color).collect();
            self.write("normals", index, &encode::png_rgb(width, height, &rgb).map_err(unencoded)?)?;
        }
        Ok(())
    }

    fn write(&self, channel: &str, index: usize, png: &[u8]) -> Result<(), RunError> {
        let name = format!("{}_{channel}", self.stem.file_name().unwrap_or_default().to_string_lossy());
        let place = self.stem.with_file_name(name);
        let file = if self.is_film { place.join(format!("{index:06}.png")) } else { place.with_extension("png") };
        inputs::write_file(&file, png)
    }

    fn finish(self) -> Result<(), RunError> {
        let Some(film) = self.film else { return Ok(()) };
        let mp4 = mux_mp4([&film.finish()]).map_err(|error| RunError::broken("cannot encode the film", error))?;
        inputs::write_file(&self.stem.with_extension("mp4"), &mp4)
    }
}

/// What was drawn, as a table.
pub fn table(rendered: &[Rendered]) -> String {
    let mut lines = vec![["drawn", "frames", "variation", "folder"].map(String::from).to_vec()];
    for Rendered { id, folder, frames, variation_seed } in rendered {
        let seed = variation_seed.map_or_else(String::new, |seed| seed.to_string());
        lines.push(vec![id.clone(), frames.to_string(), seed, folder.display().to_string()]);
    }
    genmanip_bench::text_table(&lines)
}
