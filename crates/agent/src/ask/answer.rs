//! Reading answers: the exact form, drawn marks only, and one sentence on what is wrong.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::complaint::Complaint;
use super::question::{Marks, Question, REASONING};
use super::stage::Stage;
use crate::grid::{Cell, Grid};

/// Longest answer that is read, bytes: a hundred times a long path.
const LONGEST_ANSWER: usize = 64 << 10;
/// Most sub-tasks, and most cells of a path.
const MOST_ITEMS: usize = 24;
/// Heights of a path above the table, m.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = 0.1..=0.5;

/// An answer that fits its question.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// Of [`Stage::Decompose`].
    Decompose(DecomposeAnswer),
    /// Of [`Stage::Object`] and [`Stage::Part`].
    Mark(MarkAnswer),
    /// Of [`Stage::GrabPoint`].
    GrabPoint(GrabPointAnswer),
    /// Of [`Stage::GridPath`].
    Path(PathAnswer),
    /// Of [`Stage::PointToPoint`].
    Point(PointAnswer),
    /// Of [`Stage::Check`].
    Check(CheckAnswer),
}

/// Sub-tasks, each one pick and one place.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DecomposeAnswer {
    /// In their order, at least one.
    pub subtasks: Vec<String>,
}

/// A mask. The number decides; name and colour are kept as evidence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MarkAnswer {
    /// Index of the mask, from 0.
    pub mask: usize,
    /// What the model calls it.
    pub name: String,
    /// Which colour it says the thing has.
    pub color: String,
}

/// One of the points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GrabPointAnswer {
    /// Index of the point, from 0.
    pub point: usize,
    /// Why.
    pub reason: String,
}

/// A way over the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct PathAnswer {
    /// From the start to the placement, at least two cells.
    pub cells: Vec<PathCell>,
}

/// One cell of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathCell {
    /// The cell.
    pub cell: Cell,
    /// Height of what is carried above the table, m.
    pub height_m: f64,
    /// Turn of the hand about the vertical against how it took hold, counterclockwise seen from above, degrees.
    pub yaw_deg: f64,
}

/// The cell where to put it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointAnswer {
    /// The cell.
    pub cell: Cell,
}

/// Whether the task is done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckAnswer {
    /// What is seen.
    pub scene_description: String,
    /// The verdict of the model.
    pub finished: bool,
    /// Sub-tasks that are still to be done, where it says which.
    #[serde(default)]
    pub remaining: Vec<String>,
}

