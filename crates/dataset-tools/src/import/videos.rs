//! Videos of a LeRobot data set: H.264 is copied, other video is decoded by ffmpeg and re-encoded.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use genmanip_data::export::features::VideoFeature;
use genmanip_data::mp4;
use genmanip_data::video::{self, VideoEncoder, VideoSettings};
use genmanip_data::{ColorHistogram, DataError, EncodedVideo};

/// Maximum part of ffmpeg's log that an error quotes, bytes.
const MAX_LOG_BYTES: u64 = 2000;

/// Frames of an episode to be read from a video file.
pub(super) struct FrameRequest<'a> {
    pub(super) key: &'a str,
    pub(super) path: PathBuf,
    /// Height and width of the images, pixels.
    pub(super) size: [usize; 2],
    pub(super) fps: u32,
    /// Index of the first frame in the file, and number of frames.
    pub(super) from: usize,
    pub(super) count: usize,
}

/// Open video files and running decoders, at most one of each per feature key.
#[derive(Default)]
pub(super) struct VideoReader {
    ffmpeg: Option<PathBuf>,
    copied: BTreeMap<String, (PathBuf, mp4::Video)>,
    decoded: BTreeMap<String, FfmpegDecoder>,
    /// True if any video was re-encoded.
    pub(super) are_encoded: bool,
}

impl VideoReader {
    pub(super) fn new(ffmpeg: Option<PathBuf>) -> Self {
        Self { ffmpeg, ..Self::default() }
    }

    pub(super) fn take(&mut self, wanted: &FrameRequest) -> Result<VideoFeature, DataError> {
        let (video, colors) = match (self.copy(wanted), self.ffmpeg.clone()) {
            (Ok(copied), _) => copied,
            // H.264 whose size or rate contradicts the metadata must not be re-encoded: it would come out scrambled or
            // shifted.
            (Err(error), _) if error.is_missing() || self.contradicts(wanted) => return Err(error),
            (Err(_), Some(ffmpeg)) => {
                self.are_encoded = true;
                self.decode(&ffmpeg, wanted)?
            }
            (Err(error), None) => return Err(error),
        };
        Ok(VideoFeature { key: wanted.key.into(), video, colors })
    }

    /// True if the file could be opened but its size or rate differs from the metadata.
    fn contradicts(&self, wanted: &FrameRequest) -> bool {
        let source = self.copied.get(wanted.key).filter(|(path, _)| *path == wanted.path).map(|(_, source)| source);
        source.is_some_and(|source| !has_size(source, wanted.size) || !has_rate(source, wanted.fps))
    }

    /// Copies H.264 frames without re-encoding; also decodes them for the colour histogram.
    ///
    /// # Errors
    /// If the file cannot be opened as H.264, has B-frames, another size or rate, too few frames, or no key frame at
    /// the first one.
    fn copy(&mut self, wanted: &FrameRequest) -> Result<(EncodedVideo, ColorHistogram), DataError> {
        let FrameRequest { key, path, size: [height, width], fps, from, count } = wanted;
        if self.copied.get(*key).is_none_or(|(known, _)| known != path) {
            self.copied.insert((*key).to_owned(), (path.clone(), mp4::Video::open(path)?));
        }
        let Some((_, source)) = self.copied.get_mut(*key) else {
            return Err(DataError::Video(format!("not opened: {}", path.display())));
        };
        let unfit =
            |expected: &str, got: String| Err(DataError::mismatch(format!("video {}", path.display()), expected, got));
        if source.is_reordered {
            return unfit("frames in presentation order", "another order (B-frames)".into());
        }
        if !has_size(source, [*height, *width]) {
            return unfit(
                &format!("{width}×{height}, according to info.json"),
                format!("{}×{}", source.width, source.height),
            );
        }
        if !has_rate(source, *fps) {
            return unfit(&format!("a frame every 1/{fps} s"), "another rate".into());
        }
        let mut frames = Vec::with_capacity(*count);
        for index in *from..from.saturating_add(*count) {
            let Some(frame) = source.frame(index, false) else {
                return unfit(&format!("{} frames", from + count), format!("none at {index}"));
            };
            frames.push(frame);
        }
        if let Some(first) = frames.first_mut() {
            if !video::is_keyframe(first) {
                return unfit(&format!("a key frame at {from}, where an episode begins"), "none".into());
            }
            if !video::has_parameters(first)
                && let Some(whole) = source.frame(*from, true)
            {
                *first = whole;
            }
        }
        let video = EncodedVideo { width: source.width, height: source.height, fps: *fps, frames };
        let mut colors = ColorHistogram::default();
        video::decode(&video, &mut |rgb| {
            colors.add_image(rgb, *width);
            Ok(())
        })
        .map_err(|error| match error {
            DataError::Video(why) => DataError::Video(format!("frames from {from} on in {}: {why}", path.display())),
            other => other,
        })?;
        Ok((video, colors))
    }

