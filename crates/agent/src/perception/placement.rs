//! Conversion of a grid cell that the model named into a place for the object.

use std::collections::BTreeMap;

use genmanip_core::RgbdImage;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::{HeightMap, ObservedObject, SegmentedViews, View};
use crate::grid::{Cell, Grid};
use crate::segmentation::Mask;

/// Settings of the conversion from grid cells to places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CellSettings {
    /// If true, a cell resolves to the surface seen in it: the middle of an object, or the point of the table with
    /// the most clearance, among equals the nearest to the cell's centre. If false, the measured point under the cell's
    /// centre is used as is.
    pub snap: bool,
    /// Minimum share of a cell's pixels that an object must cover for the cell to refer to it.
    pub thing_share: f64,
    /// Clearance around the placed object (m).
    pub clearance_m: f64,
    /// Number of candidate points along each side of a cell.
    pub samples: usize,
}

impl Default for CellSettings {
    fn default() -> Self {
        Self {
            snap: true,
            // Chosen: an object that covers less is better addressed by neighbouring cells.
            thing_share: 0.3,
            // Chosen: margin for the release error; the fingers are collision-checked separately.
            clearance_m: 0.006,
            samples: 7,
        }
    }
}

/// Place for the moved object, in 3D.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacementTarget {
    /// Rest position of the object's footprint centre, world frame (m).
    pub point: DVec3,
    /// Alternative free points of the same cell if `point` is out of reach, in the order of preference.
    pub others: Vec<DVec3>,
    /// True if the receiver is hollow, so that the object may be released from any height.
    pub hollow: bool,
    /// Height of the receiver's rim, world z (m); of the table without a receiver.
    pub rim_m: f64,
    /// Number of objects on the table close to the place; 0 for a place on a receiver.
    pub neighbours: usize,
    /// True if the model may have meant another surface that is visible in the cell.
    pub mixed: bool,
}

/// Placement targets of all cells of a grid over the shown image that can receive the object.
///
/// `around` holds the points of everything but the moved object and the table, world frame (m).
pub fn targets(
    views: &SegmentedViews,
    moved: usize,
    object: &ObservedObject,
    around: &[DVec3],
    table_m: f64,
    settings: &CellSettings,
    grid: &Grid,
) -> BTreeMap<Cell, PlacementTarget> {
    let Some(view) = views.shown() else { return BTreeMap::new() };
    let resolver = Resolver::new(views, view, moved, object, around, table_m, settings);
    let seen: Vec<SeenCell> = grid.cells().map(|cell| resolver.seen(grid, cell)).collect();
    let best = |mask: usize| seen.iter().map(|seen| seen.shares[mask]).fold(0.0, f64::max);
    let best: Vec<f64> = (0..view.masks.len()).map(best).collect();
    let targets = grid.cells().zip(&seen).map(|(cell, seen)| Some((cell, resolver.target(seen, &best)?)));
    targets.flatten().collect()
}

struct Resolver<'a> {
    view: &'a View,
    moved: usize,
    object: &'a ObservedObject,
    table_m: f64,
    settings: &'a CellSettings,
    /// Possible receivers: the objects of the shown view except the moved one.
    receivers: Vec<Option<Receiver>>,
    /// Height map of everything except the moved object.
    around: HeightMap,
}

/// Pixels sampled over a cell, and the masks that cover them.
struct SeenCell {
    /// Pixel indices sampled over the cell, its centre in the middle of the list.
    pixels: Vec<usize>,
    /// Share of them that each mask covers, 0 to 1.
    shares: Vec<f64>,
}

/// An object that may receive the moved object.
struct Receiver {
    /// Heights of its observed points, world z (m).
    heights: HeightMap,
    /// Centre and half extents of its upper rim, world xy (m).
    middle: DVec2,
    half: DVec2,
    /// Height of its rim, world z (m).
    top_m: f64,
    /// True if its middle lies lower than its rim, as in a bowl.
    hollow: bool,
}

