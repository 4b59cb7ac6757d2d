//! Named arrays of a network, and their files in safetensors format.

use std::collections::BTreeMap;

use genmanip_core::hexadecimal;
use half::f16;
use safetensors::{Dtype, SafeTensors};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// Named single-precision arrays in row-major order; the order of the arrays is fixed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters {
    /// Name, shape and values of each array.
    pub arrays: Vec<Array>,
}

/// Named tensor of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Name, e.g. `encoder.0.attention.query.weight`.
    pub name: String,
    /// Length along each dimension.
    pub shape: Vec<usize>,
    /// Values in row-major order.
    pub values: Vec<f32>,
}

/// Floating-point format of the values in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Single precision, 32 bits.
    Single,
    /// 16 bits (IEEE 754 binary16); exact for values of [`Parameters::rounded_to_half`].
    Half,
}

impl Precision {
    const fn name(self) -> &'static str {
        match self {
            Self::Single => "F32",
            Self::Half => "F16",
        }
    }

    /// Number of bytes per value.
    const fn size(self) -> usize {
        match self {
            Self::Single => 4,
            Self::Half => 2,
        }
    }
}

/// Reason why a file of arrays is refused.
#[derive(Debug, thiserror::Error)]
pub enum ParametersError {
    /// The file is not in safetensors format.
    #[error("not a safetensors file")]
    Format(#[from] safetensors::SafeTensorError),
    /// An array is missing or has another shape.
    #[error("array `{name}`: expected shape {expected:?} of 32-bit or 16-bit floats, got {got}")]
    Array {
        /// Name of the array.
        name: String,
        /// Shape in the network.
        expected: Vec<usize>,
        /// Shape and type in the file.
        got: String,
    },
    /// A value of the named array is NaN or infinite.
    #[error("array `{0}` holds a value that is not finite")]
    NotFinite(String),
}

impl Parameters {
    /// Total number of values of all arrays.
    pub fn count(&self) -> usize {
        self.arrays.iter().map(|array| array.values.len()).sum()
    }

    /// SHA-256 of names, shapes and values in the order of the names, hexadecimal.
    pub fn sha256(&self) -> String {
        let mut hasher = Sha256::new();
        let sorted: BTreeMap<&str, &Array> = self.arrays.iter().map(|array| (array.name.as_str(), array)).collect();
        for (name, Array { shape, values, .. }) in sorted {
            hasher.update(format!("{name} {shape:?}\n"));
            values.iter().for_each(|value| hasher.update(value.to_le_bytes()));
        }
        hexadecimal(&hasher.finalize())
    }

    /// The same arrays with every value rounded to the nearest half-precision (binary16) value.
    #[must_use]
    pub fn rounded_to_half(mut self) -> Self {
        let values = self.arrays.iter_mut().flat_map(|array| &mut array.values);
        values.for_each(|value| *value = f16::from_f32(*value).to_f32());
        self
    }

    /// Bytes of a safetensors file: arrays sorted by name and metadata sorted by key, so that equal arrays give equal
    /// bytes.
    pub fn to_bytes(&self, precision: Precision, metadata: &BTreeMap<String, String>) -> Vec<u8> {
        let mut sorted: Vec<&Array> = self.arrays.iter().collect();
        sorted.sort_by(|one, other| one.name.cmp(&other.name));
        let (mut header, mut end) = (Map::new(), 0);
        header.insert("__metadata__".into(), json!(metadata));
        for Array { name, shape, values } in &sorted {
            let begin = end;
            end += values.len() * precision.size();
            header.insert(
                name.clone(),
                json!({ "dtype": precision.name(), "shape": shape, "data_offsets": [begin, end] }),
            );
        }
        let mut header = Value::Object(header).to_string().into_bytes();
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut bytes = Vec::with_capacity(8 + header.len() + end);
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header);
        for value in sorted.into_iter().flat_map(|array| &array.values) {
            match precision {
                Precision::Single => bytes.extend(value.to_le_bytes()),
                Precision::Half => bytes.extend(f16::from_f32(*value).to_le_bytes()),
            }
        }
        bytes
    }

