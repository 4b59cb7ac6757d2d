//! Detection of a board in an image: first its tags, then its corners.

use genmanip_core::glam::{DMat3, DVec2};
use thiserror::Error;

use super::crossing::{self, Expected};
use super::grey::GreyImage;
use super::layout::{Corner, CornerKind, Layout, MIN_TAGS, PlacedTag};
use super::tags::{CELLS, decoded};
use super::{quads, segments};
use crate::homography::{homography, mapped};

/// Minimum brightness difference between the white around a tag and its black border, grey levels. Chosen by hand.
const MIN_CONTRAST: f64 = 15.0;
/// Maximum number of border cells of a tag that look white. Chosen by hand.
const MOST_BRIGHT: usize = 2;
/// Maximum distance between a tag's corner and the prediction by the homography of all tags, as a share of the tag's
/// side. Chosen by hand.
const MAX_ASTRAY: f64 = 0.4;
/// Maximum distance between the centre of a tag and a chessboard corner that is predicted from it, in squares.
const NEAR: f64 = 1.6;

/// Reason why an image shows no board.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NoBoard {
    /// No tag of the family was found.
    #[error("no board in the image")]
    NoTag,
    /// All tags found belong to another board.
    #[error("{count} tags, none of this board; the first has id {id}: is this the board that is described?")]
    OtherTags {
        /// Number of tags that were found.
        count: usize,
        /// Id of one of these tags.
        id: u32,
    },
    /// Only one tag of the board was found.
    #[error("a single tag of the board; show more of it, nearer or with more light")]
    OneTag,
}

/// Corners of a board in an image, by id; pixel centres are at integers.
///
/// # Errors
/// [`NoBoard`] if fewer than two tags of the board are found.
pub fn detect(image: &GreyImage, layout: &Layout) -> Result<Vec<(u32, DVec2)>, NoBoard> {
    let all = tags(image);
    let Some(first) = all.first() else { return Err(NoBoard::NoTag) };
    let place = |tag: &SeenTag| {
        let index = layout.tags.iter().position(|placed| placed.id == tag.id)?;
        // If an id occurs twice, one of the tags is a reflection or another print.
        let is_unique = all.iter().filter(|other| other.id == tag.id).count() == 1;
        let (on_board, mut seen) = (layout.tags[index], tag.corners);
        seen.rotate_left(if on_board.is_turned { 2 } else { 0 });
        is_unique.then_some(Placed { index, on_board, seen })
    };
    let mut placed: Vec<Placed> = all.iter().filter_map(place).collect();
    if placed.is_empty() {
        return Err(NoBoard::OtherTags { count: all.len(), id: first.id });
    }
    while let Some(astray) = astray(&placed) {
        placed.swap_remove(astray);
    }
    if placed.len() < MIN_TAGS {
        return Err(NoBoard::OneTag);
    }
    // Sharp edges alias; after smoothing, their subpixel position can be measured.
    let smooth = image.smoothed();
    let corner = |(id, corner): (usize, &Corner)| {
        let pixel = match corner.kind {
            CornerKind::OfTag { tag, corner } => placed.iter().find(|it| it.index == tag).map(|it| it.seen[corner]),
            CornerKind::Crossing { falls_dark } => {
                crossing::refined(&smooth, &expected(corner.at, falls_dark, &placed, layout)?)
            }
        };
        Some((id as u32, pixel?))
    };
    Ok(layout.corners.iter().enumerate().filter_map(corner).collect())
}

/// A tag of the board with its corners in the image, clockwise from its top left.
struct Placed {
    index: usize,
    on_board: PlacedTag,
    seen: [DVec2; 4],
}

impl Placed {
    fn pairs(&self) -> impl Iterator<Item = (DVec2, DVec2)> + Clone + use<> {
        self.on_board.outline.corners().into_iter().zip(self.seen)
    }
}

/// Index of the tag with the largest error against the homography of all tags, if that error is too large. `None`
/// otherwise.
fn astray(placed: &[Placed]) -> Option<usize> {
    let map = homography(placed.iter().flat_map(Placed::pairs));
    let error = |it: &Placed| {
        let side = it.seen[0].distance(it.seen[2]) / std::f64::consts::SQRT_2;
        let miss = |(from, to)| map.and_then(|map| mapped(&map, from)).map_or(f64::INFINITY, |at| at.distance(to));
        it.pairs().map(miss).fold(0.0, f64::max) / side
    };
    let worst = (0..placed.len()).max_by(|&a, &b| error(&placed[a]).total_cmp(&error(&placed[b])))?;
    (error(&placed[worst]) > MAX_ASTRAY).then_some(worst)
}

