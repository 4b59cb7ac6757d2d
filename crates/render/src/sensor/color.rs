//! Colour imager: exposure, white balance, vignetting, photon and read noise, and JPEG compression.

use genmanip_core::{ColorSensor, Seed};
use glam::Vec3A;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::noise::bell;
use crate::encode;
use crate::scene::texture::{linear_from_srgb8, srgb8_from_linear};

/// Image of the sensor from an ideal 8-bit sRGB image, whose linear values are taken as light; at 1.0 a pixel reaches
/// its full-well capacity.
pub(super) fn exposed(
    settings: &ColorSensor,
    [width, height]: [u32; 2],
    rgb: &[u8],
    seed: Seed,
) -> Result<Vec<u8>, String> {
    let rng = &mut seed.rng();
    let gain =
        Vec3A::from_array(settings.white_balance.map(|factor| factor as f32)) * (settings.exposure_stops as f32).exp2();
    let (well, dark) = (settings.full_well_e as f32, (settings.read_noise_e as f32).powi(2));
    let middle = glam::Vec2::new(width as f32 - 1.0, height as f32 - 1.0) * 0.5;
    let (reach, lost) = (middle.length_squared().max(1.0), settings.vignetting as f32);
    let mut read = Vec::with_capacity(rgb.len());
    for (index, pixel) in rgb.chunks_exact(3).enumerate() {
        let index = index as u32;
        let at = glam::Vec2::new((index % width) as f32, (index / width) as f32) - middle;
        let light =
            linear_from_srgb8([pixel[0], pixel[1], pixel[2]]) * gain * (1.0 - lost * at.length_squared() / reach);
        let noisy = light.to_array().map(|light| {
            let electrons = light.min(1.0) * well;
            (electrons + bell(rng) * (electrons + dark).sqrt()) / well
        });
        read.extend(srgb8_from_linear(Vec3A::from_array(noisy)));
    }
    match settings.jpeg_quality {
        None => Ok(read),
        Some(quality) => compressed(width, height, &read, quality),
    }
}

/// Image after JPEG compression and decompression, 8-bit RGB.
fn compressed(width: u32, height: u32, rgb: &[u8], quality: u8) -> Result<Vec<u8>, String> {
    let bytes = encode::jpeg_rgb(width, height, rgb, quality).map_err(|error| format!("no JPEG of it: {error}"))?;
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes), options);
    let decoded = decoder.decode().map_err(|error| format!("its JPEG cannot be decoded: {error}"))?;
    if decoded.len() == rgb.len() { Ok(decoded) } else { Err("its JPEG has another size".into()) }
}
