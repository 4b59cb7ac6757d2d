//! Responses of the cameras: from a colour chart, or from the table.

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{CameraResponse, Pose, Projection};
use genmanip_render::LinearPhotograph;
use glam::Vec3A;

use crate::chart;
use crate::error::MatchError;
use crate::request::MatchRequest;
use crate::response::{from_chart, from_color, with_gains};
use crate::unidentified::{Unidentified, names};
use crate::views::{MatchedCamera, Scenes, View, display, radiance, usable};

/// Fewest table pixels for a mean colour.
const FEWEST_PIXELS: usize = 30;
/// Responses of all cameras: from their chart, else from a camera with a chart that sees the same table, else from the
/// table's colour.
///
/// # Errors
/// An unreadable chart, and a view without usable table.
pub fn responses<'a>(
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
            why: "only their product with the colour of the table is seen; the camera is taken as exposed and balanced for this light".into(),
            remedy: "photograph a colour chart on the table (--chart), or state the table's colour (--table-color)"
                .into(),
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
        let gains = match reference.map(|reference| &views[reference]) {
            Some(reference) => relative_gains(scene, view, reference)?,
            None => None,
        };
        let response = match gains {
            Some(gains) => with_gains(gains, CameraResponse::default()),
            None => {
                let seen = mean_table(scene, view)?;
                request.table_color.map_or_else(CameraResponse::default, |color| from_color(color, seen))
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
