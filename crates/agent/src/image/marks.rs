//! Marks on images: numbered masks, crops, points, the labelled grid, the grab point, the robot's direction arrows.
//!
//! Labels are white on a dark background; they are placed on large objects and beside small ones.

use genmanip_core::RgbdImage;
use glam::DVec3;

use super::font::label_size;
use super::{BLACK, Color, RgbImage, WHITE};
use crate::grid::Grid;
use crate::segmentation::Mask;

/// Sentences that explain the arrows in prompts, after the one on the [`viewpoint`].
const ARROWS: &str = "Arrows in the picture show the robot's own directions: LEFT and \
RIGHT are the robot's left and right, FAR points away from the robot, NEAR towards it. Words like left, right, front \
and behind in the task mean the robot's directions, not those of the picture: front, or in front of, means the far \
side, and behind means the side near the robot.";

/// Colours of masks and points, distinguishable from white and from each other; used cyclically.
const COLORS: [Color; 8] = [
    [228, 26, 28],
    [55, 126, 184],
    [60, 160, 60],
    [152, 78, 163],
    [235, 120, 0],
    [0, 150, 150],
    [166, 86, 40],
    [220, 60, 150],
];

/// Opacity of mask tints in images for models, low enough to see the object.
const FILL: f64 = 0.05;

/// Label scale: pixels per dot in a 512x288 image.
const DOT: f64 = 1.0;

fn color(index: usize) -> Color {
    COLORS[index % COLORS.len()]
}

/// Label dot size (px), a whole number so that letters stay sharp.
fn dot(image: &RgbImage) -> f64 {
    (DOT * image.unit()).round().max(1.0)
}

/// Draws masks outlined, tinted and numbered from 1.
pub fn masks(image: &RgbImage, masks: &[Mask]) -> RgbImage {
    let mut marked = image.clone();
    tints(&mut marked, masks, &COLORS, FILL);
    numbers(&mut marked, masks, &COLORS);
    marked
}

/// Outlines masks in cyclic colours and fills them with opacity `fill` in [0, 1].
pub fn tints(image: &mut RgbImage, masks: &[Mask], colors: &[Color], fill: f64) {
    for (mask, color) in masks.iter().zip(colors.iter().cycle()) {
        tint(image, mask, *color, fill);
    }
}

/// Numbers masks from 1; each label has a frame in its mask's colour, used cyclically.
pub fn numbers(image: &mut RgbImage, masks: &[Mask], colors: &[Color]) {
    let taken = labels(image, masks);
    let size = dot(image);
    for ((index, middle), color) in taken.into_iter().enumerate().zip(colors.iter().cycle()) {
        let Some(middle) = middle else { continue };
        if let Some(anchor) = anchor(&masks[index]).filter(|anchor| !is_on(&masks[index], middle, *anchor)) {
            image.line(middle, anchor, size.max(1.0), *color);
        }
        image.label(&(index + 1).to_string(), middle, size);
        frame(image, &(index + 1).to_string(), middle, size, *color);
    }
}

/// Draws a thin coloured frame around a label to associate it with its outline.
fn frame(image: &mut RgbImage, text: &str, middle: [f64; 2], dot: f64, color: Color) {
    let size = label_size(text, dot);
    let [left, top] = [(middle[0] - size[0] / 2.0).round(), (middle[1] - size[1] / 2.0).round()];
    let (right, bottom) = (left + size[0], top + size[1]);
    for [from, to] in [
        [[left, top - dot], [right, top]],
        [[left, bottom], [right, bottom + dot]],
        [[left - dot, top], [left, bottom]],
        [[right, top], [right + dot, bottom]],
    ] {
        image.rectangle(from, to, color, 1.0);
    }
}

fn tint(image: &mut RgbImage, mask: &Mask, color: Color, fill: f64) {
    let width = mask.width as usize;
    let has = |x: i64, y: i64| {
        x >= 0
            && y >= 0
            && x < i64::from(mask.width)
            && y < i64::from(mask.height)
            && mask.pixels[y as usize * width + x as usize]
    };
    let reach = (image.unit().round() as i64).max(1);
    for index in mask.indices() {
        let (x, y) = ((index % width) as i64, (index / width) as i64);
        let edge = [(-reach, 0), (reach, 0), (0, -reach), (0, reach)].iter().any(|(dx, dy)| !has(x + dx, y + dy));
        image.blend(x, y, color, if edge { 0.9 } else { fill });
    }
}

