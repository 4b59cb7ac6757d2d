//! Mutations of text, JSON and bytes: blind ones, and ones that respect the format.

use std::path::Path;

use genmanip_core::hexadecimal;
use rand::{Rng, RngExt};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// Numbers of mutations per input, one of which is drawn.
pub const CHANGES: [usize; 6] = [1, 1, 1, 2, 3, 8];

/// Mutates a file in one place: with probability 3/4 within the format that its extension names, otherwise bytewise.
pub fn file(name: &str, bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    let is_blind = rng.random_bool(0.25);
    match Path::new(name).extension().and_then(|ending| ending.to_str()) {
        Some("json" | "jsonl" | "gltf") if !is_blind => json(bytes, rng),
        Some("toml" | "urdf" | "srdf" | "obj" | "mtl" | "xml") if !is_blind => tokens(bytes, rng),
        Some("txt") if !is_blind => words(bytes, rng),
        _ => blind(bytes, rng),
    }
}

/// Updates size and hash of a file in the record of its episode, so that its mutation passes the integrity check.
pub fn hash_again(record: &mut Vec<u8>, name: &str, bytes: &[u8]) {
    let Ok(mut value) = serde_json::from_slice::<Value>(record) else { return };
    let listed = value.get_mut("files").and_then(Value::as_array_mut).into_iter().flatten();
    for entry in listed.filter(|entry| entry["name"] == name) {
        entry["bytes"] = bytes.len().into();
        let digest = hexadecimal(&Sha256::digest(bytes));
        entry["sha256"] = digest.into();
    }
    *record = value.to_string().into_bytes();
}

/// Numbers that parsers and computations often mishandle, as text.
const NUMBERS: [&str; 26] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "2",
    "255",
    "65536",
    "2147483648",
    "-2147483649",
    "4294967296",
    "9007199254740993",
    "18446744073709551615",
    "18446744073709551616",
    "1e308",
    "-1e308",
    "1e-320",
    "1e9",
    "1e5",
    "1000",
    "0.001",
    "1e-6",
    "-0.5",
    "NaN",
    "inf",
    "-inf",
    "1e999",
];
/// Strings that parsers and file systems often mishandle.
const TEXTS: [&str; 14] = [
    "",
    " ",
    "..",
    ".",
    "../../outside/canary",
    "../outside/victim",
    "/etc/passwd",
    "/dev/zero",
    "a/b",
    "\u{0}",
    "\u{202e}x",
    "none",
    "001",
    "é\u{1F600}",
];

pub(super) fn number(rng: &mut impl Rng) -> &'static str {
    NUMBERS[rng.random_range(0..NUMBERS.len())]
}

fn text(rng: &mut impl Rng) -> String {
    match rng.random_range(0..TEXTS.len() + 2) {
        0 => "x".repeat(rng.random_range(1..20_000)),
        1 => format!("{}.json", "y".repeat(300)),
        index => TEXTS[index - 2].into(),
    }
}

/// Random JSON value, such as null, a problematic number or an empty list.
fn value(rng: &mut impl Rng) -> Value {
    match rng.random_range(0..9) {
        0 => Value::Null,
        1 => true.into(),
        2 => json!([]),
        3 => json!({}),
        4 => json!([1, [2, [3, {"a": []}]]]),
        5 | 6 => text(rng).into(),
        _ => serde_json::from_str(number(rng)).unwrap_or_else(|_| 1e300.into()),
    }
}

/// Mutates a JSON text in one place; a text that is no valid JSON is mutated bytewise.
fn json(bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    let Ok(mut document) = serde_json::from_slice::<Value>(bytes) else { return blind(bytes, rng) };
    let count = count(&document);
    let mut place = rng.random_range(0..count);
    change(&mut document, &mut place, rng);
    *bytes = document.to_string().into_bytes();
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(items) => items.iter().map(count).sum(),
        Value::Object(entries) => entries.values().map(count).sum(),
        _ => 0,
    }
}

