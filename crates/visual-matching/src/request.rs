//! Photographs and settings from which a workspace is matched.

use std::sync::Arc;

use genmanip_core::glam::DVec2;
use genmanip_core::{Camera, CameraMount, ObjectModel, Pose, RobotModel, World};

use crate::error::MatchError;

/// Image by a fixed camera of the world, with fixed exposure and white balance; one camera's photographs share them.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Name of the camera.
    pub camera: String,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// 8-bit sRGB, row by row.
    pub rgb: Vec<u8>,
}

/// Photograph with a 24-patch colour chart, which lies flat on the table in the open.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPhoto {
    /// Photograph.
    pub photo: Photo,
    /// Pixels of the centres of the corner patches, see [`crate::chart::read`].
    pub corners_px: [DVec2; 4],
}

/// Known objects in photographs.
#[derive(Clone, Debug)]
pub struct ObjectScene {
    /// Objects.
    pub models: Vec<Arc<ObjectModel>>,
    /// Pose in the world and joint positions (rad or m) of each object.
    pub poses: Vec<(Pose, Vec<f64>)>,
    /// Photographs with the objects, otherwise as those of the empty workspace.
    pub photos: Vec<Photo>,
}

/// Photographs of a workspace, and what is known about it.
#[derive(Clone, Debug)]
pub struct MatchRequest {
    /// World with the calibrated cameras.
    pub world: World,
    /// Its robot.
    pub robot: Arc<RobotModel>,
    /// Photographs of the empty workspace, at most one per camera.
    pub empty: Vec<Photo>,
    /// Joint positions of the arm (rad or m) and opening of the gripper (m) in all photographs; `None` if the robot is not
    /// in them.
    pub arm: Option<(Vec<f64>, f64)>,
    /// Photographs with a colour chart.
    pub charts: Vec<ChartPhoto>,
    /// Photographs with known objects. The shadows of the first scene tell the light; all tell the objects' materials.
    pub objects: Vec<ObjectScene>,
    /// Mean base colour of the table, linear RGB; `None` if it is not known.
    pub table_color: Option<[f64; 3]>,
}

impl MatchRequest {
    /// Checks the photographs against the cameras of the world.
    pub(crate) fn check(&self) -> Result<(), MatchError> {
        if self.empty.is_empty() {
            return Err(MatchError::NoPhotograph);
        }
        let mut groups =
            vec![self.empty.iter().collect::<Vec<_>>(), self.charts.iter().map(|chart| &chart.photo).collect()];
        groups.extend(self.objects.iter().map(|scene| scene.photos.iter().collect()));
        for photos in &groups {
            for (index, photo) in photos.iter().enumerate() {
                let camera = self.camera(&photo.camera)?;
                let expected = [camera.intrinsics.width, camera.intrinsics.height];
                let size = [photo.width, photo.height];
                if size != expected || photo.rgb.len() != 3 * photo.width as usize * photo.height as usize {
                    let [got, expected] = [size, expected].map(|[width, height]| format!("{width}×{height}"));
                    return Err(MatchError::WrongSize { camera: photo.camera.clone(), got, expected });
                }
                if photos[..index].iter().any(|other| other.camera == photo.camera) {
                    return Err(MatchError::TwoPhotographs { camera: photo.camera.clone() });
                }
            }
        }
        Ok(())
    }

    /// Fixed camera of the world by name.
    pub(crate) fn camera(&self, name: &str) -> Result<&Camera, MatchError> {
        let fixed = || self.world.cameras.iter().filter(|camera| camera.mount == CameraMount::World);
        fixed().find(|camera| camera.name == name).ok_or_else(|| MatchError::UnknownCamera {
            camera: name.to_owned(),
            known: fixed().map(|camera| camera.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    }
}
