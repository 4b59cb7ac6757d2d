//! From photographs to the appearance of a world.

use std::sync::Arc;

use base64::Engine;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{
    Camera, CameraAppearance, CameraResponse, Photograph, Pose, Projection, World, WorkspaceAppearance, WorkspaceLight,
};
use genmanip_render::{
    Channels, FrameState, LinearPhotograph, ROBOT, RenderAssets, RenderError, RenderVariation, Renderer, Response,
    color::srgb8_from_linear, encode,
};
use glam::Vec3A;
use serde::Serialize;

use crate::empty::{Layers, emptied};
use crate::light::{LightEstimate, Observation, estimate};
use crate::request::{MatchRequest, Photo};
use crate::response::{from_chart, from_color, with_gains};
use crate::scene::{KeyLight, SeenScene, block_means, pictured, reduced};
use crate::{MatchError, chart};

/// Width of the images in which shadows are compared, px: full width divided by a whole number, at least this.
const FIT_WIDTH_PX: u32 = 180;
/// Largest width of the images of the first search, which are rendered with coarser shadows.
const COARSE_WIDTH_PX: u32 = 128;
/// Codes of 8-bit sRGB outside of which a channel counts as clipped.
const USABLE: [u8; 2] = [4, 251];
/// Fewest table pixels for a mean colour.
const FEWEST_PIXELS: usize = 30;
/// JPEG qualities of backgrounds: the first with which all fit into a world file, and their bytes in base64 together.
const QUALITIES: [u8; 4] = [95, 90, 80, 65];
const ALL_BYTES: usize = 1_700_000;
/// Base colour assumed for a table of unknown colour, linear RGB: light wood.
const TABLE_COLOR: [f64; 3] = [0.45, 0.40, 0.33];

/// Result of a match.
#[derive(Clone, Debug)]
pub struct Matched {
    /// The world with its measured appearance.
    pub world: World,
    /// Estimate of the light; `None` if no photograph shows a shadow of something known.
    pub light: Option<LightEstimate>,
    /// Cameras with photographs.
    pub cameras: Vec<MatchedCamera>,
    /// What the photographs do not tell.
    pub unidentified: Vec<Unidentified>,
}

/// Response of a camera, and how it was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatchedCamera {
    /// Name of the camera.
    pub camera: String,
    /// Response.
    pub response: CameraResponse,
    /// Source of the response.
    pub source: &'static str,
    /// Root mean square of the chart's residuals, in steps of 8-bit sRGB; `None` without a chart.
    pub chart_rms: Option<f64>,
}

/// A property that the photographs do not tell.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unidentified {
    /// Name of the property, as `light direction`; cameras are named where it is one camera's.
    pub what: String,
    /// Reason.
    pub why: String,
    /// Photograph that would tell it.
    pub remedy: String,
}

/// Names of properties in [`Unidentified::what`].
pub mod names {
    /// Direction of the key light.
    pub const DIRECTION: &str = "light direction";
    /// Width of the key light.
    pub const SOFTNESS: &str = "softness of the light";
    /// Exposure and white balance apart from the table's colour.
    pub const EXPOSURE: &str = "exposure and white balance";
}

/// A camera's photographs while it is matched.
struct View<'a> {
    camera: &'a Camera,
    photo: &'a Photo,
    found: MatchedCamera,
    has_chart: bool,
}

/// Finds responses, light, table colour and backgrounds of a workspace.
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
    let appearance = WorkspaceAppearance { light: Some(light), table_color: Some(table), cameras };
    let world = World { appearance: Some(appearance), ..request.world.clone() };
    let cameras = views.into_iter().map(|view| view.found).collect();
    Ok(Matched { world, light: estimate, cameras, unidentified })
}

/// Posed assets of the photographs.
struct Scenes {
    empty: (Arc<RenderAssets>, FrameState),
    /// Table alone.
    open: (Arc<RenderAssets>, FrameState),
    objects: Option<(Arc<RenderAssets>, FrameState)>,
    has_arm: bool,
}

