//! Instance masks of a camera's images, rendered on request from the recorded states.
//!
//! In the store, a group `masks_<fps>hz` holds two files per camera: `<camera>.json` with the byte lengths, and
//! `<camera>.masks`, concatenated 16-bit grey PNG files. Pixel values: 0 nothing, 1 table, 2 robot, [`FIRST_OBJECT`]` +
//! i` object `i` of the scenario.

use genmanip_core::{Document, DocumentError, perception};
use serde::{Deserialize, Serialize};

use crate::depth::{decode_depth_png, encode_mm_png};
use crate::{Attachment, DataError, EpisodeStore, video};

pub use genmanip_core::perception::{FIRST_OBJECT, VisibleRegion};

/// Instance masks of one camera during one episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskTrack {
    /// Camera that the masks belong to, by name.
    pub camera: String,
    /// Masks per second.
    pub fps: u32,
    /// 16-bit PNG files, one per frame.
    pub png: Vec<Vec<u8>>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct MaskFile {
    fps: u32,
    png_bytes: Vec<usize>,
}

impl Document for MaskFile {
    const SCHEMA: &'static str = "genmanip.mask_track/1";
}

/// Encodes instance ids (row-major) as 16-bit grey PNG.
///
/// # Errors
/// If the number of ids is not `width · height`.
pub fn encode(ids: &[u16], width: u32, height: u32) -> Result<Vec<u8>, DataError> {
    let expected = width as usize * height as usize;
    if ids.len() != expected {
        return Err(DataError::mismatch("ids of a mask", expected, ids.len()));
    }
    encode_mm_png(ids, width, height)
}

/// Bounding box and number of visible pixels of the first `objects` objects of the scenario in a mask.
///
/// # Errors
/// If the file is not a 16-bit grey PNG.
pub fn seen(png: &[u8], objects: usize) -> Result<Vec<VisibleRegion>, DataError> {
    let (width, _, ids) = decode_depth_png(png)?;
    Ok(perception::visible_regions(&ids, width, objects))
}

impl EpisodeStore {
    /// Stores the masks of an episode; all tracks must have the same rate, and replace existing ones of that rate.
    ///
    /// # Errors
    /// If the rates differ, there is no track, or writing fails.
    pub fn attach_masks(&self, id: &str, masks: &[MaskTrack]) -> Result<(), DataError> {
        let Some(fps) = masks.first().map(|track| track.fps) else {
            return Err(DataError::mismatch("masks to attach", "at least one camera", 0));
        };
        if let Some(other) = masks.iter().find(|track| track.fps != fps) {
            return Err(DataError::mismatch("rate of the masks", fps, other.fps));
        }
        let files = masks.iter().flat_map(|track| {
            let about = MaskFile { fps, png_bytes: track.png.iter().map(Vec::len).collect() };
            [
                Attachment { name: format!("{}.json", track.camera), bytes: about.to_json().into_bytes() },
                Attachment { name: format!("{}.masks", track.camera), bytes: track.png.concat() },
            ]
        });
        self.attach(id, &group(fps), &files.collect::<Vec<_>>())
    }

    /// True if the store has masks of an episode at a rate for all given cameras.
    pub fn has_masks(&self, id: &str, fps: u32, cameras: &[String]) -> bool {
        let group = group(fps);
        let folder = self.root().join(id).join(&group);
        self.has_group(id, &group) && cameras.iter().all(|camera| folder.join(format!("{camera}.json")).is_file())
    }

    /// Reads the masks of one camera at a rate.
    ///
    /// # Errors
    /// If they are missing or damaged.
    pub fn read_masks(&self, id: &str, fps: u32, camera: &str) -> Result<MaskTrack, DataError> {
        let name = |ending: &str| format!("{}/{camera}.{ending}", group(fps));
        let text = self.read_attachment(id, &name("json"))?;
        let fail =
            |source: DocumentError| DataError::Document { path: self.root().join(id).join(name("json")), source };
        let file = MaskFile::from_json(&String::from_utf8_lossy(&text)).map_err(fail)?;
        let png = video::split(&self.read_attachment(id, &name("masks"))?, &file.png_bytes)?;
        Ok(MaskTrack { camera: camera.into(), fps: file.fps, png })
    }
}

fn group(fps: u32) -> String {
    format!("masks_{fps}hz")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounding_boxes_are_tight() {
        let mut ids = vec![0; 6 * 4];
        for (x, y, id) in [(1, 1, 3), (4, 2, 3), (0, 3, 5), (5, 0, 2), (3, 0, 1), (2, 2, 9)] {
            ids[y * 6 + x] = id;
        }
        let found = seen(&encode(&ids, 6, 4).unwrap(), 3).unwrap();
        assert_eq!(found[0], VisibleRegion { bounds_px: [1, 1, 5, 3], pixels: 2 });
        assert_eq!(found[1], VisibleRegion::default());
        assert_eq!(found[2], VisibleRegion { bounds_px: [0, 3, 1, 4], pixels: 1 });
        assert!(encode(&ids, 5, 4).is_err() && seen(b"not a png", 1).is_err());
    }
}
