//! Where a thing comes to stand that is put into a cell of the grid.

use std::collections::BTreeMap;

use genmanip_core::RgbdImage;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::{HeightMap, Sight, Thing, View};
use crate::grid::{Cell, Grid};
use crate::segmentation::Mask;

/// How cells become places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CellSettings {
    /// Whether a cell resolves to the surface seen in it: the middle of a thing, or the free part of the table nearest
    /// to the cell's centre. Otherwise the measured point under its centre is taken as it is.
    pub snap: bool,
    /// Share of a cell that a thing must fill for the cell to mean that thing.
    pub thing_share: f64,
    /// Free space around what is put down, m.
    pub clearance_m: f64,
    /// Points looked at along each side of a cell, in the search for a free one.
    pub samples: usize,
}

impl Default for CellSettings {
    fn default() -> Self {
        Self {
            snap: true,
            // Chosen: a thing that fills less of a cell is better named by the cells beside.
            thing_share: 0.3,
            // Chosen: room for the error of a release; fingers have their own test.
            clearance_m: 0.006,
            samples: 7,
        }
    }
}

/// How a thing is put down somewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Placing {
    /// The point over which the middle of its footprint comes to rest, world frame.
    pub point: DVec3,
    /// Further free points in the same cell, for an arm that does not get to the first; nearest first.
    pub others: Vec<DVec3>,
    /// Whether it may be let go of from high up, since what receives it is hollow.
    pub hollow: bool,
    /// Greatest height of what receives it, m.
    pub rim_m: f64,
}

/// The places of all cells into which a thing can be put.
///
/// `around` are the points of everything but the moved thing and the table.
pub fn targets(
    sight: &Sight,
    moved: usize,
    thing: &Thing,
    around: &[DVec3],
    table_m: f64,
    settings: &CellSettings,
) -> BTreeMap<Cell, Placing> {
    let Some(view) = sight.shown() else { return BTreeMap::new() };
    let grid = Grid::usual(view.image.width(), view.image.height());
    let resolver = Resolver::new(sight, view, moved, thing, around, table_m, settings);
    grid.cells().filter_map(|cell| Some((cell, resolver.placing(&grid, cell)?))).collect()
}

struct Resolver<'a> {
    view: &'a View,
    moved: usize,
    thing: &'a Thing,
    table_m: f64,
    settings: &'a CellSettings,
    /// Heights of each thing of the shown view, but for the moved one.
    things: Vec<Option<Receiver>>,
    /// Heights of everything but the moved thing.
    around: HeightMap,
}

/// A thing that may receive another.
struct Receiver {
    heights: HeightMap,
    /// Middle of its upper edge, and half of its extent.
    middle: DVec2,
    half: DVec2,
    top_m: f64,
    hollow: bool,
}

/// The part of the table that an arm reaches, m.
const REACH_M: [DVec2; 2] = [DVec2::new(-0.2, -1.0), DVec2::new(1.2, 1.0)];
/// Free space around a place that is told apart, m: more makes no place better.
const CLEARANCES_M: [f64; 4] = [0.01, 0.006, 0.003, 0.0];
/// What is lower than this above a place is no obstacle there, m.
const LOW_M: f64 = 0.006;
/// A receiver this much longer than the moved thing takes two of them.
const FITS_TWO: f64 = 2.2;
/// Share of the room on a receiver that is used.
const INSIDE: f64 = 0.8;
/// Further points of a cell, and their least distance from each other, m.
const OTHERS: usize = 3;
const APART_M: f64 = 0.012;

/// A receiver whose middle lies this much below its edge is hollow, m: more than plates and boards.
const HOLLOW_M: f64 = 0.025;
/// Part of the height below the top that counts as the edge, and the least such band, m.
const EDGE_SHARE: f64 = 0.25;
const EDGE_M: f64 = 0.015;

impl<'a> Resolver<'a> {
    fn new(
        sight: &Sight,
        view: &'a View,
        moved: usize,
        thing: &'a Thing,
        around: &[DVec3],
        table_m: f64,
        settings: &'a CellSettings,
    ) -> Self {
        let receiver = |mask: usize| (mask != moved).then(|| Receiver::new(&sight.points(mask), table_m)).flatten();
        let things = (0..view.masks.len()).map(receiver).collect();
        let around = HeightMap::new(REACH_M[0], REACH_M[1], around.iter().copied());
        Self { view, moved, thing, table_m, settings, things, around }
    }

