//! Lines of the world on an image, and text.

use genmanip_agent::image::{BLACK, Color, RgbImage};
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Projection, stroke_font};

/// Nothing nearer to the camera is drawn, m; chosen: nearer lines would fill the image.
const NEAR_M: f64 = 0.03;
/// A line this far behind what the image shows is still taken to lie on it, m; chosen: three times the steps of depth
/// at the edge of an object, well below the height of a fork.
const BEHIND_M: f64 = 0.006;
/// Length of the pieces of a line that are visible or hidden as a whole, pixels of a 512x288 image; chosen: the dashes
/// of hidden lines.
const PIECE_PX: f64 = 4.0;
/// Most pieces of a line; chosen: more than the diagonal of the largest usual image has.
const MAX_LINE_PIECES: usize = 512;
/// Dark edge of lines on either side, pixels of a 512x288 image.
const EDGE_PX: f64 = 0.7;

/// Draws on an image of a camera.
pub(super) struct Pen<'a> {
    pub(super) picture: &'a mut RgbImage,
    pub(super) projection: Projection,
    /// Depth buffer that hides lines, m; empty to hide none.
    pub(super) depth_m: &'a [f32],
}

/// First and last pixel of a piece of a line, and whether something is before it.
type Piece = (DVec2, DVec2, bool);

/// Style of hidden line segments.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Hidden {
    /// As dashes.
    Dashed,
    /// As if nothing were before it.
    Shown,
}

