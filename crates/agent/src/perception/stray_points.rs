//! Removal of background points from the points of an object: the outline of a mask is never exact to the pixel.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};

/// Edge of the voxels by which points are clustered (m); points in neighbouring voxels are connected. Chosen by hand:
/// twice the distance of neighbouring pixels on a slanted surface.
const VOXEL_M: f64 = 0.008;
/// Minimum share of the shown camera's points for a cluster to be kept. Chosen by hand.
const SHOWN_SHARE: f64 = 0.05;
/// Minimum share of all points for a cluster to be kept that the shown camera does not see. Chosen by hand.
const HIDDEN_SHARE: f64 = 0.2;

/// Points without small isolated clusters; the first `shown` points are those of the camera whose image is shown to
/// models. A part of the object that an occluder cuts off is kept if it is large enough.
pub(super) fn without_stray_points(points: Vec<DVec3>, shown: usize) -> Vec<DVec3> {
    let mut voxels: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    let voxel = |point: DVec3| (point / VOXEL_M).floor().as_ivec3();
    for (index, point) in points.iter().enumerate() {
        voxels.entry(voxel(*point).to_array()).or_default().push(index);
    }
    let mut keeps = vec![false; points.len()];
    let mut left = voxels.clone();
    while let Some((first, members)) = left.pop_first() {
        let (mut cluster, mut open) = (members, vec![IVec3::from_array(first)]);
        while let Some(from) = open.pop() {
            for neighbour in neighbours(from) {
                if let Some(members) = left.remove(&neighbour.to_array()) {
                    cluster.extend(members);
                    open.push(neighbour);
                }
            }
        }
        let of_shown = cluster.iter().filter(|index| **index < shown).count();
        let is_object = of_shown as f64 >= SHOWN_SHARE * shown as f64 && of_shown > 0
            || cluster.len() as f64 >= HIDDEN_SHARE * points.len() as f64;
        cluster.into_iter().for_each(|index| keeps[index] = is_object);
    }
    points.into_iter().zip(keeps).filter_map(|(point, keeps)| keeps.then_some(point)).collect()
}

fn neighbours(voxel: IVec3) -> impl Iterator<Item = IVec3> {
    let steps = || -1..=1;
    steps().flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| voxel + IVec3::new(x, y, z))))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of points 5 mm apart.
    fn wall(at: DVec3, width: i32, height: i32) -> Vec<DVec3> {
        let point = |index: i32| at + DVec3::new(0.0, f64::from(index % width), f64::from(index / width)) * 0.005;
        (0..width * height).map(point).collect()
    }

    #[test]
    fn pixels_on_what_lies_behind_are_no_part_of_the_object() {
        let can = wall(DVec3::ZERO, 12, 20);
        let check = |name: &str, other: Vec<DVec3>, is_shown: bool, stays: bool| {
            let shown = can.len() + if is_shown { other.len() } else { 0 };
            let all: Vec<DVec3> = can.iter().copied().chain(other.clone()).collect();
            let kept = without_stray_points(all.clone(), shown);
            assert_eq!(kept, if stays { all } else { can.clone() }, "{name}");
        };
        check("a rim on a book behind it", wall(DVec3::new(0.08, 0.0, 0.0), 2, 6), true, false);
        check("the same, seen by another camera", wall(DVec3::new(0.08, 0.0, 0.0), 2, 20), false, false);
        check("its side, seen by another camera", wall(DVec3::new(0.008, 0.0, 0.0), 2, 6), false, true);
        check("half of it, behind a hammer", wall(DVec3::new(0.0, 0.1, 0.0), 6, 10), true, true);
        check("its back, which only another camera sees", wall(DVec3::new(0.06, 0.0, 0.0), 12, 20), false, true);
        assert_eq!(without_stray_points(Vec::new(), 0), []);
    }
}