    fn placing(&self, grid: &Grid, cell: Cell) -> Option<Placing> {
        let pixels = self.pixels(grid, cell);
        let middle = pixels.get(pixels.len() / 2).copied()?;
        if !self.settings.snap {
            return self.measured(middle);
        }
        let covered = |mask: &Mask| pixels.iter().filter(|&&pixel| mask.pixels[pixel]).count();
        let counts = self.view.masks.iter().enumerate().filter(|(index, _)| *index != self.moved);
        let most = counts
            .map(|(index, mask)| (covered(mask), index))
            .max_by_key(|&(count, index)| (count, usize::MAX - index));
        let of_thing = most.filter(|(count, _)| *count as f64 >= self.settings.thing_share * pixels.len() as f64);
        match of_thing {
            Some((_, index)) => self.on_thing(index, &pixels),
            None => self.on_table(&pixels),
        }
    }

    /// Pixels spread over a cell, its centre in the middle of the list.
    fn pixels(&self, grid: &Grid, cell: Cell) -> Vec<usize> {
        let [left, top, right, bottom] = grid.edges(cell);
        let count = self.settings.samples.max(1);
        let at =
            |low: f64, high: f64, index: usize| (low + (high - low) * (index as f64 + 0.5) / count as f64) as usize;
        let width = grid.width as usize;
        (0..count)
            .flat_map(|row| (0..count).map(move |column| at(top, bottom, row) * width + at(left, right, column)))
            .collect()
    }

    /// The measured point under a pixel, as it is.
    fn measured(&self, pixel: usize) -> Option<Placing> {
        let point = self.view.image.point(pixel)?;
        let point = if self.view.masks.get(self.moved).is_some_and(|mask| mask.pixels[pixel]) {
            self.table_point(pixel)?
        } else {
            point
        };
        let index = self.view.masks.iter().position(|mask| mask.pixels[pixel]);
        let receiver = index.and_then(|index| self.things.get(index)?.as_ref());
        let rim_m = receiver.map_or(point.z, |receiver| receiver.top_m);
        let hollow = receiver.is_some_and(|receiver| receiver.hollow);
        Some(Placing { point, others: Vec::new(), hollow, rim_m })
    }

    /// Where the ray of a pixel meets the table.
    fn table_point(&self, pixel: usize) -> Option<DVec3> {
        let width = self.view.image.width() as usize;
        on_plane(&self.view.image, [(pixel % width) as f64, (pixel / width) as f64], self.table_m)
    }

    fn on_table(&self, pixels: &[usize]) -> Option<Placing> {
        let is_table = |pixel: &usize| {
            let own = self.view.masks.get(self.moved).is_some_and(|mask| mask.pixels[*pixel]);
            own || self.view.image.point(*pixel).is_some_and(|point| (point.z - self.table_m).abs() < 0.015)
        };
        let middle = pixels[pixels.len() / 2];
        let center = self.table_point(middle)?;
        let points = pixels.iter().filter(|pixel| is_table(pixel)).filter_map(|&pixel| self.table_point(pixel));
        let clearance = |point: DVec3| {
            let half = self.thing.half;
            let is_free = |margin: f64| {
                self.around.highest(point.truncate(), half + margin).is_none_or(|top_m| top_m < point.z + LOW_M)
            };
            CLEARANCES_M.into_iter().find(|margin| is_free(*margin)).unwrap_or(-1.0)
        };
        // A gap is met in its middle; where there is room, the centre of the cell counts.
        let mut points: Vec<(f64, DVec3)> = points.map(|point| (clearance(point), point)).collect();
        let distance = |point: DVec3| point.distance(center);
        points.sort_by(|a, b| b.0.total_cmp(&a.0).then(distance(a.1).total_cmp(&distance(b.1))));
        let free: Vec<DVec3> =
            points.iter().filter(|(room, _)| *room >= self.settings.clearance_m).map(|(_, point)| *point).collect();
        let points: Vec<DVec3> = points.into_iter().map(|(_, point)| point).collect();
        let point = free.first().or(points.first()).copied()?;
        Some(Placing { point, others: apart(&free), hollow: false, rim_m: self.table_m })
    }

