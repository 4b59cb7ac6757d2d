//! Materials of objects from photographs: colour and roughness of their parts, in the light that was found.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{AssetUid, Camera, CameraResponse, MeasuredMaterial, World};
use genmanip_render::{Channels, FrameState, RenderAssets, RenderVariation, Renderer, Response};
use glam::Vec3A;
use serde::Serialize;

use crate::difference::delta_e;
use crate::error::MatchError;
use crate::material_fit::{Fit, Pixels, ROUGHNESSES, Rendered, Roughness, factor_at};
use crate::request::{MatchRequest, Photo};
use crate::scene::pictured;
use crate::unidentified::Unidentified;
use crate::views::{Scenes, linear, overexposed};

/// Fewest pixels of a part that tell its colour, and most of one photograph that are compared.
const FEWEST_PIXELS: usize = 30;
const MOST_PIXELS: usize = 4_000;
/// Passes of the fit: light between surfaces depends on the colours that the pass before found.
const PASSES: usize = 2;
/// Response with which candidates are rendered: highlights do not clip below twice a white surface.
const IDEAL: CameraResponse = CameraResponse {
    exposure: 0.5,
    white_balance: [1.0; 3],
    matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    contrast: 1.0,
    white: 1.0,
};

/// Material of a part of an object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundMaterial {
    /// Material as it stands in the world.
    #[serde(flatten)]
    pub material: MeasuredMaterial,
    /// Mean base colour of the part, linear RGB.
    pub base_color: [f64; 3],
    /// Roughness that fits best; `None` without a known direction of the light, or if none explains the photographs.
    pub roughness_fit: Option<f64>,
    /// Roughnesses that fit nearly as well; no confidence interval.
    pub roughness_range: Option<[f64; 2]>,
    /// True if the photographs tell the roughness.
    pub has_roughness: bool,
    /// Number of pixels compared.
    pub pixels: usize,
    /// Mean ΔE2000 of those pixels to the photographs with the object's own material, and with this one.
    pub delta_e: [f64; 2],
}

/// A part of an object: uid and name of the part.
type Key = (AssetUid, String);

/// A photograph of objects, and the pixels of it that are compared, by part.
struct Shot<'a> {
    camera: &'a Camera,
    photo: &'a Photo,
    posed: &'a (Arc<RenderAssets>, FrameState),
    pixels: BTreeMap<Key, Vec<usize>>,
}

/// Materials of all parts that the photographs of objects show, in the light of the matched world; what they do not tell
/// is named.
///
/// # Errors
/// When a view cannot be rendered.
pub fn materials(
    request: &MatchRequest,
    scene: &Scenes,
    world: &World,
    has_direction: bool,
    unidentified: &mut Vec<Unidentified>,
) -> Result<Vec<FoundMaterial>, MatchError> {
    let shots = shots(request, scene, world)?;
    let mut pixels: BTreeMap<Key, Pixels> = BTreeMap::new();
    for shot in &shots {
        let response = response_of(world, &shot.camera.name);
        let (seen, clipped) = (linear(&response, shot.photo), overexposed(shot.photo));
        for (key, own) in &shot.pixels {
            let all = pixels.entry(key.clone()).or_default();
            all.seen.extend(own.iter().map(|&at| seen[at]));
            all.is_overexposed.extend(own.iter().map(|&at| clipped[at]));
        }
    }
    pixels.retain(|_, pixels| pixels.len() >= FEWEST_PIXELS);
    name_unseen(scene, &pixels, unidentified);
    if pixels.is_empty() {
        return Ok(Vec::new());
    }
    let failed = |source| MatchError::NotDrawn { camera: shots[0].camera.name.clone(), source };
    let look = RenderVariation::of_world(world).map_err(failed)?;
    let ideal = ideal(&look);
    let bare = |key: &Key| MeasuredMaterial {
        object: key.0.clone(),
        part: key.1.clone(),
        color_factor: [1.0; 3],
        roughness: None,
    };
    let mut found: BTreeMap<Key, FoundMaterial> = BTreeMap::new();
    let mut present: Vec<MeasuredMaterial> = pixels.keys().map(bare).collect();
    for _ in 0..PASSES {
        let mut fits: BTreeMap<&Key, Vec<Fit>> = BTreeMap::new();
        // The first candidate is the roughness of the object's file.
        for roughness in std::iter::once(None).chain(ROUGHNESSES.map(Some)) {
            let rendered = rendered(&shots, &ideal, &present, roughness)?;
            for (key, pixels) in &pixels {
                fits.entry(key).or_default().extend(rendered.get(key).map(|rendered| pixels.fit(rendered)));
            }
        }
        for ((key, pixels), present) in pixels.iter().zip(&mut present) {
            let part = part_of(scene, key);
            let entry = estimated(pixels, &fits[key], present, part, has_direction);
            *present = entry.material.clone();
            found.insert(key.clone(), entry);
        }
    }
    let [before, after] = [&[][..], &present].map(|materials| differences(&shots, &look, materials));
    let (before, after) = (before?, after?);
    for (key, entry) in &mut found {
        entry.delta_e = [before[key], after[key]];
        if !entry.has_roughness {
            unidentified.push(no_roughness(entry, has_direction));
        }
    }
    Ok(found.into_values().collect())
}

