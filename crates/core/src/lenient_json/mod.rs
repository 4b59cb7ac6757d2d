//! JSON as written by language models: within prose and code fences, encoded again as a JSON string, with unambiguous
//! syntax errors.
//!
//! Every reader of model answers uses this module. Its results are candidates; the caller checks that there is exactly
//! one.

mod parser;

use std::borrow::Cow;

use serde_json::Value;

use parser::parse;
pub use parser::{Failure, Parsed};

/// Maximum number of code fences.
const MAX_FENCES: usize = 16;
/// Maximum number of nested encodings that are decoded, of JSON inside JSON strings.
const MAX_ENCODINGS: usize = 3;
/// Name of the deviation of a value that was encoded as a string.
const ENCODED_TWICE: &str = "JSON within a text";

/// Kinds of outermost values that may be an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Objects only; lists are searched for objects.
    Objects,
    /// Objects and lists, whichever is outermost.
    ObjectsAndLists,
}

/// The outermost values of a text, in order. If the text has code fences that hold JSON, only those within the fences.
///
/// At most `max_values` JSON values are parsed, so the time is linear in the length of the text.
///
/// ```
/// use genmanip_core::lenient_json::{Wanted, find};
///
/// let text = "Sure:\n```JSON\n{number: '2',}\n```\nDone.";
/// let [Ok(found)] = &find(text, Wanted::Objects, 100)[..] else { panic!() };
/// assert_eq!(found.value, serde_json::json!({"number": "2"}));
/// ```
pub fn find(text: &str, wanted: Wanted, max_values: usize) -> Vec<Result<Parsed, Failure>> {
    let fences = fences(text);
    let regions = if fences.is_empty() { vec![(0, text.len())] } else { fences };
    let mut budget = max_values;
    let mut found = Vec::new();
    for (start, end) in regions {
        scan(text, (start, end), wanted, &mut budget, &mut found);
    }
    found
}

/// The text itself; if it is one JSON string that holds JSON, bare or in a code fence, the content of that string.
pub fn decoded(text: &str) -> Cow<'_, str> {
    let mut decoded = Cow::Borrowed(text);
    for _ in 0..MAX_ENCODINGS {
        let bare = decoded.trim();
        let fenced = bare.strip_prefix("```").and_then(|rest| rest.strip_suffix("```"));
        let bare = fenced.map_or(bare, |rest| rest.trim_start_matches(|letter: char| letter.is_ascii_alphanumeric()));
        let bare = bare.trim();
        if !bare.starts_with('"') {
            break;
        }
        match serde_json::from_str::<String>(bare) {
            Ok(inner) if inner.contains(['{', '[']) => decoded = Cow::Owned(inner),
            _ => break,
        }
    }
    decoded
}

/// Byte ranges of the code fences that begin with JSON.
fn fences(text: &str) -> Vec<(usize, usize)> {
    let mut regions = Vec::new();
    let mut at = 0;
    while regions.len() < MAX_FENCES
        && let Some(open) = text[at..].find("```").map(|offset| at + offset + 3)
    {
        let info = text[open..].bytes().take_while(|byte| byte.is_ascii_alphanumeric()).count();
        let start = open + info;
        let end = text[start..].find("```").map_or(text.len(), |offset| start + offset);
        let content = text[start..end].trim_start();
        if content.starts_with(['{', '[']) || content.starts_with("//") || content.starts_with("/*") {
            regions.push((start, end));
        }
        at = (end + 3).min(text.len());
    }
    regions
}