impl Scenes {
    fn new(request: &MatchRequest) -> Result<Self, MatchError> {
        let world = Some(&request.world);
        let drawn = |source: RenderError| MatchError::NotDrawn { camera: request.empty[0].camera.clone(), source };
        let posed = |models: &[_], poses: &[(Pose, Vec<f64>)]| {
            let poses = poses.iter().map(|(pose, joints)| (*pose, joints.as_slice()));
            let (arm, gripper) = request.arm.as_ref().map_or((&[][..], 0.0), |(arm, gripper)| (&arm[..], *gripper));
            let assets = match request.arm {
                Some(_) => RenderAssets::new(Arc::clone(&request.robot), models, world),
                None => RenderAssets::without_robot(models, world),
            };
            let assets = assets.map_err(drawn)?;
            let state = assets.frame_state(arm, gripper, poses).map_err(drawn)?;
            Ok::<_, MatchError>((assets, state))
        };
        let open = RenderAssets::without_robot(&[], world).map_err(drawn)?;
        let state = open.frame_state(&[], 0.0, []).map_err(drawn)?;
        Ok(Self {
            empty: posed(&[], &[])?,
            open: (open, state),
            objects: request.objects.as_ref().map(|it| posed(&it.models, &it.poses)).transpose()?,
            has_arm: request.arm.is_some(),
        })
    }

    fn seen((assets, frame): &(Arc<RenderAssets>, FrameState), camera: &Camera) -> Result<SeenScene, MatchError> {
        SeenScene::new(assets, frame.clone(), camera)
    }
}

/// Responses of all cameras: from their chart, else from a camera with a chart that sees the same table, else from the
/// table's colour.
fn responses<'a>(
    request: &'a MatchRequest,
    scene: &Scenes,
    unidentified: &mut Vec<Unidentified>,
) -> Result<Vec<View<'a>>, MatchError> {
    let mut views = Vec::new();
    for photo in &request.empty {
        let camera = request.camera(&photo.camera)?;
        let own = request.charts.iter().find(|chart| chart.photo.camera == photo.camera);
        let bad = |problem: &str| MatchError::BadChart { camera: camera.name.clone(), problem: problem.into() };
        let found = match own {
            Some(own) => {
                let seen = chart::read(&own.photo.rgb, own.photo.width as usize, own.corners_px)
                    .ok_or_else(|| bad("its four corners do not span a quadrilateral"))?;
                let (response, rms) = from_chart(&seen)
                    .ok_or_else(|| bad("fewer than 12 patches lie inside the image and are not overexposed"))?;
                MatchedCamera {
                    camera: camera.name.clone(),
                    response,
                    source: "its photograph of the colour chart",
                    chart_rms: Some(255.0 * rms),
                }
            }
            None => MatchedCamera {
                camera: camera.name.clone(),
                response: CameraResponse::default(),
                source: "the table",
                chart_rms: None,
            },
        };
        views.push(View { camera, photo, found, has_chart: own.is_some() });
    }
    let reference = views.iter().position(|view| view.has_chart);
    if reference.is_none() && request.table_color.is_none() {
        unidentified.push(Unidentified {
            what: names::EXPOSURE.into(),
            why: "only their product with the colour of the table is seen, which is taken as light wood".into(),
            remedy: "photograph a colour chart on the table (--chart), or state the table's colour (--table-color)".into(),
        });
    }
    for index in (0..views.len()).filter(|&index| !views[index].has_chart).collect::<Vec<_>>() {
        let view = &views[index];
        let camera = &view.camera.name;
        unidentified.push(Unidentified {
            what: format!("colour matrix and tone curve of camera {camera}"),
            why: "one colour tells neither; they are taken as ideal".into(),
            remedy: format!("photograph a colour chart with camera {camera} (--chart)"),
        });
        let gains = match reference.map(|reference| &views[reference]).filter(|_| index != reference.unwrap_or(index)) {
            Some(reference) => relative_gains(scene, view, reference)?,
            None => None,
        };
        let response = match gains {
            Some(gains) => with_gains(gains, CameraResponse::default()),
            None => {
                let seen = mean_table(scene, view)?;
                from_color(request.table_color.unwrap_or(TABLE_COLOR), seen)
            }
        };
        views[index].found.response = response;
        if gains.is_some() {
            views[index].found.source = "the table, as seen by a camera with a colour chart";
        }
    }
    Ok(views)
}

