//! Pictures of a LeRobot data set: H.264 copied as it lies there, other codecs decoded by a program.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use crate::export::features::VideoFeature;
use crate::mp4;
use crate::video::{self, VideoEncoder, VideoSettings};
use crate::{ColorHistogram, DataError, EncodedVideo};

/// Bytes of what a failing program says that are repeated.
const COMPLAINT: u64 = 2000;

/// The pictures of an episode that are wanted.
pub(super) struct Wanted<'a> {
    pub(super) key: &'a str,
    pub(super) path: PathBuf,
    /// Rows and pixels per row.
    pub(super) size: [usize; 2],
    pub(super) fps: u32,
    /// First picture in the file, and how many.
    pub(super) from: usize,
    pub(super) count: usize,
}

/// Files that are open, one per feature.
#[derive(Default)]
pub(super) struct Pictures {
    ffmpeg: Option<PathBuf>,
    copied: BTreeMap<String, (PathBuf, mp4::Video)>,
    decoded: BTreeMap<String, Decoding>,
    /// Whether any were encoded anew.
    pub(super) are_encoded: bool,
}

impl Pictures {
    pub(super) fn new(ffmpeg: Option<PathBuf>) -> Self {
        Self { ffmpeg, ..Self::default() }
    }

    pub(super) fn take(&mut self, wanted: &Wanted) -> Result<VideoFeature, DataError> {
        let (video, colors) = match (self.copy(wanted), self.ffmpeg.clone()) {
            (Ok(copied), _) => copied,
            // What is H.264 and lies about its size or rate would come out scrambled or shifted.
            (Err(error), _) if error.is_missing() || self.lies(wanted) => return Err(error),
            (Err(_), Some(ffmpeg)) => {
                self.are_encoded = true;
                self.decode(&ffmpeg, wanted)?
            }
            (Err(error), None) => return Err(error),
        };
        Ok(VideoFeature { key: wanted.key.into(), video, colors })
    }

    /// Whether a file that could be opened has another size or rate than the data set says.
    fn lies(&self, wanted: &Wanted) -> bool {
        let source = self.copied.get(wanted.key).filter(|(path, _)| *path == wanted.path).map(|(_, source)| source);
        source.is_some_and(|source| !has_size(source, wanted.size) || !has_rate(source, wanted.fps))
    }

    /// The frames of H.264 as they are.
    fn copy(&mut self, wanted: &Wanted) -> Result<(EncodedVideo, ColorHistogram), DataError> {
        let Wanted { key, path, size: [height, width], fps, from, count } = wanted;
        if self.copied.get(*key).is_none_or(|(known, _)| known != path) {
            self.copied.insert((*key).to_owned(), (path.clone(), mp4::Video::open(path)?));
        }
        let Some((_, source)) = self.copied.get_mut(*key) else {
            return Err(DataError::Video(format!("not opened: {}", path.display())));
        };
        let unfit =
            |expected: &str, got: String| Err(DataError::mismatch(format!("video {}", path.display()), expected, got));
        if source.is_reordered {
            return unfit("pictures in the order they are shown in", "another order (B-frames)".into());
        }
        if !has_size(source, [*height, *width]) {
            return unfit(
                &format!("{width}×{height}, as info.json says"),
                format!("{}×{}", source.width, source.height),
            );
        }
        if !has_rate(source, *fps) {
            return unfit(&format!("a picture every 1/{fps} s"), "another rate".into());
        }
        let mut frames = Vec::with_capacity(*count);
        for index in *from..from.saturating_add(*count) {
            let Some(frame) = source.frame(index, false) else {
                return unfit(&format!("{} pictures", from + count), format!("none at {index}"));
            };
            frames.push(frame);
        }
        if let Some(first) = frames.first_mut() {
            if !video::is_keyframe(first) {
                return unfit(
                    &format!("a picture that stands alone at {from}, where an episode begins"),
                    "none".into(),
                );
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
            DataError::Video(why) => DataError::Video(format!("pictures from {from} on in {}: {why}", path.display())),
            other => other,
        })?;
        Ok((video, colors))
    }

