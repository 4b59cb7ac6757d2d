//! From an episode to the rows of the sibling data set `<name>-depth`.

use super::episodes::EpisodeFacts;
use super::features::ImageFeature;
use super::writer::EpisodeRows;
use super::{LerobotSettings, Source, sampling};
use crate::{CameraTrack, DataError};

/// Depth pictures as 16-bit PNG in millimetres, bytes in the table.
pub(crate) fn depth_rows(source: &Source, settings: &LerobotSettings) -> Result<EpisodeRows, DataError> {
    let result = &source.episode.result;
    let (frames, _) = sampling(source.episode.frames.len(), result.control_rate_hz, settings.fps)?;
    let image = |track: &CameraTrack| {
        if track.depth_png.len() != frames {
            let what = format!("depth pictures of camera {} in episode {}", track.camera.name, result.id);
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
        facts: EpisodeFacts::of(source, settings),
    })
}
