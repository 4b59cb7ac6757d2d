//! Ground-truth labels of images, for training and testing detectors, segmenters and pose estimators.
//!
//! Labels derive from the ids, depth, colour and camera of an [`RgbdImage`] and from the object poses.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::OrientedBox;
use crate::{Document, InstanceId, Pose, Projection, RgbdImage};

/// Instance id of the first object in [`RgbdImage::ids`]; object `i` of the scenario has `FIRST_OBJECT + i`.
pub const FIRST_OBJECT: u16 = 3;

/// Visible pixels of an object in an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VisibleRegion {
    /// Bounding box: left, top, right, bottom in pixels, right and bottom exclusive. Zeros if nothing is visible.
    pub bounds_px: [u32; 4],
    /// Number of visible pixels.
    pub pixels: u32,
}

/// Labels of the objects in one image; stored as one line of `labels.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageLabels {
    /// Index of the image, from 0, as in the names of the accompanying files.
    pub picture: usize,
    /// Control step of the episode; 0 for a scenario.
    pub control_step: usize,
    /// Time since the start of the episode, s; 0 for a scenario.
    pub time_s: f64,
    /// Name of the camera.
    pub camera: String,
    /// Camera pose, intrinsics and distortion of the image.
    pub projection: Projection,
    /// All objects of the scenario in order, including those that are not visible.
    pub objects: Vec<ObjectLabel>,
}

impl Document for ImageLabels {
    const SCHEMA: &'static str = "genmanip.labels/1";
}

/// Label of an object in an image.
///
/// Image boxes are left, top, right, bottom in pixels, right and bottom exclusive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectLabel {
    /// Instance id in the scenario.
    pub id: InstanceId,
    /// Bounding box of the visible pixels (modal box); null if none is visible.
    pub visible_box_px: Option<[u32; 4]>,
    /// Number of visible pixels.
    pub visible_pixels: u32,
    /// Bounding box without occlusion (amodal box), clipped to the image; null if outside the image.
    pub whole_box_px: Option<[u32; 4]>,
    /// Number of pixels without occlusion, within the image.
    pub whole_pixels: u32,
    /// Visibility: `visible_pixels / whole_pixels`, 0-1; null if outside the image.
    pub visible_share: Option<f64>,
    /// True if the unoccluded object reaches the image border and may be truncated.
    pub touches_edge: bool,
    /// Pose of the oriented bounding box in the world; its axes are those of the object's frame.
    pub world_from_box: Pose,
    /// Pose of the oriented bounding box in the camera's optical frame: x right, y down, z forward.
    pub camera_from_box: Pose,
    /// Lengths of the box along its axes, m.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
}

/// Surface points of an object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Points in the world frame, metres.
    pub points_m: Vec<[f32; 3]>,
    /// 8-bit sRGB of each point; empty without colour.
    pub colors: Vec<[u8; 3]>,
}

/// Visible regions of the first `objects` objects of the scenario in an id image `width` pixels wide.
pub fn visible_regions(ids: &[u16], width: u32, objects: usize) -> Vec<VisibleRegion> {
    let mut all = vec![VisibleRegion::default(); objects];
    for (y, row) in (0_u32..).zip(ids.chunks(width.max(1) as usize)) {
        for (x, id) in (0_u32..).zip(row) {
            if let Some(seen) = object(*id).and_then(|object| all.get_mut(object)) {
                seen.add(x, y);
            }
        }
    }
    all
}

/// Visible region of one instance id.
pub fn visible_region(ids: &[u16], width: u32, id: u16) -> VisibleRegion {
    let mut region = VisibleRegion::default();
    for (y, row) in (0_u32..).zip(ids.chunks(width.max(1) as usize)) {
        for (x, _) in (0_u32..).zip(row).filter(|(_, shown)| **shown == id) {
            region.add(x, y);
        }
    }
    region
}

impl VisibleRegion {
    /// Includes a pixel in the region.
    fn add(&mut self, x: u32, y: u32) {
        let [left, top, right, bottom] = self.bounds_px;
        self.bounds_px = match self.pixels {
            0 => [x, y, x + 1, y + 1],
            _ => [left.min(x), top.min(y), right.max(x + 1), bottom.max(y + 1)],
        };
        self.pixels += 1;
    }
}

