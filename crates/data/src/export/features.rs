//! Features: named columns of a data set, with the values of one episode.

use crate::{ColorHistogram, EncodedVideo};

/// Numeric column, one vector per frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Name of the column, e.g. `observation.state`.
    pub key: String,
    /// Names of the vector's elements; empty for scalars.
    pub names: Vec<String>,
    /// Values of all rows, one vector per row.
    pub values: Values,
}

/// Values of a numeric column, one row after another.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Stored as 32-bit floats.
    F32(Vec<f32>),
    /// Stored as 64-bit floats.
    F64(Vec<f64>),
    /// Stored as signed 64-bit integers.
    I64(Vec<i64>),
    /// Stored as Booleans; in HDF5 as the 8-bit integers 0 and 1.
    Bool(Vec<bool>),
}

/// Video column of one camera.
#[derive(Clone, Debug)]
pub struct VideoFeature {
    /// Name of the column, e.g. `observation.images.static`.
    pub key: String,
    /// One frame per row.
    pub video: EncodedVideo,
    /// Colour histogram of all frames, for the statistics.
    pub colors: ColorHistogram,
}

/// Image column of depth or masks, stored in the table.
#[derive(Clone, Debug)]
pub struct ImageFeature {
    /// Name of the column, e.g. `observation.images.static_depth`.
    pub key: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// PNG file of each row; depth is 16-bit, mm, 0 = no return.
    pub png: Vec<Vec<u8>>,
}

impl Feature {
    /// A column with one name per component.
    pub fn new(key: &str, names: &[&str], values: Values) -> Self {
        Self { key: key.into(), names: names.iter().map(|&name| name.to_owned()).collect(), values }
    }

    /// Number of elements per row, 1 for scalars.
    pub fn length(&self) -> usize {
        self.names.len().max(1)
    }

    /// The values as `f64`, for statistics.
    pub fn numbers(&self) -> Vec<f64> {
        match &self.values {
            Values::F32(values) => values.iter().map(|value| f64::from(*value)).collect(),
            Values::F64(values) => values.clone(),
            Values::I64(values) => values.iter().map(|value| *value as f64).collect(),
            Values::Bool(values) => values.iter().map(|value| f64::from(u8::from(*value))).collect(),
        }
    }
}
