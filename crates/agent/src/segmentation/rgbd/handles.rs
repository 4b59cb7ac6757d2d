//! Merging of arched handles that were segmented on their own into the body that they rise from.

use genmanip_core::RgbdImage;
use glam::{DVec2, DVec3};

use crate::segmentation::Mask;

/// Maximum area of a handle relative to its body. Chosen by hand.
const MAX_AREA_SHARE: f64 = 0.5;
/// Maximum distance by which a handle extends beyond the body's bounding box, seen from above (m). Chosen by hand.
const BEYOND_M: f64 = 0.02;
/// Minimum share of a handle's points within that distance. Chosen by hand.
const WITHIN_SHARE: f64 = 0.9;
/// Minimum length of a handle, seen from above (m). Chosen by hand.
const MIN_LENGTH_M: f64 = 0.04;
/// Minimum height of the arch (m): of its middle above the higher one of its ends. Objects that lie across a rim have
/// no arch.
const MIN_ARCH_M: f64 = 0.01;
/// Share of a handle's length that counts as an end. Chosen by hand.
const END_SHARE: f64 = 0.15;
/// Maximum distance of each end from the body (m): a few pixels, and the registration error of two cameras.
const TOUCH_M: f64 = 0.02;
/// Minimum height of a handle's lowest points above the body's lowest ones, as a share of the body's height. Chosen by
/// hand.
const FLOATS_SHARE: f64 = 0.3;

/// Masks by descending area, with handles merged into their bodies.
pub(super) fn joined(mut masks: Vec<Mask>, image: &RgbdImage) -> Vec<Mask> {
    let mut points: Vec<Vec<DVec3>> =
        masks.iter().map(|mask| mask.indices().filter_map(|index| image.point(index)).collect()).collect();
    // Handles are smaller than their bodies, so the smallest masks are tested first.
    for handle in (1..masks.len()).rev() {
        let Some(body) = (0..handle).find(|body| is_handle(&points[handle], &points[*body])) else { continue };
        let (mask, own) = (masks.remove(handle), points.remove(handle));
        masks[body].pixels.iter_mut().zip(&mask.pixels).for_each(|(pixel, added)| *pixel |= added);
        points[body].extend(own);
    }
    let mut order: Vec<(usize, Mask)> = masks.into_iter().map(|mask| (mask.area(), mask)).collect();
    order.sort_by_key(|(area, _)| std::cmp::Reverse(*area));
    order.into_iter().map(|(_, mask)| mask).collect()
}

/// True if the points form an arch over the body that touches it at both ends.
fn is_handle(handle: &[DVec3], body: &[DVec3]) -> bool {
    if handle.is_empty() || handle.len() as f64 > MAX_AREA_SHARE * body.len() as f64 {
        return false;
    }
    let (low, high) = bounds(body);
    let is_within = |point: &&DVec3| {
        let beyond = (low.truncate() - point.truncate()).max(point.truncate() - high.truncate());
        beyond.max_element() <= BEYOND_M
    };
    let within = handle.iter().filter(is_within).count();
    let (lowest, _) = bounds(handle);
    let floats = lowest.z > low.z + FLOATS_SHARE * (high.z - low.z);
    if !floats || (within as f64) < WITHIN_SHARE * handle.len() as f64 {
        return false;
    }
    let axis = long_axis(handle);
    let mut along: Vec<(f64, DVec3)> = handle.iter().map(|point| (point.truncate().dot(axis), *point)).collect();
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (start, length) = (along[0].0, along[along.len() - 1].0 - along[0].0);
    if length < MIN_LENGTH_M {
        return false;
    }
    let between = |from: f64, to: f64| -> Vec<DVec3> {
        let inside = |at: f64| (from..=to).contains(&((at - start) / length));
        along.iter().filter(|(at, _)| inside(*at)).map(|(_, point)| *point).collect()
    };
    let ends = [between(0.0, END_SHARE), between(1.0 - END_SHARE, 1.0)];
    let middle = between(0.35, 0.65);
    let height = |points: &[DVec3]| points.iter().map(|point| point.z).sum::<f64>() / points.len().max(1) as f64;
    let arch_m = height(&middle) - height(&ends[0]).max(height(&ends[1]));
    let touches = |end: &Vec<DVec3>| {
        end.iter().any(|point| body.iter().any(|other| other.distance_squared(*point) <= TOUCH_M * TOUCH_M))
    };
    !middle.is_empty() && arch_m >= MIN_ARCH_M && ends.iter().all(touches)
}

/// Minimum and maximum corner of the points' bounding box.
fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let all = points.iter().copied();
    all.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)))
}

/// Direction of the largest extent, seen from above: the principal axis of the points.
fn long_axis(points: &[DVec3]) -> DVec2 {
    let count = points.len().max(1) as f64;
    let mean = points.iter().map(|point| point.truncate()).sum::<DVec2>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let apart = point.truncate() - mean;
        (xx, xy, yy) = (xx + apart.x * apart.x, xy + apart.x * apart.y, yy + apart.y * apart.y);
    }
    DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A squat body of 12 cm with its top at 9 cm.
    fn body() -> Vec<DVec3> {
        let point = |index: i32| DVec3::new(f64::from(index % 25) * 0.005, f64::from(index / 25) * 0.005, 0.09);
        let top = (0..25 * 25).map(point);
        let side =
            (0..25 * 18).map(|index| DVec3::new(0.0, f64::from(index % 25) * 0.005, f64::from(index / 25) * 0.005));
        top.chain(side).map(|point| point - DVec3::new(0.06, 0.06, 0.0)).collect()
    }

    /// An arch over the body from `from` to `to`, and its height above its ends.
    fn arch(from: DVec3, to: DVec3, height_m: f64) -> Vec<DVec3> {
        let point = |index: i32| {
            let along = f64::from(index) / 60.0;
            from.lerp(to, along) + DVec3::Z * height_m * (std::f64::consts::PI * along).sin()
        };
        (0..=60).map(point).collect()
    }

    #[test]
    fn an_arch_that_ends_at_the_body_is_its_handle() {
        let check = |name: &str, handle: Vec<DVec3>, expected: bool| {
            assert_eq!(is_handle(&handle, &body()), expected, "{name}");
        };
        let (left, right) = (DVec3::new(0.0, -0.055, 0.095), DVec3::new(0.0, 0.055, 0.095));
        check("a cane handle", arch(left, right, 0.07), true);
        check("a spoon across", arch(left, right, 0.0), false);
        check("a spoon that leans on it", arch(DVec3::new(0.0, 0.0, 0.1), DVec3::new(0.0, 0.2, 0.16), 0.0), false);
        check("an arch above it", arch(left + DVec3::Z * 0.05, right + DVec3::Z * 0.05, 0.03), false);
        check("a banana on it", arch(left, right, 0.004), false);
        check("an arch beside it", arch(left + DVec3::X * 0.2, right + DVec3::X * 0.2, 0.07), false);
        check("an arch that stands on the table", arch(left.with_z(0.0), right.with_z(0.0), 0.15), false);
        check("nothing", Vec::new(), false);
    }
}
