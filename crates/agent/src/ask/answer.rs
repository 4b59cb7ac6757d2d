//! Parsing and validation of answers: lenient format, drawn marks only, one-sentence error messages.
//!
//! Prose, code fences, additional keys, numbers as text and a list around the answer are ignored or unwrapped. A
//! missing number is never guessed, and of two different answers neither is accepted.

use genmanip_core::lenient_json::{self, Wanted};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::question::{Marks, Question};
use super::question_kind::QuestionKind;
use super::rejection::Rejection;
use crate::grid::{Cell, Grid};

/// Maximum length of an answer (bytes), about a hundred times a long path.
const MAX_ANSWER_BYTES: usize = 64 << 10;
/// Maximum number of JSON values of an answer. Bounds the time for invalid answers.
const MAX_VALUES: usize = 4096;
/// Maximum number of nested single-item lists and single-key objects around an answer. Chosen by hand.
const MAX_WRAPPINGS: usize = 3;
/// Maximum number of sub-tasks, and of cells of a path. Chosen by hand.
const MAX_ITEMS: usize = 24;
/// Allowed path heights above the table (m). Chosen by hand.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = 0.1..=0.5;

/// Maximum turn of a gripper or object (degrees).
const MAX_TURN_DEG: f64 = 360.0;

/// Valid answer to a question, by its kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// Answer to [`QuestionKind::Decompose`].
    Decompose(DecomposeAnswer),
    /// Answer to [`QuestionKind::Object`] or [`QuestionKind::Part`].
    Mark(MarkAnswer),
    /// Answer to [`QuestionKind::GrabPoint`].
    GrabPoint(GrabPointAnswer),
    /// Answer to [`QuestionKind::GridPath`].
    Path(PathAnswer),
    /// Answer to [`QuestionKind::PointToPoint`].
    Point(PointAnswer),
    /// Answer to [`QuestionKind::Check`].
    Check(CheckAnswer),
}

/// Sub-tasks, each one pick and one placement.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DecomposeAnswer {
    /// Sub-tasks in order, at least one.
    pub subtasks: Vec<String>,
}

/// A chosen mask. Only the number counts; name and colour are kept as evidence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MarkAnswer {
    /// Index of the mask, from 0.
    pub mask: usize,
    /// Object name given by the model.
    pub name: String,
    /// Object colour given by the model.
    pub color: String,
}

/// Answer that names one of the drawn grab points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GrabPointAnswer {
    /// Index of the point, from 0.
    pub point: usize,
    /// Reason given by the model.
    pub reason: String,
}

/// A path over the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct PathAnswer {
    /// Cells from the start to the placement, at least two.
    pub cells: Vec<PathCell>,
}

/// One cell of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathCell {
    /// Cell that the path passes.
    pub cell: Cell,
    /// Height of the carried object above the table (m).
    pub height_m: f64,
    /// Yaw of the gripper relative to the grasp, counterclockwise seen from above (degrees).
    pub yaw_deg: f64,
}

/// The grid cell of the placement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointAnswer {
    /// Chosen cell.
    pub cell: Cell,
    /// Yaw of the object relative to how it lies, counterclockwise seen from above (degrees); `None` if it was not
    /// asked for or not given.
    pub turn_deg: Option<f64>,
}

/// Answer on whether the task is complete.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckAnswer {
    /// Scene description given by the model.
    pub scene_description: String,
    /// True if the model considers the task finished.
    #[serde(deserialize_with = "flag")]
    pub finished: bool,
    /// Remaining sub-tasks; empty if the model lists none.
    #[serde(default)]
    pub remaining: Vec<String>,
}

/// Parses and validates an answer.
///
/// # Errors
/// Description of the problem, written for the model.
pub fn parse(question: &Question, text: &str) -> Result<Answer, Rejection> {
    if text.len() > MAX_ANSWER_BYTES {
        let size = text.len();
        return Err(Rejection::Format(format!("it has {size} bytes, expected {MAX_ANSWER_BYTES} at most")));
    }
    let mut answers: Vec<Result<Answer, Rejection>> = Vec::new();
    let mut other: Option<Rejection> = None;
    for found in lenient_json::find(&lenient_json::decoded(text), Wanted::ObjectsAndLists, MAX_VALUES) {
        let not_json = |error| Rejection::Format(format!("it is not the JSON that was asked for: {error}"));
        match found.map_err(not_json).and_then(|parsed| unwrapped(question, &parsed.value, MAX_WRAPPINGS)) {
            Err(rejection @ Rejection::Format(_)) => other = other.or(Some(rejection)),
            answer if answers.contains(&answer) => {}
            answer => answers.push(answer),
        }
    }
    match answers.len() {
        0 => Err(other.unwrap_or_else(|| Rejection::Format("expected one JSON object, got none".into()))),
        1 => answers.remove(0),
        several => Err(Rejection::Format(format!("expected one answer, got {several} different ones"))),
    }
}

