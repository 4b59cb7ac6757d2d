//! Options of `genmanip render`.

use genmanip_core::{CameraSensor, Distortion, ImageChannels, Seed};
use genmanip_data::images::variation_seed;
use genmanip_render::AppearanceFactor;
use genmanip_render_reference::ReferenceSettings;

use super::overlay::Overlay;

/// Options of `genmanip render`.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Name of the robot that scenarios must have been laid out for; any robot without.
    pub robot: Option<String>,
    /// Names of cameras; all of them when it is empty.
    pub cameras: Vec<String>,
    /// Pixels per row and rows; each camera's own without.
    pub size_px: Option<[u32; 2]>,
    /// Image channels; point clouds are not written.
    pub channels: ImageChannels,
    /// True to write bounding boxes, a line per image.
    pub boxes: bool,
    /// True to write the point cloud of each object.
    pub clouds: bool,
    /// Overlays on the colour images.
    pub overlays: Vec<Overlay>,
    /// True to caption the colour images.
    pub captions: bool,
    /// Images of a turn around a scenario, in place of those of its cameras.
    pub turntable: Option<u32>,
    /// Images per second of an episode, whose rate it divides, and of a turn.
    pub fps: u32,
    /// The look; the usual one without.
    pub look: Option<AppearanceOptions>,
    /// Sensors of all cameras; each camera's own without.
    pub sensor: Option<CameraSensor>,
    /// Shutter time of all cameras, s; each camera's own if `None`.
    pub shutter_s: Option<f64>,
    /// Lens of all cameras; each camera's own without.
    pub distortion: Option<Distortion>,
    /// Light paths per pixel of a traced image; rasterised without.
    pub paths: Option<u32>,
    /// Threads.
    pub workers: usize,
}

impl RenderOptions {
    /// The sensors of a camera whose own ones are given.
    pub(super) fn sensor_of(&self, own: Option<CameraSensor>) -> Option<CameraSensor> {
        let sensor = self.sensor.or(own);
        self.shutter_s.map_or(sensor, |shutter_s| CameraSensor::with_shutter(sensor, shutter_s))
    }
}

/// A look that is drawn by chance.
#[derive(Clone, Debug)]
pub struct AppearanceOptions {
    /// Seed of the randomisation.
    pub seed: AppearanceSeed,
    /// Randomised parts of the appearance.
    pub vary: Vec<AppearanceFactor>,
}

/// The seed of looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppearanceSeed {
    /// Seed derived from the episode's, as in `collect --variation per-episode`.
    Episode,
    /// A number; each episode gets a look of its own from it.
    Number(Seed),
}

impl AppearanceSeed {
    pub(super) fn of(self, id: &str, episode: Seed) -> Seed {
        match self {
            Self::Episode => variation_seed(episode),
            Self::Number(seed) => seed.fork(id),
        }
    }
}

/// Settings of the path tracer, if it is used.
pub(super) fn reference(seed: Seed, options: &RenderOptions, threads: usize) -> Option<ReferenceSettings> {
    options.paths.map(|paths| ReferenceSettings { paths, seed: seed.fork("light paths"), threads })
}