/// Pixel coordinates of [`Mask::middle`]. `None` for an empty mask.
fn anchor(mask: &Mask) -> Option<[f64; 2]> {
    let width = mask.width as usize;
    mask.middle().map(|index| [(index % width) as f64, (index / width) as f64])
}

/// True if the label lies on its object.
fn is_on(mask: &Mask, middle: [f64; 2], anchor: [f64; 2]) -> bool {
    let index = middle[1].max(0.0) as usize * mask.width as usize + middle[0].max(0.0) as usize;
    middle == anchor || mask.pixels.get(index) == Some(&true)
}

/// Maximum share of an object that its label may hide. Chosen by hand.
const MAX_HIDDEN_SHARE: f64 = 0.2;
/// Number of directions and (`STEPS`) of steps of the search for a free label position.
const DIRECTIONS: usize = 16;
const STEPS: usize = 12;

/// Label position of each mask: on large objects, otherwise beside them where no other mask is covered.
fn labels(image: &RgbImage, masks: &[Mask]) -> Vec<Option<[f64; 2]>> {
    let size_dot = dot(image);
    let mut placed: Vec<[f64; 4]> = Vec::new();
    let bounds = |middle: [f64; 2], size: [f64; 2]| {
        [middle[0] - size[0] / 2.0, middle[1] - size[1] / 2.0, middle[0] + size[0] / 2.0, middle[1] + size[1] / 2.0]
    };
    let covered = |mask: &Mask, [left, top, right, bottom]: [f64; 4]| {
        let rows = top.max(0.0) as usize..(bottom.max(0.0).ceil() as usize).min(mask.height as usize);
        rows.map(|row| {
            let columns = left.max(0.0) as usize..(right.max(0.0).ceil() as usize).min(mask.width as usize);
            columns.filter(|column| mask.pixels[row * mask.width as usize + column]).count()
        })
        .sum::<usize>()
    };
    masks
        .iter()
        .enumerate()
        .map(|(index, mask)| {
            let anchor = anchor(mask)?;
            let size = label_size(&(index + 1).to_string(), size_dot).map(|side| side + 2.0 * size_dot);
            let area = mask.indices().count();
            let hides = |middle: [f64; 2]| {
                let area_of = |other: &Mask| covered(other, bounds(middle, size));
                masks.iter().map(area_of).sum::<usize>() as f64
            };
            let overlap = |middle: [f64; 2], placed: &[[f64; 4]]| {
                let [left, top, right, bottom] = bounds(middle, size);
                let outside =
                    left < 0.0 || top < 0.0 || right > f64::from(image.width) || bottom > f64::from(image.height);
                let crossing = placed
                    .iter()
                    .any(|other| left < other[2] && right > other[0] && top < other[3] && bottom > other[1]);
                outside || crossing
            };
            let fits_on = size[0] * size[1] <= MAX_HIDDEN_SHARE * area as f64;
            let beside = (1..=STEPS).flat_map(|step| (0..DIRECTIONS).map(move |direction| (step, direction))).map(
                |(step, direction)| {
                    let turn =
                        direction as f64 / DIRECTIONS as f64 * std::f64::consts::TAU - std::f64::consts::FRAC_PI_2;
                    let reach = size[1] * (0.5 + 0.5 * step as f64);
                    [anchor[0] + reach * turn.cos(), anchor[1] + reach * turn.sin()]
                },
            );
            let choices: Vec<[f64; 2]> = std::iter::once(anchor).filter(|_| fits_on).chain(beside).collect();
            let cost = |index: usize, middle: [f64; 2]| match (index, fits_on) {
                (0, true) => 0.0,
                _ => hides(middle) + 0.1 * index as f64,
            };
            let free = choices.iter().enumerate().filter(|(_, middle)| !overlap(**middle, &placed));
            let best = free.min_by(|a, b| cost(a.0, *a.1).total_cmp(&cost(b.0, *b.1)));
            let middle = best.map_or(anchor, |(_, middle)| *middle);
            placed.push(bounds(middle, size));
            Some(middle)
        })
        .collect()
}