    /// Decodes frames with ffmpeg and re-encodes them.
    fn decode(&mut self, ffmpeg: &Path, wanted: &FrameRequest) -> Result<(EncodedVideo, ColorHistogram), DataError> {
        let FrameRequest { key, path, size: [height, width], fps, from, count } = wanted;
        let is_at = |decoding: &FfmpegDecoder| decoding.path == *path && decoding.next <= *from;
        if !self.decoded.get(*key).is_some_and(is_at) {
            self.decoded.insert((*key).to_owned(), FfmpegDecoder::begin(ffmpeg, path)?);
        }
        let Some(decoding) = self.decoded.get_mut(*key) else {
            return Err(DataError::Video(format!("not opened: {}", path.display())));
        };
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut encoder = VideoEncoder::new(side(*width), side(*height), *fps, &VideoSettings::default())?;
        let mut colors = ColorHistogram::default();
        let mut rgb = vec![0; width * height * 3];
        while decoding.next < from + count {
            decoding.read(&mut rgb, [*height, *width])?;
            if decoding.next > *from {
                colors.add_image(&rgb, *width);
                encoder.push(&rgb)?;
            }
        }
        Ok((encoder.finish(), colors))
    }
}

fn has_size(source: &mp4::Video, [height, width]: [usize; 2]) -> bool {
    [source.height as usize, source.width as usize] == [height, width]
}

fn has_rate(source: &mp4::Video, fps: u32) -> bool {
    let ticks = f64::from(source.timescale) / f64::from(fps);
    source.durations.iter().all(|duration| (f64::from(*duration) - ticks).abs() <= 1.0)
}

/// A running ffmpeg that decodes a file frame by frame.
struct FfmpegDecoder {
    path: PathBuf,
    child: Child,
    stdout: ChildStdout,
    /// Reads stderr: keeps the beginning and drains the rest, so that ffmpeg does not block.
    log: Option<JoinHandle<Vec<u8>>>,
    /// Index in the file of the next frame that is decoded.
    next: usize,
}

impl FfmpegDecoder {
    fn begin(program: &Path, path: &Path) -> Result<Self, DataError> {
        let mut child = Command::new(program)
            .args(["-nostdin", "-v", "error", "-protocol_whitelist", "file,pipe", "-i"])
            .arg(path)
            .args([
                "-map",
                "0:v:0",
                "-fps_mode",
                "passthrough",
                "-f",
                "image2pipe",
                "-c:v",
                "ppm",
                "-pix_fmt",
                "rgb24",
                "pipe:1",
            ])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(DataError::io("start", program))?;
        let Some(stdout) = child.stdout.take() else {
            return Err(DataError::Video(format!("no output of {}", program.display())));
        };
        let log = child.stderr.take().map(|mut stderr| {
            std::thread::spawn(move || {
                let mut beginning = Vec::new();
                let _ = stderr.by_ref().take(MAX_LOG_BYTES).read_to_end(&mut beginning);
                let _ = std::io::copy(&mut stderr, &mut std::io::sink());
                beginning
            })
        });
        Ok(Self { path: path.into(), child, stdout, log, next: 0 })
    }

    /// Reads the next frame as 8-bit RGB, row-major; fails if it has another size.
    fn read(&mut self, rgb: &mut [u8], [height, width]: [usize; 2]) -> Result<(), DataError> {
        if let Some(got) = ppm_size(&mut self.stdout) {
            if got != [width, height] {
                let what = format!("frame {} of {}", self.next, self.path.display());
                let [other_width, other_height] = got;
                let expected = format!("{width}×{height}, according to info.json");
                return Err(DataError::mismatch(what, expected, format!("{other_width}×{other_height}")));
            }
            if self.stdout.read_exact(rgb).is_ok() {
                self.next += 1;
                return Ok(());
            }
        }
        // The output has ended, so ffmpeg is exiting.
        let log = self.log.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let log = String::from_utf8_lossy(&log).trim().replace('\n', "; ");
        let log = if log.is_empty() { "end of file".to_owned() } else { log };
        Err(DataError::Video(format!("no frame {} in {}: {log}", self.next, self.path.display())))
    }
}

/// Width and height from the header of a PPM image, `P6 WIDTH HEIGHT 255`; `None` at the end of the stream or for
/// another header.
fn ppm_size(stream: &mut impl Read) -> Option<[usize; 2]> {
    /// Maximum header size, bytes: two numbers of five digits, and some white space.
    const MAX_HEADER_BYTES: usize = 40;
    let (mut head, mut byte) = (Vec::new(), [0]);
    while head.iter().filter(|byte: &&u8| byte.is_ascii_whitespace()).count() < 4 && head.len() < MAX_HEADER_BYTES {
        stream.read_exact(&mut byte).ok()?;
        head.extend(byte);
    }
    let head = String::from_utf8(head).ok()?;
    match head.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["P6", width, height, "255"] => Some([width.parse().ok()?, height.parse().ok()?]),
        _ => None,
    }
}

impl Drop for FfmpegDecoder {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
