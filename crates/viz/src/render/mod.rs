//! Images of scenarios and recorded episodes without physics, in the original or a randomised appearance.
//!
//! ```text
//! OUT/ID/CAMERA.mp4              colour of an episode; CAMERA.png of a scenario
//! OUT/ID/CAMERA_depth/000000.png 16-bit millimetres, 0 for the background; CAMERA_depth.png of a scenario
//! OUT/ID/CAMERA_ids/…            16-bit ids, named in render.json
//! OUT/ID/CAMERA_normals/…        camera frame, 127.5 · (n + 1) in red, green, blue; black for the background
//! OUT/ID/labels.jsonl            boxes: a line per image and camera, see docs/formats/labels.md
//! OUT/ID/CAMERA_clouds/000000/OBJECT.ply   points of each object; CAMERA_clouds/OBJECT.ply of a scenario
//! OUT/ID/turntable.mp4           once around a scenario; turntable.png its first image
//! OUT/ID/render.json             cameras with their poses, appearance and its seed, names of the ids
//! ```

mod files;
mod labels;
mod moment;
mod options;
mod overlay;
mod turntable;

use genmanip_workspace::documents;
use genmanip_workspace::{scenarios, worlds};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_core::world::camera_faults;
use genmanip_core::{Camera, Episode, Frame, ImageChannels, Seed};
pub use genmanip_render::AppearanceFactor;
use genmanip_render::{FIRST_OBJECT, ROBOT, RenderVariation, TABLE, sampling};
use genmanip_rollout::Stage;
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::images::{Exposure, StageRenderer, sensor_seed, usual_variation};
use serde::Serialize;

use self::files::Writer;
use self::labels::Labels;
use self::moment::Moment;
use self::options::reference;
pub use self::options::{AppearanceOptions, AppearanceSeed, RenderOptions};
pub use self::overlay::Overlay;
use self::overlay::Overlays;
use crate::replay;
use crate::scene_images::not_drawn;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;

/// Summary of the images rendered of one episode or scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rendered {
    /// Id of the episode or scenario.
    pub id: String,
    /// Folder that contains the images.
    pub folder: PathBuf,
    /// Number of images per camera and channel.
    pub frames: usize,
    /// Seed of the randomised appearance; `None` for the default one.
    pub variation_seed: Option<Seed>,
}

/// Contents of `render.json`.
#[derive(Serialize)]
struct Card {
    id: String,
    fps: Option<u32>,
    frames: usize,
    variation_seed: Option<Seed>,
    vary: Vec<AppearanceFactor>,
    variation: RenderVariation,
    /// Light paths per pixel; null for the rasteriser.
    paths: Option<u32>,
    /// Names of the overlays on the colour images.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    overlays: Vec<&'static str>,
    /// Cameras with their poses: in the world, or in the hand's frame for a wrist camera. Of a turntable, one camera
    /// per image.
    cameras: Vec<Camera>,
    /// Name of the table, the robot or an object for each id in the id images.
    ids: BTreeMap<u16, String>,
}

