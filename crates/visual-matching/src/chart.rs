//! The colour chart: 24 patches of known colour in six columns and four rows.

use genmanip_core::glam::DVec2;
use genmanip_real::homography::{homography, mapped};
use genmanip_render::color::linear_from_srgb8;

/// Columns and rows of patches.
pub const PATCHES: [usize; 2] = [6, 4];

/// Colours of the patches in 8-bit sRGB under D65, row by row: the published values of the classic 24-patch chart
/// (ColorChecker Classic; McCamy, Marcus and Davidson, "A Color-Rendition Chart", 1976).
pub const COLORS: [[u8; 3]; 24] = [
    [115, 82, 68],
    [194, 150, 130],
    [98, 122, 157],
    [87, 108, 67],
    [133, 128, 177],
    [103, 189, 170],
    [214, 126, 44],
    [80, 91, 166],
    [193, 90, 99],
    [94, 60, 108],
    [157, 188, 64],
    [224, 163, 46],
    [56, 61, 150],
    [70, 148, 73],
    [175, 54, 60],
    [231, 199, 31],
    [187, 86, 149],
    [8, 133, 161],
    [243, 243, 242],
    [200, 200, 200],
    [160, 160, 160],
    [122, 122, 121],
    [85, 85, 85],
    [52, 52, 52],
];

/// Share of a patch, about its centre, over which its colour is averaged.
const INNER: f64 = 0.5;
/// Samples along a side of that square.
const SAMPLES: usize = 7;

/// Mean linear display colour of each patch in an 8-bit sRGB image, row by row; `None` where a patch lies outside the
/// image or has a clipped channel.
///
/// `corners_px` are the pixels of the centres of the four corner patches, in the order dark skin, bluish green, black,
/// white, which is clockwise from the top left of the chart as it is printed.
pub fn read(rgb: &[u8], width: usize, corners_px: [DVec2; 4]) -> Option<Vec<Option<[f64; 3]>>> {
    let [columns, rows] = PATCHES.map(|count| count as f64 - 1.0);
    let places = [DVec2::ZERO, DVec2::new(columns, 0.0), DVec2::new(columns, rows), DVec2::new(0.0, rows)];
    let pixel_from_chart = homography(places.into_iter().zip(corners_px))?;
    let patch = |index: usize| {
        let middle = DVec2::new((index % PATCHES[0]) as f64, (index / PATCHES[0]) as f64);
        let mut sum = [0.0; 3];
        for sample in 0..SAMPLES * SAMPLES {
            let step = |place: usize| (place as f64 / (SAMPLES - 1) as f64 - 0.5) * INNER;
            let at = middle + DVec2::new(step(sample % SAMPLES), step(sample / SAMPLES));
            let color = pixel(rgb, width, mapped(&pixel_from_chart, at)?)?;
            sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += value);
        }
        Some(sum.map(|sum| sum / (SAMPLES * SAMPLES) as f64))
    };
    Some((0..COLORS.len()).map(patch).collect())
}

/// Linear reflectance of each patch.
pub fn reflectances() -> [[f64; 3]; 24] {
    COLORS.map(|color| linear_from_srgb8(color).to_array().map(f64::from))
}

/// Linear colour of the nearest pixel; `None` outside the image and if a channel is clipped.
fn pixel(rgb: &[u8], width: usize, place: DVec2) -> Option<[f64; 3]> {
    let (column, row) = (place.x.round(), place.y.round());
    let inside = column >= 0.0 && column < width as f64 && row >= 0.0;
    let at = inside.then(|| (row as usize * width + column as usize) * 3)?;
    let color = rgb.get(at..at + 3)?;
    let clipped = color.iter().any(|value| *value >= 254);
    (!clipped).then(|| linear_from_srgb8([color[0], color[1], color[2]]).to_array().map(f64::from))
}
