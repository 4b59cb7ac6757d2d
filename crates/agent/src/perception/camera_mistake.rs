//! Plausibility of a camera: depth, intrinsics and extrinsics must show a table at z = 0 together.
//!
//! Wrong units, axes or quaternions shift every object, and a model's answers would not reveal it. The usual mistakes
//! are tried in turn; the check names the one whose correction brings a horizontal surface to z = 0.

use std::fmt;

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Intrinsics, Pose, RgbdImage};

/// Samples along the longer side of the image. Chosen by hand.
const SAMPLES: u32 = 64;
/// Distance of the samples between which normals are measured [samples]. Chosen: 1/16 of the image, so that sensor noise
/// turns normals by less than [`MIN_NORMAL_Z`] allows.
const BASELINE: usize = 4;
/// Cosine of the maximum tilt of a horizontal surface, 20 degrees.
const MIN_NORMAL_Z: f64 = 0.94;
/// Maximum height of the table above or below z = 0 (m). Chosen by hand.
const TABLE_M: f64 = 0.03;
/// Maximum horizontal distance of the table's points from the robot's base (m). Chosen by hand.
const REACH_M: f64 = 1.5;
/// Minimum extent of the table's points (m): a scene that is a thousand times too small is near z = 0 as a whole.
const MIN_TABLE_M: f64 = 0.2;
/// Minimum share of the measured samples on the table in a plausible image. Chosen low: objects may cover most of it.
const MIN_SHARE: f64 = 0.05;
/// Minimum share of samples on the table that makes a mistake likely, and (`LIKELY_RATIO`) minimum ratio to the share
/// without correction. Chosen by hand.
const LIKELY_SHARE: f64 = 0.15;
const LIKELY_RATIO: f64 = 2.0;
/// Minimum share of samples with a measured depth. Chosen by hand.
const MIN_MEASURED: f64 = 0.05;
/// Bin size of the histogram of heights of horizontal surfaces (m).
const BIN_M: f64 = 0.02;

/// Reason why an image and its camera parameters do not belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMistake {
    /// Share of the samples with depth that lie on a horizontal surface near z = 0.
    pub table_share: f64,
    /// Height of the largest horizontal surface (m); `None` if none is visible.
    pub surface_height_m: Option<f64>,
    /// Likely mistake, with its remedy; `None` if no usual mistake explains the image.
    pub likely: Option<&'static str>,
}

impl fmt::Display for CameraMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = 100.0 * self.table_share;
        write!(
            f,
            "depth, intrinsics and camera pose do not fit together: {share:.0} % of the measured points lie on a "
        )?;
        write!(f, "horizontal table at z = 0 in the robot's base frame")?;
        if let Some(height_m) = self.surface_height_m {
            write!(f, ", and the largest horizontal surface is at z = {height_m:.2} m")?;
        }
        match self.likely {
            Some(likely) => write!(f, "; likely mistake: {likely}"),
            None => write!(f, "; check the depth unit, the intrinsics and the hand-eye calibration"),
        }
    }
}

/// The mistake that makes a camera implausible; `None` for a plausible one.
///
/// An image is plausible if at least 5 % of its measured points lie on a horizontal surface within 3 cm of z = 0, seen
/// from above, and no usual mistake explains twice as many.
pub fn camera_mistake(image: &RgbdImage) -> Option<CameraMistake> {
    let given = View::of(image);
    let measured = given.depth_m.iter().flatten().count();
    if (measured as f64) < MIN_MEASURED * given.depth_m.len() as f64 {
        let likely = Some("the depth image is almost empty; 0 means no measurement");
        return Some(CameraMistake { table_share: 0.0, surface_height_m: None, likely });
    }
    let surfaces = given.surfaces();
    let best = likely_mistakes(&given)
        .map(|(view, mistake)| (view.surfaces().table_share, mistake))
        .filter(|(share, _)| *share >= LIKELY_SHARE.max(LIKELY_RATIO * surfaces.table_share))
        .reduce(|best, other| if best.0 >= other.0 { best } else { other });
    let is_plausible = surfaces.table_share >= MIN_SHARE && best.is_none();
    let off_table = "the pose is not in the robot's base frame, whose z = 0 is the table top";
    (!is_plausible).then(|| CameraMistake {
        table_share: surfaces.table_share,
        surface_height_m: surfaces.largest_m,
        likely: best
            .map(|(_, mistake)| mistake)
            .or_else(|| surfaces.largest_m.filter(|height_m| height_m.abs() > TABLE_M).map(|_| off_table)),
    })
}

