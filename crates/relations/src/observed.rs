//! Point clouds of objects, fused from depth images with instance ids of several cameras.
//!
//! Cameras see only the near sides. Hidden sides are filled in from the convex hull of the observed points: a point of
//! the hull's surface is dropped if any camera sees through it (or has no depth there), and kept otherwise, also where
//! no camera looks. A box thus gets its back and underside, and a bowl stays open.

use std::collections::BTreeMap;

use genmanip_core::{Pose, RgbdImage};
use glam::{DVec2, DVec3};

use crate::clouds::Cloud;
use crate::hull::Hull;

/// Approximate spacing of the points of one object, metres.
const SPACING_M: f64 = 0.003;

/// Minimum distance (m) by which a camera must see past a point for the point to lie in free space.
const FREE_SPACE_M: f64 = 0.006;

/// Minimum number of observed points of an object; with fewer it gets no cloud.
const MIN_POINTS: usize = 12;

/// The cloud of each instance in the world frame, with hidden sides filled in; `None` for an instance that is hardly
/// visible.
///
/// If the id and depth images of a view differ in size, the pixels beyond the smaller one are ignored.
pub fn clouds_of_views(views: &[RgbdImage], instances: &[u16]) -> Vec<Option<Cloud>> {
    let cameras: Vec<Pose> = views.iter().map(|view| view.world_from_camera.inverse()).collect();
    let free = |point: DVec3| views.iter().zip(&cameras).any(|(view, camera)| looks_through(view, camera, point));
    let cloud = |&instance: &u16| {
        let pixels: Vec<DVec3> = views.iter().flat_map(|view| points_of(view, instance)).collect();
        if pixels.len() < MIN_POINTS {
            return None;
        }
        let mut cells: BTreeMap<[i64; 3], (DVec3, f64)> = BTreeMap::new();
        for point in pixels {
            let (sum, count) = cells.entry(cell(point)).or_insert((DVec3::ZERO, 0.0));
            *sum += point;
            *count += 1.0;
        }
        let seen: Vec<DVec3> = cells.values().map(|(sum, count)| *sum / *count).collect();
        let mut hidden: BTreeMap<[i64; 3], DVec3> = BTreeMap::new();
        for point in Hull::of(&seen).faces().flat_map(spread) {
            if !cells.contains_key(&cell(point)) && !free(point) {
                hidden.entry(cell(point)).or_insert(point);
            }
        }
        Cloud::new(seen.iter().chain(hidden.values()).map(DVec3::to_array).collect()).ok()
    };
    instances.iter().map(cloud).collect()
}

/// Observed points of an instance in the world frame, one per pixel with depth.
fn points_of(view: &RgbdImage, instance: u16) -> impl Iterator<Item = DVec3> + '_ {
    let seen = view.ids.iter().enumerate().filter(move |(_, id)| **id == instance);
    seen.filter_map(|(index, _)| view.point(index))
}

/// True if a camera measures a depth at least `FREE_SPACE_M` behind a point, or none at all; false outside its image.
fn looks_through(view: &RgbdImage, camera_from_world: &Pose, point: DVec3) -> bool {
    let local = camera_from_world.transform_point(point);
    let Some(pixel) = view.intrinsics.project(local).map(DVec2::round) else { return false };
    let size = DVec2::new(f64::from(view.width()), f64::from(view.height()));
    if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()) {
        return false;
    }
    let index = pixel.y as usize * view.width() as usize + pixel.x as usize;
    view.depth_m.get(index).is_some_and(|&depth| depth <= 0.0 || f64::from(depth) > local.z + FREE_SPACE_M)
}

fn cell(point: DVec3) -> [i64; 3] {
    (point / SPACING_M).floor().to_array().map(|index| index as i64)
}

/// Points over a triangle, about `SPACING_M` apart.
fn spread([a, b, c]: [DVec3; 3]) -> impl Iterator<Item = DVec3> {
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    let steps = ((longest / SPACING_M).ceil() as usize).clamp(1, 1000);
    let share = move |index: usize| index as f64 / steps as f64;
    (0..=steps).flat_map(move |i| (0..=steps - i).map(move |j| a + (b - a) * share(i) + (c - a) * share(j)))
}
