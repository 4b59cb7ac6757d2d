//! From photographs to the appearance of a world.

use std::sync::Arc;

use base64::Engine;
use genmanip_core::glam::DVec3;
use genmanip_core::{CameraAppearance, Photograph, WorkspaceAppearance, WorkspaceLight, World};
use genmanip_render::{Channels, ROBOT, RenderVariation, Renderer, Response, color::srgb8_from_linear, encode};
use glam::Vec3A;

use crate::cameras::responses;
use crate::empty::{Layers, emptied};
use crate::error::MatchError;
use crate::light::{LightEstimate, Observation, estimate};
use crate::materials::{FoundMaterial, materials};
use crate::request::{MatchRequest, Photo};
use crate::response::with_gains;
use crate::scene::{KeyLight, SeenScene, block_means, pictured, reduced};
use crate::unidentified::{Unidentified, names};
use crate::views::{MatchedCamera, Scenes, View, linear, radiance, usable};

/// Width of the images in which shadows are compared, px: full width divided by a whole number, at least this.
const FIT_WIDTH_PX: u32 = 180;
/// Largest width of the images of the first search, which are rendered with coarser shadows.
const COARSE_WIDTH_PX: u32 = 128;
/// JPEG qualities of backgrounds: the first with which all fit into a world file, and their bytes in base64 together.
const QUALITIES: [u8; 4] = [95, 90, 80, 65];
const ALL_BYTES: usize = 1_700_000;

/// Result of a match.
#[derive(Clone, Debug)]
pub struct Matched {
    /// The world with its measured appearance.
    pub world: World,
    /// Estimate of the light; `None` if no photograph shows a shadow of something known.
    pub light: Option<LightEstimate>,
    /// Cameras with photographs.
    pub cameras: Vec<MatchedCamera>,
    /// Materials of the objects' parts.
    pub materials: Vec<FoundMaterial>,
    /// Parameters that the photographs do not show.
    pub unidentified: Vec<Unidentified>,
}

/// Finds responses, light, table colour and backgrounds of a workspace, and materials of objects in it.
///
/// # Errors
/// [`MatchError`] for photographs that do not fit the world's cameras, unreadable charts, and views without table.
pub fn match_workspace(request: &MatchRequest) -> Result<Matched, MatchError> {
    request.check()?;
    let mut unidentified = Vec::new();
    let scene = Scenes::new(request)?;
    let mut views = responses(request, &scene, &mut unidentified)?;
    let estimate = light(request, &scene, &views)?;
    let light = usable_light(request, estimate.as_ref(), &mut unidentified);
    let table = table_color(request, &scene, &light, &mut views)?;
    let mut cameras = Vec::new();
    for view in &views {
        let photograph = background(request, &scene, view, &light)?;
        let (camera, response) = (view.found.camera.clone(), view.found.response.clone());
        cameras.push(CameraAppearance { camera, response, photograph: Some(photograph) });
    }
    let light = Some(light);
    let appearance = WorkspaceAppearance { light, table_color: Some(table), materials: Vec::new(), cameras };
    let mut world = World { appearance: Some(appearance), ..request.world.clone() };
    let has_direction = estimate.as_ref().is_some_and(LightEstimate::has_direction);
    let materials = materials(request, &scene, &world, has_direction, &mut unidentified)?;
    if let Some(appearance) = &mut world.appearance {
        appearance.materials = materials.iter().map(|found| found.material.clone()).collect();
    }
    let cameras = views.into_iter().map(|view| view.found).collect();
    Ok(Matched { world, light: estimate, cameras, materials, unidentified })
}

