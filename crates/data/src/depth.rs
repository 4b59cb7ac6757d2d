//! Depth as 16-bit grey PNG in millimetres: exact, and readable by every tool.
//!
//! 0 means that nothing was hit; what lies beyond 65.535 m is stored as 65535.

use png::{BitDepth, ColorType, Decoder, Encoder, chunk};
use zlib_rs::{DeflateConfig, ReturnCode, compress_bound, compress_slice};

use crate::DataError;

/// Most pixels along a side of an image that is read; those that are drawn have as many at most.
const MAX_SIDE_PX: u32 = 8192;
/// How hard rows are compressed. Chosen: 4 makes files 7 % larger, 6 takes twice as long for 5 %.
const LEVEL: i32 = 5;

/// Metres to millimetres, rounded; 0 for what is not a positive number.
pub fn depth_to_mm(depth_m: f32) -> u16 {
    // Not finite and negative values become 0, large ones 65535: that is what `as` does here. The product is exact, and
    // so is the sum where it could reach the next millimetre: it rounds as `f64::round` does, without a call.
    if depth_m.is_finite() { (f64::from(depth_m) * 1000.0 + 0.5) as u16 } else { 0 }
}

/// A PNG file of a depth image in metres, row by row.
///
/// # Errors
/// When the number of values is not `width · height`.
pub fn encode_depth_png(depth_m: &[f32], width: u32, height: u32) -> Result<Vec<u8>, DataError> {
    if depth_m.len() != width as usize * height as usize {
        return Err(DataError::mismatch("values of a depth image", width as usize * height as usize, depth_m.len()));
    }
    encode_mm_png(&depth_m.iter().map(|depth| depth_to_mm(*depth)).collect::<Vec<_>>(), width, height)
}

/// A PNG file of a depth image in millimetres, row by row; there must be `width · height`.
pub(crate) fn encode_mm_png(depth_mm: &[u16], width: u32, height: u32) -> Result<Vec<u8>, DataError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    let mut writer = encoder.write_header().map_err(png_error)?;
    writer.write_chunk(chunk::IDAT, &compressed(&upwards(depth_mm, width as usize))?).map_err(png_error)?;
    // Not `finish`, which wants the picture from `write_image_data`: the end is written when the writer goes.
    drop(writer);
    Ok(file)
}

/// The rows of a picture, each behind the number of its filter, as differences from the row above, byte by byte.
///
/// Of a table that a camera looks down on, much of a row has the same slope.
fn upwards(depth_mm: &[u16], width: usize) -> Vec<u8> {
    const UP: u8 = 2;
    let mut bytes = Vec::with_capacity((2 * width + 1) * (depth_mm.len() / width.max(1)));
    let (mut above, mut row) = (vec![0; 2 * width], vec![0; 2 * width]);
    for values in depth_mm.chunks_exact(width.max(1)) {
        for (bytes, value) in row.as_chunks_mut::<2>().0.iter_mut().zip(values) {
            *bytes = value.to_be_bytes();
        }
        bytes.push(UP);
        bytes.extend(row.iter().zip(&above).map(|(byte, above)| byte.wrapping_sub(*above)));
        std::mem::swap(&mut above, &mut row);
    }
    bytes
}

fn compressed(bytes: &[u8]) -> Result<Vec<u8>, DataError> {
    let mut zlib = vec![0; compress_bound(bytes.len())];
    let (packed, outcome) = compress_slice(&mut zlib, bytes, DeflateConfig::new(LEVEL));
    let size = packed.len();
    if outcome != ReturnCode::Ok {
        return Err(png_error(format!("compression failed: {outcome:?}")));
    }
    zlib.truncate(size);
    Ok(zlib)
}

/// The millimetres in a PNG file, with width and height.
///
/// # Errors
/// When the file is not a 16-bit grey PNG.
pub fn decode_depth_png(file: &[u8]) -> Result<(u32, u32, Vec<u16>), DataError> {
    let mut reader = Decoder::new(std::io::Cursor::new(file)).read_info().map_err(png_error)?;
    let (width, height) = (reader.info().width, reader.info().height);
    if width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        let got = format!("{width}x{height}");
        return Err(DataError::mismatch("depth image", format!("at most {MAX_SIDE_PX} pixels along each side"), got));
    }
    let mut data = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader.next_frame(&mut data).map_err(png_error)?;
    if (info.color_type, info.bit_depth) != (ColorType::Grayscale, BitDepth::Sixteen) {
        let got = format!("{:?} with {:?} bits", info.color_type, info.bit_depth);
        return Err(DataError::mismatch("depth image", "grey with 16 bits", got));
    }
    let (values, _) = data[..info.buffer_size()].as_chunks::<2>();
    Ok((info.width, info.height, values.iter().map(|value| u16::from_be_bytes(*value)).collect()))
}

fn png_error(error: impl ToString) -> DataError {
    DataError::Png(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Around every half millimetre, and at all scales, millimetres are those of `f64::round`.
    #[test]
    fn millimetres_are_rounded() {
        let halves = (0..=140_000).flat_map(|half| {
            let bits = (half as f32 / 2000.0).to_bits();
            (bits.saturating_sub(2)..=bits + 2).map(f32::from_bits)
        });
        let scales = (0..=u32::MAX >> 12).map(|bits| f32::from_bits(bits << 12));
        for depth_m in halves.chain(scales) {
            let expected = if depth_m.is_finite() { (f64::from(depth_m) * 1000.0).round() as u16 } else { 0 };
            assert_eq!(depth_to_mm(depth_m), expected, "{depth_m} m");
        }
    }

    /// What is written is read again, exactly, whatever the size and the values.
    #[test]
    fn pictures_come_back_exactly() {
        let noise = |index: u32| (index.wrapping_mul(2_654_435_761) >> 16) as u16;
        let slope = |index: u32| (400 + index % 96 / 3 + 2 * (index / 96)) as u16;
        let ends = |index: u32| if index.is_multiple_of(3) { u16::MAX } else { 0 };
        for (width, height) in [(1, 1), (1, 9), (9, 1), (96, 54)] {
            for value in [&noise as &dyn Fn(u32) -> u16, &slope, &ends] {
                let depth_mm: Vec<u16> = (0..width * height).map(value).collect();
                let file = encode_mm_png(&depth_mm, width, height).unwrap();
                assert_eq!(decode_depth_png(&file).unwrap(), (width, height, depth_mm));
                assert!(file.ends_with(b"IEND\xaeB`\x82"), "the file has its end");
            }
        }
    }
}
