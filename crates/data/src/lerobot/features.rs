//! Features in LeRobot's description and storage.

use std::path::Path;

use arrow_array::RecordBatch;
use arrow_array::types::{Float32Type, Float64Type, Int64Type};
use serde_json::{Value, json};

use crate::export::features::{Feature, ImageFeature, Values, VideoFeature};
use crate::table::Columns;
use crate::{DataError, EncodedVideo};

impl Feature {
    /// Entry of the numeric feature in `info.json`.
    pub fn describe(&self) -> Value {
        let dtype = match self.values {
            Values::F32(_) => "float32",
            Values::F64(_) => "float64",
            Values::I64(_) => "int64",
            Values::Bool(_) => "bool",
        };
        let names = if self.names.is_empty() { Value::Null } else { json!(self.names) };
        json!({"dtype": dtype, "shape": [self.length()], "names": names})
    }

    fn add_to(&self, columns: &mut Columns) {
        let (key, length) = (self.key.as_str(), self.length());
        match &self.values {
            Values::F32(values) => columns.vectors::<Float32Type>(key, length, values.clone()),
            Values::F64(values) => columns.vectors::<Float64Type>(key, length, values.clone()),
            Values::I64(values) => columns.vectors::<Int64Type>(key, length, values.clone()),
            Values::Bool(values) => columns.bool(key, values.iter().copied()),
        }
    }
}

impl VideoFeature {
    /// Entry of the video feature in `info.json`.
    pub fn describe(&self) -> Value {
        let EncodedVideo { width, height, fps, .. } = self.video;
        json!({
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": "h264",
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": false,
                "video.fps": fps,
                "video.channels": 3,
                "has_audio": false,
                "is_depth_map": false,
            },
        })
    }
}

impl ImageFeature {
    /// Entry of the image feature in `info.json`.
    pub fn describe(&self) -> Value {
        json!({
            "dtype": "image",
            "shape": [self.height, self.width, 1],
            "names": ["height", "width", "channels"],
            // Instance ids are integers without a unit.
            "info": match self.key.ends_with("_mask") {
                true => json!({"is_depth_map": false, "is_instance_mask": true}),
                false => json!({"is_depth_map": true, "depth_unit": "mm"}),
            },
        })
    }
}

/// Table of the rows of one episode: images first, then numbers.
pub fn batch(images: &[ImageFeature], features: &[Feature]) -> Result<RecordBatch, DataError> {
    let mut columns = Columns::default();
    for image in images {
        columns.images(&image.key, &image.png);
    }
    for feature in features {
        feature.add_to(&mut columns);
    }
    columns.batch().map_err(|error| DataError::table(Path::new("data"), error))
}
