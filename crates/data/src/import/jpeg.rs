//! JPEG pictures, their size checked before they are decoded.

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use crate::DataError;

/// Most pixels along a side, as of video.
const LARGEST: usize = 3840;

/// Width, height and 8-bit RGB, row by row.
///
/// # Errors
/// When the bytes are no JPEG, or a larger one than video may be.
pub(super) fn decode(file: &[u8]) -> Result<(u32, u32, Vec<u8>), DataError> {
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::RGB)
        .set_max_width(LARGEST)
        .set_max_height(LARGEST);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    let broken = |why: &dyn std::fmt::Debug| DataError::mismatch("picture", "a JPEG", format!("{why:?}"));
    let rgb = decoder.decode().map_err(|error| broken(&error))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken(&"one without a size"))?;
    if rgb.len() != width * height * 3 {
        return Err(broken(&"one that ends before its last row"));
    }
    Ok((width as u32, height as u32, rgb))
}