/// Answer parsed from a value, or from the only item of a list or object.
fn unwrapped(question: &Question, value: &Value, wrappings: usize) -> Result<Answer, Rejection> {
    let direct = answer(question, value);
    let inner = match value {
        Value::Array(items) if items.len() == 1 => items.first(),
        Value::Object(fields) if fields.len() == 1 => fields.values().next(),
        _ => None,
    };
    match (&direct, inner) {
        (Err(Rejection::Format(_)), Some(inner)) if wrappings > 0 && (inner.is_object() || inner.is_array()) => {
            match unwrapped(question, inner, wrappings - 1) {
                Err(Rejection::Format(_)) => direct,
                found => found,
            }
        }
        _ => direct,
    }
}

fn answer(question: &Question, value: &Value) -> Result<Answer, Rejection> {
    match question.stage {
        QuestionKind::Decompose => decompose(value).map(Answer::Decompose),
        QuestionKind::Object => {
            let ObjectWire { number, object_name, color } = read(value)?;
            mark(question, "mask", number, object_name, color).map(Answer::Mark)
        }
        QuestionKind::Part => {
            let PartWire { number, part_name, color } = read(value)?;
            mark(question, "part", number, part_name, color).map(Answer::Mark)
        }
        QuestionKind::GrabPoint => grab_point(question, read(value)?).map(Answer::GrabPoint),
        QuestionKind::GridPath => {
            // A bare list is accepted too; servers with schema-constrained output need an object around it.
            let path = if value.is_array() { read(value)? } else { read::<PathWire>(value)?.path };
            self::path(question, &path).map(Answer::Path)
        }
        QuestionKind::PointToPoint => {
            let SelectedWire { selected_point: LabelWire { kind, label }, turn_deg } = read(value)?;
            if kind != "grid" {
                return Err(Rejection::Format(format!("`type` is {kind:?}, expected \"grid\"")));
            }
            let cell = placement(question, &label)?;
            let turns = matches!(question.marks, Marks::Grid { turns: true, .. });
            let turn_deg = turn_deg.filter(|_| turns);
            if let Some(turn) = turn_deg.filter(|turn| turn.abs() > MAX_TURN_DEG) {
                let expected = format!("expected -{MAX_TURN_DEG} to {MAX_TURN_DEG} degrees");
                return Err(Rejection::Format(format!("`turn_deg` is {turn}, {expected}")));
            }
            Ok(Answer::Point(PointAnswer { cell, turn_deg }))
        }
        QuestionKind::Check => check(value).map(Answer::Check),
    }
}

#[derive(Deserialize)]
struct ObjectWire {
    #[serde(deserialize_with = "whole_number")]
    number: i64,
    object_name: String,
    color: String,
}

#[derive(Deserialize)]
struct PartWire {
    #[serde(deserialize_with = "whole_number")]
    number: i64,
    part_name: String,
    color: String,
}

#[derive(Deserialize)]
struct PointWire {
    #[serde(deserialize_with = "whole_number")]
    selected_point: i64,
    #[serde(default)]
    reason: String,
}

#[derive(Deserialize)]
struct SelectedWire {
    selected_point: LabelWire,
    #[serde(default, deserialize_with = "optional_number")]
    turn_deg: Option<f64>,
}

#[derive(Deserialize)]
struct LabelWire {
    #[serde(rename = "type")]
    kind: String,
    label: String,
}

#[derive(Deserialize)]
struct PathWire {
    path: Vec<PathItemWire>,
}

#[derive(Deserialize)]
struct PathItemWire {
    grid_number: String,
    #[serde(deserialize_with = "number")]
    height_m: f64,
    #[serde(deserialize_with = "number")]
    claw_orientation: f64,
}

/// Deserialises a number, also from text.
fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = Value::deserialize(deserializer)?;
    let number = match &value {
        Value::String(text) => text.trim().parse().ok(),
        other => other.as_f64(),
    };
    number.filter(|number| number.is_finite()).ok_or_else(|| unexpected(&value, "a number"))
}

/// Deserialises a number, also from text; `None` for null.
fn optional_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    number(deserializer).map(Some)
}

/// Deserialises an integer, also from text or with a fraction of zeros (`3.0`).
fn whole_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<i64, D::Error> {
    let value = Value::deserialize(deserializer)?;
    let whole = |number: f64| (number.fract() == 0.0 && number.abs() < 1e15).then_some(number as i64);
    let number = match &value {
        Value::String(text) => text.trim().parse().ok(),
        other => other.as_i64().or_else(|| other.as_f64().and_then(whole)),
    };
    number.ok_or_else(|| unexpected(&value, "a whole number"))
}

