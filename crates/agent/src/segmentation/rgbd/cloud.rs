//! Organised point cloud: points, normals and colours per pixel, with the depth noise.

use genmanip_core::RgbdImage;
use glam::{DVec3, Vec3};

/// Number of second differences sampled for the noise estimate.
const NOISE_SAMPLES: usize = 8192;
/// Inverse-depth noise below which smoothing is skipped [1/m]: rounding to millimetres at 1 m gives about 3e-4.
const MIN_NOISE: f32 = 5e-5;

/// An organised point cloud; all channels are row-major.
pub(super) struct OrganizedCloud {
    pub width: usize,
    /// True for pixels with depth.
    pub is_seen: Vec<bool>,
    /// Points, world frame (m).
    pub points: Vec<Vec3>,
    /// Unit normals towards the camera, world frame; zero without depth.
    pub normals: Vec<Vec3>,
    /// Standard deviation of the inverse depth after smoothing [1/m].
    pub noise: f32,
    /// Camera position, world frame.
    pub camera: Vec3,
    /// Smaller focal length of both axes (px).
    pub focal_px: f32,
}

impl OrganizedCloud {
    pub fn new(image: &RgbdImage, colors: &[Vec3], is_ignored: &[bool]) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let usable = |(index, depth): (usize, &f32)| {
            let is_seen = *depth > 0.0 && depth.is_finite() && is_ignored.get(index) != Some(&true);
            if is_seen { 1.0 / depth } else { 0.0 }
        };
        let mut inverse: Vec<f32> = image.depth_m.iter().enumerate().map(usable).collect();
        let mut noise = inverse_depth_noise(&inverse, width);
        if noise > MIN_NOISE {
            inverse = smoothed(&inverse, colors, width, noise);
            noise /= SMOOTHING_GAIN;
        }
        let points = points(image, &inverse);
        let is_seen: Vec<bool> = inverse.iter().map(|inverse| *inverse > 0.0).collect();
        let reach = if noise > MIN_NOISE { 2 } else { 1 };
        let camera = image.world_from_camera.position.as_vec3();
        let normals = normals(&points, &inverse, [width, height], reach, noise, camera);
        let focal_px = image.intrinsics.fx.min(image.intrinsics.fy) as f32;
        Self { width, is_seen, points, normals, noise, camera, focal_px }
    }

    /// Standard deviation of the depth at a point (m).
    pub fn depth_noise_m(&self, point: Vec3) -> f32 {
        self.noise * point.distance_squared(self.camera)
    }

    /// Distance between neighbouring pixels on a surface that faces the camera (m).
    pub fn footprint_m(&self, point: Vec3) -> f32 {
        point.distance(self.camera) / self.focal_px
    }
}

/// Robust standard deviation of the inverse depth, from second differences, which vanish on planes.
fn inverse_depth_noise(inverse: &[f32], width: usize) -> f32 {
    let step = (inverse.len() / NOISE_SAMPLES).max(1);
    let mut second: Vec<f32> = (1..inverse.len().saturating_sub(1))
        .step_by(step)
        .filter(|index| (1..width.saturating_sub(1)).contains(&(index % width)))
        .filter_map(|index| {
            let [left, here, right] = [inverse[index - 1], inverse[index], inverse[index + 1]];
            (left > 0.0 && here > 0.0 && right > 0.0).then_some((left - 2.0 * here + right).abs())
        })
        .collect();
    if second.is_empty() {
        return 0.0;
    }
    let middle = second.len() / 2;
    let (_, median, _) = second.select_nth_unstable_by(middle, f32::total_cmp);
    // 1.4826 turns a median deviation into a standard deviation; the weights 1, -2, 1 multiply it by the root of 6.
    1.4826 * *median / 6.0_f32.sqrt()
}

/// Radius of the smoothing filter (px).
const SMOOTHING_PX: usize = 4;
/// Noise reduction factor of smoothing near edges; larger on planes, see the test below.
const SMOOTHING_GAIN: f32 = 6.0;
/// Maximum difference within one surface, in standard deviations.
const SMOOTHING_SIGMAS: f32 = 3.5;
/// Colour difference at which a neighbour has half weight.
const SMOOTHING_COLOR: f32 = 0.06;