/// Reads an answer to a question.
///
/// # Errors
/// What is wrong, in words for the model.
pub fn parse(question: &Question, text: &str) -> Result<Answer, Complaint> {
    let object = bare_object(text)?;
    let without = question.reasoning.then(|| without_reasoning(object)).flatten();
    let object = without.as_deref().unwrap_or(object);
    match question.stage {
        Stage::Decompose => decompose(object).map(Answer::Decompose),
        Stage::Object => {
            let ObjectWire { number, object_name, color } = read(object)?;
            mark(question, "mask", number, object_name, color).map(Answer::Mark)
        }
        Stage::Part => {
            let PartWire { number, part_name, color } = read(object)?;
            mark(question, "part", number, part_name, color).map(Answer::Mark)
        }
        Stage::GrabPoint => grab_point(question, read(object)?).map(Answer::GrabPoint),
        Stage::GridPath => {
            // A bare list is the same; servers that hold answers to a schema want an object around it.
            let path = if object.starts_with('[') { read(object)? } else { read::<PathWire>(object)?.path };
            self::path(question, &path).map(Answer::Path)
        }
        Stage::PointToPoint => {
            let SelectedWire { selected_point: LabelWire { kind, label } } = read(object)?;
            if kind != "grid" {
                return Err(Complaint::Format(format!("`type` is {kind:?}, expected \"grid\"")));
            }
            let cell = placement(question, &label)?;
            Ok(Answer::Point(PointAnswer { cell }))
        }
        Stage::Check => check(object).map(Answer::Check),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectWire {
    number: i64,
    object_name: String,
    color: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PartWire {
    number: i64,
    part_name: String,
    color: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointWire {
    selected_point: i64,
    #[serde(default)]
    reason: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SelectedWire {
    selected_point: LabelWire,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LabelWire {
    #[serde(rename = "type")]
    kind: String,
    label: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathWire {
    path: Vec<PathItemWire>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathItemWire {
    grid_number: String,
    height_m: f64,
    claw_orientation: f64,
}

/// The text if it is one JSON object and nothing else; a code fence around it is taken off.
fn bare_object(text: &str) -> Result<&str, Complaint> {
    if text.len() > LONGEST_ANSWER {
        let size = text.len();
        return Err(Complaint::Format(format!("it has {size} bytes, expected {LONGEST_ANSWER} at most")));
    }
    let text = text.trim();
    let fenced =
        text.strip_prefix("```json").or_else(|| text.strip_prefix("```")).and_then(|rest| rest.strip_suffix("```"));
    let text = fenced.unwrap_or(text).trim();
    if text.starts_with('{') && text.ends_with('}') || text.starts_with('[') && text.ends_with(']') {
        return Ok(text);
    }
    Err(Complaint::Format("expected one JSON object and nothing around it".into()))
}

/// The object without the reasons that were asked for; `None` where it is no object, which is then said elsewhere.
fn without_reasoning(object: &str) -> Option<String> {
    let mut fields: serde_json::Map<String, serde_json::Value> = serde_json::from_str(object).ok()?;
    fields.remove(REASONING);
    Some(serde_json::Value::Object(fields).to_string())
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, Complaint> {
    serde_json::from_str(text)
        .map_err(|error| Complaint::Format(format!("it is not the JSON that was asked for: {error}")))
}

fn decompose(text: &str) -> Result<DecomposeAnswer, Complaint> {
    let answer: DecomposeAnswer = read(text)?;
    in_words(&answer.subtasks, 1)?;
    Ok(answer)
}

fn check(text: &str) -> Result<CheckAnswer, Complaint> {
    let answer: CheckAnswer = read(text)?;
    in_words(&answer.remaining, 0)?;
    Ok(answer)
}

fn in_words(subtasks: &[String], fewest: usize) -> Result<(), Complaint> {
    let count = subtasks.len();
    if !(fewest..=MOST_ITEMS).contains(&count) || subtasks.iter().any(|subtask| subtask.trim().is_empty()) {
        return Err(Complaint::Format(format!("expected {fewest} to {MOST_ITEMS} sub-tasks in words, got {count}")));
    }
    Ok(())
}

/// The index of a drawn number.
fn drawn(number: i64, count: usize, what: &str) -> Result<usize, Complaint> {
    let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1)).filter(|index| *index < count);
    index.ok_or_else(|| Complaint::Undrawn(format!("{what} {number} is not drawn, there are 1 to {count}")))
}

fn mark(question: &Question, what: &str, number: i64, name: String, color: String) -> Result<MarkAnswer, Complaint> {
    let count = if let Marks::Masks(masks) = &question.marks { masks.len() } else { 0 };
    if number == -1 {
        return Err(Complaint::NotFound(what.into()));
    }
    Ok(MarkAnswer { mask: drawn(number, count, what)?, name, color })
}

fn grab_point(question: &Question, wire: PointWire) -> Result<GrabPointAnswer, Complaint> {
    let count = if let Marks::Points(points) = &question.marks { points.len() } else { 0 };
    Ok(GrabPointAnswer { point: drawn(wire.selected_point, count, "point")?, reason: wire.reason })
}

fn cell(grid: &Grid, label: &str) -> Result<Cell, Complaint> {
    grid.named(label).ok_or_else(|| {
        let last = Cell { row: grid.rows - 1, column: grid.columns - 1 };
        Complaint::Undrawn(format!("cell {:?} is not drawn, there are A1 to {last}", super::shortened(label)))
    })
}

/// A cell into which something can be put.
fn placement(question: &Question, label: &str) -> Result<Cell, Complaint> {
    let Marks::Grid { grid, targets, .. } = &question.marks else {
        return Err(Complaint::Undrawn("no grid is drawn".into()));
    };
    let cell = cell(grid, label)?;
    if !targets.contains_key(&cell) {
        return Err(Complaint::Unusable(format!("in cell {cell} there is no surface to put anything on")));
    }
    Ok(cell)
}

fn path(question: &Question, path: &[PathItemWire]) -> Result<PathAnswer, Complaint> {
    let Marks::Grid { grid, .. } = &question.marks else {
        return Err(Complaint::Undrawn("no grid is drawn".into()));
    };
    let count = path.len();
    if !(2..=MOST_ITEMS).contains(&count) {
        return Err(Complaint::Format(format!("expected a path of 2 to {MOST_ITEMS} cells, got {count}")));
    }
    let mut cells = Vec::with_capacity(count);
    for (index, item) in path.iter().enumerate() {
        let cell = match index + 1 == count {
            true => placement(question, &item.grid_number)?,
            false => cell(grid, &item.grid_number)?,
        };
        if !HEIGHTS_M.contains(&item.height_m) {
            let (low, high) = (HEIGHTS_M.start(), HEIGHTS_M.end());
            return Err(Complaint::Format(format!("`height_m` is {}, expected {low} to {high}", item.height_m)));
        }
        if !item.claw_orientation.is_finite() || item.claw_orientation.abs() > 360.0 {
            let angle = item.claw_orientation;
            return Err(Complaint::Format(format!("`claw_orientation` is {angle}, expected -360 to 360 degrees")));
        }
        cells.push(PathCell { cell, height_m: item.height_m, yaw_deg: item.claw_orientation });
    }
    Ok(PathAnswer { cells })
}
