//! Readable differences between two JSON values, and shortened lists of names.

use serde_json::Value;

/// First path at which two JSON values differ, with both values as text; `None` if they are equal. `place` is the path
/// of the root.
pub fn first_difference(place: &str, known: &Value, asked: &Value) -> Option<String> {
    if known == asked {
        return None;
    }
    let deeper = match (known, asked) {
        (Value::Object(a), Value::Object(b)) => {
            let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.filter_map(|key| first_difference(&format!("{place}.{key}"), &known[key], &asked[key])).next()
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let pairs = a.iter().zip(b).enumerate();
            pairs.filter_map(|(index, (a, b))| first_difference(&format!("{place}[{index}]"), a, b)).next()
        }
        (Value::Array(a), Value::Array(b)) => Some(format!("{place} has {} entries, not {}", a.len(), b.len())),
        _ => None,
    };
    let word = |value: &Value| match value {
        Value::Null => "none".to_owned(),
        Value::Object(_) | Value::Array(_) => "set".to_owned(),
        value => value.to_string().chars().take(60).collect(),
    };
    Some(deeper.unwrap_or_else(|| format!("{place} is {}, not {}", word(known), word(asked))))
}

/// The first three names, and the number of further ones, as text.
pub fn listed(names: &[String]) -> String {
    let more = names.len().saturating_sub(3);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", names.iter().take(3).map(String::as_str).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_first_difference_is_named_with_its_place() {
        let known = json!({"images": {"fps": 10}, "list": [1, 2], "kept": true});
        for (asked, expected) in [
            (json!({"images": {"fps": 15}, "list": [1, 2], "kept": true}), "settings.images.fps is 10, not 15"),
            (json!({"images": null, "list": [1, 2], "kept": true}), "settings.images is set, not none"),
            (json!({"images": {"fps": 10}, "list": [1, 3], "kept": true}), "settings.list[1] is 2, not 3"),
            (json!({"images": {"fps": 10}, "list": [1], "kept": true}), "settings.list has 2 entries, not 1"),
            (json!({"images": {"fps": 10}, "list": [1, 2]}), "settings.kept is true, not none"),
        ] {
            assert_eq!(first_difference("settings", &known, &asked).as_deref(), Some(expected));
        }
        assert_eq!(first_difference("settings", &known, &known), None);
    }
}
