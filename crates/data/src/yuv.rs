//! Colour conversion for video: sRGB-encoded RGB to Y'CbCr 4:2:0, BT.601 matrix, limited range.
//!
//! BT.601 is used although the images are not standard definition: players and training libraries that ignore the
//! colour tags of the stream assume it. The tags also state BT.601, so all readers show the same colours.
//! Y = 16..235, Cb and Cr = 16..240; chroma is the mean of 2×2 pixels. Integer arithmetic gives equal results on every
//! machine.

use multiversion::multiversion;
use openh264::formats::YUVSource;

/// Planar image; width and height are even.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Yuv420 {
    pub width: usize,
    pub height: usize,
    pub y: Vec<u8>,
    pub u: Vec<u8>,
    pub v: Vec<u8>,
}

/// Converts 8-bit RGB, row-major. `rgb` must hold `width · height · 3` bytes, both sides even; the caller checks.
pub fn from_rgb(rgb: &[u8], width: usize, height: usize) -> Yuv420 {
    let plane = |size| vec![0; size];
    let (mut y, mut u, mut v) = (plane(width * height), plane(width * height / 4), plane(width * height / 4));
    // Two rows at a time, in planar order: interleaved 3-byte pixels do not vectorise.
    let (mut upper, mut lower) = ([(); 3].map(|()| plane(width)), [(); 3].map(|()| plane(width)));
    let chroma_rows = u.chunks_exact_mut(width / 2).zip(v.chunks_exact_mut(width / 2));
    let rows = rgb.chunks_exact(6 * width).zip(y.chunks_exact_mut(2 * width)).zip(chroma_rows);
    for ((pixels, y), (u, v)) in rows {
        let ((pixels_above, pixels_below), (y_above, y_below)) = (pixels.split_at(3 * width), y.split_at_mut(width));
        luma_row(pixels_above, &mut upper, y_above);
        luma_row(pixels_below, &mut lower, y_below);
        chroma_row(&upper, &lower, u, v);
    }
    Yuv420 { width, height, y, u, v }
}

/// Luma of a row of pixels, and the row split into channels.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn luma_row(pixels: &[u8], [red, green, blue]: &mut [Vec<u8>; 3], y: &mut [u8]) {
    let (pixels, _) = pixels.as_chunks::<3>();
    for (((pixel, r), g), b) in pixels.iter().zip(red.iter_mut()).zip(green.iter_mut()).zip(blue.iter_mut()) {
        [*r, *g, *b] = *pixel;
    }
    for (((y, r), g), b) in y.iter_mut().zip(red).zip(green).zip(blue) {
        *y = luma([*r, *g, *b]);
    }
}

/// Chroma of two rows of pixels: one value per 2×2 pixels.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn chroma_row(upper: &[Vec<u8>; 3], lower: &[Vec<u8>; 3], u: &mut [u8], v: &mut [u8]) {
    let [(red, red_below), (green, green_below), (blue, blue_below)] =
        [0, 1, 2].map(|c| (upper[c].as_chunks::<2>().0, lower[c].as_chunks::<2>().0));
    let sum = |above: &[u8; 2], below: &[u8; 2]| -> i32 {
        [above[0], above[1], below[0], below[1]].map(i32::from).iter().sum()
    };
    let colors = red.iter().zip(red_below).zip(green.iter().zip(green_below)).zip(blue.iter().zip(blue_below));
    for ((((red, green), blue), u), v) in colors.zip(u).zip(v) {
        let (r, g, b) = (sum(red.0, red.1), sum(green.0, green.1), sum(blue.0, blue.1));
        *u = chroma(-9_714 * r - 19_070 * g + 28_784 * b);
        *v = chroma(28_784 * r - 24_103 * g - 4_681 * b);
    }
}

/// Converts to 8-bit RGB, row-major, with nearest-neighbour chroma.
pub fn to_rgb(image: &dyn YUVSource) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let (y_stride, u_stride, v_stride) = image.strides();
    let mut rgb = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        let y = &image.y()[row * y_stride..][..width];
        let (u, v) = (&image.u()[row / 2 * u_stride..], &image.v()[row / 2 * v_stride..]);
        for (column, luma) in y.iter().enumerate() {
            let (cb, cr) = (i32::from(u[column / 2]) - 128, i32::from(v[column / 2]) - 128);
            // Coefficients scaled by 2^16: 255/219 for luma, and 255/224 · 2 (1 - k) for chroma, with k = 0.299 (red)
            // or 0.114 (blue).
            let luma = 76_309 * (i32::from(*luma) - 16) + (1 << 15);
            let channels = [luma + 104_597 * cr, luma - 25_675 * cb - 53_279 * cr, luma + 132_201 * cb];
            rgb.extend(channels.map(|channel| to_byte(channel >> 16)));
        }
    }
    rgb
}

/// Coefficients scaled by 2^16: 219/255 · (0.299, 0.587, 0.114).
#[inline(always)]
fn luma([r, g, b]: [u8; 3]) -> u8 {
    let sum = 16_829 * i32::from(r) + 33_039 * i32::from(g) + 6_416 * i32::from(b);
    to_byte(16 + ((sum + (1 << 15)) >> 16))
}

/// Chroma of a sum over four pixels; coefficients scaled by 2^16: 224/255 · 0.5/(1 - k) of the differences, with k =
/// 0.299 (red) or 0.114 (blue).
#[inline(always)]
fn chroma(sum: i32) -> u8 {
    to_byte(128 + ((sum + (1 << 17)) >> 18))
}

#[inline(always)]
fn to_byte(value: i32) -> u8 {
    value.clamp(0, 255) as u8
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