/// Views with each usual mistake corrected, and the description of the mistake.
fn likely_mistakes(given: &View) -> impl Iterator<Item = (View, &'static str)> {
    let pose = given.world_from_camera;
    let posed = |pose: Pose, mistake| (View { world_from_camera: pose, ..given.clone() }, mistake);
    let scaled = |factor: f64, mistake| {
        let depth_m = given.depth_m.iter().map(|depth| depth.map(|depth_m| factor * depth_m)).collect();
        (View { depth_m, ..given.clone() }, mistake)
    };
    let moved = |factor: f64, mistake| posed(Pose::new(factor * pose.position, pose.rotation), mistake);
    let DQuat { x, y, z, w } = pose.rotation;
    let opened = DQuat::from_axis_angle(DVec3::X, std::f64::consts::PI);
    let Intrinsics { width, height, fx, fy, cx, cy } = given.intrinsics;
    // Intrinsics of an image of another size whose centre is the principal point.
    let (horizontal, vertical) = (f64::from(width) / 2.0 / (cx + 0.5), f64::from(height) / 2.0 / (cy + 0.5));
    let resized = Intrinsics {
        fx: fx * horizontal,
        fy: fy * vertical,
        cx: (cx + 0.5) * horizontal - 0.5,
        cy: (cy + 0.5) * vertical - 0.5,
        ..given.intrinsics
    };
    let is_other_size = (horizontal - 1.0).abs() > 0.2 || (vertical - 1.0).abs() > 0.2;
    let projected = View { intrinsics: resized, ..given.clone() };
    let along_ray = View { is_distance: true, ..given.clone() };
    [
        scaled(1000.0, "the depth is a thousand times too small; expected millimetres in a PNG, metres in a request"),
        scaled(0.001, "the depth is a thousand times too large; expected millimetres in a PNG, metres in a request"),
        scaled(0.1, "the depth is in units of 0.1 mm; expected millimetres in a PNG, metres in a request"),
        moved(0.001, "the camera's position is in millimetres; expected metres"),
        moved(0.01, "the camera's position is in centimetres; expected metres"),
        posed(pose.inverse(), "the pose is camera_from_world; expected its inverse, world_from_camera"),
        posed(
            Pose::new(pose.position, DQuat::from_xyzw(w, x, y, z)),
            "the quaternion is in the order x, y, z, w; expected w, x, y, z",
        ),
        posed(
            Pose::new(pose.position, pose.rotation * opened),
            "the pose has OpenGL axes (y up, z backwards); expected x right, y down, z forward",
        ),
        (along_ray, "the depth is the distance along the view ray; expected the depth along the optical axis"),
    ]
    .into_iter()
    .chain(is_other_size.then_some((projected, "the intrinsics belong to an image of another size")))
}

/// Sampled depth image with its camera parameters.
#[derive(Clone)]
struct View {
    intrinsics: Intrinsics,
    world_from_camera: Pose,
    /// Distance between samples, pixels.
    stride: u32,
    /// Number of samples per row.
    columns: usize,
    /// Depth of the samples, row by row (m); `None` where nothing was measured.
    depth_m: Vec<Option<f64>>,
    /// True if the depth is a distance along the view ray.
    is_distance: bool,
}

/// Horizontal surfaces of a view.
struct Surfaces {
    table_share: f64,
    largest_m: Option<f64>,
}