/// Maximum gap to the moved object at which another object counts as its neighbour (m). Chosen by hand: about half the
/// width of a coarse cell on the table.
const NEIGHBOUR_M: f64 = 0.05;
/// Corners of the reachable part of the table, world xy (m).
const REACH_M: [DVec2; 2] = [DVec2::new(-0.2, -1.0), DVec2::new(1.2, 1.0)];
/// Clearance levels that rank candidate points (m); more clearance is no better.
const CLEARANCE_LEVELS_M: [f64; 4] = [0.01, 0.006, 0.003, 0.0];
/// Minimum share of a cell that an object must cover to be a surface that may be meant, and (`MAIN_SHARE`) share of the
/// chosen object below which the table may be meant instead. Chosen by hand.
const SURFACE_SHARE: f64 = 0.05;
const MAIN_SHARE: f64 = 0.5;
/// Minimum share of a cell that an object must cover, relative to the cell that it covers most, for this object to be
/// meant: a model that means an object names a cell that shows it well. Chosen by hand.
const MEANT_SHARE: f64 = 0.5;
/// Height above the target below which points do not count as obstacles (m). Chosen by hand.
const MIN_OBSTACLE_HEIGHT_M: f64 = 0.006;
/// A receiver longer than this multiple of the moved object holds two of them.
const HOLDS_TWO_RATIO: f64 = 2.2;
/// Usable share of the free extent on a receiver. Chosen by hand.
const USABLE_SHARE: f64 = 0.8;
/// Maximum number of alternative points per cell, and (`MIN_ALTERNATIVE_DISTANCE_M`) minimum distance between them (m).
const MAX_ALTERNATIVES: usize = 3;
const MIN_ALTERNATIVE_DISTANCE_M: f64 = 0.012;

/// Minimum depth of the middle below the rim of a hollow receiver (m); deeper than plates and boards.
const MIN_HOLLOW_DEPTH_M: f64 = 0.025;
/// Height of the rim band as a share of the receiver's height, and (`MIN_RIM_M`) its minimum (m). Chosen by hand.
const RIM_SHARE: f64 = 0.25;
const MIN_RIM_M: f64 = 0.015;

impl<'a> Resolver<'a> {
    fn new(
        views: &SegmentedViews,
        view: &'a View,
        moved: usize,
        object: &'a ObservedObject,
        around: &[DVec3],
        table_m: f64,
        settings: &'a CellSettings,
    ) -> Self {
        let receiver = |mask: usize| (mask != moved).then(|| Receiver::new(&views.points(mask), table_m)).flatten();
        let receivers = (0..view.masks.len()).map(receiver).collect();
        let around = HeightMap::new(REACH_M[0], REACH_M[1], around.iter().copied());
        Self { view, moved, object, table_m, settings, receivers, around }
    }

    fn seen(&self, grid: &Grid, cell: Cell) -> SeenCell {
        let pixels = self.pixels(grid, cell);
        let covered = |mask: &Mask| pixels.iter().filter(|&&pixel| mask.pixels[pixel]).count();
        let share = |mask: &Mask| covered(mask) as f64 / pixels.len() as f64;
        let shares = self.view.masks.iter().map(share).collect();
        SeenCell { pixels, shares }
    }

    /// Target of a cell; `best[mask]` is the largest share of any cell that the mask covers.
    fn target(&self, seen: &SeenCell, best: &[f64]) -> Option<PlacementTarget> {
        let SeenCell { pixels, shares } = seen;
        let middle = pixels.get(pixels.len() / 2).copied()?;
        if !self.settings.snap {
            return self.measured(middle);
        }
        let others = (0..shares.len()).filter(|index| *index != self.moved);
        let largest = others.clone().max_by(|a, b| shares[*a].total_cmp(&shares[*b]).then(b.cmp(a)));
        let main = largest.filter(|index| shares[*index] >= self.settings.thing_share);
        let target = match main {
            Some(index) => self.on_receiver(index, pixels),
            None => self.on_table(pixels),
        };
        // The table may be meant beside an object that covers less than half of the cell.
        let may_be_table = main.is_some_and(|index| shares[index] < MAIN_SHARE);
        let may_be = |index: usize| shares[index] >= SURFACE_SHARE && shares[index] >= MEANT_SHARE * best[index];
        let mixed = may_be_table || others.clone().any(|index| Some(index) != main && may_be(index));
        target.map(|target| PlacementTarget { mixed, ..target })
    }

    /// Pixel indices sampled over a cell, its centre in the middle of the list.
    fn pixels(&self, grid: &Grid, cell: Cell) -> Vec<usize> {
        let [left, top, right, bottom] = grid.edges(cell);
        let count = self.settings.samples.max(1);
        let at =
            |low: f64, high: f64, index: usize| (low + (high - low) * (index as f64 + 0.5) / count as f64) as usize;
        let width = self.view.image.width() as usize;
        (0..count)
            .flat_map(|row| (0..count).map(move |column| at(top, bottom, row) * width + at(left, right, column)))
            .collect()
    }

