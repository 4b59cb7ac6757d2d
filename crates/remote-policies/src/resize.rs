//! Image resizing identical to Pillow's.

/// Fractional bits of the weights of [`resized`], as in Pillow: products with a byte fit 32 bits.
const WEIGHT_BITS: u32 = 22;

/// An 8-bit RGB image, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgb {
    /// Width (px).
    pub width: usize,
    /// Height (px).
    pub height: usize,
    /// Three bytes per pixel.
    pub bytes: Vec<u8>,
}

/// Image scaled to fit with its aspect ratio preserved, centred on black: `resize_with_pad` of openpi's client.
pub fn resized_with_pad(image: &Rgb, width: usize, height: usize) -> Rgb {
    if (image.width, image.height) == (width, height) || image.bytes.is_empty() {
        return image.clone();
    }
    let ratio = (image.width as f64 / width as f64).max(image.height as f64 / height as f64);
    let inner = |length: usize, most: usize| ((length as f64 / ratio) as usize).clamp(1, most);
    let small = resized(image, inner(image.width, width), inner(image.height, height));
    let (left, top) = ((width - small.width) / 2, (height - small.height) / 2);
    let mut bytes = vec![0; width * height * 3];
    for (row, pixels) in small.bytes.chunks_exact(small.width * 3).enumerate() {
        let start = ((top + row) * width + left) * 3;
        bytes[start..start + pixels.len()].copy_from_slice(pixels);
    }
    Rgb { width, height, bytes }
}

/// Resizes with Pillow's bilinear filter, whose support widens when shrinking: identical bytes for images at least as
/// wide as tall. For tall ones Pillow 13 shrinks columns first, and a byte may differ by one.
pub fn resized(image: &Rgb, width: usize, height: usize) -> Rgb {
    let across = weights(image.width, width);
    let Rgb { width: from, height: rows, bytes } = image;
    let mut wide = Vec::with_capacity(width * rows * 3);
    for row in bytes.chunks_exact(from * 3) {
        for (first, weights) in &across {
            wide.extend((0..3).map(|channel| sum(weights, |index| row[(first + index) * 3 + channel])));
        }
    }
    let mut bytes = Vec::with_capacity(width * height * 3);
    for (first, weights) in weights(*rows, height) {
        bytes.extend((0..width * 3).map(|place| sum(&weights, |index| wide[(first + index) * width * 3 + place])));
    }
    Rgb { width, height, bytes }
}

/// For each of `to` pixels, the first contributing pixel of `from` and the weights from there on.
fn weights(from: usize, to: usize) -> Vec<(usize, Vec<i32>)> {
    let scale = from as f64 / to as f64;
    // The support of the triangle filter is one pixel of the coarser image to each side.
    let support = scale.max(1.0);
    let narrow = 1.0 / support;
    let of_pixel = |index: usize| {
        let center = (index as f64 + 0.5) * scale;
        let first = (center - support + 0.5).max(0.0) as usize;
        let end = ((center + support + 0.5) as usize).min(from);
        let weight = |pixel: usize| (1.0 - ((pixel as f64 - center + 0.5) * narrow).abs()).max(0.0);
        let raw: Vec<f64> = (first..end).map(weight).collect();
        let total: f64 = raw.iter().sum();
        let fixed = |weight: &f64| (weight / total * f64::from(1 << WEIGHT_BITS) + 0.5) as i32;
        (first, raw.iter().map(fixed).collect())
    };
    (0..to).map(of_pixel).collect()
}

fn sum(weights: &[i32], byte: impl Fn(usize) -> u8) -> u8 {
    let half = 1 << (WEIGHT_BITS - 1);
    let sum = weights.iter().enumerate().map(|(index, weight)| weight * i32::from(byte(index))).sum::<i32>() + half;
    (sum >> WEIGHT_BITS).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FNV-1a hashes of `PIL.Image.resize(…, BILINEAR)` of Pillow 13.0, pasted onto black.
    #[test]
    fn bytes_are_those_of_pillow() {
        let cases = [
            ([13, 7], [5, 5], 0x11cf_00e6_b87c_7abe_u64),
            ([16, 9], [8, 8], 0x996a_2e66_8961_f88b),
            ([5, 4], [9, 9], 0xdddd_ca11_43c9_5657),
            ([512, 288], [224, 224], 0x582b_aac5_51f1_8afe),
            ([256, 256], [224, 224], 0xee4b_a815_6432_37d3),
        ];
        for ([width, height], [to_width, to_height], expected) in cases {
            let byte = |x: usize, y: usize, channel: usize| (x * 37 + y * 91 + channel * 53 + x * y * 7) as u8;
            let places = (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |c| (x, y, c))));
            let bytes = places.map(|(x, y, channel)| byte(x, y, channel)).collect();
            let small = resized_with_pad(&Rgb { width, height, bytes }, to_width, to_height);
            let hash = small
                .bytes
                .iter()
                .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
            assert_eq!((small.width, small.height), (to_width, to_height));
            assert_eq!(hash, expected, "{width} x {height} to {to_width} x {to_height}");
        }
    }
}
