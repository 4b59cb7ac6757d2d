//! Greyscale images with subpixel sampling.

use genmanip_core::glam::DVec2;

/// 8-bit greyscale image in row-major order from the top left; pixel centres are at integers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl GreyImage {
    /// Image from row-major values; `None` unless there is one value per pixel.
    pub fn new(width: usize, height: usize, values: Vec<u8>) -> Option<Self> {
        (values.len() == width.checked_mul(height)?).then_some(Self { width, height, values })
    }

    /// Image from row-major values, of which the caller guarantees one per pixel.
    pub(super) fn of(width: usize, height: usize, values: Vec<u8>) -> Self {
        debug_assert_eq!(values.len(), width * height);
        Self { width, height, values }
    }

    /// Luma of an sRGB image with three bytes per pixel; `None` if the number of bytes is wrong.
    pub fn from_rgb(width: usize, height: usize, rgb: &[u8]) -> Option<Self> {
        let luma = |rgb: &[u8]| {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(u32::from);
            ((77 * r + 150 * g + 29 * b + 128) >> 8) as u8
        };
        let is_whole = rgb.len() == width.checked_mul(height)?.checked_mul(3)?;
        is_whole.then(|| Self { width, height, values: rgb.chunks_exact(3).map(luma).collect() })
    }

    /// Width, pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Values in row-major order.
    pub fn values(&self) -> &[u8] {
        &self.values
    }

    /// Grey level of a pixel, 0 to 255.
    pub fn at(&self, x: usize, y: usize) -> u8 {
        self.values[y * self.width + x]
    }

    /// Bilinear interpolation at a subpixel position; `None` outside of the outermost pixel centres.
    pub fn sampled(&self, at: DVec2) -> Option<f64> {
        let last = DVec2::new(self.width as f64 - 1.0, self.height as f64 - 1.0);
        if !(at.cmpge(DVec2::ZERO).all() && at.cmplt(last).all()) {
            return None;
        }
        let (corner, share) = (at.floor(), at.fract());
        let (x, y) = (corner.x as usize, corner.y as usize);
        let value = |dx: usize, dy: usize| f64::from(self.at(x + dx, y + dy));
        let row = |dy: usize| value(0, dy) + share.x * (value(1, dy) - value(0, dy));
        Some(row(0) + share.y * (row(1) - row(0)))
    }

    /// The image smoothed by a binomial kernel of 3 x 3 pixels.
    #[must_use]
    pub fn smoothed(&self) -> Self {
        let Self { width, height, .. } = *self;
        let sum = |before: u32, at: u32, after: u32| before + 2 * at + after;
        let mut rows = vec![0_u32; self.values.len()];
        for y in 0..height {
            for x in 0..width {
                let value = |x: usize| u32::from(self.at(x, y));
                rows[y * width + x] = sum(value(x.saturating_sub(1)), value(x), value((x + 1).min(width - 1)));
            }
        }
        let mut values = Vec::with_capacity(rows.len());
        for y in 0..height {
            let (before, after) = (y.saturating_sub(1), (y + 1).min(height - 1));
            values.extend((0..width).map(|x| {
                let value = |y: usize| rows[y * width + x];
                ((sum(value(before), value(y), value(after)) + 8) >> 4) as u8
            }));
        }
        Self { width, height, values }
    }
}