/// Bilateral smoothing along rows and columns by depth and colour; fills gaps.
fn smoothed(inverse: &[f32], colors: &[Vec3], width: usize, noise: f32) -> Vec<f32> {
    let height = inverse.len() / width.max(1);
    let pass = |values: &[f32], step: usize, place: &dyn Fn(usize) -> usize, count: usize, noise: f32| -> Vec<f32> {
        (0..values.len())
            .map(|index| {
                let at = place(index);
                let (back, ahead) = (at.min(SMOOTHING_PX), (count - 1 - at).min(SMOOTHING_PX));
                let mut here = values[index];
                if here <= 0.0 {
                    // Nearest neighbours along this axis; a gap with one known side only is not filled.
                    let known = |other: usize| (values[other] > 0.0).then_some(values[other]);
                    let before = (1..=back).find_map(|k| known(index - k * step));
                    let after = (1..=ahead).find_map(|k| known(index + k * step));
                    match (before, after) {
                        // Take the farther one: gaps at edges mostly belong to the background.
                        (Some(one), Some(other)) => here = one.min(other),
                        _ => return 0.0,
                    }
                }
                let color = colors[index];
                // Weighted line fit: an average would be biased where neighbours lie on one side only.
                let (mut weights, mut x, mut xx, mut v, mut xv) = (1.0, 0.0, 0.0, 0.0, 0.0);
                for other in (index - back * step..=index + ahead * step).step_by(step) {
                    let value = values[other];
                    if other == index || value <= 0.0 || (value - here).abs() > SMOOTHING_SIGMAS * 1.5 * noise {
                        continue;
                    }
                    let difference = (colors[other] - color).length_squared() / (SMOOTHING_COLOR * SMOOTHING_COLOR);
                    let weight = 1.0 / (1.0 + difference * difference);
                    let apart = if other < index {
                        -(((index - other) / step) as f32)
                    } else {
                        ((other - index) / step) as f32
                    };
                    weights += weight;
                    x += weight * apart;
                    xx += weight * apart * apart;
                    v += weight * (value - here);
                    xv += weight * apart * (value - here);
                }
                let determinant = weights * xx - x * x;
                here + if determinant > 1e-3 { (xx * v - x * xv) / determinant } else { v / weights }
            })
            .collect()
    };
    let mut values = inverse.to_vec();
    for round in [1.0, 0.5] {
        values = pass(&values, 1, &|index| index % width, width, noise * round);
        values = pass(&values, width, &|index| index / width, height, noise * round);
    }
    values
}

fn points(image: &RgbdImage, inverse: &[f32]) -> Vec<Vec3> {
    let k = &image.intrinsics;
    let [right, down, forward] = DVec3::AXES.map(|axis| image.world_from_camera.transform_vector(axis));
    let (right, down) = ((right / k.fx).as_vec3(), (down / k.fy).as_vec3());
    let corner = forward.as_vec3() - right * k.cx as f32 - down * k.cy as f32;
    let camera = image.world_from_camera.position.as_vec3();
    let width = image.width() as usize;
    let mut points = Vec::with_capacity(inverse.len());
    for (row, inverse) in inverse.chunks(width.max(1)).enumerate() {
        let start = corner + down * row as f32;
        points.extend(inverse.iter().enumerate().map(|(column, inverse)| {
            if *inverse > 0.0 { camera + (start + right * column as f32) / *inverse } else { Vec3::ZERO }
        }));
    }
    points
}

/// Normals as cross products of point differences, on the side where inverse depth changes less.
fn normals(
    points: &[Vec3],
    inverse: &[f32],
    [width, height]: [usize; 2],
    reach: usize,
    noise: f32,
    camera: Vec3,
) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; points.len()];
    for y in 0..height {
        for x in 0..width {
            let index = y * width + x;
            let here = inverse[index];
            if here <= 0.0 {
                continue;
            }
            let along = |place: usize, count: usize, step: usize| -> Vec3 {
                let before = (place >= reach && inverse[index - reach * step] > 0.0).then(|| index - reach * step);
                let after =
                    (place + reach < count && inverse[index + reach * step] > 0.0).then(|| index + reach * step);
                let change = |other: usize| (inverse[other] - here).abs();
                match (before, after) {
                    (Some(before), Some(after)) => {
                        let (one, other) = (change(before), change(after));
                        // Central difference if both sides agree, which halves the noise of the slope; otherwise the
                        // smoother side.
                        if (one - other).abs() <= 0.5 * one.min(other) + 3.0 * noise {
                            points[after] - points[before]
                        } else if one < other {
                            points[index] - points[before]
                        } else {
                            points[after] - points[index]
                        }
                    }
                    (Some(before), None) => points[index] - points[before],
                    (None, Some(after)) => points[after] - points[index],
                    (None, None) => Vec3::ZERO,
                }
            };
            let normal = along(y, height, width).cross(along(x, width, 1)).normalize_or_zero();
            normals[index] = if normal.dot(camera - points[index]) < 0.0 { -normal } else { normal };
        }
    }
    normals
}