impl View {
    fn of(image: &RgbdImage) -> Self {
        let Intrinsics { width, height, .. } = image.intrinsics;
        let stride = (width.max(height) / SAMPLES).max(1);
        let lines = |length: u32| (0..length).step_by(stride as usize);
        let depth = |row: u32, column: u32| {
            let depth_m = *image.depth_m.get(row as usize * width as usize + column as usize)?;
            (depth_m.is_finite() && depth_m > 0.0).then_some(f64::from(depth_m))
        };
        Self {
            intrinsics: image.intrinsics,
            world_from_camera: image.world_from_camera,
            stride,
            columns: lines(width).count(),
            depth_m: lines(height).flat_map(|row| lines(width).map(move |column| depth(row, column))).collect(),
            is_distance: false,
        }
    }

    /// Point of a sample in the world frame; `None` without depth.
    fn point(&self, row: usize, column: usize) -> Option<DVec3> {
        let depth_m = (*self.depth_m.get(row * self.columns + column)?)?;
        let pixel = f64::from(self.stride) * DVec2::new(column as f64, row as f64);
        let in_camera = self.intrinsics.unproject(pixel, 1.0);
        let depth_m = if self.is_distance { depth_m / in_camera.length() } else { depth_m };
        Some(self.world_from_camera.transform_point(depth_m * in_camera))
    }

    fn surfaces(&self) -> Surfaces {
        let (mut measured, mut on_table) = (0_usize, 0_usize);
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut bins = std::collections::BTreeMap::<i64, usize>::new();
        for row in BASELINE..self.depth_m.len() / self.columns.max(1) {
            for column in BASELINE..self.columns {
                let Some(point) = self.point(row, column) else { continue };
                measured += 1;
                let beside = self.point(row, column - BASELINE).zip(self.point(row - BASELINE, column));
                let Some((left, above)) = beside else { continue };
                let normal = (left - point).cross(above - point).normalize_or_zero();
                let is_horizontal = normal.z.abs() > MIN_NORMAL_Z && self.world_from_camera.position.z > point.z;
                if is_horizontal && point.truncate().length() < REACH_M {
                    if point.z.abs() <= TABLE_M {
                        on_table += 1;
                        (least, most) = (least.min(point), most.max(point));
                    }
                    *bins.entry((point.z / BIN_M).round() as i64).or_default() += 1;
                }
            }
        }
        let largest = bins.iter().max_by_key(|(_, count)| **count);
        let largest = largest.filter(|(_, count)| **count as f64 >= MIN_SHARE * measured as f64);
        let is_table = least.distance(most) >= MIN_TABLE_M;
        Surfaces {
            table_share: if is_table { on_table as f64 / measured.max(1) as f64 } else { 0.0 },
            largest_m: largest.map(|(bin, _)| *bin as f64 * BIN_M),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depth image of a table of 1.2 × 1.6 m at z = 0 with a box on it and a floor at z = −0.75.
    fn image(eye: DVec3, target: DVec3, size: [u32; 2]) -> RgbdImage {
        let intrinsics = Intrinsics::from_vertical_fov(size[0], size[1], 0.8);
        let pose = genmanip_core::Camera::pose_looking_at(eye, target);
        let depth = |pixel: DVec2| {
            let ray = pose.transform_vector(intrinsics.unproject(pixel, 1.0));
            let at = |z: f64| (z - eye.z) / ray.z;
            let on = |z: f64, center: DVec2, half: DVec2| {
                let point = (eye + at(z) * ray).truncate();
                (at(z) > 0.0 && (point - center).abs().cmple(half).all()).then_some(at(z))
            };
            let found = on(0.1, DVec2::new(0.45, 0.1), DVec2::splat(0.06))
                .or(on(0.0, DVec2::new(0.6, 0.0), DVec2::new(0.6, 0.8)))
                .or(on(-0.75, DVec2::ZERO, DVec2::splat(4.0)));
            found.unwrap_or(0.0) as f32
        };
        let pixels = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| [column, row]));
        let depth_m = pixels.map(|[u, v]| depth(DVec2::new(f64::from(u), f64::from(v)))).collect();
        RgbdImage::of_depth(intrinsics, pose, depth_m)
    }

