//! Static layer: parts at rest are rasterised once, moving parts are drawn over them, and changed tiles are reported.
//!
//! Exact: a [`VisibilityBuffer`] does not depend on the order of drawing, so the result has the bits of a full redraw.

use std::ops::Range;

use crate::raster::VisibilityBuffer;

/// Pixels along the side of a tile.
pub(crate) const TILE: usize = 8;

/// Pixel indices within a tile (row by row) of the set bits.
#[inline(always)]
pub(crate) fn each_place(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (bits != 0).then_some(bits.trailing_zeros() as usize & (TILE * TILE - 1))?;
        bits &= bits - 1;
        Some(place)
    })
}

/// A rectangle of pixels, ends excluded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Rectangle {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl Rectangle {
    /// Pixels whose samples may be covered by geometry with these image bounds (px), clipped to the image.
    pub fn around(low: [f32; 2], high: [f32; 2], width: usize, height: usize) -> Self {
        let span = |low: f32, high: f32, limit: usize| {
            let from = (low - 1.0).max(0.0) as usize;
            let to = (high + 2.0).max(0.0) as usize;
            from.min(limit)..to.min(limit)
        };
        Self { columns: span(low[0], high[0], width), rows: span(low[1], high[1], height) }
    }

    /// Row and column of each of the rectangle's pixels, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let columns = self.columns.clone();
        self.rows.clone().flat_map(move |row| columns.clone().map(move |column| (row, column)))
    }

    pub fn is_empty(&self) -> bool {
        self.columns.is_empty() || self.rows.is_empty()
    }

    /// Columns of the tiles that the rectangle overlaps.
    pub fn tile_columns(&self) -> Range<usize> {
        if self.is_empty() { 0..0 } else { self.columns.start / TILE..self.columns.end.div_ceil(TILE) }
    }

    /// Rows of the tiles that the rectangle overlaps.
    pub fn tile_rows(&self) -> Range<usize> {
        if self.is_empty() { 0..0 } else { self.rows.start / TILE..self.rows.end.div_ceil(TILE) }
    }
}

/// Motion of a part from the last frame to this one.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motion {
    pub moved: bool,
    /// Image bounds (px) of the part in the last frame and in this one.
    pub before: Rectangle,
    pub now: Rectangle,
}

/// Visibility buffer of all parts, with a second one (the layer) of the static parts only.
#[derive(Debug, Default)]
pub(crate) struct LayeredBuffer {
    pub target: VisibilityBuffer,
    layer: VisibilityBuffer,
    in_layer: Vec<bool>,
    is_layered: bool,
    /// Tiles in which moving parts are visible.
    over: Vec<bool>,
    pub tile_columns: usize,
    pub tile_rows: usize,
    /// Tiles that the last update may have changed.
    pub changed: Vec<bool>,
}