/// Renders a scenario file, an episode's folder, a store or a run on several threads; each scenario or episode gets a
/// folder of its own.
///
/// # Errors
/// When there is nothing to render, a camera is unknown, the frame rate does not divide that of an episode, or a file
/// cannot be written.
pub fn render(
    path: &Path,
    out: &Path,
    options: &RenderOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<Rendered>, WorkspaceError> {
    check_combination(options)?;
    if path.is_file() {
        let stage = scenarios::read_stage(path)?;
        return Ok(vec![draw(&stage, None, out, options, options.workers)?]);
    }
    if options.turntable.is_some() {
        return Err(WorkspaceError::input(format!(
            "--turntable of {}: expected the file of a scenario",
            path.display()
        ))
        .with_hint("a turn shows things at rest; the scenario of an episode is in the `scenarios` of its run"));
    }
    let located = replay::locate(path)?;
    progress.begin("drawing", located.ids.len());
    let rendered = in_parallel(&located.ids, options.workers, stop, &|id| {
        let episode = located.store.read(id).map_err(|error| replay::unreadable(id, error))?;
        let rendered = draw(&replay::stage(&episode)?, Some(&episode), out, options, 1)?;
        progress.advance();
        Ok::<_, WorkspaceError>(rendered)
    })?;
    progress.end();
    Ok(rendered)
}

/// Renders a scenario or an episode; `threads` are used by the path tracer, the rasteriser needs one.
fn draw(
    stage: &Stage,
    episode: Option<&Episode>,
    out: &Path,
    options: &RenderOptions,
    threads: usize,
) -> Result<Rendered, WorkspaceError> {
    let scenario = &stage.scenario;
    worlds::check_robot(&scenario.world, options.robot.as_deref())?;
    let (id, seed) = episode.map_or((&scenario.id, scenario.seed), |it| (&it.result.id, it.result.seed));
    let folder = out.join(id);
    let look = options.look.as_ref().map(|look| (look.seed.of(id, seed), &look.vary[..]));
    let usual = usual_variation(stage).map_err(|error| not_drawn(id, error))?;
    let variation = look.map_or_else(
        || usual.clone(),
        |(seed, vary)| sampling::varied(&usual, &genmanip_core::AppearanceRandomisation::new(seed, vary.to_vec())),
    );
    let (count, cameras) = match options.turntable {
        Some(count) => (count as usize, turntable::draw(stage, count, &folder, variation.clone(), options, threads)?),
        None => {
            let cameras = cameras(stage, options)?.into_iter().map(|camera| match look {
                Some((seed, vary)) => sampling::moved(&camera, seed, vary),
                None => camera,
            });
            let cameras: Vec<Camera> = cameras.collect();
            let of = Source { stage, episode, id, seed };
            (of.draw(&folder, &cameras, variation.clone(), options, threads)?, cameras)
        }
    };
    let mut ids = BTreeMap::from([(TABLE, "table".to_owned()), (ROBOT, "robot".to_owned())]);
    ids.extend(scenario.objects.iter().zip(FIRST_OBJECT..).map(|(placed, number)| (number, placed.id.to_string())));
    let variation_seed = look.map(|(seed, _)| seed);
    let vary = look.map_or_else(Vec::new, |(_, vary)| vary.to_vec());
    let has_rate = episode.is_some() || options.turntable.is_some();
    let card = Card {
        id: id.clone(),
        fps: has_rate.then_some(options.fps),
        frames: count,
        variation_seed,
        vary,
        variation,
        paths: options.paths,
        overlays: options.overlays.iter().map(|overlay| overlay.name()).collect(),
        cameras,
        ids,
    };
    let text =
        serde_json::to_string_pretty(&card).map_err(|error| WorkspaceError::broken("cannot write render.json", error));
    documents::write_file(&folder.join("render.json"), text?.as_bytes())?;
    Ok(Rendered { id: id.clone(), folder, frames: count, variation_seed })
}

/// Scenario or episode to be rendered through the cameras of its world.
struct Source<'a> {
    stage: &'a Stage,
    episode: Option<&'a Episode>,
    id: &'a str,
    seed: Seed,
}

impl Source<'_> {
    /// Renders all moments into a folder; returns the number of images per camera and channel.
    fn draw(
        &self,
        folder: &Path,
        cameras: &[Camera],
        variation: RenderVariation,
        options: &RenderOptions,
        threads: usize,
    ) -> Result<usize, WorkspaceError> {
        let Self { stage, episode, id, seed } = *self;
        let broken = |error| not_drawn(id, error);
        let painter = StageRenderer::with_appearance(stage, variation).map_err(broken)?;
        let mut painter = painter.tracing(reference(seed, options, threads));
        let frames = episode.map(|episode| chosen(episode, options.fps)).transpose()?;
        let mut overlays = Overlays::new(stage, episode, &options.overlays, options.captions)?;
        let fps = episode.map(|_| options.fps);
        let mut writers = cameras
            .iter()
            .map(|camera| Writer::new(folder, camera, options.channels, fps))
            .collect::<Result<Vec<_>, _>>()?;
        let mut labels = Labels::new(stage, folder, options.boxes, options.clouds, episode.is_some())?;
        let channels = overlays.channels(needed(options));
        let views: Vec<_> = cameras.iter().map(|camera| (camera, channels)).collect();
        let count = frames.as_ref().map_or(1, Vec::len);
        for index in 0..count {
            let moment = frames.as_ref().map_or_else(
                || Moment::start(stage, index),
                |frames| Moment::recorded(frames[index].1, index, frames[index].0),
            );
            let step = moment.control_step;
            let still = || Exposure::still(sensor_seed(seed, step));
            let exposure = episode.map_or_else(still, |episode| Exposure::of(episode, step));
            let drawn = painter.render_state(&moment.arm, moment.width, moment.placed(), &views, exposure);
            let mut images = drawn.map_err(broken)?;
            labels.push(&mut painter, &moment, cameras, &images)?;
            overlays.draw(&moment, cameras, &mut images)?;
            for (writer, image) in writers.iter_mut().zip(&images) {
                writer.push(index, image)?;
            }
        }
        writers.into_iter().try_for_each(Writer::finish)?;
        labels.finish()?;
        Ok(count)
    }
}

