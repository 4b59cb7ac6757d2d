//! MessagePack that is read as JSON, and JSON that is written as MessagePack.

use genmanip_remote_policies::numpy::Array;
use rmpv::Value;
use serde::Serialize;
use serde_json::{Map, Number, Value as Json};

/// Deepest nesting of a request.
const MAX_DEPTH: usize = 16;

/// A request; arrays are read as lists of their numbers.
///
/// # Errors
/// Says what is wrong.
pub(crate) fn read(bytes: &[u8]) -> Result<Json, String> {
    let mut rest = bytes;
    let value = rmpv::decode::read_value_with_max_depth(&mut rest, MAX_DEPTH);
    let value = value.map_err(|error| format!("no MessagePack: {error}"))?;
    if !rest.is_empty() {
        return Err(format!("{} bytes behind the request", rest.len()));
    }
    json(&value)
}

/// A value as bytes.
pub(crate) fn written(value: &Value) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Writing into memory does not fail.
    let _ = rmpv::encode::write_value(&mut bytes, value);
    bytes
}

/// A value of ours; nothing where it cannot be said in JSON.
pub(crate) fn of(value: &impl Serialize) -> Value {
    serde_json::to_value(value).map_or(Value::Nil, |json| pack(&json))
}

fn json(value: &Value) -> Result<Json, String> {
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
        Value::String(text) => Json::String(text.as_str().ok_or("a text that is no UTF-8")?.to_owned()),
        Value::Array(values) => Json::Array(values.iter().map(json).collect::<Result<_, _>>()?),
        Value::Map(entries) if is_array(entries) => {
            Json::Array(Array::read(value)?.reals().into_iter().map(real).collect::<Result<_, _>>()?)
        }
        Value::Map(entries) => {
            let entry = |(key, value): &(Value, Value)| {
                let key = key.as_str().ok_or("a key that is no text")?;
                Ok((key.to_owned(), json(value)?))
            };
            Json::Object(entries.iter().map(entry).collect::<Result<Map<_, _>, String>>()?)
        }
        Value::Binary(_) => return Err("bytes, where nothing takes any".into()),
        Value::Ext(..) => return Err("an extension type, where nothing takes any".into()),
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
        assert_eq!(read(&written(&pack(&json))), Ok(json));
        assert_eq!(read(&written(&Array::vector([1.0, 2.5]).value())), Ok(serde_json::json!([1.0, 2.5])));
    }

    #[test]
    fn what_is_no_request_is_named() {
        let deep = (0..40).fold(Value::Nil, |inner, _| Value::Array(vec![inner]));
        let cases = [
            (vec![], "no MessagePack"),
            (written(&deep), "no MessagePack"),
            (vec![0xc0, 0xc0], "1 bytes behind"),
            (written(&Value::F64(f64::NAN)), "expected a finite number"),
            (written(&Value::Binary(vec![1])), "bytes, where nothing"),
            (written(&Value::Map(vec![(1.into(), 1.into())])), "a key that is no text"),
            // An array that promises more than there is.
            (vec![0xdd, 0xff, 0xff, 0xff, 0xff], "no MessagePack"),
        ];
        for (bytes, expected) in cases {
            let error = read(&bytes).unwrap_err();
            assert!(error.contains(expected), "{bytes:?}: {error}");
        }
    }
}