/// Mutates the value that comes `place` positions after this one in document order; true if it was reached.
fn change(value: &mut Value, place: &mut usize, rng: &mut impl Rng) -> bool {
    if *place == 0 {
        replace(value, rng);
        return true;
    }
    *place -= 1;
    match value {
        Value::Array(items) => items.iter_mut().any(|item| change(item, place, rng)),
        Value::Object(entries) => entries.values_mut().any(|item| change(item, place, rng)),
        _ => false,
    }
}

fn replace(place: &mut Value, rng: &mut impl Rng) {
    match place {
        Value::Number(number) if rng.random_bool(0.4) => {
            let factor = [1000.0, 0.001, -1.0, 1.0 + 1e-9, 1e30, 0.0][rng.random_range(0..6)];
            *place = json!(number.as_f64().unwrap_or(1.0) * factor);
        }
        Value::Array(items) if !items.is_empty() && rng.random_bool(0.7) => {
            let index = rng.random_range(0..items.len());
            match rng.random_range(0..4) {
                0 => drop(items.remove(index)),
                1 => {
                    let copies = [1, 2, 10, 300][rng.random_range(0..4)];
                    let item = items[index].clone();
                    items.extend(std::iter::repeat_n(item, copies));
                }
                2 => {
                    let other = rng.random_range(0..items.len());
                    items.swap(index, other);
                }
                _ => items[index] = value(rng),
            }
        }
        Value::Object(entries) if !entries.is_empty() && rng.random_bool(0.7) => {
            let index = rng.random_range(0..entries.len());
            let key = entries.keys().nth(index).cloned().unwrap_or_default();
            match rng.random_range(0..4) {
                0 => drop(entries.shift_remove(&key)),
                1 => drop(entries.insert(text(rng), value(rng))),
                2 => {
                    let inside = entries.shift_remove(&key).unwrap_or_default();
                    entries.insert(format!("{key}x"), inside);
                }
                _ => {
                    let inside: Map<String, Value> = entries.clone();
                    entries.insert(key, Value::Object(inside));
                }
            }
        }
        place => *place = value(rng),
    }
}

/// Mutates a tokenised text (TOML, XML, OBJ) in one place: a number, a quoted string, or a line.
fn tokens(bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    let Ok(text) = String::from_utf8(bytes.clone()) else { return blind(bytes, rng) };
    let changed = match rng.random_range(0..6) {
        0..=2 => in_one(&text, &spans(&text, |c| c.is_ascii_digit() || "+-.eE".contains(c)), rng, &|_, rng| {
            number(rng).to_owned()
        }),
        3 => in_one(&text, &quoted(&text), rng, &|_, rng| self::text(rng)),
        4 => in_one(&text, &quoted(&text), rng, &|old, rng| {
            let other = quoted(&text);
            other
                .get(rng.random_range(0..other.len().max(1)))
                .map_or(old.to_owned(), |&(from, to)| text[from..to].to_owned())
        }),
        _ => {
            let mut lines: Vec<&str> = text.lines().collect();
            if lines.is_empty() {
                return blind(bytes, rng);
            }
            let index = rng.random_range(0..lines.len());
            match rng.random_range(0..3) {
                0 => drop(lines.remove(index)),
                1 => {
                    let copies = [1, 3, 600][rng.random_range(0..3)];
                    let line = lines[index];
                    lines.splice(index..index, std::iter::repeat_n(line, copies));
                }
                _ => {
                    let other = rng.random_range(0..lines.len());
                    lines.swap(index, other);
                }
            }
            lines.join("\n")
        }
    };
    *bytes = changed.into_bytes();
}

/// Leaves out, repeats, exchanges or replaces a word.
fn words(bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let mut words: Vec<&str> = text.split_whitespace().collect();
    if words.is_empty() {
        return blind(bytes, rng);
    }
    let [index, other] = [(); 2].map(|()| rng.random_range(0..words.len()));
    let new = self::text(rng);
    match rng.random_range(0..4) {
        0 => drop(words.remove(index)),
        1 => {
            let copies = [1, 3, 600][rng.random_range(0..3)];
            let word = words[index];
            words.splice(index..index, std::iter::repeat_n(word, copies));
        }
        2 => words.swap(index, other),
        _ => words[index] = &new,
    }
    *bytes = words.join(" ").into_bytes();
}