/// Expected position and orientation of a chessboard corner, from the homography of the tags around it; `None` if none
/// of them was found.
fn expected(at: DVec2, falls_dark: bool, placed: &[Placed], layout: &Layout) -> Option<Expected> {
    let square = layout.squares.first()?.size;
    let distance = |it: &Placed| ((it.on_board.outline.at + it.on_board.outline.size / 2.0 - at) / square).length();
    let near = placed.iter().filter(|it| distance(it) < NEAR);
    let map = homography(near.flat_map(Placed::pairs).collect::<Vec<_>>().into_iter())?;
    let pixel = mapped(&map, at)?;
    let toward = |x: f64, y: f64| Some(mapped(&map, at + DVec2::new(x, y) * layout.margin_m)? - pixel);
    let axes = [toward(1.0, 0.0)?.normalize(), toward(0.0, 1.0)?.normalize()];
    let diagonals = [toward(1.0, 1.0)?, toward(1.0, -1.0)?, toward(-1.0, 1.0)?, toward(-1.0, -1.0)?];
    // The tags begin at this distance; their blurred edges reach 0.7 pixels closer.
    let reach = diagonals.iter().map(|off| off.length()).fold(f64::INFINITY, f64::min) - 0.7;
    Some(Expected { at: pixel, axes, reach, is_dark: falls_dark })
}

/// A tag found in an image.
struct SeenTag {
    id: u32,
    /// Pixels of the corners, clockwise from the tag's top left.
    corners: [DVec2; 4],
}

fn tags(image: &GreyImage) -> Vec<SeenTag> {
    let tag = |outline: Vec<DVec2>| {
        let mut corners = quads::corners(image, &outline)?;
        let (id, first) = decoded(bits(image, &corners)?)?;
        corners.rotate_left(first);
        Some(SeenTag { id, corners })
    };
    segments::outlines(image).into_iter().filter_map(tag).collect()
}

/// Bits of a quadrilateral in row-major order from its first corner; `None` if it has no black border on white.
fn bits(image: &GreyImage, corners: &[DVec2; 4]) -> Option<u64> {
    let side = f64::from(CELLS);
    let square = [DVec2::ZERO, DVec2::new(side, 0.0), DVec2::splat(side), DVec2::new(0.0, side)];
    let map = homography(square.into_iter().zip(*corners))?;
    let center = |column: i32, row: i32| DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
    let last = CELLS as i32 - 1;
    let ring = |near: i32, far: i32| (near..=far).flat_map(move |at| [(at, near), (at, far), (near, at), (far, at)]);
    let black = Shade::of(image, &map, ring(0, last).map(|(column, row)| center(column, row)))?;
    // Sampled half a cell outside of the border: the white margin may be narrower than a cell.
    let white = Shade::of(
        image,
        &map,
        ring(-1, last + 1)
            .map(|(column, row)| center(column, row).clamp(DVec2::splat(-0.45), DVec2::splat(side + 0.45))),
    )?;
    let is_bright = |at: DVec2| Some(read(image, &map, at)? > f64::midpoint(black.at(at), white.at(at)));
    let middle = DVec2::splat(side / 2.0);
    if white.at(middle) - black.at(middle) < MIN_CONTRAST {
        return None;
    }
    let mut bright = 0;
    for (column, row) in ring(0, last) {
        bright += usize::from(is_bright(center(column, row))?);
    }
    // The ring visits each corner cell four times in total, others once.
    if bright > 2 * MOST_BRIGHT {
        return None;
    }
    let mut bits = 0;
    for row in 1..last {
        for column in 1..last {
            bits = bits << 1 | u64::from(is_bright(center(column, row))?);
        }
    }
    Some(bits)
}

/// Mean brightness in the middle of a cell; `None` outside of the image.
fn read(image: &GreyImage, map: &DMat3, center: DVec2) -> Option<f64> {
    const OFFS: [f64; 2] = [-0.15, 0.15];
    let mut sum = 0.0;
    for y in OFFS {
        for x in OFFS {
            sum += image.sampled(mapped(map, center + DVec2::new(x, y))?)?;
        }
    }
    Some(sum / 4.0)
}

/// Brightness that varies linearly over a tag (gradual shading).
struct Shade {
    constant: f64,
    slope: DVec2,
    middle: DVec2,
}

impl Shade {
    /// Least-squares fit to the brightness at points that are symmetrical about the centre of a tag. `None` if a point
    /// has no brightness.
    fn of(image: &GreyImage, map: &DMat3, places: impl Iterator<Item = DVec2>) -> Option<Self> {
        let middle = DVec2::splat(f64::from(CELLS) / 2.0);
        let (mut count, mut sum, mut moment, mut spread) = (0.0, 0.0, DVec2::ZERO, DVec2::ZERO);
        for place in places {
            let (value, off) = (read(image, map, place)?, place - middle);
            (count, sum, moment, spread) = (count + 1.0, sum + value, moment + off * value, spread + off * off);
        }
        Some(Self { constant: sum / count, slope: moment / spread, middle })
    }

    fn at(&self, place: DVec2) -> f64 {
        self.constant + self.slope.dot(place - self.middle)
    }
}
