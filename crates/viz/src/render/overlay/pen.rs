//! Drawing of lines and points in the world frame, and of text, on an image.

use genmanip_agent::image::{BLACK, Color, RgbImage};
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Projection, stroke_font};

/// Minimum depth of drawn points, m. Chosen by hand: nearer lines would fill the image.
const NEAR_M: f64 = 0.03;
/// Depth by which a line may lie behind the visible surface without being occluded, m. Chosen by hand: three times the
/// depth steps at the edge of an object, well below the height of a fork.
const BEHIND_M: f64 = 0.006;
/// Length of the pieces of a line, each of which is visible or occluded as a whole, pixels of a 512x288 image. Chosen
/// by hand: also the length of dashes.
const PIECE_PX: f64 = 4.0;
/// Maximum number of pieces of a line. Chosen by hand: more than the diagonal of the largest usual image needs.
const MAX_LINE_PIECES: usize = 512;
/// Width of the dark border on either side of a line, pixels of a 512x288 image.
const EDGE_PX: f64 = 0.7;

/// Pen that draws on the image of one camera.
pub(super) struct Pen<'a> {
    pub(super) picture: &'a mut RgbImage,
    pub(super) projection: Projection,
    /// Depth image that occludes lines, m, row by row; empty for no occlusion.
    pub(super) depth_m: &'a [f32],
}

/// First and last pixel of a piece of a line, and true if the piece is occluded.
type Piece = (DVec2, DVec2, bool);

/// Style of occluded line segments.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Hidden {
    /// Thin dashes.
    Dashed,
    /// Drawn like visible ones.
    Shown,
}

impl Pen<'_> {
    /// Draws a straight line in the world frame (m) with a dark border, `width` pixels wide in a 512x288 image.
    pub(super) fn line(&mut self, from: DVec3, to: DVec3, width: f64, color: Color, hidden: Hidden) {
        self.polyline(&[from, to], width, color, hidden);
    }

    /// Draws lines from each point to the next, as [`Pen::line`], with one border around all of them.
    pub(super) fn polyline(&mut self, points: &[DVec3], width: f64, color: Color, hidden: Hidden) {
        let unit = self.picture.unit();
        let pieces: Vec<Piece> = points.windows(2).flat_map(|pair| self.pieces(pair[0], pair[1], hidden)).collect();
        for (extra, color) in [(2.0 * EDGE_PX, BLACK), (0.0, color)] {
            for (start, end, is_hidden) in &pieces {
                // Occluded pieces are thinner and have no border.
                let width = if *is_hidden { 0.6 * width } else { width + extra };
                if extra == 0.0 || !is_hidden {
                    self.picture.line(start.to_array(), end.to_array(), width * unit, color);
                }
            }
        }
    }

    /// Pieces of a line that are to be drawn: all visible ones, and every second occluded one if occluded lines are
    /// dashed.
    fn pieces(&self, from: DVec3, to: DVec3, hidden: Hidden) -> Vec<Piece> {
        let unit = self.picture.unit();
        let Some((from, to)) = self.ahead(from, to) else { return Vec::new() };
        let ends = self.projection.pixel(from).zip(self.projection.pixel(to));
        // If an end has no image position through the lens, the line is still tried piece by piece.
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

    /// Draws an arrow in the world frame (m) without occlusion.
    pub(super) fn arrow(&mut self, from: DVec3, to: DVec3, width: f64, color: Color) {
        self.line(from, to, width, color, Hidden::Shown);
        let Some((foot, tip)) = self.projection.pixel(from).zip(self.projection.pixel(to)) else { return };
        self.head(foot.0, tip.0, width, color);
    }

    /// Draws the head of an arrow that leads from pixel `foot` to pixel `tip`.
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

    /// Draws a dot with a dark border at a point in the world frame (m); the radius is `radius` pixels in a 512x288
    /// image.
    pub(super) fn dot(&mut self, at: DVec3, radius: f64, color: Color) {
        let unit = self.picture.unit();
        let seen = self.projection.pixel(at).filter(|(_, depth_m)| *depth_m > NEAR_M);
        let Some((pixel, _)) = seen else { return };
        self.picture.disc(pixel.to_array(), (radius + EDGE_PX) * unit, BLACK);
        self.picture.disc(pixel.to_array(), radius * unit, color);
    }

    /// Writes a text centred at a pixel, `height` pixels high in a 512x288 image.
    pub(super) fn label(&mut self, text: &str, middle: DVec2, height: f64, color: Color) {
        let height = height * self.picture.unit();
        let corner = middle - DVec2::new(0.5 * width(text, height), -0.5 * height);
        write(self.picture, text, corner, height, color);
    }

    /// Part of a line with depths above [`NEAR_M`]; `None` if there is none.
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

/// Writes a text with a dark border; the baseline begins at a pixel, and `height` is the cap height, pixels.
pub(super) fn write(picture: &mut RgbImage, text: &str, at: DVec2, height: f64, color: Color) {
    // Stroke fonts usually have strokes of a tenth of the cap height; strokes thinner than about 1.5 pixels look grey.
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

/// Width of a text with this cap height, pixels.
pub(super) fn width(text: &str, height: f64) -> f64 {
    f64::from(stroke_font::strokes(text).1) * height
}
