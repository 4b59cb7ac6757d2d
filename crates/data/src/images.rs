//! Camera tracks: the images of one camera during an episode, rendered afterwards from the recorded states.
//!
//! In the store, a track consists of three files in the group `images_<fps>hz`: `<camera>.json` (camera with
//! intrinsics, pose per frame, byte lengths, colour statistics), `<camera>.h264`, and `<camera>.depth` (concatenated
//! PNG files, empty without depth).

use genmanip_core::{Camera, CameraMount, Document, DocumentError, Pose, RgbdImage, Seed};
use serde::{Deserialize, Serialize};

use crate::depth::encode_depth_png;
use crate::video::{self, EncodedVideo, VideoEncoder, VideoSettings};
use crate::{Attachment, DataError, EpisodeStore};

/// Appearance-randomisation seed of an episode, used by `collect`.
pub fn variation_seed(episode: Seed) -> Seed {
    episode.fork("variation")
}

/// Appearance-randomisation seed of an episode by index; 0 is that of `collect`.
pub fn appearance_seed(episode: Seed, look: u64) -> Seed {
    let usual = variation_seed(episode);
    if look == 0 { usual } else { usual.fork_index(look) }
}

/// Images of one camera during one episode.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraTrack {
    /// Camera with its intrinsics.
    pub camera: Camera,
    /// Camera poses: one per frame, or a single one for a camera fixed in the world.
    pub world_from_camera: Vec<Pose>,
    /// Colour images as H.264 video.
    pub video: EncodedVideo,
    /// 16-bit PNG files in millimetres, one per frame; empty without depth.
    pub depth_png: Vec<Vec<u8>>,
    /// Colour statistics of all images.
    pub colors: ColorHistogram,
}

/// Histogram of 8-bit colour values per channel, sampled at every fourth pixel of every fourth row.
///
/// All colour statistics of a data set follow exactly from it, and histograms of episodes add up.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColorHistogram {
    /// Counts of the values 0 to 255 for red, green and blue.
    pub counts: [Vec<u64>; 3],
}

/// Streaming encoder of a camera's images, so that raw images need not be kept.
pub struct TrackRecorder {
    camera: Camera,
    world_from_camera: Vec<Pose>,
    video: VideoEncoder,
    depth_png: Vec<Vec<u8>>,
    colors: ColorHistogram,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct TrackFile {
    camera: Camera,
    fps: u32,
    frames: usize,
    world_from_camera: Vec<Pose>,
    h264_bytes: Vec<usize>,
    depth_png_bytes: Vec<usize>,
    colors: ColorHistogram,
}

impl Document for TrackFile {
    const SCHEMA: &'static str = "genmanip.camera_track/1";
}

impl TrackRecorder {
    /// Starts a track at `fps` images per second.
    ///
    /// # Errors
    /// See [`VideoEncoder::new`].
    pub fn new(camera: &Camera, fps: u32, settings: &VideoSettings) -> Result<Self, DataError> {
        Ok(Self {
            camera: camera.clone(),
            world_from_camera: Vec::new(),
            video: VideoEncoder::new(camera.intrinsics.width, camera.intrinsics.height, fps, settings)?,
            depth_png: Vec::new(),
            colors: ColorHistogram::default(),
        })
    }

    /// Appends an image; depth must be given for every image of a track or for none.
    ///
    /// # Errors
    /// If a size does not match or an encoder fails.
    pub fn push(&mut self, image: &RgbdImage) -> Result<(), DataError> {
        let (width, height) = (self.camera.intrinsics.width, self.camera.intrinsics.height);
        self.video.push(&image.rgb)?;
        if !image.depth_m.is_empty() {
            self.depth_png.push(encode_depth_png(&image.depth_m, width, height)?);
        }
        if self.camera.mount == CameraMount::Hand || self.world_from_camera.is_empty() {
            self.world_from_camera.push(image.world_from_camera);
        }
        self.colors.add_image(&image.rgb, width as usize);
        Ok(())
    }

    /// Completes the track.
    ///
    /// # Errors
    /// If depth was given for only some of the images.
    pub fn finish(self) -> Result<CameraTrack, DataError> {
        let video = self.video.finish();
        let depth = self.depth_png.len();
        if depth != 0 && depth != video.frames.len() {
            return Err(DataError::mismatch("depth images of a track", video.frames.len(), depth));
        }
        let Self { camera, world_from_camera, depth_png, colors, .. } = self;
        Ok(CameraTrack { camera, world_from_camera, video, depth_png, colors })
    }
}

impl CameraTrack {
    /// Camera pose `world_from_camera` of a frame; `None` beyond the last frame.
    pub fn pose_at(&self, frame: usize) -> Option<&Pose> {
        self.world_from_camera.get(frame).or(match self.camera.mount {
            CameraMount::World => self.world_from_camera.first(),
            CameraMount::Hand => None,
        })
    }

