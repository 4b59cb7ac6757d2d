//! Everything that a model says about one sub-task, with where it is.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::Seed;
use glam::DVec3;
use rand::RngExt;

use super::hand::{self, Hand};
use super::{Agent, Asked};
use crate::ask::{Answer, FailedStage, Marks, PathCell, Shown, Stage};
use crate::grid::{Cell, Grid};
use crate::picture::{Picture, marks};
use crate::segmentation::{Mask, SegmentQuestion};
use crate::settings::PathKind;
use crate::sight::{Placing, Sight, Thing, View, targets};

/// Points drawn in a mask for the grab point.
const POINTS: usize = 5;
/// Pixels drawn for each of them, of which the one farthest from those before is taken.
const DRAWS: usize = 12;

/// One pick and one place.
#[derive(Clone, Debug)]
pub(super) struct Job {
    /// What the model calls the thing.
    pub name: String,
    /// The thing, where it stood.
    pub thing: Thing,
    /// Points of everything else above the table.
    pub around: Vec<DVec3>,
    /// What is to be held, all of it or a part, in the view that was shown.
    pub held: Mask,
    /// Where it is to be held.
    pub grab: DVec3,
    /// Where it is to be put.
    pub placing: Placing,
    /// The way there, without its first cell: points on the table under the way, heights and turns; the last is the
    /// placement. Empty when only a cell was asked for.
    pub way: Vec<(DVec3, PathCell)>,
}

impl Job {
    pub(super) fn asked(
        agent: &Agent,
        sight: &Sight,
        view: &View,
        is_last_view: bool,
        hand: &Hand,
        seed: Seed,
    ) -> Result<Self, FailedStage> {
        let settings = &agent.settings;
        let subtask = agent.subtasks.get(agent.current).map_or("", String::as_str);
        let plain = agent.plain(view);
        let (mask, name) = object(agent, view, &plain, subtask, is_last_view)?;
        let world = hand::table(settings);
        let around = agent
            .planner
            .points_seen(&hand::empty(&world, hand.width_m), &hand.arm, &sight.without(mask))
            .map_err(|error| FailedStage::new("look", "unsuited", error.to_string()))?;
        let thing = Thing::new(sight.points(mask), &around, settings.table_m).ok_or_else(|| {
            FailedStage::new("object", "too_small", format!("too little is seen of {name} to take hold of it"))
        })?;
        // What its outline left over is not in its own way.
        let mut known = world.clone();
        let own = known.add(hand::THING, &thing.pieces, &thing.pose);
        own.map_err(|error| FailedStage::new("object", "too_small", format!("{name}: {error}")))?;
        let around = agent
            .planner
            .points_seen(&hand::empty(&known, hand.width_m), &hand.arm, &sight.without(mask))
            .map_err(|error| FailedStage::new("look", "unsuited", error.to_string()))?;
        let held = if settings.ctof { part(agent, view, mask, subtask)? } else { view.masks[mask].clone() };
        let places = targets(sight, mask, &thing, &around, settings.table_m, &settings.cells);
        let grabbing = Grabbing::new(view, &plain, &held, &name, seed)?;
        let placement = Placement { agent, view, plain: &plain, mask, name: &name, subtask, places: &places };
        let (pixel, placed) = if settings.asks_at_once {
            // A model need not know the grab point to know the place.
            let start = placement.start(view.masks[mask].middle().unwrap_or(grabbing.points[0]));
            let [grab, place] = agent.ask_both(view, [grabbing.asked(), placement.asked(&start)]);
            (grabbing.pixel(grab?)?, place?)
        } else {
            let pixel = grabbing.pixel(agent.ask(view, grabbing.asked())?)?;
            (pixel, agent.ask(view, placement.asked(&placement.start(pixel)))?)
        };
        let (placing, way) = placement.place(placed)?;
        let grab = view.image.point(pixel).unwrap_or(thing.pose.position);
        Ok(Self { name, thing, around, held, grab, placing, way })
    }

