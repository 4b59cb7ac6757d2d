//! Placement questions, and their answers located in 3D.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{FailedStage, StageCause};
use glam::DVec3;

use super::{Agent, QuestionDraft};
use crate::ask::{Answer, Marks, PathCell, PromptVariant, QuestionImage, QuestionKind};
use crate::grid::{Cell, Grid};
use crate::image::marks;
use crate::perception::{ObservedObject, PlacementTarget, SegmentedViews, View, on_plane, targets};
use crate::settings::{Asks, PathKind};

/// Cells of the fine grid along each side of a coarse cell: 2 to 3 cm on the table as the camera `overview` sees it.
const FINE_PARTS: u32 = 4;
/// Minimum number of objects close to a coarse cell for which it is refined. Chosen by hand.
const CROWDED: usize = 2;

/// Answers to the placement questions.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// Answer on the coarse grid.
    pub answer: Answer,
    /// Cell of the fine grid around the coarse cell; `None` if it was not asked for.
    pub fine: Option<Cell>,
}

impl Placement {
    /// Yaw change of the object that the answer asks for (degrees); `None` if it gives none.
    pub fn turn_deg(&self) -> Option<f64> {
        match &self.answer {
            Answer::Point(answer) => answer.turn_deg,
            _ => None,
        }
    }
}

/// The scene around the moved object, for placement targets.
#[derive(Clone, Copy)]
pub(super) struct Places<'a> {
    pub agent: &'a Agent,
    pub views: &'a SegmentedViews,
    pub view: &'a View,
    /// Index of the moved object's mask in `view.masks`.
    pub mask: usize,
    pub object: &'a ObservedObject,
    /// Points of everything else above the table, world frame.
    pub around: &'a [DVec3],
}

impl Places<'_> {
    /// Coarse grid over the whole image.
    pub fn grid(&self) -> Grid {
        Grid::usual(self.view.image.width(), self.view.image.height())
    }

    /// Targets of the cells of a grid.
    pub fn of(&self, grid: &Grid) -> BTreeMap<Cell, PlacementTarget> {
        let settings = &self.agent.settings;
        targets(self.views, self.mask, self.object, self.around, settings.table_m, &settings.cells, grid)
    }
}

/// The placement question, and the follow-up question for a cell of the fine grid.
pub(super) struct PlacementQuestion<'a> {
    pub places: Places<'a>,
    /// Targets of the coarse cells.
    pub targets: &'a BTreeMap<Cell, PlacementTarget>,
    /// The image without marks.
    pub image: &'a QuestionImage,
    /// Name that the model gives the object.
    pub name: &'a str,
    pub subtask: &'a str,
}

/// Start of the carry path on the grid: the pixel and its cell label.
pub(super) struct Start {
    at: [f64; 2],
    cell: String,
}