    /// Files of the track in its group of the store.
    fn attachments(&self) -> [Attachment; 3] {
        let file = TrackFile {
            camera: self.camera.clone(),
            fps: self.video.fps,
            frames: self.video.frames.len(),
            world_from_camera: self.world_from_camera.clone(),
            h264_bytes: self.video.frame_bytes(),
            depth_png_bytes: self.depth_png.iter().map(Vec::len).collect(),
            colors: self.colors.clone(),
        };
        let name = |ending: &str| format!("{}.{ending}", self.camera.name);
        [
            Attachment { name: name("json"), bytes: file.to_json().into_bytes() },
            Attachment { name: name("h264"), bytes: self.video.to_bytes() },
            Attachment { name: name("depth"), bytes: self.depth_png.concat() },
        ]
    }
}

impl EpisodeStore {
    /// Stores the images of an episode; all tracks must have the same rate, and replace existing ones of that rate.
    ///
    /// # Errors
    /// If the rates differ, there is no track, or writing fails.
    pub fn attach_tracks(&self, id: &str, tracks: &[CameraTrack]) -> Result<(), DataError> {
        let Some(fps) = tracks.first().map(|track| track.video.fps) else {
            return Err(DataError::mismatch("tracks to attach", "at least one", 0));
        };
        if let Some(other) = tracks.iter().find(|track| track.video.fps != fps) {
            return Err(DataError::mismatch("rate of the tracks", fps, other.video.fps));
        }
        let attachments: Vec<Attachment> = tracks.iter().flat_map(CameraTrack::attachments).collect();
        self.attach(id, &image_group(fps), &attachments)
    }

    /// True if the store has images of an episode at a rate for all given cameras.
    pub fn has_tracks(&self, id: &str, fps: u32, cameras: &[String]) -> bool {
        let group = image_group(fps);
        let folder = self.root().join(id).join(&group);
        self.has_group(id, &group) && cameras.iter().all(|camera| folder.join(format!("{camera}.json")).is_file())
    }

    /// Reads the images of one camera at a rate.
    ///
    /// # Errors
    /// If they are missing or damaged.
    pub fn read_track(&self, id: &str, fps: u32, camera: &str) -> Result<CameraTrack, DataError> {
        let name = |ending: &str| format!("{}/{camera}.{ending}", image_group(fps));
        let text = self.read_attachment(id, &name("json"))?;
        let fail =
            |source: DocumentError| DataError::Document { path: self.root().join(id).join(name("json")), source };
        let file = TrackFile::from_json(&String::from_utf8_lossy(&text)).map_err(fail)?;
        let frames = video::split(&self.read_attachment(id, &name("h264"))?, &file.h264_bytes)?;
        let depth_png = video::split(&self.read_attachment(id, &name("depth"))?, &file.depth_png_bytes)?;
        let (width, height) = (file.camera.intrinsics.width, file.camera.intrinsics.height);
        Ok(CameraTrack {
            camera: file.camera,
            world_from_camera: file.world_from_camera,
            video: EncodedVideo { width, height, fps: file.fps, frames },
            depth_png,
            colors: file.colors,
        })
    }
}

impl Default for ColorHistogram {
    fn default() -> Self {
        Self { counts: [vec![0; 256], vec![0; 256], vec![0; 256]] }
    }
}

impl ColorHistogram {
    /// Sampling stride along rows and columns, pixels: a sixteenth of the pixels suffices for statistics.
    const STRIDE: usize = 4;

    /// Adds an RGB image of the given width.
    pub fn add_image(&mut self, rgb: &[u8], width: usize) {
        for row in rgb.chunks_exact(width * 3).step_by(Self::STRIDE) {
            for pixel in row.chunks_exact(3).step_by(Self::STRIDE) {
                for (counts, value) in self.counts.iter_mut().zip(pixel) {
                    counts[usize::from(*value)] += 1;
                }
            }
        }
    }

    /// Adds the counts of another histogram.
    pub fn add(&mut self, other: &Self) {
        for (counts, more) in self.counts.iter_mut().zip(&other.counts) {
            for (count, more) in counts.iter_mut().zip(more) {
                *count += more;
            }
        }
    }
}

fn image_group(fps: u32) -> String {
    format!("images_{fps}hz")
}
