//! Layout of printed boards: tags, squares and numbered corners.

use genmanip_core::glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grey::GreyImage;
use super::tags::{CELLS, TAGS, is_dark};

/// Grey levels of black and white in a raster image of a board.
pub const LEVELS: [u8; 2] = [0, 255];

/// Minimum number of detected tags for a board to count as found: a single tag could be one that is elsewhere in the
/// room.
pub const MIN_TAGS: usize = 2;

/// Chessboard whose white squares hold tags of the family tag36h11, as OpenCV's `CharucoBoard` with
/// `DICT_APRILTAG_36h11` (4.6 and newer): the top left square is black, tags are numbered in row-major order and upside
/// down, and inner corners are numbered in row-major order from the top left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Charuco {
    /// Number of squares per row.
    pub columns: u32,
    /// Number of rows of squares.
    pub rows: u32,
    /// Side of a square, metres.
    pub square_m: f64,
    /// Side of a tag with its black border, metres.
    pub tag_m: f64,
    /// Id of the first tag.
    #[serde(default)]
    pub first_id: u32,
}

/// Grid of tags of the family tag36h11, numbered in row-major order from the top left. The corners of a tag have the
/// ids 4 · index of the tag and the three following, clockwise from its top left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TagGrid {
    /// Number of tags per row.
    pub columns: u32,
    /// Number of rows of tags.
    pub rows: u32,
    /// Side of a tag with its black border, metres.
    pub tag_m: f64,
    /// White gap between neighbours, metres.
    pub gap_m: f64,
    /// Id of the first tag.
    #[serde(default)]
    pub first_id: u32,
}

/// Layout of a printed board; x to the right and y down from its top left, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Width and height of the pattern, metres.
    pub size_m: DVec2,
    /// Tags with their places.
    pub tags: Vec<PlacedTag>,
    /// Black squares of a chessboard.
    pub squares: Vec<Rectangle>,
    /// Corners; a corner's id is its index.
    pub corners: Vec<Corner>,
    /// Width of the white margin between a tag and the chessboard corners around it, metres.
    pub margin_m: f64,
}

/// A tag on a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedTag {
    /// Id within the tag family.
    pub id: u32,
    /// Outline of its black border.
    pub outline: Rectangle,
    /// True if the tag is printed upside down.
    pub is_turned: bool,
}

/// Axis-aligned rectangle on a board, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Top left corner on the board.
    pub at: DVec2,
    /// Width and height.
    pub size: DVec2,
}

/// A numbered corner of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position on the board, metres.
    pub at: DVec2,
    /// Printed pattern around the corner, by which it is detected.
    pub kind: CornerKind,
}

/// Printed pattern around a corner, by which it is detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CornerKind {
    /// Inner corner of a chessboard.
    Crossing {
        /// True if the squares at the corner's top left and bottom right are black.
        falls_dark: bool,
    },
    /// Outer corner of a tag.
    OfTag {
        /// Index of the tag in [`Layout::tags`].
        tag: usize,
        /// Index of the corner, clockwise from the tag's top left.
        corner: usize,
    },
}

impl Charuco {
    /// Layout of this board.
    ///
    /// # Errors
    /// Names the number that is out of range.
    pub fn layout(&self) -> Result<Layout, String> {
        let Self { columns, rows, square_m, tag_m, first_id } = *self;
        check_counts(columns, rows, 3)?;
        check_lengths(&[("square_m", square_m), ("tag_m", tag_m)])?;
        if !(0.3 * square_m..=0.85 * square_m).contains(&tag_m) {
            return Err(format!("tag_m {tag_m} with square_m {square_m}; expected 0.3 to 0.85 of it"));
        }
        let cells = || (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)));
        let at = |column: u32, row: u32| DVec2::new(f64::from(column), f64::from(row)) * square_m;
        let margin_m = (square_m - tag_m) / 2.0;
        let white = cells().filter(|(column, row)| (column + row) % 2 == 1);
        let outline = |(column, row)| Rectangle { at: at(column, row) + margin_m, size: DVec2::splat(tag_m) };
        let tags = placed(first_id, true, white.map(outline))?;
        let black = cells().filter(|(column, row)| (column + row) % 2 == 0);
        let squares =
            black.map(|(column, row)| Rectangle { at: at(column, row), size: DVec2::splat(square_m) }).collect();
        let inner = cells().filter(|(column, row)| *column > 0 && *row > 0);
        let corner = |(column, row)| Corner {
            at: at(column, row),
            kind: CornerKind::Crossing { falls_dark: (column + row) % 2 == 0 },
        };
        Ok(Layout { size_m: at(columns, rows), tags, squares, corners: inner.map(corner).collect(), margin_m })
    }
}