impl PlacementQuestion<'_> {
    fn stage(&self) -> QuestionKind {
        match self.places.agent.settings.path {
            PathKind::P2p => QuestionKind::PointToPoint,
            PathKind::Grid => QuestionKind::GridPath,
        }
    }

    pub fn start(&self, pixel: usize) -> Start {
        let width = self.places.view.image.width() as usize;
        let at = [(pixel % width) as f64, (pixel / width) as f64];
        Start { at, cell: self.places.grid().cell_at(at[0], at[1]).map_or_else(String::new, |cell| cell.to_string()) }
    }

    pub fn asked<'b>(&'b self, start: &'b Start) -> QuestionDraft<'b> {
        let grid = self.places.grid();
        let picture = marks::grid(&self.places.view.picture(), &grid, start.at);
        let turns = self.asks_turn();
        let variant = if turns { PromptVariant::Turned } else { PromptVariant::Plain };
        QuestionDraft { variant, ..self.draft(start, picture, self.marks(grid, self.targets, turns)) }
    }

    fn draft<'b>(&'b self, start: &'b Start, picture: crate::image::RgbImage, marks: Marks) -> QuestionDraft<'b> {
        let lettered = QuestionImage { name: "grid", picture: Arc::new(picture) };
        QuestionDraft {
            object_name: self.name,
            start_point: &start.cell,
            pictures: vec![self.image.clone(), lettered],
            marks,
            ..QuestionDraft::new(self.stage(), self.subtask)
        }
    }

    /// True if the question also asks for the object's yaw; a path already contains yaws.
    fn asks_turn(&self) -> bool {
        self.places.agent.settings.asks == Asks::Needed && self.stage() == QuestionKind::PointToPoint
    }

    fn marks(&self, grid: Grid, targets: &BTreeMap<Cell, PlacementTarget>, turns: bool) -> Marks {
        let targets = targets.iter().map(|(cell, target)| (*cell, target.point)).collect();
        Marks::Grid { grid, targets, moved: self.places.view.masks[self.places.mask].clone(), turns }
    }

    /// The target of an answer, and the waypoints of its path.
    pub fn place(&self, answer: &Answer) -> Result<(PlacementTarget, Vec<(DVec3, PathCell)>), FailedStage> {
        let unusable =
            || FailedStage::new(self.stage(), StageCause::Unusable, format!("{} cannot be put there", self.name));
        let place = |cell| self.targets.get(&cell).cloned().ok_or_else(unusable);
        match answer {
            Answer::Point(answer) => Ok((place(answer.cell)?, Vec::new())),
            Answer::Path(answer) => {
                let cells = &answer.cells;
                let last = cells.last().map(|last| last.cell).ok_or_else(unusable)?;
                let (grid, table_m) = (self.places.grid(), self.places.agent.settings.table_m);
                let path = cells.iter().skip(1).filter_map(|&step| {
                    let [x, y] = grid.center(step.cell);
                    Some((on_plane(&self.places.view.image, [x, y], table_m)?, step))
                });
                Ok((place(last)?, path.collect()))
            }
            other => Err(unexpected(self.stage(), other)),
        }
    }

    /// Placement refined to a cell of the fine grid, where the coarse cell is ambiguous; asks for the fine cell unless
    /// it is known. Without a valid answer, the coarse target is kept.
    pub fn refined(
        &self,
        placement: Placement,
        target: PlacementTarget,
        start: &Start,
    ) -> Result<(Placement, PlacementTarget), FailedStage> {
        let Answer::Point(coarse) = &placement.answer else { return Ok((placement, target)) };
        if !self.needs_fine_cell(&target) {
            return Ok((placement, target));
        }
        let Places { agent, view, .. } = self.places;
        let grid = self.places.grid().around(coarse.cell, FINE_PARTS);
        let targets = self.places.of(&grid);
        let fine = match placement.fine {
            Some(cell) => Some(cell),
            None => {
                let picture = marks::enlarged_grid(&view.picture(), &grid, start.at);
                let marks = self.marks(grid, &targets, false);
                let asked = QuestionDraft { variant: PromptVariant::FineCell, ..self.draft(start, picture, marks) };
                match agent.ask(view, asked) {
                    Ok(Answer::Point(answer)) => Some(answer.cell),
                    Err(failure) if failure.cause == StageCause::Service => return Err(failure),
                    Ok(_) | Err(_) => None,
                }
            }
        };
        let found = fine.and_then(|cell| targets.get(&cell).cloned()).unwrap_or(target);
        Ok((Placement { fine, ..placement }, found))
    }

    /// True if the coarse cell is ambiguous: it may mean several surfaces, lies close to several objects, or is to lie
    /// between objects.
    fn needs_fine_cell(&self, target: &PlacementTarget) -> bool {
        let is_between = self.subtask.to_lowercase().split(|c: char| !c.is_alphabetic()).any(|word| word == "between");
        let settings = &self.places.agent.settings;
        // Answers recorded with `Asks::Every` contain no answer to this question.
        let is_asked = settings.fine_cells && settings.asks == Asks::Needed;
        is_asked && (is_between || target.mixed || target.neighbours >= CROWDED)
    }
}

pub(super) fn unexpected(stage: QuestionKind, answer: &Answer) -> FailedStage {
    FailedStage::new(stage, StageCause::Format, format!("got an answer of another stage: {answer:?}"))
}