/// Replaces one random span (start and end, bytes) of a text; the text unchanged if there are none.
fn in_one<R: Rng>(text: &str, spans: &[(usize, usize)], rng: &mut R, new: &dyn Fn(&str, &mut R) -> String) -> String {
    if spans.is_empty() {
        return text.to_owned();
    }
    let (from, to) = spans[rng.random_range(0..spans.len())];
    let inside = new(&text[from..to], rng);
    format!("{}{inside}{}", &text[..from], &text[to..])
}

/// Spans (start and end, bytes) of consecutive characters of one class with at least one digit.
fn spans(text: &str, belongs: impl Fn(char) -> bool) -> Vec<(usize, usize)> {
    let (mut found, mut start) = (Vec::new(), None);
    for (index, c) in text.char_indices().chain([(text.len(), ' ')]) {
        match (belongs(c), start) {
            (true, None) => start = Some(index),
            (false, Some(from)) => {
                if text[from..index].contains(|c: char| c.is_ascii_digit()) {
                    found.push((from, index));
                }
                start = None;
            }
            _ => {}
        }
    }
    found
}

/// Spans (start and end, bytes) between double quotes.
fn quoted(text: &str) -> Vec<(usize, usize)> {
    let marks: Vec<usize> = text.match_indices('"').map(|(index, _)| index).collect();
    marks.chunks_exact(2).map(|pair| (pair[0] + 1, pair[1])).collect()
}

/// Mutates bytes without regard to the format of the file.
fn blind(bytes: &mut Vec<u8>, rng: &mut impl Rng) {
    if bytes.is_empty() {
        bytes.extend((0..rng.random_range(1..64)).map(|_| rng.random::<u8>()));
        return;
    }
    let at = rng.random_range(0..bytes.len());
    let some = rng.random_range(1..=64.min(bytes.len() - at));
    match rng.random_range(0..8) {
        0 => bytes[at] ^= 1 << rng.random_range(0..8),
        1 => bytes[at] = rng.random(),
        2 => drop(bytes.drain(at..at + some)),
        3 => bytes.truncate(at),
        4 => {
            let part = bytes[at..at + some].to_vec();
            bytes.splice(at..at, part);
        }
        5 => {
            let noise: Vec<u8> = (0..some).map(|_| rng.random()).collect();
            bytes.splice(at..at, noise);
        }
        6 => bytes[at..at + some].fill([0, 0xff][rng.random_range(0..2)]),
        // Many formats store lengths and counts as four bytes.
        _ => {
            let number = [0_u32, 1, 0x7fff_ffff, 0xffff_ffff, 1 << 20, f32::NAN.to_bits(), 1e30_f32.to_bits()];
            let number = number[rng.random_range(0..number.len())].to_le_bytes();
            let end = (at + 4).min(bytes.len());
            bytes[at..end].copy_from_slice(&number[..end - at]);
        }
    }
}

#[cfg(test)]
mod tests {
    use genmanip_core::Seed;

    use super::*;

    #[test]
    fn changes_are_the_same_for_a_seed_and_never_the_input_alone() {
        let samples =
            [&b"{\"a\": [1, {\"b\": \"x\"}], \"c\": null}"[..], b"a = 1.5\n[b]\nc = \"x\"\n", b"\xff\x00\x80", b""];
        // Two of the four samples have no tokens to mutate.
        for (name, least) in [("json", 1500), ("tokens", 700), ("blind", 1500)] {
            let all = |seed: u64| -> Vec<Vec<u8>> {
                let mut rng = Seed::new(seed).rng();
                let changed = |index: usize| {
                    let mut bytes = samples[index % samples.len()].to_vec();
                    match name {
                        "json" => json(&mut bytes, &mut rng),
                        "tokens" => tokens(&mut bytes, &mut rng),
                        _ => blind(&mut bytes, &mut rng),
                    }
                    bytes
                };
                (0..2000).map(changed).collect()
            };
            let first = all(1);
            assert_eq!(first, all(1), "{name}");
            let different =
                first.iter().enumerate().filter(|(index, bytes)| ***bytes != *samples[index % samples.len()]);
            let different = different.count();
            assert!(different > least, "{name} changes too little: {different} of 2000");
        }
    }
}
