//! NumPy arrays in MessagePack, as in `msgpack_numpy` of openpi's client.
//!
//! An array is a map with the keys `__ndarray__` (true), `data` (bytes, C order), `dtype` (NumPy string, e.g. `<f4`)
//! and `shape`. openpi writes these keys as bytes; text keys are accepted as well.

use rmpv::Value;

/// Maximum number of elements of an array. Bounds memory for invalid messages.
const MAX_ELEMENTS: usize = 1 << 20;

/// NumPy array of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis.
    pub shape: Vec<usize>,
    /// The elements in C order.
    pub numbers: Numbers,
}

/// The elements of an array, by their type.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    /// dtype `|u1`.
    U8(Vec<u8>),
    /// dtype `<f4`.
    F32(Vec<f32>),
    /// dtype `<f8`.
    F64(Vec<f64>),
    /// dtype `<i4`.
    I32(Vec<i32>),
    /// dtype `<i8`.
    I64(Vec<i64>),
}

impl Array {
    /// One-dimensional array of `f64`.
    pub fn vector(numbers: impl IntoIterator<Item = f64>) -> Self {
        let numbers: Vec<f64> = numbers.into_iter().collect();
        Self { shape: vec![numbers.len()], numbers: Numbers::F64(numbers) }
    }

    /// An RGB image of shape [height, width, 3].
    pub fn picture(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        Self { shape: vec![height, width, 3], numbers: Numbers::U8(rgb) }
    }

    /// Elements converted to `f64`.
    pub fn reals(&self) -> Vec<f64> {
        match &self.numbers {
            Numbers::U8(numbers) => numbers.iter().map(|&number| f64::from(number)).collect(),
            Numbers::F32(numbers) => numbers.iter().map(|&number| f64::from(number)).collect(),
            Numbers::F64(numbers) => numbers.clone(),
            Numbers::I32(numbers) => numbers.iter().map(|&number| f64::from(number)).collect(),
            Numbers::I64(numbers) => numbers.iter().map(|&number| number as f64).collect(),
        }
    }

    /// MessagePack value with byte keys, as openpi's client encodes it.
    pub fn value(&self) -> Value {
        self.value_with(|name| Value::Binary(name.as_bytes().to_vec()))
    }

    /// MessagePack value with text keys, as vla-eval encodes it.
    pub fn value_with_text_keys(&self) -> Value {
        self.value_with(Value::from)
    }

    fn value_with(&self, key: impl Fn(&'static str) -> Value) -> Value {
        let (dtype, data) = match &self.numbers {
            Numbers::U8(numbers) => ("|u1", numbers.clone()),
            Numbers::F32(numbers) => ("<f4", numbers.iter().flat_map(|number| number.to_le_bytes()).collect()),
            Numbers::F64(numbers) => ("<f8", numbers.iter().flat_map(|number| number.to_le_bytes()).collect()),
            Numbers::I32(numbers) => ("<i4", numbers.iter().flat_map(|number| number.to_le_bytes()).collect()),
            Numbers::I64(numbers) => ("<i8", numbers.iter().flat_map(|number| number.to_le_bytes()).collect()),
        };
        Value::Map(vec![
            (key("__ndarray__"), true.into()),
            (key("data"), Value::Binary(data)),
            (key("dtype"), dtype.into()),
            (key("shape"), Value::Array(self.shape.iter().map(|&length| length.into()).collect())),
        ])
    }

    /// Decodes an array.
    ///
    /// # Errors
    /// Description of the problem.
    pub fn read(value: &Value) -> Result<Self, String> {
        let entry = |name: &str| get(value, name).ok_or_else(|| format!("an array without `{name}`"));
        if entry("__ndarray__")?.as_bool() != Some(true) {
            return Err("`__ndarray__` is not true".into());
        }
        let axes = entry("shape")?.as_array().ok_or("its shape is not a list")?;
        let axes: Option<Vec<usize>> =
            axes.iter().map(|axis| axis.as_u64().and_then(|axis| usize::try_from(axis).ok())).collect();
        let shape = axes.ok_or("its shape has other values than whole numbers")?;
        let count = shape.iter().try_fold(1_usize, |count, axis| count.checked_mul(*axis));
        let count =
            count.filter(|count| *count <= MAX_ELEMENTS).ok_or_else(|| format!("more than {MAX_ELEMENTS} elements"))?;
        let data = entry("data")?.as_slice().ok_or("its data is not bytes")?;
        let dtype = entry("dtype")?.as_str().ok_or("its dtype is not a string")?;
        let numbers = match dtype {
            "|u1" => Numbers::U8(data.to_vec()),
            "<f4" => Numbers::F32(words(data).map(f32::from_le_bytes).collect()),
            "<f8" => Numbers::F64(words(data).map(f64::from_le_bytes).collect()),
            "<i4" => Numbers::I32(words(data).map(i32::from_le_bytes).collect()),
            "<i8" => Numbers::I64(words(data).map(i64::from_le_bytes).collect()),
            other => {
                let other: String = other.chars().take(20).collect();
                return Err(format!("dtype `{other}`, expected one of |u1, <f4, <f8, <i4, <i8"));
            }
        };
        let width = match numbers {
            Numbers::U8(_) => 1,
            Numbers::F32(_) | Numbers::I32(_) => 4,
            Numbers::F64(_) | Numbers::I64(_) => 8,
        };
        if data.len() != count * width {
            return Err(format!("{} bytes of data, expected {} of shape {shape:?}", data.len(), count * width));
        }
        Ok(Self { shape, numbers })
    }
}

/// Value of a key in a map with text or byte keys; `None` if it is missing.
pub(crate) fn get<'a>(map: &'a Value, name: &str) -> Option<&'a Value> {
    let is_named = |key: &Value| key.as_str() == Some(name) || key.as_slice() == Some(name.as_bytes());
    map.as_map()?.iter().find(|(key, _)| is_named(key)).map(|(_, value)| value)
}

