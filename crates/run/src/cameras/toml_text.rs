//! One camera changed in the text of a TOML world; its other lines and their comments stay as they are.

use std::path::Path;

use serde_json::{Map, Value};

use crate::error::RunError;

/// What each camera's table begins with.
const HEADER: &str = "[[cameras]]";

/// The text with the camera at an index replaced, added behind the others, or removed; whole lines are kept.
///
/// The caller compares what the new text says with what it should say: a text that is written in another way than one
/// key per line is not understood here. `None` when there is no such table.
pub(super) fn with_camera(text: &str, index: usize, entry: Option<&Map<String, Value>>) -> Option<String> {
    let mut lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
    if let Some(last) = lines.last_mut().filter(|line| !line.ends_with('\n')) {
        last.push('\n');
    }
    let tables = tables(&lines);
    match (tables.get(index), entry) {
        (Some(&(start, end)), Some(entry)) => {
            let changed = changed(&lines[start..end], entry);
            lines.splice(start..end, changed);
        }
        (Some(&(start, end)), None) => {
            // One of the empty lines around it goes too.
            let is_blank = |index: usize| lines.get(index).is_none_or(|line| line.trim().is_empty());
            let first = if start > 0 && is_blank(start - 1) && is_blank(end) { start - 1 } else { start };
            lines.drain(first..end);
        }
        (None, Some(entry)) => {
            let at = tables.last().map_or(lines.len(), |&(_, end)| end);
            let added = ["\n".into(), format!("{HEADER}\n")].into_iter().chain(entry.iter().map(line));
            lines.splice(at..at, added);
        }
        (None, None) => return None,
    }
    Some(lines.concat())
}

/// The value of the text.
pub(super) fn value(path: &Path, text: &str) -> Result<Value, RunError> {
    toml::from_str(text).map_err(|error| RunError::input(format!("{} is no TOML", path.display())).because(error))
}

/// First line and end of each camera's table; comments and empty lines before the next table belong to that.
fn tables(lines: &[String]) -> Vec<(usize, usize)> {
    let is_header = |line: &str| line.starts_with('[') && !line.starts_with("[cameras.");
    let starts = (0..lines.len()).filter(|&index| lines[index].trim().starts_with(HEADER));
    starts
        .map(|start| {
            let next = (start + 1..lines.len()).find(|&index| is_header(lines[index].trim_start()));
            let mut end = next.unwrap_or(lines.len());
            while end > start + 1 && (lines[end - 1].trim().is_empty() || lines[end - 1].trim().starts_with('#')) {
                end -= 1;
            }
            (start, end)
        })
        .collect()
}

/// A table with the values of an entry: unchanged lines stay, with their comments.
fn changed(table: &[String], entry: &Map<String, Value>) -> Vec<String> {
    let mut left = entry.clone();
    let mut lines = Vec::new();
    for old in table {
        let key = old.split_once('=').map(|(key, _)| key.trim().trim_matches('"').to_owned());
        let Some(key) = key.filter(|key| !key.starts_with(['#', '['])) else {
            lines.push(old.clone());
            continue;
        };
        if let Some(new) = left.shift_remove(&key) {
            let said: Option<Map<String, Value>> = toml::from_str(old).ok();
            let stays = said.is_some_and(|said| said.get(&key) == Some(&new));
            lines.push(if stays { old.clone() } else { line((&key, &new)) });
        }
    }
    lines.extend(left.iter().map(line));
    lines
}

fn line((key, value): (&String, &Value)) -> String {
    format!("{key} = {}\n", inline(value))
}

/// A value as TOML in one line.
fn inline(value: &Value) -> String {
    match value {
        Value::Array(values) => format!("[{}]", values.iter().map(inline).collect::<Vec<_>>().join(", ")),
        Value::Object(table) => {
            let pairs = table.iter().map(|(key, value)| format!("{key} = {}", inline(value)));
            format!("{{ {} }}", pairs.collect::<Vec<_>>().join(", "))
        }
        // Numbers, truth values and strings are written alike in both formats.
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORLD: &str = "a = 1 # kept\n\n# first\n[[cameras]]\nname = \"left\" # of the robot\neye_m = [1.0, 2.0, 0.5]\n\
                         # a note\n\n[[cameras]]\nname = \"right\"\n# the end\n\n# of another table\n[b]\nc = 2\n";

    #[test]
    fn only_the_lines_of_one_camera_change() {
        let entry = |text: &str| -> Map<String, Value> { toml::from_str(text).unwrap() };
        let moved = entry("name = \"left\"\neye_m = [1.5, 2.0, 0.5]\nfov = 40.0");
        let new = entry("name = \"top\"\nsize_px = [640, 360]\npose = { x = -1.0 }");
        let cases = [
            (0, Some(&moved), WORLD.replacen("[1.0, 2.0, 0.5]\n", "[1.5, 2.0, 0.5]\nfov = 40.0\n", 1)),
            (1, None, WORLD.replacen("[[cameras]]\nname = \"right\"\n", "", 1)),
            (
                2,
                Some(&new),
                WORLD.replacen(
                    "name = \"right\"\n",
                    "name = \"right\"\n\n[[cameras]]\nname = \"top\"\nsize_px = [640, 360]\npose = { x = -1.0 }\n",
                    1,
                ),
            ),
        ];
        for (index, entry, wanted) in cases {
            let got = with_camera(WORLD, index, entry).unwrap();
            assert_eq!(got, wanted, "camera {index}");
            assert!(toml::from_str::<Value>(&got).is_ok());
        }
        assert_eq!(with_camera(WORLD, 2, None), None);
    }
}
