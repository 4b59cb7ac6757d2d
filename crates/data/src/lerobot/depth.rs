//! Rows of the sibling data set `<name>-depth`: depth images and, on request, instance masks.

use crate::export::features::ImageFeature;
use crate::export::{EpisodeRows, ExportSettings, ExtraColumns, Source};
use crate::masks::MaskTrack;
use crate::{CameraTrack, DataError};

/// Depth images as 16-bit PNG in millimetres, and instance masks, stored in the table; parallel to the rows `colors` of
/// the main data set.
pub fn depth_rows(source: &Source, colors: &EpisodeRows, settings: &ExportSettings) -> Result<EpisodeRows, DataError> {
    let frames = colors.frames;
    let image = |track: &CameraTrack| {
        if track.depth_png.len() != frames {
            let what = format!("depth images of camera {} in episode {}", track.camera.name, source.episode.result.id);
            return Err(DataError::mismatch(what, frames, track.depth_png.len()));
        }
        Ok(ImageFeature {
            key: format!("observation.images.{}_depth", track.camera.name),
            width: track.camera.intrinsics.width,
            height: track.camera.intrinsics.height,
            png: track.depth_png.clone(),
        })
    };
    let mut images = Vec::new();
    if settings.depth {
        images = source.tracks.iter().map(image).collect::<Result<_, _>>()?;
    }
    if settings.columns.contains(&ExtraColumns::Masks) {
        let mask = |(track, masks): (&CameraTrack, &MaskTrack)| ImageFeature {
            key: format!("observation.images.{}_mask", track.camera.name),
            width: track.camera.intrinsics.width,
            height: track.camera.intrinsics.height,
            png: masks.png.clone(),
        };
        images.extend(source.tracks.iter().zip(&source.masks).map(mask));
    }
    Ok(EpisodeRows {
        frames,
        features: Vec::new(),
        images,
        videos: Vec::new(),
        steps: Vec::new(),
        metadata: colors.metadata.clone(),
    })
}