    /// The same, to be held at another of the points of the same thing: it and its place stay as they were answered.
    pub(super) fn held_elsewhere(self, agent: &Agent, view: &View, seed: Seed) -> Result<Self, FailedStage> {
        let plain = agent.plain(view);
        let grabbing = Grabbing::new(view, &plain, &self.held, &self.name, seed)?;
        let pixel = grabbing.pixel(agent.ask(view, grabbing.asked())?)?;
        Ok(Self { grab: view.image.point(pixel).unwrap_or(self.grab), ..self })
    }
}

fn object(
    agent: &Agent,
    view: &View,
    plain: &Shown,
    subtask: &str,
    is_last_view: bool,
) -> Result<(usize, String), FailedStage> {
    if view.masks.is_empty() {
        return Err(FailedStage::new("object", "no_masks", "segmentation found nothing in the picture".into()));
    }
    let numbered = Shown { name: "masks", picture: Arc::new(marks::masks(&view.picture(), &view.masks)) };
    let asked = Asked {
        pictures: vec![plain.clone(), numbered],
        marks: Marks::Masks(Arc::clone(&view.masks)),
        is_last_view,
        ..Asked::new(Stage::Object, subtask)
    };
    match agent.ask(view, asked)? {
        Answer::Mark(answer) => Ok((answer.mask, answer.name)),
        other => Err(unexpected(Stage::Object, &other)),
    }
}

/// The part of a thing to be held; the whole thing where it has no parts.
fn part(agent: &Agent, view: &View, mask: usize, subtask: &str) -> Result<Mask, FailedStage> {
    let whole = &view.masks[mask];
    let question = SegmentQuestion { image: &view.image, ignore: &[], within: Some(whole) };
    let parts = agent.services.segmenter.segment(&question);
    let parts = parts.map_err(|error| FailedStage::new("segmentation", FailedStage::SERVICE, error.to_string()))?;
    if parts.len() < 2 {
        return Ok(whole.clone());
    }
    let [plain, numbered] = marks::crops(&view.picture(), whole, &parts);
    let shown = |name, picture: Picture| Shown { name, picture: Arc::new(picture) };
    let asked = Asked {
        pictures: vec![shown("crop", plain), shown("parts", numbered)],
        marks: Marks::Masks(parts.clone().into()),
        ..Asked::new(Stage::Part, subtask)
    };
    match agent.ask(view, asked)? {
        Answer::Mark(answer) => Ok(parts[answer.mask].clone()),
        other => Err(unexpected(Stage::Part, &other)),
    }
}

/// What the question after the grab point needs.
struct Grabbing<'a> {
    view: &'a View,
    plain: &'a Shown,
    name: &'a str,
    /// Pixels of the points that are drawn, at least one.
    points: Vec<usize>,
}

impl<'a> Grabbing<'a> {
    fn new(view: &'a View, plain: &'a Shown, mask: &Mask, name: &'a str, seed: Seed) -> Result<Self, FailedStage> {
        let points = spread_points(view, mask, seed);
        if points.is_empty() {
            return Err(FailedStage::new("grab_point", "no_depth", format!("no pixel of {name} has a depth")));
        }
        Ok(Self { view, plain, name, points })
    }

    fn asked(&self) -> Asked<'a> {
        let numbered = Shown { name: "points", picture: Arc::new(marks::points(&self.view.picture(), &self.points)) };
        Asked {
            object_name: self.name,
            pictures: vec![self.plain.clone(), numbered],
            marks: Marks::Points(self.points.clone()),
            ..Asked::new(Stage::GrabPoint, self.name)
        }
    }

    fn pixel(&self, answer: Answer) -> Result<usize, FailedStage> {
        match answer {
            Answer::GrabPoint(answer) => Ok(self.points[answer.point]),
            other => Err(unexpected(Stage::GrabPoint, &other)),
        }
    }
}

