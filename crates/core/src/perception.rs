//! What a picture shows of each object: what detectors, pose estimators and segmenters are trained and tested with.
//!
//! All of it follows from ids, depth, colour and the camera of an [`RgbdImage`], and from where the objects are.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::OrientedBox;
use crate::{Document, Pose, Projection, RgbdImage};

/// Id of the first object in [`RgbdImage::ids`]; object `i` of the scenario has `FIRST_OBJECT + i`.
pub const FIRST_OBJECT: u16 = 3;

/// What a picture shows of a thing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Left, top, right, bottom in pixels; right and bottom are the first behind it. Zeros where nothing is seen.
    pub bounds_px: [u32; 4],
    /// Pixels that show it.
    pub pixels: u32,
}

/// What one camera's picture shows of the objects, at one moment: a line of `labels.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PictureLabels {
    /// Number of the picture, from 0; that in the names of the files beside it.
    pub picture: usize,
    /// Control step of the episode; 0 of a scenario.
    pub control_step: usize,
    /// Time since the start of the episode, s; 0 of a scenario.
    pub time_s: f64,
    /// Name of the camera.
    pub camera: String,
    /// Where the camera is and how it projects.
    pub projection: Projection,
    /// The objects of the scenario, in its order; those out of sight too.
    pub objects: Vec<ObjectLabel>,
}

impl Document for PictureLabels {
    const SCHEMA: &'static str = "genmanip.labels/1";
}

/// What a picture shows of an object.
///
/// Boxes in the picture are left, top, right, bottom in pixels; right and bottom are the first pixels behind it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectLabel {
    /// Id in the scenario.
    pub id: String,
    /// Box around the visible pixels; null when none is.
    pub visible_box_px: Option<[u32; 4]>,
    /// Pixels that show it.
    pub visible_pixels: u32,
    /// Box of what would be seen of it with nothing before it, within the picture; null when it is out of sight.
    pub whole_box_px: Option<[u32; 4]>,
    /// Pixels that would show it with nothing before it, within the picture.
    pub whole_pixels: u32,
    /// `visible_pixels / whole_pixels`, 0-1; null when it is out of sight.
    pub visible_share: Option<f64>,
    /// Whether it reaches the edge of the picture, so that the picture may cut some of it off.
    pub touches_edge: bool,
    /// Centre and axes of the box around it, in the world. The axes are those of the object's own frame.
    pub world_from_box: Pose,
    /// The same in the camera's optical frame: x right, y down, z ahead.
    pub camera_from_box: Pose,
    /// Lengths of the box along its axes, m.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
}

/// Points of an object's surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// In the world, metres.
    pub points_m: Vec<[f32; 3]>,
    /// 8-bit sRGB of each point; empty without colour.
    pub colors: Vec<[u8; 3]>,
}

/// What an image of ids, `width` pixels wide, shows of the first objects of the scenario.
pub fn seen(ids: &[u16], width: u32, objects: usize) -> Vec<Seen> {
    let mut all = vec![Seen::default(); objects];
    for (y, row) in (0_u32..).zip(ids.chunks(width.max(1) as usize)) {
        for (x, id) in (0_u32..).zip(row) {
            if let Some(seen) = object(*id).and_then(|object| all.get_mut(object)) {
                seen.add(x, y);
            }
        }
    }
    all
}

/// What such an image shows of the thing with this id alone.
pub fn seen_of(ids: &[u16], width: u32, id: u16) -> Seen {
    let mut seen = Seen::default();
    for (y, row) in (0_u32..).zip(ids.chunks(width.max(1) as usize)) {
        for (x, _) in (0_u32..).zip(row).filter(|(_, shown)| **shown == id) {
            seen.add(x, y);
        }
    }
    seen
}

impl Seen {
    /// One more pixel shows it.
    fn add(&mut self, x: u32, y: u32) {
        let [left, top, right, bottom] = self.bounds_px;
        self.bounds_px = match self.pixels {
            0 => [x, y, x + 1, y + 1],
            _ => [left.min(x), top.min(y), right.max(x + 1), bottom.max(y + 1)],
        };
        self.pixels += 1;
    }
}

/// What a camera's picture shows of each object: its name, what is seen of it, what would be seen of it with nothing
/// before it, and the box around it in the world.
pub fn labels<'a>(
    projection: &Projection,
    objects: impl IntoIterator<Item = (&'a str, Seen, Seen, OrientedBox)>,
) -> Vec<ObjectLabel> {
    let size = [projection.intrinsics.width, projection.intrinsics.height];
    let camera_from_world = projection.world_from_camera.inverse();
    let label = |(id, visible, whole, placed): (&str, Seen, Seen, OrientedBox)| {
        let bounds = |seen: Seen| (seen.pixels > 0).then_some(seen.bounds_px);
        let [left, top, right, bottom] = whole.bounds_px;
        let is_at_edge = left == 0 || top == 0 || right >= size[0] || bottom >= size[1];
        ObjectLabel {
            id: id.to_owned(),
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

/// The points that an image with ids and depth shows of each of the first objects of the scenario, row by row.
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

/// Index of the object with an id; `None` for background, table and robot.
fn object(id: u16) -> Option<usize> {
    id.checked_sub(FIRST_OBJECT).map(usize::from)
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::{Distortion, Intrinsics};

    /// Things far from each other, seen in part, not at all, and at the edge.
    #[test]
    fn labels_tell_what_is_hidden_and_what_is_cut_off() {
        let projection = Projection {
            intrinsics: Intrinsics::from_vertical_fov(6, 4, 0.8),
            distortion: None,
            world_from_camera: Pose::from_position_yaw(DVec3::new(1.0, 2.0, 3.0), 0.5),
        };
        let mut ids = vec![0; 24];
        for (x, y, id) in [(1, 1, 3), (4, 2, 3), (0, 3, 5), (5, 0, 2), (3, 0, 1), (2, 2, 9)] {
            ids[y * 6 + x] = id;
        }
        let visible = seen(&ids, 6, 3);
        assert_eq!(visible[0], Seen { bounds_px: [1, 1, 5, 3], pixels: 2 });
        assert_eq!(visible[1], Seen::default());
        assert_eq!([3, 4, 5].map(|id| seen_of(&ids, 6, id)), visible[..]);
        let whole = [Seen { bounds_px: [1, 1, 5, 3], pixels: 8 }, Seen::default(), visible[2]];
        let placed = OrientedBox { outer_from_box: Pose::from_position(DVec3::X), size: DVec3::splat(0.1) };
        let names = ["mug", "fork", "box"];
        let told = names.into_iter().zip(visible).zip(whole).map(|((id, visible), whole)| (id, visible, whole, placed));
        let labels = labels(&projection, told);
        let shares: Vec<_> = labels.iter().map(|label| label.visible_share).collect();
        assert_eq!(shares, [Some(0.25), None, Some(1.0)]);
        assert_eq!(labels.iter().map(|label| label.touches_edge).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!((labels[1].visible_box_px, labels[1].whole_box_px), (None, None));
        let back = projection.world_from_camera * labels[0].camera_from_box;
        assert!(back.position.distance(DVec3::X) < 1e-12 && back.angle_to(&placed.outer_from_box) < 1e-7);
    }

    /// Each point lies in front of the pixel it was taken from, through a lens too.
    #[test]
    fn clouds_hold_the_points_that_the_pixels_show() {
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
