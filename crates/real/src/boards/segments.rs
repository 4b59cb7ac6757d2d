//! Connected dark segments of an image, and their contours.

use genmanip_core::glam::DVec2;

use super::grey::GreyImage;

/// Side of the tiles whose minimum and maximum brightness set the adaptive threshold, pixels. As in AprilTag 2.
const TILE: usize = 4;
/// Minimum difference between bright and dark around an edge, grey levels. Chosen by hand.
const MIN_CONTRAST: u8 = 20;
/// Minimum width and height of a segment, pixels; the same as for the sides of a tag.
const MIN_SIDE: usize = 10;

/// Contours of the dark segments, as midpoints of pixel edges, clockwise from the top left.
pub fn outlines(image: &GreyImage) -> Vec<Vec<DVec2>> {
    let (width, height) = (image.width(), image.height());
    let dark = Dark::of(image);
    let mut is_seen = vec![false; width * height];
    let mut found = Vec::new();
    let mut open = Vec::new();
    for first in 0..width * height {
        if is_seen[first] || !dark.pixels[first] {
            continue;
        }
        let (mut left, mut right, mut bottom) = (width, 0, 0);
        is_seen[first] = true;
        open.push(first);
        while let Some(index) = open.pop() {
            let (x, y) = (index % width, index / width);
            (left, right, bottom) = (left.min(x), right.max(x), bottom.max(y));
            let mut visit = |index: usize| {
                if dark.pixels[index] && !is_seen[index] {
                    is_seen[index] = true;
                    open.push(index);
                }
            };
            if x > 0 {
                visit(index - 1);
            }
            if x + 1 < width {
                visit(index + 1);
            }
            if y > 0 {
                visit(index - width);
            }
            if y + 1 < height {
                visit(index + width);
            }
        }
        if right + 1 - left >= MIN_SIDE && bottom + 1 - first / width >= MIN_SIDE {
            found.push(dark.outline(first));
        }
    }
    found
}

/// Pixels that are darker than the mean of the brightest and the darkest pixel around them.
struct Dark {
    width: usize,
    height: usize,
    pixels: Vec<bool>,
}

impl Dark {
    fn of(image: &GreyImage) -> Self {
        let image = image.smoothed();
        let (width, height) = (image.width(), image.height());
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut tiles = vec![(u8::MAX, u8::MIN); columns * rows];
        for y in 0..height {
            for x in 0..width {
                let (low, high) = &mut tiles[y / TILE * columns + x / TILE];
                (*low, *high) = ((*low).min(image.at(x, y)), (*high).max(image.at(x, y)));
            }
        }
        let around = |column: usize, row: usize| {
            let tiles = &tiles;
            let rows = row.saturating_sub(1)..(row + 2).min(rows);
            let near = rows.flat_map(|row| {
                (column.saturating_sub(1)..(column + 2).min(columns)).map(move |column| tiles[row * columns + column])
            });
            near.fold((u8::MAX, u8::MIN), |(low, high), tile| (low.min(tile.0), high.max(tile.1)))
        };
        let mut pixels = vec![false; width * height];
        for row in 0..rows {
            for column in 0..columns {
                let (low, high) = around(column, row);
                if high - low < MIN_CONTRAST {
                    continue;
                }
                let middle = low + (high - low) / 2;
                for y in row * TILE..((row + 1) * TILE).min(height) {
                    for x in column * TILE..((column + 1) * TILE).min(width) {
                        pixels[y * width + x] = image.at(x, y) < middle;
                    }
                }
            }
        }
        Self { width, height, pixels }
    }

    /// Contour of the segment to which `first` belongs, its first pixel in row-major order, as midpoints of the pixel
    /// edges.
    fn outline(&self, first: usize) -> Vec<DVec2> {
        let is_dark = |x: i64, y: i64| {
            let is_inside = (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y);
            is_inside && self.pixels[y as usize * self.width + x as usize]
        };
        // The contour is followed with the segment on the right; the position is a pixel corner (pixel x, y has its top
        // left corner at x, y).
        let begin = ((first % self.width) as i64, (first / self.width) as i64);
        let (mut at, mut step) = (begin, (1_i64, 0_i64));
        let mut outline = Vec::new();
        loop {
            let next = (at.0 + step.0, at.1 + step.1);
            outline.push(DVec2::new((at.0 + next.0) as f64 / 2.0 - 0.5, (at.1 + next.1) as f64 / 2.0 - 0.5));
            at = next;
            // Pixels ahead of the corner, on the left and on the right.
            let (x, y) = match step {
                (1, 0) => ((0, -1), (0, 0)),
                (0, 1) => ((0, 0), (-1, 0)),
                (-1, 0) => ((-1, 0), (-1, -1)),
                _ => ((-1, -1), (0, -1)),
            };
            let (ahead_left, ahead_right) = (is_dark(at.0 + x.0, at.1 + x.1), is_dark(at.0 + y.0, at.1 + y.1));
            step = match (ahead_left, ahead_right) {
                (_, false) => (-step.1, step.0),
                (false, true) => step,
                (true, true) => (step.1, -step.0),
            };
            if at == begin && step == (1, 0) {
                return outline;
            }
        }
    }
}
