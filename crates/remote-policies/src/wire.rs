//! Conversion between MessagePack and JSON.

use rmpv::Value;
use serde::Serialize;
use serde_json::{Map, Number, Value as Json};

use crate::numpy::Array;

/// Maximum nesting depth of a request. Bounds the recursion for hostile requests.
const MAX_DEPTH: usize = 16;

/// Decodes a request; arrays become lists of numbers.
///
/// # Errors
/// Describes the problem.
pub fn read(bytes: &[u8]) -> Result<Json, String> {
    let mut rest = bytes;
    let value = rmpv::decode::read_value_with_max_depth(&mut rest, MAX_DEPTH);
    let value = value.map_err(|error| format!("invalid MessagePack: {error}"))?;
    if !rest.is_empty() {
        return Err(format!("{} extra bytes after the request", rest.len()));
    }
    json(&value)
}

/// MessagePack encoding of a value.
pub fn encoded(value: &Value) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Writing to memory does not fail.
    let _ = rmpv::encode::write_value(&mut bytes, value);
    bytes
}

/// Converts a serialisable value; nil if it has no JSON form.
pub fn of(value: &impl Serialize) -> Value {
    serde_json::to_value(value).map_or(Value::Nil, |json| pack(&json))
}

/// Converts a message; arrays become lists of numbers.
///
/// # Errors
/// Describes the value that has no JSON form.
pub(crate) fn json(value: &Value) -> Result<Json, String> {
    Ok(match value {
        Value::Nil => Json::Null,
        Value::Boolean(yes) => Json::Bool(*yes),
        Value::Integer(number) => match (number.as_u64(), number.as_i64()) {
            (Some(number), _) => number.into(),
            (_, Some(number)) => number.into(),
            _ => Json::Null,
        },
        Value::F32(number) => real(f64::from(*number))?,
        Value::F64(number) => real(*number)?,
        Value::String(text) => Json::String(text.as_str().ok_or("a string that is not UTF-8")?.to_owned()),
        Value::Array(values) => Json::Array(values.iter().map(json).collect::<Result<_, _>>()?),
        Value::Map(entries) if is_array(entries) => {
            Json::Array(Array::read(value)?.reals().into_iter().map(real).collect::<Result<_, _>>()?)
        }
        Value::Map(entries) => {
            let entry = |(key, value): &(Value, Value)| {
                let key = key.as_str().ok_or("a key that is not a string")?;
                Ok((key.to_owned(), json(value)?))
            };
            Json::Object(entries.iter().map(entry).collect::<Result<Map<_, _>, String>>()?)
        }
        Value::Binary(_) => return Err("bytes are not supported here".into()),
        Value::Ext(..) => return Err("extension types are not supported".into()),
    })
}

fn is_array(entries: &[(Value, Value)]) -> bool {
    let name = "__ndarray__";
    entries.iter().any(|(key, _)| key.as_str() == Some(name) || key.as_slice() == Some(name.as_bytes()))
}

fn real(number: f64) -> Result<Json, String> {
    Number::from_f64(number).map(Json::Number).ok_or_else(|| format!("{number}, expected a finite number"))
}

fn pack(value: &Json) -> Value {
    match value {
        Json::Null => Value::Nil,
        Json::Bool(yes) => (*yes).into(),
        Json::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
            (Some(number), ..) => number.into(),
            (_, Some(number), _) => number.into(),
            (.., number) => number.map_or(Value::Nil, Value::from),
        },
        Json::String(text) => text.as_str().into(),
        Json::Array(values) => Value::Array(values.iter().map(pack).collect()),
        Json::Object(entries) => {
            Value::Map(entries.iter().map(|(key, value)| (Value::from(key.as_str()), pack(value))).collect())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_go_both_ways_and_arrays_become_lists() {
        let json = serde_json::json!({"a": [1, -2, 0.5, null, true], "b": {"c": "text"}});
        assert_eq!(read(&encoded(&pack(&json))), Ok(json));
        assert_eq!(read(&encoded(&Array::vector([1.0, 2.5]).value())), Ok(serde_json::json!([1.0, 2.5])));
    }

    #[test]
    fn what_is_no_request_is_named() {
        let deep = (0..40).fold(Value::Nil, |inner, _| Value::Array(vec![inner]));
        let cases = [
            (vec![], "invalid MessagePack"),
            (encoded(&deep), "invalid MessagePack"),
            (vec![0xc0, 0xc0], "1 extra bytes"),
            (encoded(&Value::F64(f64::NAN)), "expected a finite number"),
            (encoded(&Value::Binary(vec![1])), "bytes are not supported"),
            (encoded(&Value::Map(vec![(1.into(), 1.into())])), "a key that is not a string"),
            // An array that announces more elements than it contains.
            (vec![0xdd, 0xff, 0xff, 0xff, 0xff], "invalid MessagePack"),
        ];
        for (bytes, expected) in cases {
            let error = read(&bytes).unwrap_err();
            assert!(error.contains(expected), "{bytes:?}: {error}");
        }
    }
}
