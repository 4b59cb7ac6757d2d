//! Point clouds of a table: of the whole surface, or as seen by depth cameras.

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, ObjectModel, Pose, Seed, World};
use genmanip_render::{Channels, FIRST_OBJECT, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::{Table, TrialError, TrialView};

/// Resolution and noise of the depth cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ViewSettings {
    /// Width and height of the prompt cameras' images, pixels.
    pub resolution: [u32; 2],
    /// Standard deviation of the depth at 1 m, m; proportional to the squared distance.
    pub noise_m: f64,
    /// Share of pixels lost at edges: next to another object or a depth step above `edge_m`.
    pub edge_dropout: f64,
    /// Minimum depth step that counts as an edge for `edge_dropout`, m.
    pub edge_m: f64,
    /// Share of all other pixels that are lost.
    pub dropout: f64,
    /// Maximum number of points of the target; more are subsampled evenly.
    pub points: usize,
    /// Maximum number of points of everything else.
    pub scene_points: usize,
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self {
            // Same as in the prompt images in the GenManip paper.
            resolution: [1280, 720],
            // Chosen: a good short-range depth camera; earlier experiments with one and three views used the same.
            noise_m: 0.0005,
            // Chosen: cameras lose most where a pixel covers two objects.
            edge_dropout: 0.5,
            edge_m: 0.01,
            // Chosen: isolated holes everywhere, as such cameras have.
            dropout: 0.02,
            // Chosen: twice what the sampler keeps after subsampling (`CloudSettings::most_points`).
            points: 4000,
            // Chosen: the same density for the neighbours together as for the target.
            scene_points: 8000,
        }
    }
}

/// Input of the grasp sampler.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    /// Points on the target, world frame.
    pub points: Vec<DVec3>,
    /// Points on all other objects, world frame.
    pub scene: Vec<DVec3>,
    /// Camera positions, world frame; empty for the whole surface.
    pub cameras: Vec<DVec3>,
    /// Pose of the camera that saw most of the target; of the first prompt camera for the whole surface.
    pub world_from_camera: Pose,
}

/// Point cloud of a table whose object 0 is the target.
pub(super) fn observe(
    table: &Table,
    world: &World,
    view: TrialView,
    settings: &ViewSettings,
    seed: Seed,
) -> Result<Cloud, TrialError> {
    let prompt: Vec<Camera> = world
        .prompt_cameras()
        .into_iter()
        .map(|camera| {
            let [width, height] = settings.resolution;
            Camera { intrinsics: camera.intrinsics.resized(width, height), ..camera.clone() }
        })
        .collect();
    match view {
        TrialView::Full => {
            let world_from_camera = prompt.first().map_or(Pose::IDENTITY, |camera| camera.mount_from_camera);
            Ok(Cloud { world_from_camera, ..whole(table, settings, seed) })
        }
        TrialView::Three => seen(table, world, &prompt, settings, seed),
        TrialView::One => {
            let index = seed.fork("camera").rng().random_range(0..prompt.len());
            seen(table, world, &prompt[index..=index], settings, seed)
        }
    }
}

fn whole(table: &Table, settings: &ViewSettings, seed: Seed) -> Cloud {
    let others = (table.models.len() - 1).max(1);
    let mut cloud = Cloud::default();
    for (index, (model, pose)) in table.models.iter().zip(&table.poses).enumerate() {
        let (count, into) = if index == 0 {
            (settings.points, &mut cloud.points)
        } else {
            (settings.scene_points / others, &mut cloud.scene)
        };
        into.extend(surface(model, pose, count, seed.fork_index(index as u64)));
    }
    cloud
}

/// Uniform points on the visual surface.
fn surface(model: &ObjectModel, world_from_object: &Pose, count: usize, seed: Seed) -> Vec<DVec3> {
    let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
    let parts: Vec<_> = model.links.iter().flat_map(|link| &link.visual).collect();
    let areas: Vec<f64> = parts.iter().map(|part| part.mesh.corners().map(area).sum()).collect();
    let total = areas.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut rng = seed.rng();
    let mut points = Vec::new();
    for (part, area) in parts.iter().zip(&areas) {
        let share = (count as f64 * area / total).round() as usize;
        let world_from_part = *world_from_object * part.link_from_part;
        points
            .extend(part.mesh.sample_surface(share, &mut rng).iter().map(|(p, _)| world_from_part.transform_point(*p)));
    }
    points
}

fn seen(
    table: &Table,
    world: &World,
    cameras: &[Camera],
    settings: &ViewSettings,
    seed: Seed,
) -> Result<Cloud, TrialError> {
    let assets = RenderAssets::without_robot(&table.models, Some(world))?;
    let mut renderer = Renderer::new(std::sync::Arc::clone(&assets), RenderVariation::default());
    let frame = assets.frame_state(&[], 0.0, table.poses.iter().map(|pose| (*pose, [].as_slice())))?;
    let mut cloud = Cloud::default();
    let mut most = 0;
    for (index, camera) in cameras.iter().enumerate() {
        let mut buffers = [FrameBuffers::default()];
        renderer.render(&[ViewJob::new(&frame, camera, Channels::GEOMETRY)], &mut buffers)?;
        let mut rng = seed.fork("noise").fork_index(index as u64).rng();
        let [buffers] = buffers;
        let before = cloud.points.len();
        add_pixels(&buffers, camera, settings, &mut rng, &mut cloud);
        let own = cloud.points.len() - before;
        if index == 0 || own > most {
            (most, cloud.world_from_camera) = (own, camera.mount_from_camera);
        }
        cloud.cameras.push(camera.mount_from_camera.position);
    }
    cloud.points = evenly(cloud.points, settings.points);
    cloud.scene = evenly(cloud.scene, settings.scene_points);
    Ok(cloud)
}

fn add_pixels(buffers: &FrameBuffers, camera: &Camera, settings: &ViewSettings, rng: &mut impl Rng, cloud: &mut Cloud) {
    let (width, height) = (buffers.width as usize, buffers.height as usize);
    let world_from_camera = camera.mount_from_camera;
    for row in 1..height.saturating_sub(1) {
        for column in 1..width.saturating_sub(1) {
            let pixel = row * width + column;
            let (id, depth) = (buffers.instance[pixel], f64::from(buffers.depth_m[pixel]));
            if id < FIRST_OBJECT {
                continue;
            }
            let differs = |other: usize| {
                buffers.instance[other] != id || (f64::from(buffers.depth_m[other]) - depth).abs() > settings.edge_m
            };
            let is_edge = [pixel - 1, pixel + 1, pixel - width, pixel + width].into_iter().any(differs);
            if rng.random::<f64>() < if is_edge { settings.edge_dropout } else { settings.dropout } {
                continue;
            }
            let measured = depth + settings.noise_m * depth * depth * normal(rng);
            let point = camera.intrinsics.unproject(DVec2::new(column as f64, row as f64), measured);
            let point = world_from_camera.transform_point(point);
            if id == FIRST_OBJECT { cloud.points.push(point) } else { cloud.scene.push(point) }
        }
    }
}

/// Sample of the standard normal distribution (Box and Muller, 1958).
fn normal(rng: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

/// At most `count` of the points, evenly spaced in their order.
fn evenly(points: Vec<DVec3>, count: usize) -> Vec<DVec3> {
    if points.len() <= count {
        return points;
    }
    (0..count).map(|index| points[index * points.len() / count]).collect()
}
