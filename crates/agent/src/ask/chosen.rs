//! Image of an answer for the transcript: the chosen mark, and the place that it refers to.

use genmanip_core::RgbdImage;

use super::answer::Answer;
use super::question::{Marks, Question};
use crate::grid::{Cell, Grid};
use crate::image::{Color, RgbImage, WHITE, marks};

/// Name of the image of an answer.
pub(super) const CHOSEN: &str = "chosen";
/// Colour of the chosen mark.
const COLOR: Color = [228, 26, 28];
/// Opacity of the tint of a chosen mask or cell.
const FILL: f64 = 0.35;

/// The view with the answer drawn into it; `None` for an answer in words.
///
/// A mask is tinted, a grab point is a disc, a cell is tinted with a disc at the resolved place; a path is a line through
/// its cells.
pub(super) fn picture(question: &Question, answer: &Answer) -> Option<RgbImage> {
    let view = &question.view;
    let mut image = RgbImage::new(view.width(), view.height(), view.rgb.clone())?;
    match (answer, &question.marks) {
        (Answer::Mark(answer), Marks::Masks(masks)) => {
            let mask = masks.get(answer.mask).cloned()?;
            marks::tints(&mut image, &[mask], &[COLOR], FILL);
        }
        (Answer::GrabPoint(answer), Marks::Points(points)) => {
            let pixel = *points.get(answer.point)?;
            let width = view.width().max(1) as usize;
            disc(&mut image, [(pixel % width) as f64, (pixel / width) as f64]);
        }
        (Answer::Point(answer), Marks::Grid { grid, targets, .. }) => {
            tinted(&mut image, grid, answer.cell);
            place(&mut image, view, targets.get(&answer.cell).copied());
        }
        (Answer::Path(answer), Marks::Grid { grid, targets, .. }) => {
            let centers: Vec<[f64; 2]> = answer.cells.iter().map(|step| grid.center(step.cell)).collect();
            for step in centers.windows(2) {
                image.line(step[0], step[1], 2.0 * image.unit(), COLOR);
            }
            let last = answer.cells.last()?.cell;
            tinted(&mut image, grid, last);
            place(&mut image, view, targets.get(&last).copied());
        }
        _ => return None,
    }
    Some(image)
}

fn tinted(image: &mut RgbImage, grid: &Grid, cell: Cell) {
    let [left, top, right, bottom] = grid.edges(cell);
    image.rectangle([left, top], [right, bottom], COLOR, FILL);
}

/// Draws a disc at a world point, if the view shows it.
fn place(image: &mut RgbImage, view: &RgbdImage, point: Option<glam::DVec3>) {
    if let Some(pixel) = point.and_then(|point| view.pixel_of(point)) {
        disc(image, pixel.to_array());
    }
}

fn disc(image: &mut RgbImage, at: [f64; 2]) {
    let size = image.unit();
    image.disc(at, 3.6 * size, WHITE);
    image.disc(at, 2.6 * size, COLOR);
}