/// Brightness and two chroma components nearly invariant to shading, each about 0-1, after a 3x3 binomial filter.
pub(super) fn colors(rgb: &[u8], width: usize) -> Vec<Vec3> {
    let raw: Vec<Vec3> = rgb
        .chunks_exact(3)
        .map(|pixel| {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(|channel| f32::from(channel) / 255.0);
            // 0.3 suppresses the chroma of dark pixels, which is mostly rounding.
            let sum = r + g + b + 0.3;
            Vec3::new((r + g + b) / 3.0, (r - g) * 2.0 / sum, (0.5 * (r + g) - b) * 2.0 / sum)
        })
        .collect();
    let height = raw.len() / width.max(1);
    let mut rows = raw.clone();
    for y in 0..height {
        for x in 1..width.saturating_sub(1) {
            let index = y * width + x;
            rows[index] = 0.25 * (raw[index - 1] + raw[index + 1]) + 0.5 * raw[index];
        }
    }
    let mut out = rows.clone();
    for index in width..rows.len().saturating_sub(width) {
        out[index] = 0.25 * (rows[index - width] + rows[index + width]) + 0.5 * rows[index];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::{Intrinsics, Pose, Seed};
    use rand::RngExt;

    const SIZE: [u32; 2] = [120, 90];

    /// Inverse depths of a slanted plane with Gaussian noise.
    fn slanted(noise: f32) -> Vec<f32> {
        let rng = &mut Seed::new(3).rng();
        let [width, height] = SIZE.map(|side| side as usize);
        let exact = |index: usize| 0.5 + 4e-4 * (index % width) as f32 - 3e-4 * (index / width) as f32;
        // The sum of twelve uniform numbers has variance 1.
        (0..width * height)
            .map(|index| exact(index) + noise * ((0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0))
            .collect()
    }

    fn rms(one: &[f32], other: &[f32]) -> f32 {
        let square: f32 = one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum();
        (square / one.len() as f32).sqrt()
    }

    #[test]
    fn noise_is_told_from_slopes() {
        assert!(inverse_depth_noise(&slanted(0.0), SIZE[0] as usize) < MIN_NOISE);
        for noise in [5e-4, 2e-3] {
            let told = inverse_depth_noise(&slanted(noise), SIZE[0] as usize);
            assert!((told / noise - 1.0).abs() < 0.1, "{told} for {noise}");
        }
    }

    #[test]
    fn smoothing_lowers_noise_and_keeps_planes() {
        let (noise, width) = (1e-3, SIZE[0] as usize);
        let colors = vec![Vec3::splat(0.5); (SIZE[0] * SIZE[1]) as usize];
        let (exact, noisy) = (slanted(0.0), slanted(noise));
        let gain = rms(&noisy, &exact) / rms(&smoothed(&noisy, &colors, width, noise), &exact);
        assert!(gain > SMOOTHING_GAIN, "{gain}");
        assert!(rms(&smoothed(&exact, &colors, width, noise), &exact) < 1e-6);
    }

    #[test]
    fn normals_face_the_camera() {
        let intrinsics = Intrinsics::from_vertical_fov(SIZE[0], SIZE[1], 0.5);
        let pose = Pose::default();
        let image = RgbdImage::of_depth(intrinsics, pose, slanted(0.0).iter().map(|inverse| 1.0 / inverse).collect());
        let colors = vec![Vec3::ZERO; (SIZE[0] * SIZE[1]) as usize];
        let cloud = OrganizedCloud::new(&image, &colors, &[]);
        let first = cloud.normals[0];
        assert!(first.z < -0.5 && cloud.normals.iter().all(|normal| normal.distance(first) < 1e-2), "{first}");
        let ignored: Vec<bool> = (0..colors.len()).map(|index| index % 2 == 0).collect();
        assert!(
            OrganizedCloud::new(&image, &colors, &ignored).is_seen.iter().zip(&ignored).all(|(seen, out)| seen != out)
        );
    }
}
