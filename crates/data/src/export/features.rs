//! Features: named columns of a data set, with the numbers of one episode.

use crate::{ColorHistogram, EncodedVideo};

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
}