    fn on_thing(&self, index: usize, pixels: &[usize]) -> Option<Placing> {
        let receiver = self.things.get(index)?.as_ref()?;
        let mask = &self.view.masks[index];
        let seen = pixels.iter().filter(|&&pixel| mask.pixels[pixel]).filter_map(|&pixel| self.view.image.point(pixel));
        // Where two would fit, the cell says which side is meant; otherwise the middle is.
        let room = receiver.half - self.thing.half;
        let has_room_for_two = receiver.half.max_element() > FITS_TWO * self.thing.half.max_element();
        let low = receiver.middle - room.max(DVec2::ZERO) * INSIDE;
        let high = receiver.middle + room.max(DVec2::ZERO) * INSIDE;
        let seen = seen.map(|point| point.truncate().clamp(low, high));
        let middle = (!has_room_for_two).then_some(receiver.middle);
        let choices: Vec<DVec2> = middle.into_iter().chain(centered(seen.collect())).collect();
        let at = |center: DVec2| center.extend(receiver.support_m(center, self.thing.half));
        let free: Vec<DVec3> =
            choices.iter().copied().map(at).filter(|point| self.is_free(*point, Some(index))).collect();
        let point = free.first().copied().unwrap_or_else(|| at(receiver.middle));
        Some(Placing { point, others: apart(&free), hollow: receiver.hollow, rim_m: receiver.top_m })
    }

    /// Whether no other thing rises above a place where the moved one would stand.
    fn is_free(&self, point: DVec3, on: Option<usize>) -> bool {
        let half = self.thing.half + self.settings.clearance_m;
        let others = self.things.iter().enumerate().filter(|(index, _)| Some(*index) != on);
        others
            .filter_map(|(_, thing)| thing.as_ref())
            .all(|other| other.heights.highest(point.truncate(), half).is_none_or(|top_m| top_m < point.z + LOW_M))
    }
}

/// The points of a cell, the one nearest to their mean first.
fn centered(mut points: Vec<DVec2>) -> Vec<DVec2> {
    let mean = points.iter().sum::<DVec2>() / points.len().max(1) as f64;
    points.sort_by(|a, b| a.distance(mean).total_cmp(&b.distance(mean)));
    points
}

/// A few of the points behind the first, apart from it and from each other.
fn apart(points: &[DVec3]) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    for point in points {
        if kept.len() <= OTHERS && kept.iter().all(|other| other.distance(*point) >= APART_M) {
            kept.push(*point);
        }
    }
    kept.into_iter().skip(1).collect()
}

impl Receiver {
    fn new(points: &[DVec3], table_m: f64) -> Option<Self> {
        let mut levels: Vec<f64> = points.iter().map(|point| point.z).collect();
        levels.sort_by(f64::total_cmp);
        // A few stray pixels are no edge.
        let top_m = *levels.get(levels.len().checked_sub(1 + levels.len() / 200)?)?;
        let band = EDGE_M.max(EDGE_SHARE * (top_m - table_m));
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in points.iter().filter(|point| point.z >= top_m - band) {
            (low, high) = (low.min(point.truncate()), high.max(point.truncate()));
        }
        let all = points.iter().map(|point| point.truncate());
        let (outer_low, outer_high) =
            all.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let heights = HeightMap::new(outer_low, outer_high, points.iter().copied());
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let floor_m = heights.quantile(middle, half * 0.35, 0.3);
        let hollow = floor_m.is_some_and(|floor_m| floor_m < top_m - HOLLOW_M);
        Some(Self { heights, middle, half, top_m, hollow })
    }

    /// Height at which a thing of some extent comes to rest here.
    fn support_m(&self, center: DVec2, half: DVec2) -> f64 {
        // The round thing does not reach the corners of its box, and walls slope.
        let share = if self.hollow { 0.95 } else { 0.98 };
        let inside = half.min(self.half) * if self.hollow { 0.7 } else { 0.9 };
        self.heights.quantile(center, inside, share).unwrap_or(self.top_m)
    }
}

/// Where the ray of a pixel meets a level plane; `None` when it does not.
pub fn on_plane(image: &RgbdImage, pixel: [f64; 2], height_m: f64) -> Option<DVec3> {
    let eye = image.world_from_camera.position;
    let ray = image.world_from_camera.transform_vector(image.intrinsics.unproject(DVec2::from_array(pixel), 1.0));
    let along = (height_m - eye.z) / ray.z;
    (along > 0.0 && along.is_finite()).then(|| eye + ray * along)
}
