//! Contact sheets: thumbnails of several episodes at several times each.

use std::path::Path;

use super::metadata::{EpisodeEntry, Metadata, VideoSpan};
use genmanip_data::mp4::Video;
use genmanip_data::{DataError, EncodedVideo, genmanip_format, video};

/// Maximum number of episodes on a sheet; evenly spaced over the data set.
const EPISODES: usize = 12;
/// Number of images per episode, evenly spaced in time from first to last. Chosen by hand.
const MOMENTS: usize = 4;
/// Maximum image width, pixels; wider images are downscaled by an integer factor.
const WIDTH: usize = 256;
/// Maximum frames per episode; of longer episodes only the first ones are shown.
const MAX_FRAMES: usize = 4000;

/// Row of a contact sheet: images of one episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Strip {
    /// Index of the episode in the data set.
    pub episode: i64,
    /// Instruction of the episode.
    pub sentence: String,
    /// True if the episode succeeded; `None` if unknown.
    pub success: Option<bool>,
    /// JPEG files in chronological order.
    pub pictures: Vec<Vec<u8>>,
}

/// Images of evenly spaced episodes from the first video feature; empty if there is none.
///
/// # Errors
/// If the folder is not a LeRobot data set, or a video cannot be decoded.
pub fn contact_sheet(dataset: &Path) -> Result<Vec<Strip>, DataError> {
    let (metadata, _) = super::read_metadata(dataset)?;
    let Some(key) = metadata.info.features.iter().find(|feature| feature.is_video()).map(|feature| feature.key.clone())
    else {
        return Ok(Vec::new());
    };
    let count = metadata.episodes.len();
    let shown = count.min(EPISODES);
    let mut strips = Vec::new();
    for place in 0..shown {
        let episode = &metadata.episodes[place * count / shown];
        let Some(span) = episode.videos.iter().find(|span| span.key == key) else { continue };
        strips.push(Strip {
            episode: episode.index,
            sentence: episode.sentence.clone(),
            success: episode.success,
            pictures: moments(&metadata, episode, span)?,
        });
    }
    Ok(strips)
}

fn moments(metadata: &Metadata, episode: &EpisodeEntry, span: &VideoSpan) -> Result<Vec<Vec<u8>>, DataError> {
    let path = metadata.root.join(&span.file);
    let mut video = Video::open(&path)?;
    // The cast saturates, so that invalid times are safe.
    let first = (span.from_s * metadata.info.fps).round() as usize;
    let length = usize::try_from(episode.length).unwrap_or(0).min(MAX_FRAMES);
    let frames: Option<Vec<Vec<u8>>> =
        (0..length).map(|frame| video.frame(first.checked_add(frame)?, frame == 0)).collect();
    let frames = frames.ok_or_else(|| {
        DataError::mismatch(format!("{} in {}", episode.place(), path.display()), format!("{length} frames"), "fewer")
    })?;
    let wanted: Vec<usize> = (0..MOMENTS).map(|moment| moment * length.saturating_sub(1) / (MOMENTS - 1)).collect();
    let encoded = EncodedVideo { width: video.width, height: video.height, fps: 1, frames };
    let (mut at, mut pictures) = (0, Vec::new());
    video::decode(&encoded, &mut |rgb| {
        if wanted.contains(&at) {
            let (small, width, height) = downscale(rgb, encoded.width as usize, encoded.height as usize);
            pictures.push(genmanip_format::jpeg(&small, width, height)?);
        }
        at += 1;
        Ok(())
    })?;
    Ok(pictures)
}

/// Downscales an image by an integer factor to at most [`WIDTH`], by box filtering.
fn downscale(rgb: &[u8], width: usize, height: usize) -> (Vec<u8>, u32, u32) {
    let factor = width.div_ceil(WIDTH).clamp(1, height.max(1));
    let (columns, rows) = (width / factor, height / factor);
    let mut small = Vec::with_capacity(columns * rows * 3);
    for place in 0..columns * rows {
        let (left, top) = (place % columns * factor, place / columns * factor);
        for channel in 0..3 {
            let pixel = |index: usize| {
                let (x, y) = (left + index % factor, top + index / factor);
                u32::from(rgb[(y * width + x) * 3 + channel])
            };
            let count = factor * factor;
            small.push(((0..count).map(pixel).sum::<u32>() / count as u32) as u8);
        }
    }
    (small, columns as u32, rows as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downscaling_averages_pixels() {
        let width = 2 * WIDTH;
        let rgb: Vec<u8> =
            (0..width * 2).flat_map(|pixel| [(pixel % 2 * 100) as u8, 7, (pixel / width) as u8]).collect();
        let (small, columns, rows) = downscale(&rgb, width, 2);
        assert_eq!((columns as usize, rows), (WIDTH, 1));
        assert_eq!(&small[..6], [50, 7, 0, 50, 7, 0]);
        assert_eq!(downscale(&rgb[..12], 2, 2), (rgb[..12].to_vec(), 2, 2));
    }
}
