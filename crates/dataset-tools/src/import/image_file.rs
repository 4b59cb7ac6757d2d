//! JPEG and PNG decoding with a size limit.

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use genmanip_data::DataError;

/// Maximum width and height of an image, pixels: the longer side that a video may have.
const MAX_SIDE_PX: usize = 3840;

/// Decodes a JPEG or PNG file to width and height in pixels, and 8-bit RGB, row-major; alpha is dropped and 16-bit PNG
/// reduced to 8 bits.
///
/// # Errors
/// If the bytes are neither JPEG nor PNG, damaged, or an image above the maximum size.
pub fn decode(file: &[u8]) -> Result<(u32, u32, Vec<u8>), DataError> {
    if file.starts_with(b"\x89PNG") {
        return decode_png(file);
    }
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::RGB)
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    let broken = |why: &dyn std::fmt::Debug| DataError::mismatch("image", "a JPEG or PNG", format!("{why:?}"));
    let rgb = decoder.decode().map_err(|error| broken(&error))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken(&"no size"))?;
    if rgb.len() != width * height * 3 {
        return Err(broken(&"a truncated image"));
    }
    Ok((width as u32, height as u32, rgb))
}

fn decode_png(file: &[u8]) -> Result<(u32, u32, Vec<u8>), DataError> {
    let broken = |error: png::DecodingError| DataError::mismatch("image", "a PNG", error);
    let mut decoder = png::Decoder::new(std::io::Cursor::new(file));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = (reader.info().width, reader.info().height);
    if width as usize > MAX_SIDE_PX || height as usize > MAX_SIDE_PX {
        let expected = format!("at most {MAX_SIDE_PX} pixels along each side");
        return Err(DataError::mismatch("image", expected, format!("{width}×{height}")));
    }
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader.next_frame(&mut pixels).map_err(broken)?;
    pixels.truncate(info.buffer_size());
    let rgb = match info.color_type {
        png::ColorType::Rgb => pixels,
        png::ColorType::Rgba => pixels.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
        png::ColorType::Grayscale => pixels.iter().flat_map(|gray| [*gray; 3]).collect(),
        png::ColorType::GrayscaleAlpha => pixels.chunks_exact(2).flat_map(|pixel| [pixel[0]; 3]).collect(),
        png::ColorType::Indexed => return Err(DataError::mismatch("image", "a PNG with colours", "a palette")),
    };
    Ok((width, height, rgb))
}