impl TagGrid {
    /// Layout of this board.
    ///
    /// # Errors
    /// Names the number that is out of range.
    pub fn layout(&self) -> Result<Layout, String> {
        let Self { columns, rows, tag_m, gap_m, first_id } = *self;
        check_counts(columns, rows, 1)?;
        check_lengths(&[("tag_m", tag_m), ("gap_m", gap_m)])?;
        if gap_m < 0.15 * tag_m {
            return Err(format!("gap_m {gap_m} with tag_m {tag_m}; expected 0.15 of it or more"));
        }
        let cells =
            (0..rows).flat_map(|row| (0..columns).map(move |column| DVec2::new(f64::from(column), f64::from(row))));
        let outline = |cell: DVec2| Rectangle { at: cell * (tag_m + gap_m), size: DVec2::splat(tag_m) };
        let tags = placed(first_id, false, cells.map(outline))?;
        let corners = tags.iter().enumerate().flat_map(|(tag, placed)| {
            let corners = placed.outline.corners().into_iter().enumerate();
            corners.map(move |(corner, at)| Corner { at, kind: CornerKind::OfTag { tag, corner } })
        });
        let count = DVec2::new(f64::from(columns), f64::from(rows));
        let size_m = count * (tag_m + gap_m) - gap_m;
        let corners = corners.collect();
        Ok(Layout { size_m, tags, squares: Vec::new(), corners, margin_m: gap_m })
    }
}

impl Layout {
    /// Black rectangles of the print, metres: chessboard squares, and horizontal runs of cells of the tags.
    pub fn dark(&self) -> Vec<Rectangle> {
        let mut dark = self.squares.clone();
        for tag in &self.tags {
            let cell = tag.outline.size / f64::from(CELLS);
            let is_black = |column: u32, row: u32| {
                let [column, row] = [column, row].map(|at| if tag.is_turned { CELLS - 1 - at } else { at });
                is_dark(tag.id, column, row)
            };
            for row in 0..CELLS {
                let mut column = 0;
                while column < CELLS {
                    let run = (column..CELLS).take_while(|&column| is_black(column, row)).count() as u32;
                    if run > 0 {
                        let at = tag.outline.at + cell * DVec2::new(f64::from(column), f64::from(row));
                        dark.push(Rectangle { at, size: cell * DVec2::new(f64::from(run), 1.0) });
                    }
                    column += run + 1;
                }
            }
        }
        dark
    }

    /// Raster image of the print with pixels of side `pixel_m` and a white border of `border_m` (metres); edges are
    /// rounded to whole pixels.
    pub fn raster(&self, pixel_m: f64, border_m: f64) -> GreyImage {
        let [black, white] = LEVELS;
        let pixel = |at: DVec2| ((at + border_m) / pixel_m).round().as_usizevec2();
        let size = pixel(self.size_m + border_m);
        let mut values = vec![white; size.x * size.y];
        for rectangle in self.dark() {
            let (from, to) = (pixel(rectangle.at), pixel(rectangle.at + rectangle.size));
            (from.y..to.y).for_each(|row| values[row * size.x..][from.x..to.x].fill(black));
        }
        GreyImage::of(size.x, size.y, values)
    }
}

impl Rectangle {
    /// Corners, clockwise from the top left.
    pub fn corners(&self) -> [DVec2; 4] {
        let Self { at, size } = *self;
        [at, at + DVec2::new(size.x, 0.0), at + size, at + DVec2::new(0.0, size.y)]
    }
}

fn check_counts(columns: u32, rows: u32, least: u32) -> Result<(), String> {
    if columns < least || rows < least || columns > 100 || rows > 100 {
        return Err(format!("{columns} x {rows}; expected {least} to 100 each way"));
    }
    Ok(())
}

fn check_lengths(lengths: &[(&str, f64)]) -> Result<(), String> {
    match lengths.iter().find(|(_, length)| !(1e-4..10.0).contains(length)) {
        Some((name, length)) => Err(format!("{name} {length}; expected metres, such as 0.025")),
        None => Ok(()),
    }
}

fn placed(first_id: u32, is_turned: bool, outlines: impl Iterator<Item = Rectangle>) -> Result<Vec<PlacedTag>, String> {
    let outlines: Vec<Rectangle> = outlines.collect();
    let (count, last) = (outlines.len(), u64::from(first_id) + outlines.len() as u64);
    if count < MIN_TAGS || last > u64::from(TAGS) {
        return Err(format!(
            "{count} tags from id {first_id}; expected {MIN_TAGS} tags or more, with ids below {TAGS}"
        ));
    }
    Ok((first_id..).zip(outlines).map(|(id, outline)| PlacedTag { id, outline, is_turned }).collect())
}
