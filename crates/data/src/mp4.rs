//! Index of an MP4 file: image size, frame durations and byte ranges.
//!
//! Supports files with a single H.264 track; only the index is read, with bounds.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::{DataError, files};

/// Maximum size of the index (box `moov`), bytes: enough for some millions of frames.
const INDEX_BYTES: u64 = 64 << 20;
/// Maximum number of frames of a file: a day at 60 Hz has 5.2 million.
const MAX_FRAMES: usize = 6_000_000;

/// The only video track of a file.
#[derive(Debug)]
pub struct Video {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Ticks per second.
    pub timescale: u32,
    /// Duration of each frame, ticks.
    pub durations: Vec<u32>,
    /// Offset and size of each frame in the file, bytes.
    pub frames: Vec<(u64, u32)>,
    /// True if the presentation order of the frames differs from the file order (B-frames).
    pub is_reordered: bool,
    /// H.264 parameter sets (SPS and PPS).
    parameters: Vec<Vec<u8>>,
    file: File,
}

impl Video {
    /// Reads the index of an MP4 file.
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let mut file = files::open(path)?;
        let length = file.metadata().map_err(DataError::io("read", path))?.len();
        let broken = |why: String| DataError::Video(format!("{why}: {}", path.display()));
        let index = movie(&mut file, length).map_err(|why| broken(why.to_owned()))?;
        Self::of(&index, file, length).ok_or_else(|| broken("not a file with exactly one H.264 track".into()))
    }

    fn of(movie: &[u8], file: File, length: u64) -> Option<Self> {
        let media = find(find(movie, b"trak")?, b"mdia")?;
        let timescale = {
            let header = find(media, b"mdhd")?;
            if header.first()? == &0 { u32_at(header, 12)? } else { u32_at(header, 20)? }
        };
        let table = find(find(media, b"minf")?, b"stbl")?;
        let sample = find(table, b"stsd")?.get(8..)?;
        let avc = find(sample, b"avc1")?;
        let (width, height) = (u32::from(u16_at(avc, 24)?), u32::from(u16_at(avc, 26)?));
        let parameters = parameter_sets(find(avc.get(78..)?, b"avcC")?)?;
        let sizes = find(table, b"stsz")?;
        let (same, count) = (u32_at(sizes, 4)?, usize::try_from(u32_at(sizes, 8)?).ok()?);
        if count > MAX_FRAMES {
            return None;
        }
        let sizes: Vec<u32> = (0..count)
            .map(|index| if same > 0 { Some(same) } else { u32_at(sizes, 12 + 4 * index) })
            .collect::<Option<_>>()?;
        let times = find(table, b"stts")?;
        let mut durations = Vec::new();
        for entry in 0..usize::try_from(u32_at(times, 4)?).ok()? {
            let (frames, ticks) = (u32_at(times, 8 + 8 * entry)?, u32_at(times, 12 + 8 * entry)?);
            let frames = usize::try_from(frames).ok().filter(|frames| durations.len() + frames <= MAX_FRAMES)?;
            durations.resize(durations.len() + frames, ticks);
        }
        let frames = frame_ranges(table, &sizes)?;
        let is_within =
            frames.iter().all(|(at, size)| at.checked_add(u64::from(*size)).is_some_and(|end| end <= length));
        let is_reordered = find(table, b"ctts").is_some();
        is_within.then_some(Self { width, height, timescale, durations, frames, is_reordered, parameters, file })
    }

    /// Frame in Annex B format for the decoder, optionally preceded by the parameter sets; `None` if the index is out
    /// of range or the data are not H.264.
    pub fn frame(&mut self, index: usize, with_parameters: bool) -> Option<Vec<u8>> {
        let (at, size) = *self.frames.get(index)?;
        let mut bytes = vec![0; usize::try_from(size).ok()?];
        self.file.seek(SeekFrom::Start(at)).ok()?;
        self.file.read_exact(&mut bytes).ok()?;
        let mut stream = Vec::with_capacity(bytes.len() + 64);
        let mut add = |unit: &[u8]| {
            stream.extend_from_slice(&[0, 0, 0, 1]);
            stream.extend_from_slice(unit);
        };
        if with_parameters {
            self.parameters.iter().for_each(|unit| add(unit));
        }
        let mut rest = bytes.as_slice();
        while !rest.is_empty() {
            let length = usize::try_from(u32_at(rest, 0)?).ok()?;
            let unit = rest.get(4..4_usize.checked_add(length)?)?;
            // Not H.264 if the forbidden bit is set or the unit type is 0.
            let kind = unit.first()?;
            if kind & 0x80 != 0 || kind & 0x1f == 0 {
                return None;
            }
            add(unit);
            rest = rest.get(4 + length..)?;
        }
        (size > 0).then_some(stream)
    }
}