    /// The pictures that a program decodes, encoded anew.
    fn decode(&mut self, ffmpeg: &Path, wanted: &Wanted) -> Result<(EncodedVideo, ColorHistogram), DataError> {
        let Wanted { key, path, size: [height, width], fps, from, count } = wanted;
        let is_at = |decoding: &Decoding| decoding.path == *path && decoding.next <= *from;
        if !self.decoded.get(*key).is_some_and(is_at) {
            self.decoded.insert((*key).to_owned(), Decoding::begin(ffmpeg, path)?);
        }
        let Some(decoding) = self.decoded.get_mut(*key) else {
            return Err(DataError::Video(format!("not opened: {}", path.display())));
        };
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut encoder = VideoEncoder::new(side(*width), side(*height), *fps, &VideoSettings::default())?;
        let mut colors = ColorHistogram::default();
        let mut picture = vec![0; width * height * 3];
        while decoding.next < from + count {
            decoding.read(&mut picture, [*height, *width])?;
            if decoding.next > *from {
                colors.add_image(&picture, *width);
                encoder.push(&picture)?;
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

/// A program that decodes a file, picture by picture.
struct Decoding {
    path: PathBuf,
    child: Child,
    pictures: ChildStdout,
    /// The beginning of what it says; all is read, or it would wait for ever.
    complaint: Option<JoinHandle<Vec<u8>>>,
    /// Index of the picture that comes next.
    next: usize,
}

impl Decoding {
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
        let Some(pictures) = child.stdout.take() else {
            return Err(DataError::Video(format!("no pictures from {}", program.display())));
        };
        let complaint = child.stderr.take().map(|mut talk| {
            std::thread::spawn(move || {
                let mut beginning = Vec::new();
                let _ = talk.by_ref().take(COMPLAINT).read_to_end(&mut beginning);
                let _ = std::io::copy(&mut talk, &mut std::io::sink());
                beginning
            })
        });
        Ok(Self { path: path.into(), child, pictures, complaint, next: 0 })
    }

    /// The next picture, 8-bit RGB, row by row, which must be of this size.
    fn read(&mut self, picture: &mut [u8], [height, width]: [usize; 2]) -> Result<(), DataError> {
        if let Some(got) = ppm_size(&mut self.pictures) {
            if got != [width, height] {
                let what = format!("picture {} of {}", self.next, self.path.display());
                let [other_width, other_height] = got;
                let expected = format!("{width}×{height}, as info.json says");
                return Err(DataError::mismatch(what, expected, format!("{other_width}×{other_height}")));
            }
            if self.pictures.read_exact(picture).is_ok() {
                self.next += 1;
                return Ok(());
            }
        }
        // Its output is over, so it ends.
        let complaint = self.complaint.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let complaint = String::from_utf8_lossy(&complaint).trim().replace('\n', "; ");
        let complaint = if complaint.is_empty() { "the file has no more".to_owned() } else { complaint };
        Err(DataError::Video(format!("no picture {} in {}: {complaint}", self.next, self.path.display())))
    }
}

/// Width and height in the head of a PPM picture, `P6 WIDTH HEIGHT 255`; `None` where none comes.
fn ppm_size(pictures: &mut impl Read) -> Option<[usize; 2]> {
    /// Longest head: two numbers of five digits, and room for odd spaces.
    const LONGEST: usize = 40;
    let (mut head, mut byte) = (Vec::new(), [0]);
    while head.iter().filter(|byte: &&u8| byte.is_ascii_whitespace()).count() < 4 && head.len() < LONGEST {
        pictures.read_exact(&mut byte).ok()?;
        head.extend(byte);
    }
    let head = String::from_utf8(head).ok()?;
    match head.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["P6", width, height, "255"] => Some([width.parse().ok()?, height.parse().ok()?]),
        _ => None,
    }
}

impl Drop for Decoding {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
