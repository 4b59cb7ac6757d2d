//! Grasps proposed from camera images instead of geometry.
//!
//! The object's points are segmented by simulator ground truth, as in GenManip (Gao et al., CVPR 2025), whose
//! demonstrations crop the target from the rendered RGB-D image and query AnyGrasp.

use genmanip_core::glam::DVec3;
use genmanip_core::{
    CameraMount, CameraRequest, Grasp, ImageChannels, Observation, PolicyError, Pose, RgbdImage, Scenario,
};
use genmanip_render::FIRST_OBJECT;

/// Points of an object and its surroundings seen by all fixed cameras; world frame, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObservedObject {
    /// Points on the object's surface.
    pub points: Vec<DVec3>,
    /// Points of everything else except the arm and the table.
    pub scene: Vec<DVec3>,
    /// Pose of the camera that sees most points of the object; x right, y down, z forward.
    pub world_from_camera: Pose,
    /// Positions of all cameras that see the object.
    pub camera_positions: Vec<DVec3>,
    /// Height of the object's support, world z, metres.
    pub table_height: f64,
}

/// Proposes grasps of an observed object.
pub trait GraspProposer: Send + Sync {
    /// Grasps in the world frame, best first; empty if there are none.
    ///
    /// # Errors
    /// [`PolicyError::Unreachable`] if a service does not answer: the attempt then does not count as failed.
    fn grasps(&self, seen: &ObservedObject) -> Result<Vec<Grasp>, PolicyError>;
}

/// Camera requests of the expert: points and ids of every camera fixed in the world.
pub(super) fn cameras(scenario: &Scenario) -> Vec<CameraRequest> {
    let channels = ImageChannels { rgb: false, depth: true, ids: true, normals: false, points: true };
    let fixed = scenario.world.cameras.iter().filter(|camera| camera.mount == CameraMount::World);
    fixed.map(|camera| CameraRequest::new(&camera.name, channels)).collect()
}

/// Extracts an object from the images of an observation.
pub(super) fn observe_object(observation: &Observation, object: usize, table_height: f64) -> ObservedObject {
    let wanted = u16::try_from(object).unwrap_or(u16::MAX).saturating_add(FIRST_OBJECT);
    let mut seen = ObservedObject { table_height, ..ObservedObject::default() };
    let mut most = 0;
    for image in observation.images.values() {
        let before = seen.points.len();
        add(&mut seen, image, wanted);
        let own = seen.points.len() - before;
        if own > 0 {
            seen.camera_positions.push(image.world_from_camera.position);
        }
        if own > most {
            (most, seen.world_from_camera) = (own, image.world_from_camera);
        }
    }
    seen
}

fn add(seen: &mut ObservedObject, image: &RgbdImage, wanted: u16) {
    for (point, id) in image.points_m.iter().zip(&image.ids) {
        let point = DVec3::from(point.map(f64::from));
        match *id {
            _ if !point.is_finite() => {}
            id if id == wanted => seen.points.push(point),
            // Lower ids are the background, the table and the arm. The arm moves, and planning avoids it anyway.
            id if id >= FIRST_OBJECT => seen.scene.push(point),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use genmanip_core::Intrinsics;

    use super::*;

    #[test]
    fn points_are_segmented_by_ids_and_merged_over_cameras() {
        let image = |x: f64, ids: &[u16], points: &[[f32; 3]]| {
            let eye = Pose { position: DVec3::new(x, 0.0, 1.0), ..Pose::IDENTITY };
            let intrinsics = Intrinsics::from_vertical_fov(ids.len() as u32, 1, 0.5);
            let empty = RgbdImage::of_depth(intrinsics, eye, vec![]);
            RgbdImage { ids: ids.to_vec(), points_m: points.to_vec(), ..empty }
        };
        let (target, other, table) = (FIRST_OBJECT + 1, FIRST_OBJECT, FIRST_OBJECT - 1);
        let nothing = [f32::NAN; 3];
        let images = [
            ("a".to_owned(), image(1.0, &[target, other, table], &[[0.1; 3], [0.2; 3], [0.3; 3]])),
            ("b".to_owned(), image(2.0, &[target, target, target], &[[0.4; 3], [0.5; 3], nothing])),
            ("c".to_owned(), image(3.0, &[table, 0], &[[0.6; 3], nothing])),
        ];
        let images = images.into_iter().map(|(name, image)| (name, Arc::new(image))).collect();
        let observation = Observation { time_s: 0.0, state: BTreeMap::new(), images, privileged: None };
        let seen = observe_object(&observation, 1, 0.02);
        let xs = |points: &[DVec3]| points.iter().map(|point| (point.x * 10.0).round()).collect::<Vec<_>>();
        assert_eq!((xs(&seen.points), xs(&seen.scene)), (vec![1.0, 4.0, 5.0], vec![2.0]));
        assert_eq!((xs(&seen.camera_positions), seen.world_from_camera.position.x), (vec![10.0, 20.0], 2.0));
        assert_eq!(seen.table_height, 0.02);
    }
}
