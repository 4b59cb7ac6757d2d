//! Options of `genmanip render`.

use genmanip_core::{CameraSensor, Distortion, ImageChannels, Seed};
use genmanip_data::images::variation_seed;
use genmanip_render::AppearanceFactor;
use genmanip_render_reference::ReferenceSettings;

use super::overlay::Overlay;

/// Options of `genmanip render`.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Name of the robot that scenarios must have been laid out for; `None` for any robot.
    pub robot: Option<String>,
    /// Names of the cameras; empty for all.
    pub cameras: Vec<String>,
    /// Width and height of images, pixels; `None` for each camera's own size.
    pub size_px: Option<[u32; 2]>,
    /// Image channels to be written; point clouds are not among them, see `clouds`.
    pub channels: ImageChannels,
    /// True to write bounding boxes, one line per image.
    pub boxes: bool,
    /// True to write the point cloud of each object.
    pub clouds: bool,
    /// Overlays on the colour images.
    pub overlays: Vec<Overlay>,
    /// True to caption the colour images.
    pub captions: bool,
    /// Number of images of a turntable around a scenario, instead of images of its cameras; `None` for no turntable.
    pub turntable: Option<u32>,
    /// Frame rate of the images, Hz; of an episode, a divisor of its control rate.
    pub fps: u32,
    /// Randomised appearance; `None` for the default one.
    pub look: Option<AppearanceOptions>,
    /// Sensors of all cameras; `None` for each camera's own.
    pub sensor: Option<CameraSensor>,
    /// Exposure time of all cameras, s; `None` for each camera's own.
    pub shutter_s: Option<f64>,
    /// Lens of all cameras; `None` for each camera's own.
    pub distortion: Option<Distortion>,
    /// Light paths per pixel of path-traced images; `None` for the rasteriser.
    pub paths: Option<u32>,
    /// Number of threads.
    pub workers: usize,
}

impl RenderOptions {
    /// Sensors of a camera under these options; `own` are the camera's own.
    pub(super) fn sensor_of(&self, own: Option<CameraSensor>) -> Option<CameraSensor> {
        let sensor = self.sensor.or(own);
        self.shutter_s.map_or(sensor, |shutter_s| CameraSensor::with_shutter(sensor, shutter_s))
    }
}

/// Randomised appearance of images.
#[derive(Clone, Debug)]
pub struct AppearanceOptions {
    /// Seed from which the appearance is randomised.
    pub seed: AppearanceSeed,
    /// Aspects of the appearance that are randomised.
    pub vary: Vec<AppearanceFactor>,
}

/// Seed of randomised appearances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppearanceSeed {
    /// Seed derived from the episode's, as in `collect --variation per-episode`.
    Episode,
    /// Given seed, from which each episode derives its own.
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

/// Settings of the path tracer; `None` for the rasteriser.
pub(super) fn reference(seed: Seed, options: &RenderOptions, threads: usize) -> Option<ReferenceSettings> {
    options.paths.map(|paths| ReferenceSettings { paths, seed: seed.fork("light paths"), threads })
}
