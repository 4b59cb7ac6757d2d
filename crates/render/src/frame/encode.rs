//! Encoding of image files, and resizing.

use std::io::Write;

use genmanip_core::image::depth_to_mm;
use png::{BitDepth, ColorType, Compression, Filter, PixelDimensions, Unit};

/// Reasons why an image cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// The buffer's length does not match the image size.
    #[error("got {got} values for a picture of {width}×{height}, expected {expected}")]
    Size {
        /// Width of the image (px).
        width: u32,
        /// Height of the image (px).
        height: u32,
        /// Number of values that the size requires.
        expected: usize,
        /// Number of values in the buffer.
        got: usize,
    },
    /// The PNG writer failed.
    #[error("cannot write the PNG")]
    Png(#[from] png::EncodingError),
    /// The JPEG writer failed.
    #[error("cannot write the JPEG")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
}

/// Encodes an 8-bit sRGB image as PNG.
///
/// # Errors
/// A buffer of the wrong size.
pub fn png_rgb(width: u32, height: u32, rgb: &[u8]) -> Result<Vec<u8>, EncodeError> {
    check_size(width, height, 3, rgb.len())?;
    png(width, height, ColorType::Rgb, BitDepth::Eight, Filter::Adaptive, rgb)
}

/// Depth as 16-bit greyscale PNG in millimetres: 0 for the background, 65535 from 65.535 m on.
///
/// # Errors
/// A buffer of the wrong size.
pub fn png_depth_mm(width: u32, height: u32, depth_m: &[f32]) -> Result<Vec<u8>, EncodeError> {
    let millimetres: Vec<u16> = depth_m.iter().map(|&depth| depth_to_mm(depth)).collect();
    png_u16(width, height, &millimetres)
}

/// Encodes 16-bit values, such as instance ids, as greyscale PNG.
///
/// # Errors
/// A buffer of the wrong size.
pub fn png_u16(width: u32, height: u32, values: &[u16]) -> Result<Vec<u8>, EncodeError> {
    check_size(width, height, 1, values.len())?;
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    // Depth is piecewise planar: the Paeth filter makes it ten times smaller than `Up` at the same speed.
    png(width, height, ColorType::Grayscale, BitDepth::Sixteen, Filter::Paeth, &bytes)
}

/// 8-bit grey image as PNG for printing; `pixels_per_m` states its size on paper.
///
/// # Errors
/// A buffer of the wrong size.
pub fn png_print(width: u32, height: u32, grey: &[u8], pixels_per_m: u32) -> Result<Vec<u8>, EncodeError> {
    check_size(width, height, 1, grey.len())?;
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_pixel_dims(Some(PixelDimensions { xppu: pixels_per_m, yppu: pixels_per_m, unit: Unit::Meter }));
    let mut writer = encoder.write_header()?;
    writer.write_image_data(grey)?;
    writer.finish()?;
    Ok(out)
}

/// Encodes an 8-bit sRGB image as JPEG of `quality` 1-100; chroma is subsampled below 90.
///
/// # Errors
/// A buffer of the wrong size, or more than 65535 pixels along a side.
pub fn jpeg_rgb(width: u32, height: u32, rgb: &[u8], quality: u8) -> Result<Vec<u8>, EncodeError> {
    check_size(width, height, 3, rgb.len())?;
    let side = |pixels: u32| {
        let (expected, got) = (usize::from(u16::MAX), pixels as usize);
        u16::try_from(pixels).map_err(|_| EncodeError::Size { width, height, expected, got })
    };
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, quality.clamp(1, 100));
    encoder.encode(rgb, side(width)?, side(height)?, jpeg_encoder::ColorType::Rgb)?;
    Ok(bytes)
}

/// Resizes an 8-bit RGB image by averaging the area under each new pixel.
///
/// # Errors
/// A buffer of the wrong size, or an empty size.
pub fn resize_rgb(size: [u32; 2], rgb: &[u8], new_size: [u32; 2]) -> Result<Vec<u8>, EncodeError> {
    check_size(size[0], size[1], 3, rgb.len())?;
    check_not_empty(new_size)?;
    let [width, height] = size.map(|side| side as usize);
    let rows = spans(size[1], new_size[1]);
    let columns = spans(size[0], new_size[0]);
    let mut out = Vec::with_capacity(rows.len() * columns.len() * 3);
    for row in &rows {
        for column in &columns {
            let (mut sum, mut total) = ([0.0_f32; 3], 0.0);
            for (y, weight_y) in row.clone().into_weights(height) {
                for (x, weight_x) in column.clone().into_weights(width) {
                    let weight = weight_x * weight_y;
                    let pixel = &rgb[(y * width + x) * 3..][..3];
                    sum.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += f32::from(value) * weight);
                    total += weight;
                }
            }
            out.extend(sum.map(|value| (value / total + 0.5) as u8));
        }
    }
    Ok(out)
}

/// Interval along a row or column of the old image (px).
#[derive(Clone)]
struct Span {
    start: f32,
    end: f32,
}

impl Span {
    /// Old pixels that the interval overlaps, with the length of each overlap (px).
    fn into_weights(self, limit: usize) -> impl Iterator<Item = (usize, f32)> {
        let first = self.start as usize;
        let last = (self.end.ceil() as usize).min(limit);
        (first..last).map(move |index| (index, self.end.min(index as f32 + 1.0) - self.start.max(index as f32)))
    }
}

fn spans(old: u32, new: u32) -> Vec<Span> {
    let scale = old as f32 / new as f32;
    (0..new).map(|index| Span { start: index as f32 * scale, end: (index + 1) as f32 * scale }).collect()
}

fn png(
    width: u32,
    height: u32,
    color: ColorType,
    depth: BitDepth,
    filter: Filter,
    bytes: &[u8],
) -> Result<Vec<u8>, EncodeError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(filter);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    out.flush().map_err(png::EncodingError::from)?;
    Ok(out)
}

fn check_size(width: u32, height: u32, channels: usize, got: usize) -> Result<(), EncodeError> {
    let expected = width as usize * height as usize * channels;
    if expected == got && got > 0 { Ok(()) } else { Err(EncodeError::Size { width, height, expected, got }) }
}

fn check_not_empty([width, height]: [u32; 2]) -> Result<(), EncodeError> {
    if width > 0 && height > 0 { Ok(()) } else { Err(EncodeError::Size { width, height, expected: 1, got: 0 }) }
}
