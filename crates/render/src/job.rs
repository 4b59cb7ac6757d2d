//! What to draw, from where, and where the picture goes.

use genmanip_core::{Camera, ImageChannels, Pose, RgbdImage};

/// Instance id of a pixel that sees nothing.
pub const NOTHING: u16 = 0;
/// Instance id of the table and of every further support surface.
pub const TABLE: u16 = 1;
/// Instance id of the robot.
pub const ROBOT: u16 = 2;
/// Instance id of object 0; object `i` is `FIRST_OBJECT + i`, in the order given to [`crate::RenderAssets::new`].
pub const FIRST_OBJECT: u16 = genmanip_core::perception::FIRST_OBJECT;

/// Index of the object with an instance id; `None` for background, table and robot.
pub fn object_of_instance(instance: u16) -> Option<usize> {
    instance.checked_sub(FIRST_OBJECT).map(usize::from)
}

/// Where every body is at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameState {
    /// `world_from_link` of every robot link in the order of the robot model,
    /// then of every link of object 0, of object 1, and so on.
    pub body_poses: Vec<Pose>,
}

/// One picture: a frame seen by a camera.
#[derive(Clone, Copy, Debug)]
pub struct ViewJob<'a> {
    /// The bodies; jobs of equal frames that follow each other share their shadow map.
    pub frame: &'a FrameState,
    /// The camera; one mounted on the hand moves with the robot's hand in `frame`.
    pub camera: &'a Camera,
    /// What is wanted.
    pub channels: Channels,
    /// Samples per pixel along each axis for the colour, 1-4; 2 gives smooth edges.
    /// Depth, ids and normals always come from exactly the pixel's centre.
    pub supersample: u32,
}

impl<'a> ViewJob<'a> {
    /// A view with 2×2 samples per pixel.
    pub fn new(frame: &'a FrameState, camera: &'a Camera, channels: Channels) -> Self {
        Self { frame, camera, channels, supersample: 2 }
    }
}

/// The channels of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Colour.
    pub rgb: bool,
    /// Distance along the optical axis.
    pub depth: bool,
    /// Which object.
    pub instance: bool,
    /// Which way the surface faces.
    pub normal: bool,
    /// Which part, a mesh of one material.
    pub parts: bool,
}

impl Channels {
    /// Everything that pictures are asked for.
    pub const ALL: Self = Self { rgb: true, depth: true, instance: true, normal: true, parts: false };
    /// Colour only.
    pub const RGB: Self = Self { rgb: true, depth: false, instance: false, normal: false, parts: false };
    /// Colour and depth.
    pub const RGBD: Self = Self { rgb: true, depth: true, instance: false, normal: false, parts: false };
    /// Depth and instance ids: no shading, several times cheaper.
    pub const GEOMETRY: Self = Self { rgb: false, depth: true, instance: true, normal: false, parts: false };
}

/// A picture, row by row from the top left; owned by the caller and reused from job to job. A renderer may exchange lists with
/// its own.
///
/// A channel that was not asked for is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameBuffers {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour, 8-bit sRGB, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Metres along the optical axis at the pixel's centre, 0 where nothing is seen; transparent things count as solid.
    pub depth_m: Vec<f32>,
    /// [`NOTHING`], [`TABLE`], [`ROBOT`] or [`FIRST_OBJECT`]` + i` at the pixel's centre.
    pub instance: Vec<u16>,
    /// Unit surface normal in the camera's optical frame times 127, towards the camera; zero where nothing is seen.
    pub normal: Vec<[i8; 3]>,
    /// Number of the part at the pixel's centre, counted from 1 in the order of the assets; 0 where nothing is seen.
    pub parts: Vec<u16>,
}

impl From<ImageChannels> for Channels {
    /// What must be drawn for what is asked for: points follow from the depth.
    fn from(asked: ImageChannels) -> Self {
        let ImageChannels { rgb, depth, ids, normals, points } = asked;
        Self { rgb, depth: depth || points, instance: ids, normal: normals, parts: false }
    }
}

impl FrameBuffers {
    /// The image of a camera at this place, which is what other crates speak.
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