    /// Values read from a file for the arrays of this network, stored under names with a prefix; other arrays in the
    /// file are ignored.
    ///
    /// # Errors
    /// If the file is damaged, or an array is missing, has another shape or a value that is not finite.
    pub fn from_bytes(&self, bytes: &[u8], prefix: &str) -> Result<Self, ParametersError> {
        let file = SafeTensors::deserialize(bytes)?;
        let read = |Array { name, shape, .. }: &Array| {
            let (name, expected) = (format!("{prefix}{name}"), shape.clone());
            let wrong = |got: String| ParametersError::Array { name: name.clone(), expected: expected.clone(), got };
            let found = file.tensor(&name).map_err(|_| wrong("none".into()))?;
            let values: Vec<f32> = match found.dtype() {
                Dtype::F32 if found.shape() == shape => {
                    found.data().as_chunks().0.iter().map(|number| f32::from_le_bytes(*number)).collect()
                }
                Dtype::F16 if found.shape() == shape => {
                    found.data().as_chunks().0.iter().map(|number| f16::from_le_bytes(*number).to_f32()).collect()
                }
                other => return Err(wrong(format!("{:?} of {other:?}", found.shape()))),
            };
            if values.iter().any(|value| !value.is_finite()) {
                return Err(ParametersError::NotFinite(name));
            }
            Ok(Array { name: name[prefix.len()..].into(), shape: shape.clone(), values })
        };
        Ok(Self { arrays: self.arrays.iter().map(read).collect::<Result<_, _>>()? })
    }

    /// Metadata of a safetensors file.
    ///
    /// # Errors
    /// If it is not a safetensors file.
    pub fn metadata(bytes: &[u8]) -> Result<BTreeMap<String, String>, ParametersError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes)?;
        Ok(metadata.metadata().clone().unwrap_or_default().into_iter().collect())
    }

    /// The same names (with a prefix) and shapes, with other values.
    pub(crate) fn with(&self, prefix: &str, values: &[Vec<f32>]) -> impl Iterator<Item = Array> {
        let arrays = self.arrays.iter().zip(values);
        arrays.map(move |(Array { name, shape, .. }, values)| Array {
            name: format!("{prefix}{name}"),
            shape: shape.clone(),
            values: values.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_as_written_or_refused() {
        let array = |name: &str, shape: &[usize], values: &[f32]| Array {
            name: name.into(),
            shape: shape.to_vec(),
            values: values.to_vec(),
        };
        let written =
            Parameters { arrays: vec![array("b", &[3], &[1.0, -2.5, 1e-30]), array("a", &[2, 1], &[0.1, 0.2])] };
        let metadata = BTreeMap::from([("step".into(), "7".into()), ("a".into(), "b".into())]);
        let bytes = written.to_bytes(Precision::Single, &metadata);
        assert_eq!(written.from_bytes(&bytes, "").unwrap(), written);
        let rounded = written.clone().rounded_to_half();
        assert_ne!(rounded, written);
        let half = rounded.to_bytes(Precision::Half, &metadata);
        assert_eq!((half.len(), bytes.len() - half.len()), (bytes.len() - 10, 10), "five values of two bytes less");
        assert_eq!(written.from_bytes(&half, "").unwrap(), rounded);
        assert_eq!(Parameters::metadata(&bytes).unwrap(), metadata);
        let refused = |wanted: Array, bytes: &[u8]| {
            Parameters { arrays: vec![wanted] }.from_bytes(bytes, "").unwrap_err().to_string()
        };
        assert!(refused(array("c", &[1], &[]), &bytes).contains("got none"));
        assert!(
            refused(array("b", &[1], &[]), &bytes).contains("expected shape [1] of 32-bit or 16-bit floats, got [3]")
        );
        let endless = Parameters { arrays: vec![array("b", &[1], &[f32::NAN])] }.to_bytes(Precision::Single, &metadata);
        assert!(refused(array("b", &[1], &[]), &endless).contains("not finite"));
        for cut in [0, 7, 20, bytes.len() - 1] {
            assert!(written.from_bytes(&bytes[..cut], "").is_err(), "cut at {cut}");
        }
        let mut other = written.clone();
        other.arrays.reverse();
        assert_eq!(other.sha256(), written.sha256());
        other.arrays[0].values[0] = 0.3;
        assert_ne!(other.sha256(), written.sha256());
    }
}
