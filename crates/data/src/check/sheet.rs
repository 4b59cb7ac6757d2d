//! A contact sheet: some moments of some episodes, for people who want to see what is in a data set.

use std::path::Path;

use super::book::{Book, Listed, VideoSpan};
use crate::mp4::Video;
use crate::{DataError, EncodedVideo, paper, video};

/// Episodes on a sheet, evenly chosen.
const EPISODES: usize = 12;
/// Moments of each, the first and the last among them.
const MOMENTS: usize = 4;
/// Widest picture, pixels; wider ones are made smaller by a whole number.
const WIDTH: usize = 256;
/// Longest episode of which the end is shown; of longer ones the moments are of its first so many pictures.
const MOST_PICTURES: usize = 4000;

/// One line of the sheet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Strip {
    /// Index of the episode.
    pub episode: i64,
    /// Its sentence.
    pub sentence: String,
    /// Whether it succeeded, where that is told.
    pub success: Option<bool>,
    /// JPEG files, in the order of time.
    pub pictures: Vec<Vec<u8>>,
}

/// Moments of episodes, as the first video feature shows them; empty without one.
///
/// # Errors
/// When the folder is no LeRobot data set, or a video cannot be decoded.
pub fn contact_sheet(dataset: &Path) -> Result<Vec<Strip>, DataError> {
    let (book, _) = super::book(dataset)?;
    let Some(key) = book.info.features.iter().find(|feature| feature.is_video()).map(|feature| feature.key.clone())
    else {
        return Ok(Vec::new());
    };
    let count = book.episodes.len();
    let shown = count.min(EPISODES);
    let mut strips = Vec::new();
    for place in 0..shown {
        let episode = &book.episodes[place * count / shown];
        let Some(span) = episode.videos.iter().find(|span| span.key == key) else { continue };
        strips.push(Strip {
            episode: episode.index,
            sentence: episode.sentence.clone(),
            success: episode.success,
            pictures: moments(&book, episode, span)?,
        });
    }
    Ok(strips)
}

fn moments(book: &Book, episode: &Listed, span: &VideoSpan) -> Result<Vec<Vec<u8>>, DataError> {
    let path = book.root.join(&span.file);
    let mut video = Video::open(&path)?;
    // A float becomes the nearest whole number that there is, whatever it was.
    let first = (span.from_s * book.info.fps).round() as usize;
    let length = usize::try_from(episode.length).unwrap_or(0).min(MOST_PICTURES);
    let frames: Option<Vec<Vec<u8>>> =
        (0..length).map(|frame| video.frame(first.checked_add(frame)?, frame == 0)).collect();
    let frames = frames.ok_or_else(|| {
        DataError::mismatch(format!("{} in {}", episode.place(), path.display()), format!("{length} pictures"), "fewer")
    })?;
    let wanted: Vec<usize> = (0..MOMENTS).map(|moment| moment * length.saturating_sub(1) / (MOMENTS - 1)).collect();
    let encoded = EncodedVideo { width: video.width, height: video.height, fps: 1, frames };
    let (mut at, mut pictures) = (0, Vec::new());
    video::decode(&encoded, &mut |rgb| {
        if wanted.contains(&at) {
            let (small, width, height) = smaller(rgb, encoded.width as usize, encoded.height as usize);
            pictures.push(paper::jpeg(&small, width, height)?);
        }
        at += 1;
        Ok(())
    })?;
    Ok(pictures)
}

/// A picture made smaller by a whole number, each pixel the mean of those that it stands for.
fn smaller(rgb: &[u8], width: usize, height: usize) -> (Vec<u8>, u32, u32) {
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
    fn a_smaller_picture_has_the_mean_of_its_pixels() {
        let width = 2 * WIDTH;
        let rgb: Vec<u8> =
            (0..width * 2).flat_map(|pixel| [(pixel % 2 * 100) as u8, 7, (pixel / width) as u8]).collect();
        let (small, columns, rows) = smaller(&rgb, width, 2);
        assert_eq!((columns as usize, rows), (WIDTH, 1));
        assert_eq!(&small[..6], [50, 7, 0, 50, 7, 0]);
        assert_eq!(smaller(&rgb[..12], 2, 2), (rgb[..12].to_vec(), 2, 2));
    }
}
