//! Render jobs and their output buffers.

use genmanip_core::{Camera, ImageChannels, Pose, RgbdImage};

/// Instance id of the background.
pub const NOTHING: u16 = 0;
/// Instance id of all support surfaces.
pub const TABLE: u16 = 1;
/// Instance id of the robot.
pub const ROBOT: u16 = 2;
/// Instance id of object 0; object `i` has `FIRST_OBJECT + i`, in the order given to [`crate::RenderAssets::new`].
pub const FIRST_OBJECT: u16 = genmanip_core::perception::FIRST_OBJECT;

/// Object index of an instance id; `None` for background, support surfaces and robot.
pub fn object_of_instance(instance: u16) -> Option<usize> {
    instance.checked_sub(FIRST_OBJECT).map(usize::from)
}

/// Poses of all bodies at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// Pose `world_from_link` of every link of the robot, in the order of its model, then of object 0, 1, ….
    pub body_poses: Vec<Pose>,
}

/// Job of one image: a frame seen by a camera.
#[derive(Clone, Copy, Debug)]
pub struct ViewJob<'a> {
    /// Poses of the bodies; consecutive jobs with equal frames share their shadow map.
    pub frame: &'a FrameState,
    /// Camera; one mounted on the hand moves with the hand.
    pub camera: &'a Camera,
    /// Channels to be rendered.
    pub channels: Channels,
}

impl<'a> ViewJob<'a> {
    /// Job of an image; colours are anti-aliased from 2×2 samples per pixel, other channels sampled at pixel centres.
    pub fn new(frame: &'a FrameState, camera: &'a Camera, channels: Channels) -> Self {
        Self { frame, camera, channels }
    }
}

/// Selection of image channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Colour, [`FrameBuffers::rgb`].
    pub rgb: bool,
    /// Depth along the optical axis, [`FrameBuffers::depth_m`].
    pub depth: bool,
    /// Instance ids, [`FrameBuffers::instance`].
    pub instance: bool,
    /// Surface normals, [`FrameBuffers::normal`].
    pub normal: bool,
    /// Part numbers (a part is a mesh of one material).
    pub parts: bool,
}

impl Channels {
    /// All channels except the part numbers.
    pub const ALL: Self = Self { rgb: true, depth: true, instance: true, normal: true, parts: false };
    /// Colour only.
    pub const RGB: Self = Self { rgb: true, depth: false, instance: false, normal: false, parts: false };
    /// Colour and depth.
    pub const RGBD: Self = Self { rgb: true, depth: true, instance: false, normal: false, parts: false };
    /// Depth and instance ids, which need no shading and are several times cheaper than colour.
    pub const GEOMETRY: Self = Self { rgb: false, depth: true, instance: true, normal: false, parts: false };
}

/// Channels of an image, row by row from the top left; owned by the caller and reused from job to job.
///
/// A channel that was not requested is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameBuffers {
    /// Width of the image (px).
    pub width: u32,
    /// Height of the image (px).
    pub height: u32,
    /// Colour, 8-bit sRGB, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Distance along the optical axis at the pixel's centre (m), 0 for the background; transparent objects count as
    /// solid.
    pub depth_m: Vec<f32>,
    /// Instance id at the pixel's centre: [`NOTHING`], [`TABLE`], [`ROBOT`] or [`FIRST_OBJECT`]` + i`.
    pub instance: Vec<u16>,
    /// Unit normal towards the camera in its optical frame, times 127, at the pixel's centre; zero for the background.
    pub normal: Vec<[i8; 3]>,
    /// Part number at the pixel's centre, from 1 in the order of the assets; 0 for the background.
    pub parts: Vec<u16>,
}

impl From<ImageChannels> for Channels {
    /// Channels to render for requested image channels; a point cloud requires depth.
    fn from(asked: ImageChannels) -> Self {
        let ImageChannels { rgb, depth, ids, normals, points } = asked;
        Self { rgb, depth: depth || points, instance: ids, normal: normals, parts: false }
    }
}

impl FrameBuffers {
    /// Empties all channels except the colour.
    pub(crate) fn clear_geometry(&mut self) {
        self.depth_m.clear();
        self.instance.clear();
        self.normal.clear();
        self.parts.clear();
    }

    /// Image with intrinsics and pose of its camera, in the form that other crates use.
    pub fn into_image(self, camera: &Camera, world_from_camera: Pose) -> RgbdImage {
        RgbdImage {
            intrinsics: camera.intrinsics,
            distortion: camera.distortion,
            world_from_camera,
            rgb: self.rgb,
            depth_m: self.depth_m,
            ids: self.instance,
            normals: self.normal,
            points_m: Vec::new(),
        }
    }
}