/// Deserialises a truth value, also from text.
fn flag<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    let value = Value::deserialize(deserializer)?;
    let flag = match &value {
        Value::String(text) => text.trim().to_lowercase().parse().ok(),
        other => other.as_bool(),
    };
    flag.ok_or_else(|| unexpected(&value, "true or false"))
}

fn unexpected<E: serde::de::Error>(value: &Value, expected: &str) -> E {
    E::custom(format!("expected {expected}, got {}", super::shortened::shortened(&value.to_string())))
}

fn read<T: DeserializeOwned>(value: &Value) -> Result<T, Rejection> {
    T::deserialize(value).map_err(|error| Rejection::Format(format!("it is not the JSON that was asked for: {error}")))
}

fn decompose(value: &Value) -> Result<DecomposeAnswer, Rejection> {
    let answer: DecomposeAnswer = read(value)?;
    check_subtasks(&answer.subtasks, 1)?;
    Ok(answer)
}

fn check(value: &Value) -> Result<CheckAnswer, Rejection> {
    let answer: CheckAnswer = read(value)?;
    check_subtasks(&answer.remaining, 0)?;
    Ok(answer)
}

fn check_subtasks(subtasks: &[String], fewest: usize) -> Result<(), Rejection> {
    let count = subtasks.len();
    if !(fewest..=MAX_ITEMS).contains(&count) || subtasks.iter().any(|subtask| subtask.trim().is_empty()) {
        return Err(Rejection::Format(format!("expected {fewest} to {MAX_ITEMS} sub-tasks in words, got {count}")));
    }
    Ok(())
}

/// Index from 0 of a mark by the number drawn on the image; rejects numbers of no mark.
fn drawn(number: i64, count: usize, what: &str) -> Result<usize, Rejection> {
    let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1)).filter(|index| *index < count);
    index.ok_or_else(|| Rejection::Undrawn(format!("{what} {number} is not drawn, there are 1 to {count}")))
}

fn mark(question: &Question, what: &str, number: i64, name: String, color: String) -> Result<MarkAnswer, Rejection> {
    let count = if let Marks::Masks(masks) = &question.marks { masks.len() } else { 0 };
    if number == -1 {
        return Err(Rejection::NotFound(what.into()));
    }
    Ok(MarkAnswer { mask: drawn(number, count, what)?, name, color })
}

fn grab_point(question: &Question, wire: PointWire) -> Result<GrabPointAnswer, Rejection> {
    let count = if let Marks::Points(points) = &question.marks { points.len() } else { 0 };
    Ok(GrabPointAnswer { point: drawn(wire.selected_point, count, "point")?, reason: wire.reason })
}

fn cell(grid: &Grid, label: &str) -> Result<Cell, Rejection> {
    grid.named(label).ok_or_else(|| {
        let last = Cell { row: grid.rows - 1, column: grid.columns - 1 };
        Rejection::Undrawn(format!(
            "cell {:?} is not drawn, there are A1 to {last}",
            super::shortened::shortened(label)
        ))
    })
}

/// Parses the label of a cell that can receive the object.
fn placement(question: &Question, label: &str) -> Result<Cell, Rejection> {
    let Marks::Grid { grid, targets, .. } = &question.marks else {
        return Err(Rejection::Undrawn("no grid is drawn".into()));
    };
    let cell = cell(grid, label)?;
    if !targets.contains_key(&cell) {
        return Err(Rejection::Unusable(format!("in cell {cell} there is no surface to put anything on")));
    }
    Ok(cell)
}

fn path(question: &Question, path: &[PathItemWire]) -> Result<PathAnswer, Rejection> {
    let Marks::Grid { grid, .. } = &question.marks else {
        return Err(Rejection::Undrawn("no grid is drawn".into()));
    };
    let count = path.len();
    if !(2..=MAX_ITEMS).contains(&count) {
        return Err(Rejection::Format(format!("expected a path of 2 to {MAX_ITEMS} cells, got {count}")));
    }
    let mut cells = Vec::with_capacity(count);
    for (index, item) in path.iter().enumerate() {
        let cell = match index + 1 == count {
            true => placement(question, &item.grid_number)?,
            false => cell(grid, &item.grid_number)?,
        };
        if !HEIGHTS_M.contains(&item.height_m) {
            let (low, high) = (HEIGHTS_M.start(), HEIGHTS_M.end());
            return Err(Rejection::Format(format!("`height_m` is {}, expected {low} to {high}", item.height_m)));
        }
        if !item.claw_orientation.is_finite() || item.claw_orientation.abs() > MAX_TURN_DEG {
            let angle = item.claw_orientation;
            return Err(Rejection::Format(format!("`claw_orientation` is {angle}, expected -360 to 360 degrees")));
        }
        cells.push(PathCell { cell, height_m: item.height_m, yaw_deg: item.claw_orientation });
    }
    Ok(PathAnswer { cells })
}
