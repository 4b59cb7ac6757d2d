//! Output files of one camera: a video or image, and an image per further channel.

use std::path::{Path, PathBuf};

use genmanip_core::{Camera, ImageChannels, RgbdImage};
use genmanip_data::video::mux_mp4;
use genmanip_data::{VideoEncoder, VideoSettings};
use genmanip_render::encode;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Writer of one camera's images; each is written as soon as it is rendered.
pub(super) struct Writer {
    /// Path of the output files without extension.
    stem: PathBuf,
    channels: ImageChannels,
    film: Option<VideoEncoder>,
    is_film: bool,
}

impl Writer {
    /// Writer into `folder`; `fps` is the frame rate of a video, `None` for a single image. Fails for a video of odd
    /// width or height, before anything is rendered.
    pub(super) fn new(
        folder: &Path,
        camera: &Camera,
        channels: ImageChannels,
        fps: Option<u32>,
    ) -> Result<Self, WorkspaceError> {
        let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
        let fps_of_color = fps.filter(|_| channels.rgb);
        if fps_of_color.is_some() && (width % 2 != 0 || height % 2 != 0) {
            return Err(WorkspaceError::input(format!("camera {} has {width}x{height} pixels", camera.name))
                .with_hint("films need even sides; choose another --size"));
        }
        let film = fps_of_color.map(|fps| VideoEncoder::new(width, height, fps, &VideoSettings::default())).transpose();
        let film = film.map_err(|error| WorkspaceError::broken("cannot encode the film", error))?;
        Ok(Self { stem: folder.join(&camera.name), channels, film, is_film: fps.is_some() })
    }

    /// Writes the requested channels of image number `index`.
    pub(super) fn push(&mut self, index: usize, image: &RgbdImage) -> Result<(), WorkspaceError> {
        let unencoded = |error: encode::EncodeError| WorkspaceError::broken("cannot encode a picture", error);
        let (width, height) = (image.width(), image.height());
        if let Some(film) = &mut self.film {
            film.push(&image.rgb).map_err(|error| WorkspaceError::broken("cannot encode the film", error))?;
        } else if self.channels.rgb {
            self.write_still(image)?;
        }
        if self.channels.depth {
            self.write("depth", index, &encode::png_depth_mm(width, height, &image.depth_m).map_err(unencoded)?)?;
        }
        if self.channels.ids {
            self.write("ids", index, &encode::png_u16(width, height, &image.ids).map_err(unencoded)?)?;
        }
        if self.channels.normals {
            let color = |normal: &[i8; 3]| match normal {
                [0, 0, 0] => [0; 3],
                normal => normal.map(|axis| (f32::from(axis) / 127.0 * 127.5 + 127.5).round() as u8),
            };
            let rgb: Vec<u8> = image.normals.iter().flat_map(color).collect();
            self.write("normals", index, &encode::png_rgb(width, height, &rgb).map_err(unencoded)?)?;
        }
        Ok(())
    }

    /// Writes the colour channel of one image as PNG, beside the video if there is one.
    pub(super) fn write_still(&self, image: &RgbdImage) -> Result<(), WorkspaceError> {
        let png = encode::png_rgb(image.width(), image.height(), &image.rgb);
        let png = png.map_err(|error| WorkspaceError::broken("cannot encode a picture", error))?;
        documents::write_file(&self.stem.with_extension("png"), &png)
    }

    fn write(&self, channel: &str, index: usize, png: &[u8]) -> Result<(), WorkspaceError> {
        let name = format!("{}_{channel}", self.stem.file_name().unwrap_or_default().to_string_lossy());
        let place = self.stem.with_file_name(name);
        let file = if self.is_film { place.join(format!("{index:06}.png")) } else { place.with_extension("png") };
        documents::write_file(&file, png)
    }

    /// Writes the video file, if there is a video.
    pub(super) fn finish(self) -> Result<(), WorkspaceError> {
        let Some(film) = self.film else { return Ok(()) };
        let mp4 = mux_mp4([&film.finish()]).map_err(|error| WorkspaceError::broken("cannot encode the film", error))?;
        documents::write_file(&self.stem.with_extension("mp4"), &mp4)
    }
}