    /// Target at the measured point of a pixel, without snapping; `None` without depth.
    fn measured(&self, pixel: usize) -> Option<PlacementTarget> {
        let point = self.view.image.point(pixel)?;
        let point = if self.view.masks.get(self.moved).is_some_and(|mask| mask.pixels[pixel]) {
            self.table_point(pixel)?
        } else {
            point
        };
        let index = self.view.masks.iter().position(|mask| mask.pixels[pixel]);
        let receiver = index.and_then(|index| self.receivers.get(index)?.as_ref());
        let rim_m = receiver.map_or(point.z, |receiver| receiver.top_m);
        let hollow = receiver.is_some_and(|receiver| receiver.hollow);
        Some(PlacementTarget { point, others: Vec::new(), hollow, rim_m, neighbours: 0, mixed: false })
    }

    /// Intersection of a pixel's view ray with the table plane; `None` if there is none.
    fn table_point(&self, pixel: usize) -> Option<DVec3> {
        let width = self.view.image.width() as usize;
        on_plane(&self.view.image, [(pixel % width) as f64, (pixel / width) as f64], self.table_m)
    }

    fn on_table(&self, pixels: &[usize]) -> Option<PlacementTarget> {
        // 15 mm (chosen): more than the noise of depth cameras at arm's length, less than most objects' height.
        let is_table = |pixel: &usize| {
            let own = self.view.masks.get(self.moved).is_some_and(|mask| mask.pixels[*pixel]);
            own || self.view.image.point(*pixel).is_some_and(|point| (point.z - self.table_m).abs() < 0.015)
        };
        let middle = pixels[pixels.len() / 2];
        let center = self.table_point(middle)?;
        let points = pixels.iter().filter(|pixel| is_table(pixel)).filter_map(|&pixel| self.table_point(pixel));
        let clearance = |point: DVec3| {
            let half = self.object.half;
            let is_free = |margin: f64| {
                self.around
                    .highest(point.truncate(), half + margin)
                    .is_none_or(|top_m| top_m < point.z + MIN_OBSTACLE_HEIGHT_M)
            };
            CLEARANCE_LEVELS_M.into_iter().find(|margin| is_free(*margin)).unwrap_or(-1.0)
        };
        // Rank by clearance first, which centres the object in a gap, then by distance from the cell's centre.
        let mut points: Vec<(f64, DVec3)> = points.map(|point| (clearance(point), point)).collect();
        let distance = |point: DVec3| point.distance(center);
        points.sort_by(|a, b| b.0.total_cmp(&a.0).then(distance(a.1).total_cmp(&distance(b.1))));
        let free: Vec<DVec3> = points
            .iter()
            .filter(|(free_extent, _)| *free_extent >= self.settings.clearance_m)
            .map(|(_, point)| *point)
            .collect();
        let points: Vec<DVec3> = points.into_iter().map(|(_, point)| point).collect();
        let point = free.first().or(points.first()).copied()?;
        let neighbours = self.neighbours(point);
        let (others, rim_m) = (alternatives(&free), self.table_m);
        Some(PlacementTarget { point, others, hollow: false, rim_m, neighbours, mixed: false })
    }

    fn on_receiver(&self, index: usize, pixels: &[usize]) -> Option<PlacementTarget> {
        let receiver = self.receivers.get(index)?.as_ref()?;
        let mask = &self.view.masks[index];
        let seen = pixels.iter().filter(|&&pixel| mask.pixels[pixel]).filter_map(|&pixel| self.view.image.point(pixel));
        // If two objects fit, the cell selects the side; otherwise use the middle.
        let free_extent = receiver.half - self.object.half;
        let holds_two = receiver.half.max_element() > HOLDS_TWO_RATIO * self.object.half.max_element();
        let low = receiver.middle - free_extent.max(DVec2::ZERO) * USABLE_SHARE;
        let high = receiver.middle + free_extent.max(DVec2::ZERO) * USABLE_SHARE;
        let seen = seen.map(|point| point.truncate().clamp(low, high));
        let middle = (!holds_two).then_some(receiver.middle);
        let choices: Vec<DVec2> = middle.into_iter().chain(sorted_by_centrality(seen.collect())).collect();
        let at = |center: DVec2| center.extend(receiver.support_m(center, self.object.half));
        let free: Vec<DVec3> =
            choices.iter().copied().map(at).filter(|point| self.is_free(*point, Some(index))).collect();
        let point = free.first().copied().unwrap_or_else(|| at(receiver.middle));
        let (hollow, rim_m) = (receiver.hollow, receiver.top_m);
        let others = alternatives(&free);
        Some(PlacementTarget { point, others, hollow, rim_m, neighbours: 0, mixed: false })
    }