    /// Views of a table, as labs mount cameras: facing the robot, over its shoulder, from the side, from above.
    /// Not straight from above, where a pose and its inverse show the same plane.
    fn views() -> [RgbdImage; 4] {
        let middle = DVec3::new(0.5, 0.0, 0.0);
        [
            image(DVec3::new(1.9, 0.45, 1.12), middle, [512, 288]),
            image(DVec3::new(-0.2, 0.4, 0.9), middle, [640, 480]),
            image(DVec3::new(0.5, 1.3, 0.7), middle, [320, 240]),
            image(DVec3::new(0.1, 0.3, 1.2), middle, [1280, 720]),
        ]
    }

    #[test]
    fn a_right_camera_is_plausible() {
        for image in views() {
            assert_eq!(camera_mistake(&image), None);
        }
    }

    #[test]
    fn a_noisy_camera_is_plausible() {
        for mut image in views() {
            // Deterministic noise of about 1 % with holes, as of an active stereo camera.
            for (index, depth_m) in image.depth_m.iter_mut().enumerate() {
                let noise = ((index as f32 * 12.9898).sin() * 43_758.547).fract();
                *depth_m = if index % 7 == 0 { 0.0 } else { *depth_m * (1.0 + 0.01 * noise) };
            }
            assert_eq!(camera_mistake(&image), None);
        }
    }

    #[test]
    fn usual_mistakes_are_named() {
        type Spoil = fn(&mut RgbdImage);
        let cases: [(Spoil, &str); 10] = [
            (|it| it.depth_m.iter_mut().for_each(|depth| *depth *= 0.001), "a thousand times too small"),
            (|it| it.depth_m.iter_mut().for_each(|depth| *depth *= 1000.0), "a thousand times too large"),
            (|it| it.depth_m.iter_mut().for_each(|depth| *depth *= 10.0), "units of 0.1 mm"),
            (|it| it.depth_m.fill(0.0), "almost empty"),
            (|it| it.world_from_camera.position *= 1000.0, "in millimetres"),
            (|it| it.world_from_camera.position *= 100.0, "in centimetres"),
            (|it| it.world_from_camera = it.world_from_camera.inverse(), "camera_from_world"),
            (
                |it| {
                    let DQuat { x, y, z, w } = it.world_from_camera.rotation;
                    it.world_from_camera.rotation = DQuat::from_xyzw(y, z, w, x);
                },
                "order x, y, z, w",
            ),
            (|it| it.world_from_camera.rotation *= DQuat::from_rotation_x(std::f64::consts::PI), "OpenGL axes"),
            (|it| it.world_from_camera.position.z += 0.4, "not in the robot's base frame"),
        ];
        for (number, image) in views().into_iter().enumerate() {
            for (spoil, expected) in cases {
                let mut spoilt = image.clone();
                spoil(&mut spoilt);
                let mistake = camera_mistake(&spoilt).map(|mistake| mistake.to_string()).unwrap_or_default();
                assert!(mistake.contains(expected), "view {number}: {expected}: {mistake}");
            }
            let mut resized = image.clone();
            let double = |length: u32| 2 * length;
            let (width, height) = (image.width(), image.height());
            resized.intrinsics = image.intrinsics.resized(double(width), double(height));
            (resized.intrinsics.width, resized.intrinsics.height) = (width, height);
            let mistake = camera_mistake(&resized).map(|mistake| mistake.to_string()).unwrap_or_default();
            assert!(mistake.contains("another size"), "view {number}: {mistake}");
        }
    }

    #[test]
    fn distances_along_the_view_ray_are_told_from_depth() {
        // A view of 90 degrees, where both differ most.
        let mut image = image(DVec3::new(0.5, 0.0, 0.75), DVec3::new(0.52, 0.0, 0.0), [512, 288]);
        let wide = Intrinsics::from_horizontal_fov(512, 288, 1.6);
        for (index, depth_m) in image.depth_m.iter_mut().enumerate() {
            let pixel = DVec2::new((index % 512) as f64, (index / 512) as f64);
            let ray = image.world_from_camera.transform_vector(wide.unproject(pixel, 1.0));
            *depth_m = (-0.75 / ray.z * ray.length()) as f32;
        }
        image.intrinsics = wide;
        let mistake = camera_mistake(&image).map(|mistake| mistake.to_string()).unwrap_or_default();
        assert!(mistake.contains("along the view ray"), "{mistake}");
    }
}
