//! From an episode to the rows of the sibling data set `<name>-depth`.

use crate::export::features::ImageFeature;
use crate::export::{EpisodeRows, Source};
use crate::{CameraTrack, DataError};

/// Depth pictures as 16-bit PNG in millimetres, bytes in the table, beside the rows `colors` of the main data set.
pub(crate) fn depth_rows(source: &Source, colors: &EpisodeRows) -> Result<EpisodeRows, DataError> {
    let frames = colors.frames;
    let image = |track: &CameraTrack| {
        if track.depth_png.len() != frames {
            let what =
                format!("depth pictures of camera {} in episode {}", track.camera.name, source.episode.result.id);
            return Err(DataError::mismatch(what, frames, track.depth_png.len()));
        }
        Ok(ImageFeature {
            key: format!("observation.images.{}_depth", track.camera.name),
            width: track.camera.intrinsics.width,
            height: track.camera.intrinsics.height,
            png: track.depth_png.clone(),
        })
    };
    Ok(EpisodeRows {
        frames,
        features: Vec::new(),
        images: source.tracks.iter().map(image).collect::<Result<_, _>>()?,
        videos: Vec::new(),
        steps: Vec::new(),
        facts: colors.facts.clone(),
    })
}