    /// Number of objects whose bounding boxes are at most [`NEIGHBOUR_M`] from the moved object at a point of the
    /// table.
    fn neighbours(&self, point: DVec3) -> usize {
        let gap = |other: &Receiver| {
            let apart = (other.middle - point.truncate()).abs() - other.half - self.object.half;
            apart.max(DVec2::ZERO).length()
        };
        self.receivers.iter().flatten().filter(|other| gap(other) <= NEIGHBOUR_M).count()
    }

    /// True if no other object obstructs the moved object at this point.
    fn is_free(&self, point: DVec3, on: Option<usize>) -> bool {
        let half = self.object.half + self.settings.clearance_m;
        let others = self.receivers.iter().enumerate().filter(|(index, _)| Some(*index) != on);
        others.filter_map(|(_, object)| object.as_ref()).all(|other| {
            other.heights.highest(point.truncate(), half).is_none_or(|top_m| top_m < point.z + MIN_OBSTACLE_HEIGHT_M)
        })
    }
}

/// Sorts points by distance from their mean.
fn sorted_by_centrality(mut points: Vec<DVec2>) -> Vec<DVec2> {
    let mean = points.iter().sum::<DVec2>() / points.len().max(1) as f64;
    points.sort_by(|a, b| a.distance(mean).total_cmp(&b.distance(mean)));
    points
}

/// Up to [`MAX_ALTERNATIVES`] points after the first, at least [`MIN_ALTERNATIVE_DISTANCE_M`] from it and from each
/// other.
fn alternatives(points: &[DVec3]) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    for point in points {
        if kept.len() <= MAX_ALTERNATIVES
            && kept.iter().all(|other| other.distance(*point) >= MIN_ALTERNATIVE_DISTANCE_M)
        {
            kept.push(*point);
        }
    }
    kept.into_iter().skip(1).collect()
}

impl Receiver {
    fn new(points: &[DVec3], table_m: f64) -> Option<Self> {
        let mut levels: Vec<f64> = points.iter().map(|point| point.z).collect();
        levels.sort_by(f64::total_cmp);
        // Ignore the top 0.5 % of points: stray pixels.
        let top_m = *levels.get(levels.len().checked_sub(1 + levels.len() / 200)?)?;
        let band = MIN_RIM_M.max(RIM_SHARE * (top_m - table_m));
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for point in points.iter().filter(|point| point.z >= top_m - band) {
            (low, high) = (low.min(point.truncate()), high.max(point.truncate()));
        }
        let all = points.iter().map(|point| point.truncate());
        let (outer_low, outer_high) =
            all.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let heights = HeightMap::new(outer_low, outer_high, points.iter().copied());
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        // Chosen: the floor of a cavity is the lower part of its middle third; the quantile skips stray low pixels.
        let floor_m = heights.quantile(middle, half * 0.35, 0.3);
        let hollow = floor_m.is_some_and(|floor_m| floor_m < top_m - MIN_HOLLOW_DEPTH_M);
        Some(Self { heights, middle, half, top_m, hollow })
    }

    /// Support height under a footprint at `center` (m).
    fn support_m(&self, center: DVec2, half: DVec2) -> f64 {
        // Round objects do not fill their bounding box, and cavity walls slope. Quantiles skip stray pixels, of which
        // there are more at the walls of a cavity.
        let share = if self.hollow { 0.95 } else { 0.98 };
        let inside = half.min(self.half) * if self.hollow { 0.7 } else { 0.9 };
        self.heights.quantile(center, inside, share).unwrap_or(self.top_m)
    }
}

/// Intersection of a pixel's view ray with the horizontal plane at `height_m`; `None` if there is none.
pub fn on_plane(image: &RgbdImage, pixel: [f64; 2], height_m: f64) -> Option<DVec3> {
    let camera = image.world_from_camera.position;
    let ray = image.world_from_camera.transform_vector(image.intrinsics.unproject(DVec2::from_array(pixel), 1.0));
    let along = (height_m - camera.z) / ray.z;
    (along > 0.0 && along.is_finite()).then(|| camera + ray * along)
}
