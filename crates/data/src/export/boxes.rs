//! Optional columns: bounding boxes of the objects in each camera's images.

use super::features::{Feature, Values};
use super::privileged::OBJECTS;
use crate::DataError;
use crate::masks::{self, MaskTrack};

const BOUNDS: [&str; 4] = ["left", "top", "right", "bottom"];

/// Bounding box and number of visible pixels of each object in the order of the scenario; zeros if the object is not
/// visible or missing.
pub fn features(track: &MaskTrack, objects: usize, id: &str) -> Result<[Feature; 2], DataError> {
    if objects > OBJECTS {
        let what = format!("objects of episode {id} for the columns `sim.box…`");
        return Err(DataError::mismatch(what, format!("at most {OBJECTS}"), objects));
    }
    let rows = track.png.iter().map(|png| masks::seen(png, OBJECTS)).collect::<Result<Vec<_>, _>>()?;
    let seen = || rows.iter().flatten();
    let objects = 0..OBJECTS;
    Ok([
        Feature {
            key: format!("sim.box.{}", track.camera),
            names: objects.clone().flat_map(|object| BOUNDS.map(|side| format!("object_{object}.{side}"))).collect(),
            values: Values::F32(seen().flat_map(|seen| seen.bounds_px).map(|pixel| pixel as f32).collect()),
        },
        Feature {
            key: format!("sim.visible_pixels.{}", track.camera),
            names: objects.map(|object| format!("object_{object}")).collect(),
            values: Values::I64(seen().map(|seen| i64::from(seen.pixels)).collect()),
        },
    ])
}
