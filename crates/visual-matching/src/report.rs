//! Photographs beside renderings of the same scene, in the world as it was and in the matched one.

use std::sync::Arc;

use genmanip_core::{Pose, World};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderError, RenderVariation, Renderer};
use serde::Serialize;

use crate::compare::{RegionDifference, by_region};
use crate::error::MatchError;
use crate::flip::{PIXELS_PER_DEGREE, flip};
use crate::matching::Matched;
use crate::request::{MatchRequest, Photo};
use crate::scene::pictured;

/// A photograph compared with renderings of the same scene.
#[derive(Clone, Debug, Serialize)]
pub struct ViewReport {
    /// Name of the camera.
    pub camera: String,
    /// Number of the scene with objects, from 1; 0 for the empty workspace.
    pub scene: usize,
    /// Differences to the image of the world as it was, by region.
    pub before: Vec<RegionDifference>,
    /// Differences to the image of the matched world, by region.
    pub after: Vec<RegionDifference>,
    /// Width of each image, px.
    #[serde(skip)]
    pub width: u32,
    /// Height, px.
    #[serde(skip)]
    pub height: u32,
    /// Before, photograph, after and FLIP of the latter two (white is the largest difference), 8-bit sRGB.
    #[serde(skip)]
    pub images: [Vec<u8>; 4],
}

impl ViewReport {
    /// The four images side by side: width, height and 8-bit sRGB.
    pub fn sheet(&self) -> (u32, u32, Vec<u8>) {
        let row_bytes = 3 * self.width as usize;
        let rows = (0..self.height as usize)
            .flat_map(|row| self.images.iter().map(move |image| &image[row * row_bytes..][..row_bytes]));
        (4 * self.width, self.height, rows.flatten().copied().collect())
    }
}

/// Compares all photographs of a request with renderings of the same scene before and after the match.
///
/// # Errors
/// When a view cannot be rendered.
pub fn reports(request: &MatchRequest, matched: &Matched) -> Result<Vec<ViewReport>, MatchError> {
    let empty = request.empty.iter().map(|photo| (photo, 0));
    let with_objects = request.objects.iter().zip(1..);
    let with_objects = with_objects.flat_map(|(objects, scene)| objects.photos.iter().map(move |photo| (photo, scene)));
    empty.chain(with_objects).map(|(photo, scene)| compared(request, matched, photo, scene)).collect()
}

fn compared(request: &MatchRequest, matched: &Matched, photo: &Photo, scene: usize) -> Result<ViewReport, MatchError> {
    let before = drawn(request, &request.world, photo, scene)?;
    let after = drawn(request, &matched.world, photo, scene)?;
    let width = photo.width as usize;
    let compare = |image: &FrameBuffers| by_region(&photo.rgb, &image.rgb, &image.instance, width);
    let (regions_before, regions_after) = (compare(&before), compare(&after));
    let flips = flip(&photo.rgb, &after.rgb, width, PIXELS_PER_DEGREE).unwrap_or_default();
    let difference = flips.iter().flat_map(|value| [(255.0 * value) as u8; 3]).collect();
    Ok(ViewReport {
        camera: photo.camera.clone(),
        scene,
        before: regions_before,
        after: regions_after,
        width: photo.width,
        height: photo.height,
        images: [before.rgb, photo.rgb.clone(), after.rgb, difference],
    })
}

fn drawn(request: &MatchRequest, world: &World, photo: &Photo, scene: usize) -> Result<FrameBuffers, MatchError> {
    let failed = |source: RenderError| MatchError::NotDrawn { camera: photo.camera.clone(), source };
    let objects = scene.checked_sub(1).and_then(|index| request.objects.get(index));
    let models = objects.map_or(&[][..], |objects| &objects.models);
    let assets = match request.arm {
        Some(_) => RenderAssets::new(Arc::clone(&request.robot), models, Some(world)),
        None => RenderAssets::without_robot(models, Some(world)),
    };
    let assets = assets.map_err(failed)?;
    let (arm, gripper) = request.arm.as_ref().map_or((&[][..], 0.0), |(arm, gripper)| (&arm[..], *gripper));
    let poses: &[(Pose, Vec<f64>)] = objects.map_or(&[], |objects| &objects.poses);
    let poses = poses.iter().map(|(pose, joints)| (*pose, joints.as_slice()));
    let frame = assets.frame_state(arm, gripper, poses).map_err(failed)?;
    let mut renderer = Renderer::new(assets, RenderVariation::of_world(world).map_err(failed)?);
    let channels = Channels { instance: true, ..Channels::RGB };
    pictured(&mut renderer, &frame, request.camera(&photo.camera)?, channels)
}
