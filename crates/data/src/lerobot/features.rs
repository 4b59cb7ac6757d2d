//! Features: named columns of a data set, with the numbers of one episode.

use std::path::Path;

use arrow_array::RecordBatch;
use arrow_array::types::{Float32Type, Float64Type, Int64Type};
use serde_json::{Value, json};

use crate::table::Columns;
use crate::{ColorHistogram, DataError, EncodedVideo};

/// One column of numbers, a vector per frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Feature {
    pub(crate) key: String,
    /// Names of the vector's entries; empty for a single number.
    pub(crate) names: Vec<String>,
    pub(crate) values: Values,
}

/// Numbers, frame by frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    F32(Vec<f32>),
    F64(Vec<f64>),
    I64(Vec<i64>),
    Bool(Vec<bool>),
}

/// One column of video.
#[derive(Clone, Debug)]
pub(crate) struct VideoFeature {
    pub(crate) key: String,
    pub(crate) video: EncodedVideo,
    pub(crate) colors: ColorHistogram,
}

/// One column of depth pictures, kept in the table.
#[derive(Clone, Debug)]
pub(crate) struct ImageFeature {
    pub(crate) key: String,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) png: Vec<Vec<u8>>,
}

impl Feature {
    pub(crate) fn new(key: &str, names: &[&str], values: Values) -> Self {
        Self { key: key.into(), names: names.iter().map(|&name| name.to_owned()).collect(), values }
    }

    /// Length of the vector.
    pub(crate) fn length(&self) -> usize {
        self.names.len().max(1)
    }

    /// The numbers for statistics.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        match &self.values {
            Values::F32(values) => values.iter().map(|value| f64::from(*value)).collect(),
            Values::F64(values) => values.clone(),
            Values::I64(values) => values.iter().map(|value| *value as f64).collect(),
            Values::Bool(values) => values.iter().map(|value| f64::from(u8::from(*value))).collect(),
        }
    }

    /// The entry in `info.json`.
    pub(crate) fn describe(&self) -> Value {
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
    /// The entry in `info.json`.
    pub(crate) fn describe(&self) -> Value {
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
    /// The entry in `info.json`.
    pub(crate) fn describe(&self) -> Value {
        json!({
            "dtype": "image",
            "shape": [self.height, self.width, 1],
            "names": ["height", "width", "channels"],
            "info": {"is_depth_map": true, "depth_unit": "mm"},
        })
    }
}

/// The rows of one episode as a table: pictures first, then numbers.
pub(crate) fn batch(images: &[ImageFeature], features: &[Feature]) -> Result<RecordBatch, DataError> {
    let mut columns = Columns::default();
    for image in images {
        columns.images(&image.key, &image.png);
    }
    for feature in features {
        feature.add_to(&mut columns);
    }
    columns.batch().map_err(|error| DataError::table(Path::new("data"), error))
}
