//! Lens distortion: each pixel looks up its position in a pinhole image.

use genmanip_core::glam::DVec2;
use genmanip_core::{Distortion, Intrinsics};

use crate::job::FrameBuffers;

/// Distorted image from a larger pinhole image: bilinear interpolation of colours, nearest pixel for other channels.
pub(super) fn distorted(
    lens: &Distortion,
    seen: &Intrinsics,
    pinhole: &Intrinsics,
    picture: &FrameBuffers,
) -> FrameBuffers {
    let (width, height) = (pinhole.width as usize, pinhole.height as usize);
    let shift = DVec2::new(pinhole.cx, pinhole.cy);
    let focal = DVec2::new(seen.fx, seen.fy);
    let limit = DVec2::new((width - 1) as f64, (height - 1) as f64);
    let place = |index: u32| {
        let at = DVec2::new(f64::from(index % seen.width), f64::from(index / seen.width));
        // A lens validated along the image border is invertible inside it. If the inversion still fails, the centre is
        // used.
        let point = lens.undistort((at - DVec2::new(seen.cx, seen.cy)) / focal).unwrap_or_default();
        (point * focal + shift).clamp(DVec2::ZERO, limit)
    };
    let places: Vec<DVec2> = (0..seen.width * seen.height).map(place).collect();
    let nearest: Vec<usize> = places.iter().map(|at| at.y.round() as usize * width + at.x.round() as usize).collect();
    let rgb = if picture.rgb.is_empty() { Vec::new() } else { blended(&places, [width, height], &picture.rgb) };
    FrameBuffers {
        width: seen.width,
        height: seen.height,
        rgb,
        depth_m: picked(&nearest, &picture.depth_m),
        instance: picked(&nearest, &picture.instance),
        normal: picked(&nearest, &picture.normal),
        parts: picked(&nearest, &picture.parts),
    }
}

fn picked<T: Copy>(nearest: &[usize], values: &[T]) -> Vec<T> {
    if values.is_empty() { Vec::new() } else { nearest.iter().map(|&index| values[index]).collect() }
}

fn blended(places: &[DVec2], [width, height]: [usize; 2], rgb: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(places.len() * 3);
    for at in places {
        let (corner, share) = (at.floor(), at.fract().as_vec2());
        let (x, y) = (corner.x as usize, corner.y as usize);
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        let pixel = |x: usize, y: usize, channel: usize| f32::from(rgb[(y * width + x) * 3 + channel]);
        for channel in 0..3 {
            let upper = pixel(x, y, channel) * (1.0 - share.x) + pixel(right, y, channel) * share.x;
            let lower = pixel(x, below, channel) * (1.0 - share.x) + pixel(right, below, channel) * share.x;
            out.push((upper * (1.0 - share.y) + lower * share.y + 0.5) as u8);
        }
    }
    out
}