impl LayeredBuffer {
    /// Draws all parts into an emptied buffer of `width` × `height` pixels with `scale`² samples each; discards the
    /// static layer.
    pub fn redraw<const IDS: bool>(
        &mut self,
        [width, height]: [usize; 2],
        scale: usize,
        parts: usize,
        mut draw: impl FnMut(usize, &mut VisibilityBuffer),
    ) {
        self.target.reset::<IDS>(width, height, scale);
        (self.tile_columns, self.tile_rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        self.changed.clear();
        self.changed.resize(self.tile_columns * self.tile_rows, true);
        self.is_layered = false;
        for part in 0..parts {
            draw(part, &mut self.target);
        }
    }

    /// Updates the buffer after motions: static parts come from the layer, moved parts are drawn again.
    pub fn follow<const IDS: bool>(&mut self, motions: &[Motion], mut draw: impl FnMut(usize, &mut VisibilityBuffer)) {
        self.changed.fill(false);
        if !motions.iter().any(|motion| motion.moved) {
            return;
        }
        let scale = self.target.scale;
        let (width, height) = (self.target.width / scale, self.target.height / scale);
        let leaves = |(motion, in_layer): (&Motion, &bool)| motion.moved && *in_layer;
        let is_new = !self.is_layered || motions.iter().zip(&self.in_layer).any(leaves);
        if is_new {
            self.in_layer.clear();
            self.in_layer.extend(motions.iter().map(|motion| !motion.moved));
            self.layer.reset::<IDS>(width, height, scale);
            self.is_layered = true;
            for part in (0..motions.len()).filter(|&part| self.in_layer[part]) {
                draw(part, &mut self.layer);
            }
            self.over.clear();
            self.over.resize(self.changed.len(), false);
        }
        for motion in motions.iter().filter(|motion| motion.moved) {
            self.mark(&motion.before);
            self.mark(&motion.now);
        }
        for tile in 0..self.changed.len() {
            // A tile in which no moving part was visible still shows the layer.
            if is_new || self.changed[tile] && self.over[tile] {
                let [columns, rows] = self.samples_of(tile);
                self.target.copy_rectangle(&self.layer, columns, rows);
            }
        }
        for part in (0..motions.len()).filter(|&part| !self.in_layer[part]) {
            draw(part, &mut self.target);
        }
        // Bounds are generous: a marked tile that still shows only the static layer has not changed.
        for tile in 0..self.changed.len() {
            if !self.changed[tile] {
                continue;
            }
            let [columns, rows] = self.samples_of(tile);
            let is_over = self.target.differs(&self.layer, columns, rows);
            self.changed[tile] = is_new || is_over || self.over[tile];
            self.over[tile] = is_over;
        }
    }

    /// Samples of a tile, as ranges of columns and rows.
    fn samples_of(&self, tile: usize) -> [Range<usize>; 2] {
        let size = TILE * self.target.scale;
        let samples = |at: usize, limit: usize| at * size..((at + 1) * size).min(limit);
        [samples(tile % self.tile_columns, self.target.width), samples(tile / self.tile_columns, self.target.height)]
    }

    /// Marks the tiles that overlap a rectangle as changed.
    pub fn mark(&mut self, rectangle: &Rectangle) {
        for row in rectangle.tile_rows() {
            self.changed[row * self.tile_columns..][rectangle.tile_columns()].fill(true);
        }
    }
}

/// Summed-area table of marks on a grid of tiles: tests rectangles in constant time.
#[derive(Debug, Default)]
pub(crate) struct MarkCount {
    columns: usize,
    rows: usize,
    sums: Vec<u32>,
}

impl MarkCount {
    /// Replaces the table by the sums of a grid of marks.
    pub fn count(&mut self, marks: impl IntoIterator<Item = bool>, columns: usize, rows: usize) {
        (self.columns, self.rows) = (columns, rows);
        self.sums.clear();
        self.sums.resize((columns + 1) * (rows + 1), 0);
        let mut marks = marks.into_iter();
        for row in 1..=rows {
            let mut sum = 0;
            for column in 1..=columns {
                sum += u32::from(marks.next().unwrap_or(false));
                self.sums[row * (columns + 1) + column] = self.sums[(row - 1) * (columns + 1) + column] + sum;
            }
        }
    }

    /// True if any tile in a range of columns and rows, ends included, is marked; the range may exceed the grid.
    pub fn any(&self, from: [isize; 2], to: [isize; 2]) -> bool {
        let cut = |value: isize, limit: usize| value.clamp(0, limit as isize) as usize;
        let (x0, x1) = (cut(from[0], self.columns), cut(to[0] + 1, self.columns));
        let (y0, y1) = (cut(from[1], self.rows), cut(to[1] + 1, self.rows));
        let at = |x: usize, y: usize| self.sums[y * (self.columns + 1) + x];
        x0 < x1 && y0 < y1 && at(x1, y1) + at(x0, y0) > at(x0, y1) + at(x1, y0)
    }
}