/// Labels of the objects in an image, given each object's id, visible region, unoccluded region and oriented bounding
/// box in the world.
pub fn labels<'a>(
    projection: &Projection,
    objects: impl IntoIterator<Item = (&'a InstanceId, VisibleRegion, VisibleRegion, OrientedBox)>,
) -> Vec<ObjectLabel> {
    let size = [projection.intrinsics.width, projection.intrinsics.height];
    let camera_from_world = projection.world_from_camera.inverse();
    let label = |(id, visible, whole, placed): (&InstanceId, VisibleRegion, VisibleRegion, OrientedBox)| {
        let bounds = |region: VisibleRegion| (region.pixels > 0).then_some(region.bounds_px);
        let [left, top, right, bottom] = whole.bounds_px;
        let is_at_edge = left == 0 || top == 0 || right >= size[0] || bottom >= size[1];
        ObjectLabel {
            id: id.clone(),
            visible_box_px: bounds(visible),
            visible_pixels: visible.pixels,
            whole_box_px: bounds(whole),
            whole_pixels: whole.pixels,
            visible_share: (whole.pixels > 0).then(|| f64::from(visible.pixels) / f64::from(whole.pixels)),
            touches_edge: whole.pixels > 0 && is_at_edge,
            world_from_box: placed.outer_from_box,
            camera_from_box: camera_from_world * placed.outer_from_box,
            size_m: placed.size,
        }
    };
    objects.into_iter().map(label).collect()
}

/// Point clouds of the first `objects` objects of the scenario in an image with ids and depth, in row-major order.
pub fn clouds(image: &RgbdImage, objects: usize) -> Vec<PointCloud> {
    let mut clouds = vec![PointCloud::default(); objects];
    let colors = image.rgb.as_chunks::<3>().0;
    for (index, id) in image.ids.iter().enumerate() {
        let Some(cloud) = object(*id).and_then(|object| clouds.get_mut(object)) else { continue };
        let Some(point) = image.point(index) else { continue };
        cloud.points_m.push(point.as_vec3().to_array());
        cloud.colors.extend(colors.get(index));
    }
    clouds
}

/// Scenario index of an instance id; `None` for background, table and robot.
fn object(id: u16) -> Option<usize> {
    id.checked_sub(FIRST_OBJECT).map(usize::from)
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::{Distortion, Intrinsics};

    /// Checks objects that are partly visible, invisible, and at the border.
    #[test]
    fn labels_report_occlusion_and_truncation() {
        let projection = Projection {
            intrinsics: Intrinsics::from_vertical_fov(6, 4, 0.8),
            distortion: None,
            world_from_camera: Pose::from_position_yaw(DVec3::new(1.0, 2.0, 3.0), 0.5),
        };
        let mut ids = vec![0; 24];
        for (x, y, id) in [(1, 1, 3), (4, 2, 3), (0, 3, 5), (5, 0, 2), (3, 0, 1), (2, 2, 9)] {
            ids[y * 6 + x] = id;
        }
        let visible = visible_regions(&ids, 6, 3);
        assert_eq!(visible[0], VisibleRegion { bounds_px: [1, 1, 5, 3], pixels: 2 });
        assert_eq!(visible[1], VisibleRegion::default());
        assert_eq!([3, 4, 5].map(|id| visible_region(&ids, 6, id)), visible[..]);
        let whole = [VisibleRegion { bounds_px: [1, 1, 5, 3], pixels: 8 }, VisibleRegion::default(), visible[2]];
        let placed = OrientedBox { outer_from_box: Pose::from_position(DVec3::X), size: DVec3::splat(0.1) };
        let names = ["mug", "fork", "box"].map(|name| InstanceId::new(&name.into(), 1));
        let described = names.iter().zip(visible).zip(whole).map(|((id, visible), whole)| (id, visible, whole, placed));
        let labels = labels(&projection, described);
        let shares: Vec<_> = labels.iter().map(|label| label.visible_share).collect();
        assert_eq!(shares, [Some(0.25), None, Some(1.0)]);
        assert_eq!(labels.iter().map(|label| label.touches_edge).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!((labels[1].visible_box_px, labels[1].whole_box_px), (None, None));
        let back = projection.world_from_camera * labels[0].camera_from_box;
        assert!(back.position.distance(DVec3::X) < 1e-12 && back.angle_to(&placed.outer_from_box) < 1e-7);
    }

    /// Checks that points project back to their pixel, with and without distortion.
    #[test]
    fn cloud_points_project_to_their_pixels() {
        let intrinsics = Intrinsics::from_vertical_fov(8, 6, 0.9);
        let mut image = RgbdImage::of_depth(intrinsics, Pose::from_position(DVec3::Z), vec![2.0; 48]);
        image.distortion = Some(Distortion { k1: -0.1, ..Distortion::default() });
        image.depth_m[9] = 0.0;
        image.ids = (0..48).map(|index| if index < 12 { FIRST_OBJECT + 1 } else { 1 }).collect();
        image.rgb = (0..144).collect();
        let clouds = clouds(&image, 2);
        assert_eq!((clouds[0].points_m.len(), clouds[1].points_m.len()), (0, 11), "one pixel has no depth");
        assert_eq!(clouds[1].colors[1], [3, 4, 5]);
        let point = DVec3::from_array(clouds[1].points_m[1].map(f64::from));
        let (pixel, depth_m) = image.projection().pixel(point).unwrap();
        assert!(pixel.distance(DVec2::new(1.0, 0.0)) < 1e-4 && (depth_m - 2.0).abs() < 1e-6, "{pixel} {depth_m}");
    }
}
