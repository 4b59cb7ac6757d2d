//! Subpixel refinement of chessboard corners, to a few hundredths of a pixel.

use genmanip_core::glam::DVec2;

use super::grey::GreyImage;
use crate::least_squares::{Normal, minimise};

/// Minimum amplitude: half of the difference between black and white, in grey levels. Chosen by hand.
const MIN_AMPLITUDE: f64 = 8.0;
/// Maximum residual of the fit, as a share of the amplitude. Chosen by hand.
const MAX_REST: f64 = 0.35;
/// Minimum radius of the fitted window, pixels.
const MIN_REACH: f64 = 2.0;
/// Maximum radius of the fitted window, pixels.
const MAX_REACH: f64 = 8.0;

/// Expected position and orientation of a chessboard corner in the image.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Approximate position, pixels.
    pub at: DVec2,
    /// Directions of the board's x and y axes in the image.
    pub axes: [DVec2; 2],
    /// Radius around the corner that contains no other edge, pixels.
    pub reach: f64,
    /// True if the quadrant between the two axes, and the opposite one, are dark.
    pub is_dark: bool,
}

/// Refined pixel of a chessboard corner; `None` if the image shows no corner there.
///
/// Least-squares fit of the brightness by a constant plus the product of two sigmoids across the lines. A tone curve
/// changes the grey levels, but not the symmetry about the corner.
pub fn refined(image: &GreyImage, expected: &Expected) -> Option<DVec2> {
    let reach = expected.reach.min(MAX_REACH);
    if reach < MIN_REACH {
        return None;
    }
    let sign = if expected.is_dark { -1.0 } else { 1.0 };
    let [along_x, along_y] = expected.axes;
    let turn = along_x.perp_dot(along_y).signum();
    let mut model = Saddle {
        center: expected.at,
        angles: [along_x.to_angle(), along_y.to_angle()],
        log_width: 0.0,
        level: 0.0,
        amplitude: 0.0,
    };
    for round in 0..2 {
        let window = window(image, model.center, reach)?;
        if round == 0 {
            let values = || window.iter().map(|(_, value)| *value);
            let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
            (model.level, model.amplitude) = (f64::midpoint(low, high), 0.5 * sign * (high - low));
        }
        let (next, normal) = minimise(model, |saddle| Some(saddle.fit(&window, turn)), Saddle::moved)?;
        let rest = (normal.cost / window.len() as f64).sqrt();
        let is_sound = next.center.distance(expected.at) < 0.7 * reach
            && sign * next.amplitude > MIN_AMPLITUDE
            && rest < MAX_REST * next.amplitude.abs()
            && next.log_width.exp() < reach;
        if !is_sound {
            return None;
        }
        model = next;
    }
    Some(model.center)
}

/// Pixels within the radius `reach` of a point, with their grey levels; `None` if the window crosses the image border.
fn window(image: &GreyImage, center: DVec2, reach: f64) -> Option<Vec<(DVec2, f64)>> {
    let (low, high) = ((center - reach).ceil(), (center + reach).floor());
    let size = DVec2::new(image.width() as f64, image.height() as f64);
    if !(low.cmpge(DVec2::ZERO).all() && high.cmplt(size).all()) {
        return None;
    }
    let mut pixels = Vec::new();
    for y in low.y as usize..=high.y as usize {
        for x in low.x as usize..=high.x as usize {
            let pixel = DVec2::new(x as f64, y as f64);
            if pixel.distance(center) <= reach {
                pixels.push((pixel, f64::from(image.at(x, y))));
            }
        }
    }
    Some(pixels)
}

/// Brightness `level + amplitude tanh(u) tanh(v)`, where u and v are the distances from the two lines over their width.
#[derive(Clone, Copy, Debug)]
struct Saddle {
    center: DVec2,
    /// Angles of the board's x and y axes in the image, rad.
    angles: [f64; 2],
    /// Natural logarithm of the edge width, pixels.
    log_width: f64,
    level: f64,
    amplitude: f64,
}

impl Saddle {
    fn fit(&self, window: &[(DVec2, f64)], turn: f64) -> Normal {
        let mut normal = Normal::new(7);
        let width = self.log_width.exp();
        // Signed distances: along the board's x axis from the line along y, and along y from the line along x.
        let across =
            [DVec2::from_angle(self.angles[1]).perp() * -turn, DVec2::from_angle(self.angles[0]).perp() * turn];
        for &(pixel, value) in window {
            let off = pixel - self.center;
            let [u, v] = across.map(|across| across.dot(off) / width);
            let (s, t) = (u.tanh(), v.tanh());
            let (by_u, by_v) = (self.amplitude * (1.0 - s * s) * t, self.amplitude * s * (1.0 - t * t));
            let by_center = -(across[0] * by_u + across[1] * by_v) / width;
            // Derivative by a line's angle: its normal rotates by 90°.
            let by_angle = |across: DVec2| across.perp().dot(off) / width;
            let row = [
                (0, by_center.x),
                (1, by_center.y),
                (2, by_v * by_angle(across[1])),
                (3, by_u * by_angle(across[0])),
                (4, -(by_u * u + by_v * v)),
                (5, 1.0),
                (6, s * t),
            ];
            normal.add(self.level + self.amplitude * s * t - value, &row, 1.0);
        }
        normal
    }

    fn moved(&self, change: &[f64]) -> Self {
        Self {
            center: self.center + DVec2::new(change[0], change[1]),
            angles: [self.angles[0] + change[2], self.angles[1] + change[3]],
            log_width: (self.log_width + change[4]).clamp(-1.5, 2.0),
            level: self.level + change[5],
            amplitude: self.amplitude + change[6],
        }
    }
}