/// Photographs of objects by cameras with a known response.
fn shots<'a>(request: &'a MatchRequest, scene: &'a Scenes, world: &World) -> Result<Vec<Shot<'a>>, MatchError> {
    let known = |photo: &&Photo| world.appearance.as_ref().is_some_and(|it| it.camera(&photo.camera).is_some());
    let mut shots = Vec::new();
    for (objects, posed) in request.objects.iter().zip(&scene.objects) {
        for photo in objects.photos.iter().filter(known) {
            let camera = request.camera(&photo.camera)?;
            let mut renderer = Renderer::new(Arc::clone(&posed.0), RenderVariation::default());
            let geometry = pictured(&mut renderer, &posed.1, camera, Channels { parts: true, ..Channels::GEOMETRY })?;
            let inner = inner_pixels(&geometry.parts, photo.width as usize);
            let mut pixels: BTreeMap<Key, Vec<usize>> = BTreeMap::new();
            for at in inner {
                let part = usize::from(geometry.parts[at]).checked_sub(1).and_then(|part| posed.0.parts().get(part));
                let Some(part) = part.filter(|part| !part.is_transparent()) else { continue };
                if let Some(object) = posed.0.object_of(part) {
                    pixels.entry((object.card.uid.clone(), part.name.clone())).or_default().push(at);
                }
            }
            for own in pixels.values_mut() {
                let step = own.len().div_ceil(MOST_PIXELS).max(1);
                *own = own.iter().copied().step_by(step).collect();
            }
            shots.push(Shot { camera, photo, posed, pixels });
        }
    }
    Ok(shots)
}

/// Pixels whose neighbours show the same part.
fn inner_pixels(parts: &[u16], width: usize) -> Vec<usize> {
    let height = parts.len() / width.max(1);
    let is_inner = |at: &usize| {
        let (column, row) = (at % width, at / width);
        let inside = column > 0 && row > 0 && column + 1 < width && row + 1 < height;
        inside
            && (row - 1..=row + 1).all(|row| (column - 1..=column + 1).all(|it| parts[row * width + it] == parts[*at]))
    };
    (0..parts.len()).filter(is_inner).collect()
}

fn response_of(world: &World, camera: &str) -> CameraResponse {
    let entry = world.appearance.as_ref().and_then(|appearance| appearance.camera(camera));
    entry.map_or_else(CameraResponse::default, |entry| entry.response.clone())
}

/// The look with ideal cameras in place of the measured ones.
fn ideal(look: &RenderVariation) -> RenderVariation {
    let response = Response::new(&IDEAL).map(Arc::new);
    let mut look = look.clone();
    for (look, response) in look.looks.iter_mut().zip(response.iter().cycle()) {
        look.response = Arc::clone(response);
    }
    look
}

