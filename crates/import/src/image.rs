//! Texture loading: PNG, JPEG and WebP, validated before decoding and downscaled to the rendering resolution.

use genmanip_core::Texture;
use png::{ColorType, Transformations};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Maximum image width and height: 8192 x 8192 pixels take 200 MB.
const MAX_SIDE: usize = 8192;
/// Maximum number of pixels decoded per object: four of the largest images, 6 s of CPU time. Needed because a small
/// file can decode to many pixels.
pub const MAX_PIXELS: usize = 4 * MAX_SIDE * MAX_SIDE;
/// Maximum texture side after downscaling by an integer factor, pixels. Chosen by hand.
const KEPT_PIXELS: usize = 512;

/// Decodes a texture, with a note if it was downscaled; errors are messages. Decoded pixels are deducted from
/// `pixels_left`, initially [`MAX_PIXELS`].
pub fn texture(bytes: &[u8], pixels_left: &mut usize) -> Result<(Texture, Option<String>), String> {
    let (width, height, rgb) = match bytes {
        [0x89, b'P', b'N', b'G', ..] => from_png(bytes, pixels_left)?,
        [0xff, 0xd8, ..] => from_jpeg(bytes, pixels_left)?,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => from_webp(bytes, pixels_left)?,
        _ => return Err("expected a PNG, JPEG or WebP image".into()),
    };
    let factor = width.max(height).div_ceil(KEPT_PIXELS);
    if factor == 1 {
        return Ok((Texture { width: width as u32, height: height as u32, rgb }, None));
    }
    let (small, rgb) = scaled_down(width, height, &rgb, factor);
    let note = format!("texture of {width} x {height} pixels downscaled to {} x {}", small[0], small[1]);
    Ok((Texture { width: small[0] as u32, height: small[1] as u32, rgb }, Some(note)))
}

fn check_size(width: usize, height: usize, pixels_left: &mut usize) -> Result<(), String> {
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(format!("{width} x {height} pixels; expected 1 to {MAX_SIDE} per side"));
    }
    let left = pixels_left.checked_sub(width * height);
    *pixels_left = left
        .ok_or_else(|| format!("{width} x {height} pixels; the images of one object may have {MAX_PIXELS} in total"))?;
    Ok(())
}