/// Crops the image around an object; returns the plain crop and one with the parts outlined and numbered.
pub fn crops(image: &RgbImage, whole: &Mask, parts: &[Mask]) -> [RgbImage; 2] {
    let width = whole.width as usize;
    let Some([columns, rows]) = whole.bounds() else { return [image.clone(), image.clone()] };
    let (low, high) = ([columns[0], rows[0]], [columns[1], rows[1]]);
    let margin = ((high[0] - low[0]).max(high[1] - low[1]) / 5).max(6);
    let corner = low.map(|side| side.saturating_sub(margin));
    let end = [(high[0] + margin + 1).min(image.width), (high[1] + margin + 1).min(image.height)];
    let size = [end[0] - corner[0], end[1] - corner[1]];
    // Enlarge to about the default image size.
    let scale = (512 / size[0].max(1)).min(288 / size[1].max(1)).clamp(1, 6);
    let plain = image.cropped(corner, size, scale);
    let cut = |mask: &Mask| {
        let [columns, rows] = size.map(|side| (side * scale) as usize);
        let pixels = (0..rows * columns).map(|index| {
            let x = corner[0] as usize + index % columns / scale as usize;
            let y = corner[1] as usize + index / columns / scale as usize;
            mask.pixels[y * width + x]
        });
        Mask { width: columns as u32, height: rows as u32, pixels: pixels.collect() }
    };
    let parts: Vec<Mask> = parts.iter().map(cut).collect();
    let numbered = masks(&plain, &parts);
    [plain, numbered]
}

/// Draws points numbered from 1, each with its label beside it.
pub fn points(image: &RgbImage, pixels: &[usize]) -> RgbImage {
    let mut marked = image.clone();
    let (size, width) = (dot(image), image.width as usize);
    let places: Vec<[f64; 2]> = pixels.iter().map(|pixel| [(pixel % width) as f64, (pixel / width) as f64]).collect();
    let count = places.len().max(1) as f64;
    let middle = places.iter().fold([0.0, 0.0], |sum, at| [sum[0] + at[0] / count, sum[1] + at[1] / count]);
    // Labels are arranged on a circle around the points, sorted by angle.
    let mut order: Vec<usize> = (0..places.len()).collect();
    let turn = |index: usize| (places[index][1] - middle[1]).atan2(places[index][0] - middle[0]);
    order.sort_by(|a, b| turn(*a).total_cmp(&turn(*b)));
    let spread = places.iter().map(|at| (at[0] - middle[0]).hypot(at[1] - middle[1])).fold(0.0, f64::max);
    for (rank, &index) in order.iter().enumerate() {
        let first = order.first().map_or(0.0, |&index| turn(index));
        let angle = first + rank as f64 / count * std::f64::consts::TAU;
        let reach = spread + 14.0 * size;
        let label = label_size("5", size);
        let keep = |value: f64, side: f64, most: u32| value.clamp(side / 2.0 + 1.0, f64::from(most) - side / 2.0 - 1.0);
        let at = [
            keep(middle[0] + reach * angle.cos(), label[0], image.width),
            keep(middle[1] + reach * angle.sin(), label[1], image.height),
        ];
        marked.line(places[index], at, size, color(index));
        marked.label(&(index + 1).to_string(), at, size);
        frame(&mut marked, &(index + 1).to_string(), at, size, color(index));
    }
    for (index, at) in places.iter().enumerate() {
        marked.disc(*at, 2.6 * size, WHITE);
        marked.disc(*at, 1.9 * size, color(index));
    }
    marked
}

/// Draws a labelled grid and a cross at the grab point.
pub fn grid(image: &RgbImage, grid: &Grid, grab: [f64; 2]) -> RgbImage {
    let mut marked = image.clone();
    lettered(&mut marked, grid);
    cross(&mut marked, grab);
    marked
}

/// Approximate side of an enlarged grid (px). Chosen by hand.
const ENLARGED_PX: u32 = 576;

/// Enlarges the part of an image that a grid covers; draws the grid and, if it lies inside, a cross at the grab point.
pub fn enlarged_grid(image: &RgbImage, grid: &Grid, grab: [f64; 2]) -> RgbImage {
    let Grid { left, top, width, height, .. } = *grid;
    let scale = (ENLARGED_PX / width.max(height).max(1)).clamp(1, 8);
    let mut marked = image.cropped([left, top], [width, height], scale);
    lettered(&mut marked, &Grid { left: 0, top: 0, width: width * scale, height: height * scale, ..*grid });
    if grid.cell_at(grab[0], grab[1]).is_some() {
        let enlarged = |at: f64, start: u32| (at + 0.5 - f64::from(start)) * f64::from(scale) - 0.5;
        cross(&mut marked, [enlarged(grab[0], left), enlarged(grab[1], top)]);
    }
    marked
}