/// Renderings of the compared pixels with one roughness of all parts, `None` for each part's own.
fn rendered(
    shots: &[Shot<'_>],
    ideal: &RenderVariation,
    present: &[MeasuredMaterial],
    roughness: Option<f64>,
) -> Result<BTreeMap<Key, Rendered>, MatchError> {
    let mut found: BTreeMap<Key, Rendered> = BTreeMap::new();
    for shot in shots {
        let [black, colored] = [0.0, 1.0].map(|share| {
            let candidate = |it: &MeasuredMaterial| MeasuredMaterial {
                color_factor: it.color_factor.map(|factor| share * factor),
                roughness,
                ..it.clone()
            };
            let rgb = drawn(shot, ideal, present.iter().map(candidate).collect())?;
            Ok::<_, MatchError>(linear(&IDEAL, &Photo { rgb, ..shot.photo.clone() }))
        });
        let (black, colored) = (black?, colored?);
        for (key, pixels) in &shot.pixels {
            let rendered = pixels.iter().map(|&at| [black[at], (colored[at] - black[at]).max(Vec3A::ZERO)]);
            found.entry(key.clone()).or_default().extend(rendered);
        }
    }
    Ok(found)
}

/// Image of a shot with these materials.
fn drawn(shot: &Shot<'_>, look: &RenderVariation, measured: Vec<MeasuredMaterial>) -> Result<Vec<u8>, MatchError> {
    let mut renderer = Renderer::new(Arc::clone(&shot.posed.0), RenderVariation { measured, ..look.clone() });
    Ok(pictured(&mut renderer, &shot.posed.1, shot.camera, Channels::RGB)?.rgb)
}

/// Material of a part from the fits at its own roughness and at the candidates, relative to the present one.
fn estimated(
    pixels: &Pixels,
    fits: &[Fit],
    present: &MeasuredMaterial,
    (mean, own_roughness): (Vec3A, f64),
    has_direction: bool,
) -> FoundMaterial {
    let (own, candidates) = (&fits[0], &fits[1..]);
    let told = has_direction.then(|| pixels.roughness(candidates)).filter(Roughness::is_explained);
    let has_roughness = told.is_some_and(|told| told.is_identified());
    // A wide range still excludes values: the roughness of the file moves into it, no further.
    let roughness = told.and_then(|told| match (has_roughness, told.range) {
        (true, _) => Some(told.value),
        (false, [low, high]) => (!(low..=high).contains(&own_roughness)).then(|| own_roughness.clamp(low, high)),
    });
    let factor = roughness.map_or(own.factor, |roughness| factor_at(candidates, roughness));
    let color_factor = [0, 1, 2].map(|channel| {
        let mean = f64::from(mean[channel]).max(1e-3);
        (present.color_factor[channel] * factor[channel]).clamp(1e-3, (1.0 / mean).min(100.0))
    });
    FoundMaterial {
        material: MeasuredMaterial { color_factor, roughness, ..present.clone() },
        base_color: [0, 1, 2].map(|channel| color_factor[channel] * f64::from(mean[channel])),
        roughness_fit: told.map(|told| told.value),
        roughness_range: told.map(|told| told.range),
        has_roughness,
        pixels: pixels.len(),
        delta_e: [0.0; 2],
    }
}

/// Mean colour (linear RGB) and roughness of a part in its object's file.
fn part_of(scene: &Scenes, key: &Key) -> (Vec3A, f64) {
    let is_of = |assets: &RenderAssets, part: &genmanip_render::internals::Part| {
        part.name == key.1 && assets.object_of(part).is_some_and(|object| object.card.uid == key.0)
    };
    let mut parts =
        scene.objects.iter().filter_map(|(assets, _)| assets.parts().iter().find(|part| is_of(assets, part)));
    parts.next().map_or((Vec3A::ONE, 0.5), |part| (part.material.mean_color(), f64::from(part.material.roughness)))
}

/// Mean ΔE2000 of the compared pixels of each part, rendered with these materials.
fn differences(
    shots: &[Shot<'_>],
    look: &RenderVariation,
    materials: &[MeasuredMaterial],
) -> Result<BTreeMap<Key, f64>, MatchError> {
    let mut sums: BTreeMap<Key, (f64, f64)> = BTreeMap::new();
    for shot in shots {
        let image = drawn(shot, look, materials.to_vec())?;
        let off = delta_e(&shot.photo.rgb, &image);
        for (key, pixels) in &shot.pixels {
            let sum = sums.entry(key.clone()).or_default();
            *sum = (sum.0 + pixels.iter().map(|&at| off[at]).sum::<f64>(), sum.1 + pixels.len() as f64);
        }
    }
    Ok(sums.into_iter().map(|(key, (sum, count))| (key, sum / f64::max(count, 1.0))).collect())
}

fn no_roughness(found: &FoundMaterial, has_direction: bool) -> Unidentified {
    let MeasuredMaterial { object, part, .. } = &found.material;
    let why = match found.roughness_range {
        None if has_direction => "no roughness explains the photographs well".to_owned(),
        None => "the direction of the light is not known".to_owned(),
        Some([low, high]) => format!("no clear highlight is seen: anything from {low:.2} to {high:.2} fits"),
    };
    let remedy = "photograph the object at further places, so that the light is mirrored towards a camera (--scenario, \
                  --objects once more)";
    Unidentified { what: format!("roughness of {object}, part {part}"), why, remedy: remedy.into() }
}

/// Names parts of objects that are transparent, or that too few pixels show.
fn name_unseen(scene: &Scenes, seen: &BTreeMap<Key, Pixels>, unidentified: &mut Vec<Unidentified>) {
    let mut unseen: BTreeMap<Key, bool> = BTreeMap::new();
    for (assets, _) in &scene.objects {
        for part in assets.parts() {
            if let Some(object) = assets.object_of(part) {
                unseen.insert((object.card.uid.clone(), part.name.clone()), part.is_transparent());
            }
        }
    }
    unseen.retain(|key, _| !seen.contains_key(key));
    for ((object, part), is_transparent) in unseen {
        let (why, remedy) = match is_transparent {
            true => ("it is transparent", "set its material in the object's file"),
            false => (
                "too few of its pixels are seen",
                "photograph the object from other sides (--scenario, --objects once more)",
            ),
        };
        let what = format!("material of {object}, part {part}");
        unidentified.push(Unidentified { what, why: why.into(), remedy: remedy.into() });
    }
}