/// Rejects combinations of options that are meaningless for every scenario and episode.
fn check_combination(options: &RenderOptions) -> Result<(), WorkspaceError> {
    let RenderOptions { channels, overlays, captions, turntable, .. } = options;
    let other = channels.depth || channels.ids || channels.normals || options.boxes || options.clouds;
    let refuse = |what: &str, hint: &str| Err(WorkspaceError::input(what).with_hint(hint));
    if !channels.rgb && (!overlays.is_empty() || *captions) {
        return refuse("--overlay and --captions draw over colours, which are not asked for", "add rgb to --channels");
    }
    if turntable.is_some() && other {
        return refuse("--turntable makes a film of colours alone", "leave --channels out; cameras have the others");
    }
    if turntable.is_some() && !options.cameras.is_empty() {
        return refuse("--turntable has a camera of its own", "leave --cameras out");
    }
    Ok(())
}

/// Channels that must be rendered for the requested outputs.
fn needed(options: &RenderOptions) -> ImageChannels {
    let asked = options.channels;
    let (boxes, clouds) = (options.boxes, options.clouds);
    ImageChannels { depth: asked.depth || clouds, ids: asked.ids || boxes || clouds, ..asked }
}

/// Requested cameras at the requested size, with the requested sensors and lens.
fn cameras(stage: &Stage, options: &RenderOptions) -> Result<Vec<Camera>, WorkspaceError> {
    let known = &stage.scenario.world.cameras;
    let names: Vec<&str> = known.iter().map(|camera| camera.name.as_str()).collect();
    if let Some(unknown) = options.cameras.iter().find(|name| !names.contains(&name.as_str())) {
        return Err(WorkspaceError::unknown("camera", "cameras", unknown, &names));
    }
    let asked = |camera: &&Camera| options.cameras.is_empty() || options.cameras.contains(&camera.name);
    let sized = |camera: &Camera| {
        let [width, height] = options.size_px.unwrap_or([camera.intrinsics.width, camera.intrinsics.height]);
        Camera {
            intrinsics: camera.intrinsics.filling(width, height),
            sensor: options.sensor_of(camera.sensor),
            distortion: options.distortion.or(camera.distortion),
            ..camera.clone()
        }
    };
    let cameras: Vec<Camera> = known.iter().filter(asked).map(sized).collect();
    match &camera_faults(&cameras)[..] {
        [] => Ok(cameras),
        [fault, ..] => Err(WorkspaceError::input(format!("scenario {}: {fault}", stage.scenario.id))),
    }
}

/// Frames of an episode to be rendered, with their indices: every n-th one, as `collect` selects them.
fn chosen(episode: &Episode, fps: u32) -> Result<Vec<(usize, &Frame)>, WorkspaceError> {
    let rate = episode.result.control_rate_hz;
    let stride = rate / f64::from(fps);
    if stride < 1.0 || (stride - stride.round()).abs() > 1e-9 {
        return Err(WorkspaceError::input(format!("--fps {fps} does not divide the rate of {}", episode.result.id))
            .with_hint(format!("expected a divisor of {rate} Hz, e.g. 15 or 30")));
    }
    Ok(episode.frames.iter().enumerate().step_by(stride.round() as usize).collect())
}

/// Text table of the rendered episodes and scenarios.
pub fn table(rendered: &[Rendered]) -> String {
    let mut lines = vec![["drawn", "frames", "variation", "folder"].map(String::from).to_vec()];
    for Rendered { id, folder, frames, variation_seed } in rendered {
        let seed = variation_seed.map_or_else(String::new, |seed| seed.to_string());
        lines.push(vec![id.clone(), frames.to_string(), seed, folder.display().to_string()]);
    }
    genmanip_workspace::text_table(&lines)
}