fn from_png(bytes: &[u8], pixels_left: &mut usize) -> Result<(usize, usize, Vec<u8>), String> {
    let limits = png::Limits { bytes: 3 * MAX_SIDE * MAX_SIDE };
    let mut decoder = png::Decoder::new_with_limits(std::io::Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let broken = |error: png::DecodingError| format!("the PNG image cannot be decoded: {error}");
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_size(width, height, pixels_left)?;
    let size = reader.output_buffer_size().ok_or("the PNG image is too large")?;
    let mut pixels = vec![0; size];
    let frame = reader.next_frame(&mut pixels).map_err(broken)?;
    let rgb = match frame.color_type {
        ColorType::Rgb => pixels,
        ColorType::Rgba => pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
        ColorType::Grayscale => pixels.iter().flat_map(|&p| [p; 3]).collect(),
        ColorType::GrayscaleAlpha => pixels.chunks_exact(2).flat_map(|p| [p[0]; 3]).collect(),
        ColorType::Indexed => return Err("the PNG image has a palette that cannot be expanded".into()),
    };
    if rgb.len() < width * height * 3 {
        return Err("the PNG image ends before its last row".into());
    }
    Ok((width, height, rgb[..width * height * 3].to_vec()))
}

fn from_jpeg(bytes: &[u8], pixels_left: &mut usize) -> Result<(usize, usize, Vec<u8>), String> {
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let broken = |error: zune_jpeg::errors::DecodeErrors| format!("the JPEG image cannot be decoded: {error}");
    decoder.decode_headers().map_err(broken)?;
    let (width, height) = decoder.dimensions().ok_or("the JPEG image does not declare its size")?;
    check_size(width, height, pixels_left)?;
    let rgb = decoder.decode().map_err(broken)?;
    if rgb.len() != width * height * 3 {
        return Err("the JPEG image has a different number of pixels than it declares".into());
    }
    Ok((width, height, rgb))
}

/// The first frame if it is animated.
fn from_webp(bytes: &[u8], pixels_left: &mut usize) -> Result<(usize, usize, Vec<u8>), String> {
    let broken = |error: image_webp::DecodingError| format!("the WebP image cannot be decoded: {error}");
    let mut decoder = image_webp::WebPDecoder::new(std::io::Cursor::new(bytes)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size(width, height, pixels_left)?;
    decoder.set_memory_limit(8 * MAX_SIDE * MAX_SIDE);
    let mut pixels = vec![0; decoder.output_buffer_size().ok_or("the WebP image is too large")?];
    decoder.read_image(&mut pixels).map_err(broken)?;
    let rgb =
        if decoder.has_alpha() { pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect() } else { pixels };
    if rgb.len() != width * height * 3 {
        return Err("the WebP image has a different number of pixels than it declares".into());
    }
    Ok((width, height, rgb))
}

/// Box filter over blocks of `factor` x `factor` pixels.
fn scaled_down(width: usize, height: usize, rgb: &[u8], factor: usize) -> ([usize; 2], Vec<u8>) {
    let small = [(width / factor).max(1), (height / factor).max(1)];
    let mut out = Vec::with_capacity(small[0] * small[1] * 3);
    for y in 0..small[1] {
        for x in 0..small[0] {
            let (rows, columns) =
                ((y * factor)..((y + 1) * factor).min(height), (x * factor)..((x + 1) * factor).min(width));
            let count = (rows.len() * columns.len()) as u32;
            let mut sum = [0_u32; 3];
            for row in rows {
                for pixel in rgb[(row * width + columns.start) * 3..(row * width + columns.end) * 3].chunks_exact(3) {
                    (0..3).for_each(|channel| sum[channel] += u32::from(pixel[channel]));
                }
            }
            out.extend(sum.map(|value| ((value + count / 2) / count) as u8));
        }
    }
    (small, out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(bytes: &[u8]) -> Result<(Texture, Option<String>), String> {
        super::texture(bytes, &mut { MAX_PIXELS })
    }

    fn png_of(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(rgb).unwrap();
        bytes
    }

    #[test]
    fn images_are_decoded_and_downscaled() {
        let (small, note) = texture(&png_of(2, 1, &[1, 2, 3, 4, 5, 6])).unwrap();
        assert_eq!((small.width, small.height, small.rgb, note), (2, 1, vec![1, 2, 3, 4, 5, 6], None));
        let (large, note) = texture(&png_of(1024, 16, &[200; 1024 * 16 * 3])).unwrap();
        assert_eq!((large.width, large.height), (512, 8));
        assert!(large.rgb.iter().all(|&value| value == 200) && note.unwrap().contains("1024 x 16"));
    }

    #[test]
    fn invalid_images_are_rejected() {
        let good = png_of(4, 4, &[9; 48]);
        assert!(texture(&good[..good.len() / 2]).is_err(), "cut off");
        let mut huge = good.clone();
        // A decompression bomb: the header states huge width and height.
        huge[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        assert!(texture(&huge).is_err(), "65536 pixels per side");
        assert!(texture(b"GIF89a").unwrap_err().contains("PNG, JPEG or WebP"));
        assert!(texture(&[0xff, 0xd8, 0xff, 0xd9]).is_err(), "an empty JPEG");
    }

    #[test]
    fn the_pixel_budget_is_enforced() {
        let image = png_of(512, 512, &[9; 512 * 512 * 3]);
        let mut left = 2 * 512 * 512;
        let read: Vec<bool> = (0..3).map(|_| super::texture(&image, &mut left).is_ok()).collect();
        assert_eq!((read, left), (vec![true, true, false], 0));
    }
}