impl Pen<'_> {
    /// A straight line of the world with a dark edge, `width` pixels wide on a 512x288 picture.
    pub(super) fn line(&mut self, from: DVec3, to: DVec3, width: f64, color: Color, hidden: Hidden) {
        self.polyline(&[from, to], width, color, hidden);
    }

    /// Straight lines from each point to the next, as [`Pen::line`], with one edge around all of them.
    pub(super) fn polyline(&mut self, points: &[DVec3], width: f64, color: Color, hidden: Hidden) {
        let unit = self.picture.unit();
        let pieces: Vec<Piece> = points.windows(2).flat_map(|pair| self.pieces(pair[0], pair[1], hidden)).collect();
        for (extra, color) in [(2.0 * EDGE_PX, BLACK), (0.0, color)] {
            for (start, end, is_hidden) in &pieces {
                // What is hidden is thinner and has no edge.
                let width = if *is_hidden { 0.6 * width } else { width + extra };
                if extra == 0.0 || !is_hidden {
                    self.picture.line(start.to_array(), end.to_array(), width * unit, color);
                }
            }
        }
    }

    /// The pieces of a line that are drawn.
    fn pieces(&self, from: DVec3, to: DVec3, hidden: Hidden) -> Vec<Piece> {
        let unit = self.picture.unit();
        let Some((from, to)) = self.ahead(from, to) else { return Vec::new() };
        let ends = self.projection.pixel(from).zip(self.projection.pixel(to));
        // Where a lens shows no place for an end, the line is still tried piece by piece.
        let length = ends.map_or(f64::from(self.picture.width), |(from, to)| from.0.distance(to.0));
        let count = ((length / (PIECE_PX * unit)).ceil() as usize).clamp(1, MAX_LINE_PIECES);
        let at = |index: usize| from.lerp(to, index as f64 / count as f64);
        let piece = |index: usize| {
            let (start, end) = (self.projection.pixel(at(index))?.0, self.projection.pixel(at(index + 1))?.0);
            let is_hidden = hidden == Hidden::Dashed && self.is_behind(at(index).lerp(at(index + 1), 0.5));
            (!is_hidden || index.is_multiple_of(2)).then_some((start, end, is_hidden))
        };
        (0..count).filter_map(piece).collect()
    }

    /// An arrow of the world, in full.
    pub(super) fn arrow(&mut self, from: DVec3, to: DVec3, width: f64, color: Color) {
        self.line(from, to, width, color, Hidden::Shown);
        let Some((foot, tip)) = self.projection.pixel(from).zip(self.projection.pixel(to)) else { return };
        self.head(foot.0, tip.0, width, color);
    }

    /// The head of an arrow between pixels.
    pub(super) fn head(&mut self, foot: DVec2, tip: DVec2, width: f64, color: Color) {
        let unit = self.picture.unit();
        let Some(way) = (tip - foot).try_normalize() else { return };
        let size = (2.6 * width * unit).min(0.6 * foot.distance(tip)).max(2.0 * unit);
        for (extra, color) in [(2.0 * EDGE_PX, BLACK), (0.0, color)] {
            for side in [1.0, -1.0] {
                let barb = tip - way * size + way.perp() * (side * 0.6 * size);
                self.picture.line(barb.to_array(), tip.to_array(), (width + extra) * unit, color);
            }
        }
    }

    /// A dot of the world with a dark edge, `radius` pixels on a 512x288 picture.
    pub(super) fn dot(&mut self, at: DVec3, radius: f64, color: Color) {
        let unit = self.picture.unit();
        let seen = self.projection.pixel(at).filter(|(_, depth_m)| *depth_m > NEAR_M);
        let Some((pixel, _)) = seen else { return };
        self.picture.disc(pixel.to_array(), (radius + EDGE_PX) * unit, BLACK);
        self.picture.disc(pixel.to_array(), radius * unit, color);
    }

    /// A text with its middle at a pixel, `height` pixels high on a 512x288 picture.
    pub(super) fn label(&mut self, text: &str, middle: DVec2, height: f64, color: Color) {
        let height = height * self.picture.unit();
        let corner = middle - DVec2::new(0.5 * width(text, height), -0.5 * height);
        write(self.picture, text, corner, height, color);
    }

    /// The part of a line before the camera.
    fn ahead(&self, from: DVec3, to: DVec3) -> Option<(DVec3, DVec3)> {
        let depth = |point: DVec3| self.projection.to_camera(point).z - NEAR_M;
        let (a, b) = (depth(from), depth(to));
        let cut = from.lerp(to, a / (a - b));
        match (a > 0.0, b > 0.0) {
            (true, true) => Some((from, to)),
            (true, false) => Some((from, cut)),
            (false, true) => Some((cut, to)),
            (false, false) => None,
        }
    }

    fn is_behind(&self, point: DVec3) -> bool {
        let Some((pixel, depth_m)) = self.projection.pixel(point) else { return false };
        if !self.projection.is_in_image(pixel) {
            return false;
        }
        let (column, row) = (pixel.x.round() as usize, pixel.y.round() as usize);
        let shown_m = self.depth_m.get(row * self.picture.width as usize + column).copied().unwrap_or(0.0);
        shown_m > 0.0 && depth_m > f64::from(shown_m) + BEHIND_M
    }
}

/// Writes a text with its base line beginning at a pixel, capitals `height` pixels high, with a dark edge.
pub(super) fn write(picture: &mut RgbImage, text: &str, at: DVec2, height: f64, color: Color) {
    // A tenth of the height is what stroke fonts are usually drawn with; thinner than a pixel and a half is grey.
    let stroke = (0.11 * height).max(1.3);
    let (strokes, _) = stroke_font::strokes(text);
    for (width, color) in [(stroke + 2.0 * EDGE_PX * picture.unit(), BLACK), (stroke, color)] {
        for pair in strokes.iter().flat_map(|stroke| stroke.windows(2)) {
            let pixel = |index: usize| {
                let point = pair[index].as_dvec2() * height;
                [at.x + point.x, at.y - point.y]
            };
            picture.line(pixel(0), pixel(1), width, color);
        }
    }
}

/// Pixels per row of a text whose capitals are `height` pixels high.
pub(super) fn width(text: &str, height: f64) -> f64 {
    f64::from(stroke_font::strokes(text).1) * height
}