/// Points drawn at random in a mask, apart from each other and, where they can be, from its edge.
fn spread_points(view: &View, mask: &Mask, seed: Seed) -> Vec<usize> {
    let seen = |index: &usize| view.image.point(*index).is_some();
    let all: Vec<usize> = mask.indices().filter(seen).collect();
    let width = mask.width as usize;
    let is_inner = |index: &usize| {
        [index.checked_sub(1), Some(index + 1), index.checked_sub(width), Some(index + width)]
            .into_iter()
            .all(|other| other.is_some_and(|other| mask.pixels.get(other) == Some(&true)))
    };
    let inner: Vec<usize> = all.iter().copied().filter(is_inner).collect();
    let pool = if inner.len() >= 2 * POINTS { inner } else { all };
    let rng = &mut seed.fork("points").rng();
    let mut chosen: Vec<usize> = Vec::new();
    while !pool.is_empty() && chosen.len() < POINTS {
        let place = |index: usize| ((index % width) as f64, (index / width) as f64);
        let apart = |index: usize| {
            let (x, y) = place(index);
            let distances = chosen.iter().map(|&other| (x - place(other).0).hypot(y - place(other).1));
            distances.fold(f64::INFINITY, f64::min)
        };
        let draws: Vec<usize> = (0..DRAWS).map(|_| pool[rng.random_range(0..pool.len())]).collect();
        chosen.extend(draws.into_iter().max_by(|a, b| apart(*a).total_cmp(&apart(*b))));
    }
    chosen
}

/// What the question after the placement needs.
struct Placement<'a> {
    agent: &'a Agent,
    view: &'a View,
    plain: &'a Shown,
    mask: usize,
    name: &'a str,
    subtask: &'a str,
    places: &'a BTreeMap<Cell, Placing>,
}

/// Where a thing is taken, on the grid: the pixel, and the name of its cell.
struct Start {
    at: [f64; 2],
    cell: String,
}

impl<'a> Placement<'a> {
    fn grid(&self) -> Grid {
        Grid::usual(self.view.image.width(), self.view.image.height())
    }

    fn stage(&self) -> Stage {
        match self.agent.settings.path {
            PathKind::P2p => Stage::PointToPoint,
            PathKind::Grid => Stage::GridPath,
        }
    }

    fn start(&self, pixel: usize) -> Start {
        let width = self.view.image.width() as usize;
        let at = [(pixel % width) as f64, (pixel / width) as f64];
        Start { at, cell: self.grid().cell_at(at[0], at[1]).map_or_else(String::new, |cell| cell.to_string()) }
    }

    fn asked<'b>(&'b self, start: &'b Start) -> Asked<'b> {
        let grid = self.grid();
        let lettered = Shown { name: "grid", picture: Arc::new(marks::grid(&self.view.picture(), &grid, start.at)) };
        Asked {
            object_name: self.name,
            start_point: &start.cell,
            pictures: vec![self.plain.clone(), lettered],
            marks: Marks::Grid {
                grid,
                targets: self.places.iter().map(|(cell, placing)| (*cell, placing.point)).collect(),
                moved: self.view.masks[self.mask].clone(),
            },
            ..Asked::new(self.stage(), self.subtask)
        }
    }

    fn place(&self, answer: Answer) -> Result<(Placing, Vec<(DVec3, PathCell)>), FailedStage> {
        let unusable =
            || FailedStage::new(self.stage().name(), "unusable", format!("{} cannot be put there", self.name));
        let place = |cell| self.places.get(&cell).cloned().ok_or_else(unusable);
        match answer {
            Answer::Point(answer) => Ok((place(answer.cell)?, Vec::new())),
            Answer::Path(answer) => {
                let cells = answer.cells;
                let last = cells.last().map(|last| last.cell).ok_or_else(unusable)?;
                let (grid, table) = (self.grid(), self.agent.settings.table_m);
                let way = cells.iter().skip(1).filter_map(|&step| {
                    let [x, y] = grid.center(step.cell);
                    Some((crate::sight::on_plane(&self.view.image, [x, y], table)?, step))
                });
                Ok((place(last)?, way.collect()))
            }
            other => Err(unexpected(self.stage(), &other)),
        }
    }
}

fn unexpected(stage: Stage, answer: &Answer) -> FailedStage {
    FailedStage::new(stage.name(), "format", format!("got an answer of another stage: {answer:?}"))
}
