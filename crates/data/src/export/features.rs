//! Features: named columns of a data set, with the values of one episode.

use crate::{ColorHistogram, EncodedVideo};

/// Numeric column, one vector per frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Feature {
    pub(crate) key: String,
    /// Names of the vector's elements; empty for scalars.
    pub(crate) names: Vec<String>,
    pub(crate) values: Values,
}

/// Column values, frame-major.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    F32(Vec<f32>),
    F64(Vec<f64>),
    I64(Vec<i64>),
    Bool(Vec<bool>),
}

/// Video column.
#[derive(Clone, Debug)]
pub(crate) struct VideoFeature {
    pub(crate) key: String,
    pub(crate) video: EncodedVideo,
    pub(crate) colors: ColorHistogram,
}

/// Depth image column, stored in the table.
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

    /// The values as `f64`, for statistics.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        match &self.values {
            Values::F32(values) => values.iter().map(|value| f64::from(*value)).collect(),
            Values::F64(values) => values.clone(),
            Values::I64(values) => values.iter().map(|value| *value as f64).collect(),
            Values::Bool(values) => values.iter().map(|value| f64::from(u8::from(*value))).collect(),
        }
    }
}
