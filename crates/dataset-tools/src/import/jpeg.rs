//! JPEG decoding with a size limit.

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use genmanip_data::DataError;

/// Maximum image side, pixels; that of video.
const MAX_SIDE_PX: usize = 3840;

/// Decodes a JPEG file: width, height and 8-bit RGB, row-major.
///
/// # Errors
/// If the bytes are not a JPEG or exceed the maximum size.
pub(super) fn decode(file: &[u8]) -> Result<(u32, u32, Vec<u8>), DataError> {
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::RGB)
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    let broken = |why: &dyn std::fmt::Debug| DataError::mismatch("image", "a JPEG", format!("{why:?}"));
    let rgb = decoder.decode().map_err(|error| broken(&error))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken(&"no size"))?;
    if rgb.len() != width * height * 3 {
        return Err(broken(&"a truncated image"));
    }
    Ok((width as u32, height as u32, rgb))
}