/// Contents of the box `moov`.
fn movie(file: &mut File, length: u64) -> Result<Vec<u8>, &'static str> {
    let mut at = 0;
    while at + 8 <= length {
        let mut header = [0; 16];
        file.seek(SeekFrom::Start(at)).map_err(|_| "cannot be read")?;
        let read = file.read(&mut header).map_err(|_| "cannot be read")?;
        let (size, head) = match (u32_at(&header, 0), &header[4..8]) {
            (Some(1), _) if read == 16 => (u64::from_be_bytes(header[8..16].try_into().unwrap_or_default()), 16),
            (Some(0), _) => (length - at, 8),
            (Some(size), _) => (u64::from(size), 8),
            (None, _) => (0, 8),
        };
        if size < head || at.checked_add(size).is_none_or(|end| end > length) {
            return Err("truncated: a box extends beyond the end of the file");
        }
        if &header[4..8] == b"moov" {
            if size > INDEX_BYTES {
                return Err("the index exceeds 64 MiB");
            }
            let mut index = vec![0; usize::try_from(size - head).map_err(|_| "the index is too large")?];
            file.seek(SeekFrom::Start(at + head)).map_err(|_| "cannot be read")?;
            file.read_exact(&mut index).map_err(|_| "cannot be read")?;
            return Ok(index);
        }
        at += size;
    }
    Err("no index (`moov` box)")
}

/// Contents of the first box of a type; `None` if there is none.
fn find<'a>(mut boxes: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    loop {
        let size = usize::try_from(u32_at(boxes, 0)?).ok().filter(|size| *size >= 8)?;
        let whole = boxes.get(..size)?;
        if &whole[4..8] == kind {
            return whole.get(8..);
        }
        boxes = &boxes[size..];
    }
}

/// Offset and size of each frame; a chunk holds consecutive frames. `None` if the tables are invalid.
fn frame_ranges(table: &[u8], sizes: &[u32]) -> Option<Vec<(u64, u32)>> {
    let chunks: Vec<u64> = match (find(table, b"stco"), find(table, b"co64")) {
        (Some(narrow), _) => (0..usize::try_from(u32_at(narrow, 4)?).ok()?)
            .map(|index| u32_at(narrow, 8 + 4 * index).map(u64::from))
            .collect::<Option<_>>()?,
        (None, Some(wide)) => (0..usize::try_from(u32_at(wide, 4)?).ok()?)
            .map(|index| Some(u64::from(u32_at(wide, 8 + 8 * index)?) << 32 | u64::from(u32_at(wide, 12 + 8 * index)?)))
            .collect::<Option<_>>()?,
        (None, None) => return None,
    };
    let runs = find(table, b"stsc")?;
    let count = usize::try_from(u32_at(runs, 4)?).ok()?;
    let mut places = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (chunk, start) in chunks.iter().enumerate() {
        while run + 1 < count && usize::try_from(u32_at(runs, 8 + 12 * (run + 1))?).ok()? <= chunk + 1 {
            run += 1;
        }
        let mut at = *start;
        for size in sizes.iter().skip(places.len()).take(usize::try_from(u32_at(runs, 12 + 12 * run)?).ok()?) {
            places.push((at, *size));
            at = at.checked_add(u64::from(*size))?;
        }
    }
    (places.len() == sizes.len()).then_some(places)
}

/// SPS and PPS of an H.264 stream; only 4-byte NAL unit lengths are supported. `None` if the record is invalid.
fn parameter_sets(avcc: &[u8]) -> Option<Vec<Vec<u8>>> {
    if avcc.get(4)? & 3 != 3 {
        return None;
    }
    let mut sets = Vec::new();
    let mut at = 5;
    for mask in [0x1f, 0xff] {
        let count = avcc.get(at)? & mask;
        at += 1;
        for _ in 0..count {
            let length = usize::from(u16_at(avcc, at)?);
            sets.push(avcc.get(at + 2..at + 2 + length)?.to_vec());
            at += 2 + length;
        }
    }
    Some(sets)
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at.checked_add(2)?)?.try_into().ok()?))
}
