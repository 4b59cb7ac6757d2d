//! Selection of episodes by conditions or indices.

use std::collections::BTreeSet;

use arrow_array::{Array, RecordBatch};
use serde::Deserialize;

use super::source::Source;
use genmanip_data::DataError;
use genmanip_data::columns::{cell, text};
use genmanip_data::table::Table;

/// Maximum episode index in a selection; larger than that of any data set.
const MAX_INDEX: usize = 10_000_000;

/// Condition on an episode: a column of the episodes table, or `object`, and its value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Condition {
    /// The column; `kind` and `task` stand for `task_kind` and `task_id`.
    pub key: String,
    /// Required value; `true` or `false` for booleans, an object id for `object`, one or several names separated by
    /// commas for `source`.
    pub value: String,
}

impl std::str::FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((key, value)) if !key.is_empty() && !value.is_empty() => {
                Ok(Self { key: key.into(), value: value.into() })
            }
            _ => Err("expected COLUMN=VALUE, e.g. success=true or kind=spatial".into()),
        }
    }
}

impl Condition {
    fn column(&self) -> &str {
        match self.key.as_str() {
            "kind" => "task_kind",
            "task" => "task_id",
            "object" => "scenario_json",
            key => key,
        }
    }

    /// True if the row meets the condition; `None` if the cell's type cannot be compared with the value.
    fn holds(&self, batch: &RecordBatch, row: usize) -> Option<bool> {
        let column = self.column();
        if let Some((found, _)) = text(batch, column, row) {
            return match self.key.as_str() {
                "object" => {
                    serde_json::from_str::<ScenarioObjects>(&found).ok().map(|scenario| scenario.has(&self.value))
                }
                "source" => Some(self.value.split(',').any(|name| name == found)),
                _ => Some(found == self.value),
            };
        }
        if batch.column_by_name(column).is_some_and(|column| row < column.len() && column.is_null(row)) {
            return Some(false);
        }
        let numbers = cell(batch, column, row)?;
        let [found] = numbers[..] else { return None };
        match self.value.as_str() {
            "true" => Some(found == 1.0),
            "false" => Some(found == 0.0),
            value => Some(value.parse::<f64>().ok()? == found),
        }
    }
}

/// Part of a scenario that names its objects.
#[derive(Deserialize)]
struct ScenarioObjects {
    objects: Vec<ScenarioObject>,
}

#[derive(Deserialize)]
struct ScenarioObject {
    id: String,
}

impl ScenarioObjects {
    fn has(&self, id: &str) -> bool {
        self.objects.iter().any(|object| object.id == id)
    }
}

impl Source {
    /// Indices of the episodes that meet all conditions.
    pub(super) fn matching(&self, conditions: &[Condition]) -> Result<Vec<usize>, DataError> {
        let mut kept = Vec::new();
        let mut number = 0;
        for path in &self.tables {
            let table = Table::open(path)?;
            let known = table.names();
            for condition in conditions {
                let column = condition.column();
                if !known.iter().any(|name| name == column) {
                    let simple = |name: &&String| !name.contains('/') && *name != "scenario_json" && *name != "tasks";
                    let names: Vec<&str> = known.iter().filter(simple).map(String::as_str).collect();
                    let expected = format!("object, kind, task or one of {}", names.join(", "));
                    return Err(DataError::mismatch(
                        format!("column of a condition on {}", path.display()),
                        expected,
                        format!("`{}`", condition.key),
                    ));
                }
            }
            let batch = table.whole(|name| conditions.iter().any(|condition| condition.column() == name))?;
            for row in 0..batch.num_rows() {
                let mut is_kept = true;
                for condition in conditions {
                    let Condition { key, value } = condition;
                    is_kept &= condition.holds(&batch, row).ok_or_else(|| {
                        DataError::mismatch(
                            format!("condition {key}={value} on row {row} of {}", path.display()),
                            "a value of that column",
                            "another type",
                        )
                    })?;
                }
                if is_kept {
                    kept.push(number);
                }
                number += 1;
            }
        }
        Ok(kept)
    }
}

/// Parses indices and ranges such as `3,7-9`.
///
/// # Errors
/// Text with the expected format.
pub fn numbers(text: &str) -> Result<BTreeSet<usize>, String> {
    let expected = || "expected indices and ranges, e.g. 3,7-9".to_owned();
    let mut numbers = BTreeSet::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let parse = |text: &str| text.trim().parse::<usize>().map_err(|_| expected());
        let (first, last) = (parse(first)?, parse(last)?);
        if first > last || last >= MAX_INDEX {
            return Err(expected());
        }
        numbers.extend(first..=last);
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_conditions_are_read() {
        assert_eq!(numbers("3,7-9, 8").unwrap(), [3, 7, 8, 9].into());
        for text in ["", "a", "9-7", "3,", "-1", "1-99999999999"] {
            assert!(numbers(text).is_err(), "{text}");
        }
        let condition: Condition = "success=true".parse().unwrap();
        assert_eq!((condition.key.as_str(), condition.value.as_str()), ("success", "true"));
        for text in ["success", "=true", "success=", ""] {
            assert!(text.parse::<Condition>().is_err(), "{text}");
        }
    }
}
