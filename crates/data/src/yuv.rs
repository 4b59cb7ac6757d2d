//! Colour conversion for video: sRGB-coded RGB to Y'CbCr 4:2:0, BT.601 matrix, limited range.
//!
//! BT.601, although the pictures are not standard definition, because players and training libraries that ignore
//! the tags in the stream assume it; those that read the tags find it there, so both show the same colours.
//! Y = 16..235, Cb and Cr = 16..240; chroma is the mean of 2×2 pixels; integer arithmetic, so every machine agrees.

use openh264::formats::YUVSource;

/// An image in three planes; width and height are even.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Yuv420 {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) y: Vec<u8>,
    pub(crate) u: Vec<u8>,
    pub(crate) v: Vec<u8>,
}

/// Converts 8-bit RGB, row by row. `rgb` must hold `width · height · 3` bytes, both even; the caller checks.
pub(crate) fn from_rgb(rgb: &[u8], width: usize, height: usize) -> Yuv420 {
    let (pixels, _) = rgb.as_chunks::<3>();
    let y = pixels.iter().map(|pixel| luma(*pixel)).collect();
    let mut u = Vec::with_capacity(width * height / 4);
    let mut v = Vec::with_capacity(width * height / 4);
    for rows in pixels.chunks_exact(2 * width) {
        let (upper, lower) = rows.split_at(width);
        for (above, below) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
            let sum = |c: usize| [above[0][c], above[1][c], below[0][c], below[1][c]].map(i32::from).iter().sum();
            let (r, g, b): (i32, i32, i32) = (sum(0), sum(1), sum(2));
            u.push(chroma(-9_714 * r - 19_070 * g + 28_784 * b));
            v.push(chroma(28_784 * r - 24_103 * g - 4_681 * b));
        }
    }
    Yuv420 { width, height, y, u, v }
}

/// Converts back to 8-bit RGB, row by row; each chroma value holds for its 2×2 pixels.
pub(crate) fn to_rgb(image: &dyn YUVSource) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let (y_stride, u_stride, v_stride) = image.strides();
    let mut rgb = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        let y = &image.y()[row * y_stride..][..width];
        let (u, v) = (&image.u()[row / 2 * u_stride..], &image.v()[row / 2 * v_stride..]);
        for (column, luma) in y.iter().enumerate() {
            let (cb, cr) = (i32::from(u[column / 2]) - 128, i32::from(v[column / 2]) - 128);
            // Coefficients times 2^16: 255/219, and 255/224 · 2 (1 - k) of the inverse matrix.
            let luma = 76_309 * (i32::from(*luma) - 16) + (1 << 15);
            let channels = [luma + 104_597 * cr, luma - 25_675 * cb - 53_279 * cr, luma + 132_201 * cb];
            rgb.extend(channels.map(|channel| to_byte(channel >> 16)));
        }
    }
    rgb
}

/// Coefficients times 2^16: 219/255 · (0.299, 0.587, 0.114).
fn luma([r, g, b]: [u8; 3]) -> u8 {
    let sum = 16_829 * i32::from(r) + 33_039 * i32::from(g) + 6_416 * i32::from(b);
    to_byte(16 + ((sum + (1 << 15)) >> 16))
}

/// From a sum over four pixels with coefficients times 2^16: 224/255 · 0.5/(1 - k) of the differences.
fn chroma(sum: i32) -> u8 {
    to_byte(128 + ((sum + (1 << 17)) >> 18))
}

fn to_byte(value: i32) -> u8 {
    u8::try_from(value.clamp(0, 255)).unwrap_or(u8::MAX)
}

impl YUVSource for Yuv420 {
    fn dimensions(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn strides(&self) -> (usize, usize, usize) {
        (self.width, self.width / 2, self.width / 2)
    }

    fn y(&self) -> &[u8] {
        &self.y
    }

    fn u(&self) -> &[u8] {
        &self.u
    }

    fn v(&self) -> &[u8] {
        &self.v
    }
}