fn words<const N: usize>(data: &[u8]) -> impl Iterator<Item = [u8; N]> + '_ {
    data.chunks_exact(N).filter_map(|word| word.try_into().ok())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes(value: &Value) -> Vec<u8> {
        let mut bytes = Vec::new();
        rmpv::encode::write_value(&mut bytes, value).unwrap();
        bytes
    }

    /// Bytes of Python's openpi client for `{"observation/state": float32 zeros(2), "prompt": "x", "n": 1.5}`.
    #[test]
    fn bytes_are_those_of_the_python_client() {
        let state = Array { shape: vec![2], numbers: Numbers::F32(vec![0.0, 0.0]) };
        let value = Value::Map(vec![
            ("observation/state".into(), state.value()),
            ("prompt".into(), "x".into()),
            ("n".into(), 1.5.into()),
        ]);
        let hex: String = bytes(&value).iter().map(|byte| format!("{byte:02x}")).collect();
        let expected = "83b16f62736572766174696f6e2f737461746584c40b5f5f6e6461727261795f5fc3c40464617461c408000000000000\
                        0000c4056474797065a33c6634c40573686170659102a670726f6d7074a178a16ecb3ff8000000000000";
        assert_eq!(hex, expected);
    }

    proptest! {
        #[test]
        fn arrays_come_back(rows in 0_usize..4, columns in 0_usize..4, seed in any::<[f64; 16]>()) {
            let numbers: Vec<f64> = seed[..rows * columns].to_vec();
            let array = Array { shape: vec![rows, columns], numbers: Numbers::F64(numbers) };
            let sent = bytes(&array.value());
            let received = rmpv::decode::read_value(&mut sent.as_slice()).unwrap();
            prop_assert_eq!(bytes(&Array::read(&received).unwrap().value()), sent);
        }
    }

    #[test]
    fn what_is_no_array_is_named() {
        let array = |shape: Vec<Value>, dtype: &str, data: &[u8]| {
            Value::Map(vec![
                ("__ndarray__".into(), true.into()),
                ("data".into(), Value::Binary(data.to_vec())),
                ("dtype".into(), dtype.into()),
                ("shape".into(), Value::Array(shape)),
            ])
        };
        assert!(Array::read(&array(vec![2.into()], "<f4", &[0; 8])).is_ok(), "keys may be texts");
        let cases = [
            (Value::Nil, "an array without `__ndarray__`"),
            (array(vec![3.into()], "<f4", &[0; 8]), "8 bytes of data, expected 12 of shape [3]"),
            (array(vec![(-1).into()], "<f4", &[0; 8]), "other values than whole numbers"),
            (array(vec![u64::MAX.into(), 2.into()], "<f4", &[]), "more than 1048576 elements"),
            (array(vec![1.into()], "|O", &[0; 8]), "dtype `|O`, expected one of"),
        ];
        for (value, expected) in cases {
            let error = Array::read(&value).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