/// Light from the shadows of objects and arm; `None` if nothing known throws one.
fn light(request: &MatchRequest, scene: &Scenes, views: &[View<'_>]) -> Result<Option<LightEstimate>, MatchError> {
    let (mut coarse, mut fine) = (Vec::new(), Vec::new());
    for view in views {
        let width = view.photo.width;
        coarse.extend(observations(request, scene, view, width.div_ceil(COARSE_WIDTH_PX))?);
        fine.extend(observations(request, scene, view, (width / FIT_WIDTH_PX).max(1))?);
    }
    estimate(&coarse, &fine)
}

/// Shadows that a camera shows, in images reduced by a whole factor: those of objects, in which the texture of the
/// table cancels, and those of the arm.
fn observations(
    request: &MatchRequest,
    scene: &Scenes,
    view: &View<'_>,
    factor: u32,
) -> Result<Vec<Observation>, MatchError> {
    let camera = reduced(view.camera, factor);
    let small = |values: &[Vec3A]| block_means(values, view.photo.width, factor);
    let clean = |photo: &Photo| {
        let flags: Vec<Vec3A> = usable(photo).iter().map(|usable| Vec3A::splat(f32::from(u8::from(*usable)))).collect();
        small(&flags).iter().map(|share| share.x > 0.999).collect::<Vec<bool>>()
    };
    let (is_clean, empty) = (clean(view.photo), small(&radiance(view)));
    let mut with_objects = request.objects.first().into_iter().flat_map(|it| &it.photos);
    let with_objects = with_objects.find(|it| it.camera == view.camera.name);
    let mut found = Vec::new();
    if let (Some(photo), Some(posed)) = (with_objects, scene.objects.first()) {
        let after = small(&linear(&view.found.response, photo));
        let both: Vec<bool> = is_clean.iter().zip(clean(photo)).map(|(a, b)| *a && b).collect();
        let before = scene.has_arm.then(|| Scenes::seen(&scene.empty, &camera)).transpose()?;
        let posed = Scenes::seen(posed, &camera)?;
        found.push(Observation::pair(posed, before, [&after, &empty], &both, view.has_chart));
    }
    if scene.has_arm {
        let posed = Scenes::seen(&scene.empty, &camera)?;
        found.push(Observation::alone(posed, &empty, &is_clean, view.has_chart));
    }
    Ok(found)
}

/// The light to write: the estimate, or the default light in place of what it leaves open, which is named.
fn usable_light(
    request: &MatchRequest,
    estimate: Option<&LightEstimate>,
    unidentified: &mut Vec<Unidentified>,
) -> WorkspaceLight {
    let usual = RenderVariation::default();
    let remedy = "put one or two upright objects of known shape into view, as a cup or a box in a scenario file, and \
                  photograph them too (--scenario, --objects)";
    if estimate.is_none_or(|found| !found.has_radius || !found.has_direction()) {
        let why = match estimate {
            None => "nothing known throws a shadow on the table",
            Some(_) => "the edges of the shadows do not tell it",
        };
        unidentified.push(Unidentified { what: names::SOFTNESS.into(), why: why.into(), remedy: remedy.into() });
    }
    let (light, part) = match estimate.filter(|found| found.has_direction()) {
        Some(found) => (found.light, found.part),
        None => {
            let why = match (estimate, request.arm.is_some() || !request.objects.is_empty()) {
                (None, false) => "nothing known throws a shadow on the table".to_owned(),
                (None, true) => "no camera sees the table around what throws a shadow".to_owned(),
                (Some(found), _) => format!(
                    "the shadows on the table tell it to ± {:.0} degrees only; {:.0} % of the light comes from the key light",
                    found.direction_sd_deg.min(180.0),
                    100.0 * found.part.iter().sum::<f64>() / 3.0
                ),
            };
            unidentified.push(Unidentified { what: names::DIRECTION.into(), why, remedy: remedy.into() });
            let direction = glam::Vec3::from_array(usual.light_direction).as_dvec3().normalize();
            let key = f64::from(usual.light_intensity) * direction.z;
            // With a known direction but no visible key light, the light is ambient.
            let part = estimate.map_or([key / (key + f64::from(usual.ambient_intensity)); 3], |found| found.part);
            (KeyLight { direction, radius_rad: f64::from(usual.light_angular_radius) }, part)
        }
    };
    let facing = light.direction.z.max(0.05);
    WorkspaceLight {
        direction: light.direction.to_array(),
        angular_radius_rad: light.radius_rad,
        key: part.map(|part| part / facing),
        ambient: part.map(|part| 1.0 - part),
    }
}

/// Share of light on the table, by channel, and the key light it belongs to.
fn table_light(seen: &SeenScene, light: &WorkspaceLight) -> Result<Vec<Vec3A>, MatchError> {
    let direction = DVec3::from_array(light.direction).normalize();
    let shares = seen.shares(&KeyLight { direction, radius_rad: light.angular_radius_rad })?;
    let ambient = Vec3A::from_array(light.ambient.map(|value| value as f32));
    let mixed = |(key, around): (&f32, &f32)| (1.0 - ambient) * *key + ambient * *around;
    Ok(shares.key.iter().zip(&shares.ambient).map(mixed).collect())
}

/// Mean base colour of the table over all cameras; also corrects the gains of cameras that were set from the mean colour
/// of a shadowed table.
fn table_color(
    request: &MatchRequest,
    scene: &Scenes,
    light: &WorkspaceLight,
    views: &mut [View<'_>],
) -> Result<[f64; 3], MatchError> {
    let has_chart = views.iter().any(|view| view.has_chart);
    let (mut sum, mut count) = (Vec3A::ZERO, 0.0_f32);
    for view in views.iter_mut() {
        let seen = Scenes::seen(&scene.empty, view.camera)?;
        let lit = table_light(&seen, light)?;
        let (values, usable) = (radiance(view), usable(view.photo));
        let on: Vec<usize> = (0..values.len()).filter(|&at| seen.is_table[at] && usable[at]).collect();
        if on.is_empty() {
            continue;
        }
        let mean = on.iter().map(|&at| values[at] / lit[at].max(Vec3A::splat(0.05))).sum::<Vec3A>() / on.len() as f32;
        if let Some(known) = request.table_color.filter(|_| !has_chart) {
            let gains = view.found.response.gains();
            let gains = [0, 1, 2].map(|channel| gains[channel] * f64::from(mean[channel]) / known[channel].max(1e-3));
            view.found.response = with_gains(gains, view.found.response.clone());
        }
        (sum, count) = (sum + mean, count + 1.0);
    }
    if let Some(known) = request.table_color.filter(|_| !has_chart) {
        return Ok(known);
    }
    Ok((sum / count.max(1.0)).clamp(Vec3A::ZERO, Vec3A::ONE).to_array().map(f64::from))
}

/// The camera's background: its photograph without the arm.
fn background(
    request: &MatchRequest,
    scene: &Scenes,
    view: &View<'_>,
    light: &WorkspaceLight,
) -> Result<Photograph, MatchError> {
    let (width, height) = (view.photo.width, view.photo.height);
    let rgb = if request.arm.is_none() {
        view.photo.rgb.clone()
    } else {
        let (assets, frame) = &scene.empty;
        let mut renderer = Renderer::new(Arc::clone(assets), RenderVariation::default());
        let geometry = pictured(&mut renderer, frame, view.camera, Channels::GEOMETRY)?;
        let is_arm: Vec<bool> = geometry.instance.iter().map(|id| *id == ROBOT).collect();
        let open = Scenes::seen(&scene.open, view.camera)?;
        let lit = table_light(&Scenes::seen(&scene.empty, view.camera)?, light)?;
        let layers = Layers { width: width as usize, is_arm: &is_arm, is_table: &open.is_table, light: &lit };
        let empty = emptied(&radiance(view), &layers);
        let Some(response) = Response::new(&view.found.response) else {
            return Err(MatchError::NoTable { camera: view.camera.name.clone() });
        };
        empty.into_iter().flat_map(|radiance| srgb8_from_linear(response.display(radiance))).collect()
    };
    let encoded = |source| MatchError::NotEncoded { camera: view.camera.name.clone(), source };
    let mut jpeg = String::new();
    for quality in QUALITIES {
        let bytes = encode::jpeg_rgb(width, height, &rgb, quality).map_err(encoded)?;
        jpeg = base64::engine::general_purpose::STANDARD.encode(bytes);
        if jpeg.len() * request.empty.len() <= ALL_BYTES {
            break;
        }
    }
    Ok(Photograph { jpeg })
}