/// Draws the lines and labels of a grid.
pub fn lettered(image: &mut RgbImage, grid: &Grid) {
    let size = dot(image);
    for cell in grid.cells() {
        let [left, top, right, bottom] = grid.edges(cell);
        for [from, to] in [[[left, top], [right, top + size]], [[left, top], [left + size, bottom]]] {
            image.rectangle(from, to, BLACK, 0.45);
        }
        image.small_label(&cell.to_string(), [left + 2.0 * size, top + 2.0 * size], size);
    }
}

/// Draws a cross with a white outline.
fn cross(image: &mut RgbImage, at: [f64; 2]) {
    let (size, reach) = (dot(image), 6.0 * dot(image));
    for (width, color) in [(4.0, WHITE), (2.0, [220, 0, 0])] {
        for (dx, dy) in [(1.0, 1.0), (1.0, -1.0)] {
            let (from, to) = ([at[0] - reach * dx, at[1] - reach * dy], [at[0] + reach * dx, at[1] + reach * dy]);
            image.line(from, to, width * size, color);
        }
    }
}

/// Length of an arrow in the world (m). Chosen by hand.
const ARROW_M: f64 = 0.11;
/// Position of the arrows as a share of the image's width and height: a lower corner, away from the table's centre.
const ARROWS_AT: [f64; 2] = [0.9, 0.86];
/// Horizontal share of a viewing direction below which a camera counts as looking straight down. Chosen by hand.
const STEEP: f64 = 0.2;

/// Sentences that say from where the camera sees the table and what the arrows mean.
pub fn directions(view: &RgbdImage) -> String {
    format!("{} {ARROWS}", viewpoint(view.world_from_camera.transform_vector(DVec3::Z)))
}

/// Sentence on the viewpoint of a camera that looks in a direction, world frame.
fn viewpoint(looks: DVec3) -> &'static str {
    let [along, across] = [looks.x, looks.y].map(f64::abs);
    if along.max(across) < STEEP * looks.length() {
        "The camera looks straight down."
    } else if along >= across {
        if looks.x < 0.0 { "The camera faces the robot." } else { "The camera looks away from the robot." }
    } else if looks.y < 0.0 {
        "The camera looks across the table from the robot's left."
    } else {
        "The camera looks across the table from the robot's right."
    }
}

/// Draws arrows for the robot's left, right, far and near directions into a corner of the image, in perspective.
pub fn arrows(image: &mut RgbImage, view: &RgbdImage, table_m: f64) {
    let at = [ARROWS_AT[0] * f64::from(image.width), ARROWS_AT[1] * f64::from(image.height)];
    let Some(foot) = crate::perception::on_plane(view, at, table_m) else { return };
    let camera_from_world = view.world_from_camera.inverse();
    let pixel = |point: DVec3| view.intrinsics.project(camera_from_world.transform_point(point));
    let Some(start) = pixel(foot) else { return };
    let size = dot(image);
    for (direction, name) in [(DVec3::Y, "LEFT"), (DVec3::NEG_Y, "RIGHT"), (DVec3::X, "FAR"), (DVec3::NEG_X, "NEAR")] {
        let Some(end) = pixel(foot + direction * ARROW_M) else { continue };
        let step = end - start;
        let length = step.length();
        if length < 1.0 {
            continue;
        }
        // The length is fixed in pixels; only the direction follows the perspective.
        let step = step / length;
        let tip = start + step * (16.0 * size);
        let side = step.perp() * (3.0 * size);
        let back = tip - step * (4.5 * size);
        let (from, to) = (start + step * (3.0 * size), tip);
        for (width, color) in [(3.0, WHITE), (1.4, [0, 70, 160])] {
            image.line(from.to_array(), to.to_array(), width * size, color);
            for barb in [back + side, back - side] {
                image.line(barb.to_array(), tip.to_array(), width * size, color);
            }
        }
        let label = label_size(name, size);
        let beyond = tip + step * (2.0 * size) + step * glam::DVec2::new(label[0], label[1]) / 2.0;
        let keep = |value: f64, side: f64, most: u32| value.clamp(side / 2.0, f64::from(most) - side / 2.0);
        let middle = [keep(beyond.x, label[0], image.width), keep(beyond.y, label[1], image.height)];
        image.label(name, middle, size);
    }
}