/// Tries to parse at every opening bracket outside parsed values; continues after the position of a failure, so that the
/// time is linear in the length of the text.
fn scan(
    text: &str,
    (start, end): (usize, usize),
    wanted: Wanted,
    budget: &mut usize,
    found: &mut Vec<Result<Parsed, Failure>>,
) {
    let text = &text[..end];
    let opens: &[char] = match wanted {
        Wanted::Objects => &['{'],
        Wanted::ObjectsAndLists => &['{', '['],
    };
    let mut at = start;
    while let Some(open) = text[at..].find(opens).map(|offset| at + offset) {
        // Each attempt has a cost, so that a megabyte of braces is soon abandoned.
        *budget = budget.saturating_sub(64);
        let mut result = match *budget {
            0 => Err(Failure::TooManyValues { at: open }),
            _ => parse(text, open, budget),
        };
        if let Ok(parsed) = &mut result
            && open_texts(&mut parsed.value, MAX_ENCODINGS)
        {
            parsed.sloppy.push((ENCODED_TWICE, open));
        }
        let exhausted = matches!(result, Err(Failure::TooManyValues { .. }));
        let next = match &result {
            Ok(parsed) => parsed.end,
            Err(failure) => failure.at().max(open + 1),
        };
        found.push(result);
        if exhausted {
            return;
        }
        at = (next..=end).find(|&index| text.is_char_boundary(index)).unwrap_or(end);
    }
}

/// Replaces strings that hold one JSON object or list by that value; true if any was replaced.
fn open_texts(value: &mut Value, encodings: usize) -> bool {
    match value {
        Value::String(text) if encodings > 0 => {
            let bare = text.trim();
            let is_json = bare.starts_with('{') && bare.ends_with('}') || bare.starts_with('[') && bare.ends_with(']');
            let Some(mut inner) = is_json.then(|| serde_json::from_str(bare).ok()).flatten() else { return false };
            open_texts(&mut inner, encodings - 1);
            *value = inner;
            true
        }
        Value::Array(items) => open_each(items.iter_mut(), encodings),
        Value::Object(fields) => open_each(fields.values_mut(), encodings),
        Value::String(_) | Value::Null | Value::Bool(_) | Value::Number(_) => false,
    }
}

fn open_each<'a>(values: impl Iterator<Item = &'a mut Value>, encodings: usize) -> bool {
    let mut is_any_open = false;
    for value in values {
        is_any_open |= open_texts(value, encodings);
    }
    is_any_open
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Values of a text, and the number of failures.
    fn values(text: &str, wanted: Wanted) -> (Vec<Value>, usize) {
        let found = find(&decoded(text), wanted, 1000);
        let failures = found.iter().filter(|found| found.is_err()).count();
        (found.into_iter().flatten().map(|parsed| parsed.value).collect(), failures)
    }

    #[test]
    fn answers_as_models_wrap_them() {
        let one = json!({"a": [1, "b"]});
        let plain = one.to_string();
        let quoted = json!(plain).to_string();
        for text in [
            plain.clone(),
            format!("Here it is: {plain}. Anything else?"),
            format!("Here it is:\n```json\n{plain}\n```\nIs {{this}} good?"),
            format!("```JSON\n{plain}\n```"),
            format!("~~~\n{plain}"),
            quoted.clone(),
            format!("```json\n{quoted}\n```"),
            json!(quoted).to_string(),
            plain.replace('"', "'"),
            plain.replace("]}", ",],}"),
        ] {
            let (found, _) = values(&text, Wanted::Objects);
            assert_eq!(found, std::slice::from_ref(&one), "{text}");
        }
        assert_eq!(values(&format!("[{plain}, {plain}]"), Wanted::Objects).0, [one.clone(), one.clone()]);
        assert_eq!(values(&format!("see [{plain}]"), Wanted::ObjectsAndLists).0, [json!([one])]);
        let nested = json!({"task": quoted}).to_string();
        assert_eq!(values(&nested, Wanted::Objects).0, [json!({"task": quoted})], "a text in a text in a text stays");
        let nested = json!({"task": plain, "note": "[sic]"}).to_string();
        assert_eq!(values(&nested, Wanted::Objects).0, [json!({"task": one, "note": "[sic]"})]);
        for (text, failures) in [("", 0), ("no answer", 0), ("{\"a\": 1", 1), ("{a b}", 1), ("\"{\"", 1)] {
            assert_eq!(values(text, Wanted::ObjectsAndLists), (vec![], failures), "{text}");
        }
    }

    #[test]
    fn a_text_of_brackets_is_soon_abandoned() {
        for text in ["{".repeat(1 << 20), "[".repeat(1 << 20), "{\"a\":".repeat(1 << 17)] {
            assert!(find(&text, Wanted::ObjectsAndLists, 10_000).len() < 200);
        }
    }
}