/// Gains of a camera from table points that another camera, whose response is known, sees too; `None` without any.
fn relative_gains(scene: &Scenes, view: &View<'_>, reference: &View<'_>) -> Result<Option<[f64; 3]>, MatchError> {
    let Some(other) = LinearPhotograph::new(reference.camera, radiance(reference)) else { return Ok(None) };
    let seen = Scenes::seen(&scene.empty, view.camera)?;
    let hidden = Scenes::seen(&scene.empty, reference.camera)?;
    let own = display(view);
    let projections = [view.camera, reference.camera].map(|camera| Projection::of(camera, &Pose::IDENTITY));
    let usable = usable(view.photo);
    let (mut shown, mut light, mut count) = (Vec3A::ZERO, Vec3A::ZERO, 0);
    let width = view.photo.width as usize;
    for at in (0..own.len()).filter(|&at| seen.is_table[at] && usable[at]) {
        let pixel = DVec2::new((at % width) as f64, (at / width) as f64);
        let Some(point) = projections[0].view_ray(pixel).and_then(|(eye, ray)| on_table(eye, ray)) else { continue };
        let Some((there, _)) = projections[1].pixel(point) else { continue };
        let (column, row) = (there.x.round(), there.y.round());
        let inside = column >= 0.0 && row >= 0.0 && column < f64::from(reference.photo.width);
        let place = row as usize * reference.photo.width as usize + column as usize;
        if !inside || !hidden.is_table.get(place).copied().unwrap_or(false) {
            continue;
        }
        if let Some(radiance) = other.at(point.as_vec3a()) {
            (shown, light, count) = (shown + own[at], light + radiance, count + 1);
        }
    }
    let gains = (shown / light.max(Vec3A::splat(1e-6))).max(Vec3A::splat(1e-3));
    Ok((count >= FEWEST_PIXELS).then(|| gains.to_array().map(f64::from)))
}

/// Point of the table's plane on a ray.
fn on_table(eye: DVec3, ray: DVec3) -> Option<DVec3> {
    (ray.z < -1e-6).then(|| eye - ray * (eye.z / ray.z))
}

/// Mean linear display colour of the table.
fn mean_table(scene: &Scenes, view: &View<'_>) -> Result<[f64; 3], MatchError> {
    let seen = Scenes::seen(&scene.empty, view.camera)?;
    let (own, usable) = (display(view), usable(view.photo));
    let on: Vec<Vec3A> = (0..own.len()).filter(|&at| seen.is_table[at] && usable[at]).map(|at| own[at]).collect();
    if on.len() < FEWEST_PIXELS {
        return Err(MatchError::NoTable { camera: view.camera.name.clone() });
    }
    Ok((on.iter().sum::<Vec3A>() / on.len() as f32).to_array().map(f64::from))
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

/// What a camera shows of shadows, in images reduced by a whole factor: those of objects, in which the texture of the
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
    let with_objects = request.objects.iter().flat_map(|it| &it.photos).find(|it| it.camera == view.camera.name);
    let mut found = Vec::new();
    if let (Some(photo), Some(posed)) = (with_objects, &scene.objects) {
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
            let why = match (estimate, request.arm.is_some() || request.objects.is_some()) {
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
        if !has_chart {
            let known = request.table_color.unwrap_or(TABLE_COLOR);
            let gains = view.found.response.gains();
            let gains = [0, 1, 2].map(|channel| gains[channel] * f64::from(mean[channel]) / known[channel].max(1e-3));
            view.found.response = with_gains(gains, view.found.response.clone());
        }
        (sum, count) = (sum + mean, count + 1.0);
    }
    if !has_chart {
        return Ok(request.table_color.unwrap_or(TABLE_COLOR));
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

/// Radiance of the pixels of a camera's photograph of the empty workspace.
fn radiance(view: &View<'_>) -> Vec<Vec3A> {
    linear(&view.found.response, view.photo)
}

fn linear(response: &CameraResponse, photo: &Photo) -> Vec<Vec3A> {
    Response::new(response).map_or_else(Vec::new, |response| response.radiance(&photo.rgb))
}

/// Linear display colours of a camera's photograph.
fn display(view: &View<'_>) -> Vec<Vec3A> {
    linear(&CameraResponse::default(), view.photo)
}

/// Pixels without a clipped channel.
fn usable(photo: &Photo) -> Vec<bool> {
    let fits = |rgb: &[u8]| rgb.iter().all(|value| (USABLE[0]..=USABLE[1]).contains(value));
    photo.rgb.chunks_exact(3).map(fits).collect()
}
