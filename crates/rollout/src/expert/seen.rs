//! Grasps from what cameras see of an object, in place of those from its geometry.
//!
//! Which points are the object's is the simulator's truth, as in GenManip (Gao et al., CVPR 2025), whose demonstrations
//! crop the target from the rendered RGB-D image and ask AnyGrasp about it.

use genmanip_core::glam::DVec3;
use genmanip_core::{
    CameraMount, CameraRequest, Grasp, ImageChannels, Observation, PolicyError, Pose, RgbdImage, Scenario,
};
use genmanip_render::FIRST_OBJECT;

/// What all fixed cameras see of an object and around it; world frame, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenObject {
    /// Points on the object.
    pub points: Vec<DVec3>,
    /// Points of everything else, the arm apart.
    pub scene: Vec<DVec3>,
    /// The camera that saw most of it; x right, y down, z forward.
    pub world_from_camera: Pose,
    /// Where all cameras are that saw it.
    pub eyes: Vec<DVec3>,
    /// World z of what it stands on.
    pub table_height: f64,
}

/// Anything that proposes grasps of what is seen.
pub trait SeenGrasps: Send + Sync {
    /// Grasps in the world frame, best first; an object that no grasp fits has none.
    ///
    /// # Errors
    /// [`PolicyError::Unreachable`] where a service does not answer: the attempt is then no failure.
    fn grasps(&self, seen: &SeenObject) -> Result<Vec<Grasp>, PolicyError>;
}

/// What the expert must be shown: points and ids of every camera that is fixed in the world.
pub(super) fn cameras(scenario: &Scenario) -> Vec<CameraRequest> {
    let channels = ImageChannels { rgb: false, depth: true, ids: true, normals: false, points: true };
    let fixed = scenario.world.cameras.iter().filter(|camera| camera.mount == CameraMount::World);
    fixed.map(|camera| CameraRequest::new(&camera.name, channels)).collect()
}

/// What the images of an observation show of an object that stands at a height.
pub(super) fn seen(observation: &Observation, object: usize, table_height: f64) -> SeenObject {
    let wanted = u16::try_from(object).unwrap_or(u16::MAX).saturating_add(FIRST_OBJECT);
    let mut seen = SeenObject { table_height, ..SeenObject::default() };
    let mut most = 0;
    for image in observation.images.values() {
        let before = seen.points.len();
        add(&mut seen, image, wanted);
        let own = seen.points.len() - before;
        if own > 0 {
            seen.eyes.push(image.world_from_camera.position);
        }
        if own > most {
            (most, seen.world_from_camera) = (own, image.world_from_camera);
        }
    }
    seen
}

fn add(seen: &mut SeenObject, image: &RgbdImage, wanted: u16) {
    for (point, id) in image.points_m.iter().zip(&image.ids) {
        let point = DVec3::from(point.map(f64::from));
        match *id {
            _ if !point.is_finite() => {}
            id if id == wanted => seen.points.push(point),
            // What is below are nothing, the table and the arm, which is moving and is planned around anyway.
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
    fn points_are_told_apart_by_ids_and_joined_over_cameras() {
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
        let seen = seen(&observation, 1, 0.02);
        let xs = |points: &[DVec3]| points.iter().map(|point| (point.x * 10.0).round()).collect::<Vec<_>>();
        assert_eq!((xs(&seen.points), xs(&seen.scene)), (vec![1.0, 4.0, 5.0], vec![2.0]));
        assert_eq!((xs(&seen.eyes), seen.world_from_camera.position.x), (vec![10.0, 20.0], 2.0));
        assert_eq!(seen.table_height, 0.02);
    }
}
