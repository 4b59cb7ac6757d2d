//! Check of video files: number, size and timing of frames, and their colours against the statistics.

use std::collections::BTreeMap;

use super::findings::Findings;
use super::metadata::{EpisodeEntry, Feature, Metadata, VideoSpan};
use super::v30;
use genmanip_data::mp4::Video;
use genmanip_data::{DataError, EncodedVideo, video};

/// Tolerance of an episode's mean colour against its statistics, on a scale of 0 to 1: compression changes colours.
const MEAN_COLOR: f64 = 0.02;
/// Tolerance of frame times against the episode's span in the file, s.
const TIME_S: f64 = 1e-4;

pub(super) fn check(metadata: &Metadata, findings: &mut Findings) {
    for feature in metadata.info.features.iter().filter(|feature| feature.is_video()) {
        let mut files: BTreeMap<&str, Vec<(&EpisodeEntry, &VideoSpan)>> = BTreeMap::new();
        for episode in &metadata.episodes {
            let own = episode.videos.iter().filter(|span| span.key == feature.key);
            for span in own {
                files.entry(span.file.as_str()).or_default().push((episode, span));
            }
        }
        for (file, mut episodes) in files {
            episodes.sort_by_key(|(episode, _)| episode.from);
            let path = metadata.root.join(file);
            match Video::open(&path) {
                Ok(video) => check_file(metadata, feature, file, &episodes, video, findings),
                Err(error) if error.is_missing() => {}
                Err(error) => findings.add("video", file, "", "a readable video", error),
            }
        }
    }
}

fn check_file(
    metadata: &Metadata,
    feature: &Feature,
    file: &str,
    episodes: &[(&EpisodeEntry, &VideoSpan)],
    mut video: Video,
    findings: &mut Findings,
) {
    let size = [video.height as usize, video.width as usize, 3];
    if feature.rgb_size() != Some([size[0], size[1]]) {
        findings.add(
            "video",
            file,
            "size",
            format!("{:?}, according to info.json", feature.shape),
            format!("{size:?}"),
        );
    }
    let count = episodes.iter().fold(0_i64, |sum, (episode, _)| sum.saturating_add(episode.length.max(0)));
    let held = video.frames.len();
    if i64::try_from(held).ok() != Some(count) {
        findings.add("video", file, "", format!("{count} frames, the number of rows"), held);
    }
    let ticks = f64::from(video.timescale) / metadata.info.fps;
    if let Some(frame) = video.durations.iter().position(|duration| (f64::from(*duration) - ticks).abs() > 1.0) {
        let found = format!("{} of {} s", video.durations[frame], video.timescale);
        let expected = format!("{ticks} of {} s, for {} Hz", video.timescale, metadata.info.fps);
        findings.add("video", file, format!("duration of frame {frame}"), expected, found);
    }
    let mut first = 0;
    for (episode, span) in episodes {
        let length = usize::try_from(episode.length).unwrap_or(0);
        let times = [("from_timestamp", span.from_s, first), ("to_timestamp", span.to_s, first + length)];
        for (name, found, frame) in times {
            let expected = frame as f64 / metadata.info.fps;
            if (found - expected).abs() > TIME_S || found.is_nan() {
                let place = format!("{}, videos/{}/{name}", episode.place(), feature.key);
                findings.add("video", &episode.listed_in.0, place, expected, found);
            }
        }
        first += length;
    }
    if let Some(frame) = (0..held).find(|frame| video.frame(*frame, false).is_none()) {
        findings.add("video", file, format!("frame {frame}"), "H.264 NAL units", "other bytes");
        return;
    }
    sample(metadata, feature, file, episodes, &mut video, findings);
}

/// Decodes the middle episode and compares its mean colour with its statistics.
fn sample(
    metadata: &Metadata,
    feature: &Feature,
    file: &str,
    episodes: &[(&EpisodeEntry, &VideoSpan)],
    video: &mut Video,
    findings: &mut Findings,
) {
    let middle = episodes.len() / 2;
    let Some((episode, _)) = episodes.get(middle) else { return };
    let before =
        episodes[..middle].iter().map(|(episode, _)| usize::try_from(episode.length).unwrap_or(0)).sum::<usize>();
    let range = before..before.saturating_add(usize::try_from(episode.length).unwrap_or(0));
    let frames: Option<Vec<Vec<u8>>> = range.clone().map(|frame| video.frame(frame, frame == range.start)).collect();
    let Some(frames) = frames else { return };
    let place = format!("{}, frames of {}", episode.place(), feature.key);
    match mean_color(&EncodedVideo { width: video.width, height: video.height, fps: 1, frames }) {
        Err(error) => findings.add("video", file, place, "frames that can be decoded", error),
        Ok(found) => {
            let recorded = v30::statistics(metadata, episode, &feature.key, &["mean"]);
            let Some(mean) = recorded.and_then(|recorded| recorded.get("mean").cloned()) else { return };
            let is_near = mean.len() == 3 && mean.iter().zip(found).all(|(a, b)| (a - b).abs() <= MEAN_COLOR);
            if metadata.is_own && !is_near {
                findings.add(
                    "video",
                    file,
                    place,
                    format!("mean colour {mean:.3?}, according to the statistics"),
                    format!("{found:.3?}"),
                );
            }
        }
    }
}

/// Mean of each colour channel, 0-1, over the pixels sampled for statistics.
fn mean_color(encoded: &EncodedVideo) -> Result<[f64; 3], DataError> {
    let mut colors = genmanip_data::ColorHistogram::default();
    let width = encoded.width as usize;
    video::decode(encoded, &mut |rgb| {
        colors.add_image(rgb, width);
        Ok(())
    })?;
    Ok([0, 1, 2].map(|channel: usize| {
        let counts = &colors.counts[channel];
        let sum: f64 = counts.iter().enumerate().map(|(value, count)| value as f64 * *count as f64).sum();
        sum / counts.iter().sum::<u64>().max(1) as f64 / 255.0
    }))
}
