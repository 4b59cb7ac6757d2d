//! Reflected radiance of shading points.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::near_field::{cavity_term, ground_bounce};
use super::part::{PartLight, ShadedPart};
use super::points::ShadingPoints;
use super::terms::{ShadingTerms, mirrored};
use crate::gbuffer::view::{CameraView, PartView};
use crate::lights::lighting::Lighting;
use crate::lights::sky::{Glossy, Sky};
use crate::scene::material::Material;
use crate::shading::reflectance::{ambient_fresnel, multibounce_ao, schlick_weight};
use crate::shading::tone_map::tone_map;
use crate::simd::{BatchColumn, CHUNK, REGISTER, dot, lerp, turned, within};

/// Strength of key light reflected twice in concave corners. Fitted to path-traced images.
const CORNER_KEY: f32 = 0.845;
/// Loss of that light where a surface that faces the light is in shadow. Then its limit as a multiple of the unoccluded
/// share of the sky, since little light enters deep corners. Fitted likewise.
const CORNER_SHADE: f32 = 1.0;
const CORNER_OPEN: f32 = 2.0;

/// Computes the reflected radiance of a batch of points, tone-mapped unless the part has a look of its own.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn reflect(points: &ShadingPoints, part: &ShadedPart<'_>, out: &mut ShadingTerms) {
    if points.pixels.count <= REGISTER {
        reflect_chunk::<REGISTER>(points, part, out);
    } else {
        reflect_chunk::<CHUNK>(points, part, out);
    }
}

/// Implementation of [`reflect`], inlined so that it is compiled for several instruction sets.
#[inline(always)]
fn reflect_chunk<const LANES: usize>(points: &ShadingPoints, part: &ShadedPart<'_>, out: &mut ShadingTerms) {
    let &ShadedPart { material, placed, camera, ref light, .. } = part;
    face_viewer::<LANES>(points, placed, camera, out);
    environment_term::<LANES>(&light.lighting.sky, &light.glossy, out);
    if let Some(top) = light.ground {
        ground_bounce::<LANES>(light, camera.viewpoint.z - top, points, placed, out);
    }
    if let Some(irradiance_grid) = light.irradiance_grid {
        irradiance_grid.apply(points.pixels.count, &points.place, &mut out.around);
    }
    find_highlights::<LANES>(material.roughness, light.lighting, out);
    if part.look.is_some() {
        remove_gloss::<LANES>(&points.photographed, out);
    }
    apply_shadow::<LANES>(&points.shadow, light.with_key(), out);
    sum_terms::<LANES>(points, material, light, out);
    if let Some(cavity) = light.cavity {
        cavity_term::<LANES>(cavity, points, material, light.lighting, out);
    }
    if part.look.is_none() {
        tone_map_all::<LANES>(material.opacity < 1.0, out);
    }
}

/// Removes specular reflection where a surface has a photographed colour, which contains it.
#[inline(always)]
fn remove_gloss<const LANES: usize>(photographed: &BatchColumn, out: &mut ShadingTerms) {
    for i in 0..LANES {
        let kept = 1.0 - photographed[i];
        out.lobe[i] *= kept;
        for axis in 0..3 {
            out.mirrored[axis][i] *= kept;
        }
    }
}

/// Computes unit normals, unit directions to the viewer, and the cosines between them.
#[inline(always)]
fn face_viewer<const LANES: usize>(
    points: &ShadingPoints,
    placed: &PartView,
    camera: &CameraView,
    out: &mut ShadingTerms,
) {
    let turn = [placed.world_from_body.x_axis, placed.world_from_body.y_axis, placed.world_from_body.z_axis]
        .map(|column| column.to_array());
    let camera_axes = [camera.turn.x_axis, camera.turn.y_axis, camera.turn.z_axis].map(|column| column.to_array());
    let (inverse_x, inverse_y) = (1.0 / camera.focal.x, 1.0 / camera.focal.y);
    let (center_x, center_y) = (camera.center.x, camera.center.y);
    for i in 0..LANES {
        let (ray_x, ray_y) =
            ((points.pixels.column[i] - center_x) * inverse_x, (points.pixels.row[i] - center_y) * inverse_y);
        let inverse = -1.0 / ray_x.mul_add(ray_x, ray_y.mul_add(ray_y, 1.0)).sqrt();
        for axis in 0..3 {
            out.viewer[axis][i] = turned(&camera_axes, axis, [ray_x, ray_y, 1.0]) * inverse;
        }
    }
    for i in 0..LANES {
        let mixed = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let normal = [turned(&turn, 0, mixed), turned(&turn, 1, mixed), turned(&turn, 2, mixed)];
        let inverse = 1.0 / (dot(normal, normal) + 1e-20).sqrt();
        for axis in 0..3 {
            out.normal[axis][i] = normal[axis] * inverse;
        }
    }
}

/// Computes the diffuse and specular environment light.
#[inline(always)]
fn environment_term<const LANES: usize>(sky: &Sky, glossy: &Glossy, out: &mut ShadingTerms) {
    for i in 0..LANES {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let around = sky.diffuse(normal);
        out.around[0][i] = around[0];
        out.around[1][i] = around[1];
        out.around[2][i] = around[2];
    }
    for i in 0..LANES {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let viewer = [out.viewer[0][i], out.viewer[1][i], out.viewer[2][i]];
        let cosine = dot(normal, viewer);
        out.facing[i] = within(cosine, 1e-3, 1.0);
        let twice = cosine + cosine;
        let mirrored = mirrored(normal, viewer, twice);
        let light = glossy.at(mirrored);
        out.mirrored[0][i] = light[0];
        out.mirrored[1][i] = light[1];
        out.mirrored[2][i] = light[2];
    }
}

/// Computes the specular highlight of the key light. The squared angular radius of the light is added to the squared
/// width of the lobe, as variances add up, so that polished surfaces show the light's size.
#[inline(always)]
fn find_highlights<const LANES: usize>(roughness: f32, lighting: &Lighting, out: &mut ShadingTerms) {
    let to_light = lighting.to_light.to_array();
    let square = roughness * roughness;
    let square_alpha = square.mul_add(square, lighting.key_turn_squared);
    let alpha = square_alpha.sqrt();
    for i in 0..LANES {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let viewer = [out.viewer[0][i], out.viewer[1][i], out.viewer[2][i]];
        let facing = out.facing[i];
        let lit = dot(normal, to_light);
        let lit = if lit > 0.0 { lit } else { 0.0 };
        out.lit[i] = lit;
        let half = [viewer[0] + to_light[0], viewer[1] + to_light[1], viewer[2] + to_light[2]];
        let inverse = 1.0 / (dot(half, half) + 1e-12).sqrt();
        let half = [half[0] * inverse, half[1] * inverse, half[2] * inverse];
        let n_h = within(dot(normal, half), 0.0, 1.0);
        let denominator = (n_h * n_h).mul_add(square_alpha - 1.0, 1.0);
        let smith = (lit * facing).mul_add(2.0 * (1.0 - alpha), (lit + facing) * alpha);
        let smith = if smith > 1e-4 { smith } else { 1e-4 };
        // The key light is given as irradiance over π, which cancels the π of the distribution.
        out.lobe[i] = square_alpha * 0.5 / (denominator * denominator * smith);
        out.weight[i] = schlick_weight(dot(viewer, half));
    }
    for i in 0..LANES {
        (out.scale[i], out.bias[i]) = ambient_fresnel(roughness, out.facing[i]);
    }
}

/// Applies the shadow mask to the key light, and to the ambient light that comes from around the key light.
#[inline(always)]
fn apply_shadow<const LANES: usize>(key: &BatchColumn, with_key: f32, out: &mut ShadingTerms) {
    for i in 0..LANES {
        let lit = out.lit[i];
        out.strength[i] = lit * key[i];
        out.occluded_ambient[i] = (lit - out.strength[i]) * with_key;
        out.corner[i] = within((lit - out.strength[i]) * 4.0, 0.0, 1.0).mul_add(-CORNER_SHADE, 1.0);
    }
}

/// Sums up all terms except the interreflection in a cavity.
#[inline(always)]
fn sum_terms<const LANES: usize>(
    points: &ShadingPoints,
    material: &Material,
    light: &PartLight<'_>,
    out: &mut ShadingTerms,
) {
    let (lighting, bounce) = (light.lighting, light.bounce);
    let (metallic, reflectance, exposure) = (material.metallic, material.reflectance, lighting.exposure);
    let key = lighting.key.to_array();
    // Diffuse share of one interface.
    let side = material.scatters();
    for channel in 0..3 {
        let lamp = key[channel];
        for i in 0..LANES {
            let (base, ambient_share) = (points.base[channel][i], points.ambient[i]);
            let around = out.around[channel][i] * (1.0 - out.occluded_ambient[i]);
            let f0 = lerp(reflectance, base, metallic);
            let albedo = base * (1.0 - metallic);
            let arriving = lamp * out.strength[i];
            let [ambient, direct] = mirrored_shares(f0, out, i);
            let diffuse = scattered([albedo, bounce], ambient_share, around, arriving, [out.corner[i], lamp]);
            let specular = arriving.mul_add(direct, out.mirrored[channel][i] * ambient * ambient_share);
            out.color[channel][i] = diffuse.mul_add(side, specular) * exposure;
        }
    }
}

/// Specular reflectances for ambient light and for the key light; `f0` is the reflectance at normal incidence.
#[inline(always)]
fn mirrored_shares(f0: f32, out: &ShadingTerms, i: usize) -> [f32; 2] {
    let ambient = f0.mul_add(out.scale[i], out.bias[i]);
    let direct = lerp(f0, 1.0, out.weight[i]) * out.lobe[i];
    [if ambient > 0.0 { ambient } else { 0.0 }, if direct < 12.0 { direct } else { 12.0 }]
}

/// Diffusely reflected light: ambient light, key light, and key light interreflected in a concave corner.
#[inline(always)]
fn scattered([albedo, bounce]: [f32; 2], open: f32, around: f32, arriving: f32, [corner, lamp]: [f32; 2]) -> f32 {
    let enclosed = (1.0 - open) * within(open * CORNER_OPEN, 0.0, 1.0);
    let corner = enclosed * corner * albedo * albedo * albedo * lamp * CORNER_KEY;
    albedo * around.mul_add(multibounce_ao(open, albedo * bounce), corner + arriving)
}

/// Tone-maps all colours, except those of transparent interfaces, which are only clamped to 1: they are added to a
/// background that is already tone-mapped.
#[inline(always)]
fn tone_map_all<const LANES: usize>(is_transparent: bool, out: &mut ShadingTerms) {
    for i in 0..LANES {
        let color = [out.color[0][i], out.color[1][i], out.color[2][i]];
        let mapped = tone_map(color);
        for channel in 0..3 {
            let bounded = if color[channel] < 1.0 { color[channel] } else { 1.0 };
            out.color[channel][i] = if is_transparent { bounded } else { mapped[channel] };
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3A};

    use super::*;
    use crate::scene::variation::RenderVariation;

    /// All instruction sets give the same bits as a scalar loop.
    #[test]
    fn wide_registers_give_the_same_bits() {
        let variation = RenderVariation::default();
        let lighting = Lighting::new(&variation, None);
        let camera =
            CameraView { focal: Vec2::new(400.0, 410.0), center: Vec2::new(250.0, 140.0), ..CameraView::default() };
        let mut state = 1_u32;
        let mut draw = |low: f32, high: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / 16_777_216.0
        };
        for _ in 0..50 {
            let mut shading = ShadingPoints::default();
            for i in 0..CHUNK {
                let pixels = &mut shading.pixels;
                (pixels.column[i], pixels.row[i], pixels.depth[i]) =
                    (draw(0.0, 512.0), draw(0.0, 288.0), draw(0.1, 2.0));
                (shading.shadow[i], shading.ambient[i]) = (draw(0.0, 1.0), draw(0.0, 1.0));
                shading.normal.iter_mut().for_each(|axis| axis[i] = draw(-1.0, 1.0));
                shading.base.iter_mut().for_each(|channel| channel[i] = draw(0.0, 1.0));
            }
            let material = Material {
                base: Vec3A::ONE,
                roughness: draw(0.05, 1.0),
                metallic: draw(0.0, 1.0),
                opacity: draw(0.2, 1.2).min(1.0),
                reflectance: 0.04,
                texture: None,
            };
            let glossy = lighting.sky.glossy(material.roughness);
            let (bounce, ground) = (draw(0.0, 1.0), [None, Some(0.0)][usize::from(draw(0.0, 1.0) < 0.5)]);
            let light = PartLight {
                lighting: &lighting,
                glossy,
                irradiance_grid: None,
                ground,
                ground_lit: 1.0,
                cavity: None,
                bounce,
            };
            let (material, placed, camera) = (&material, &PartView::default(), &camera);
            let (look, is_fixture) = (None, false);
            let part = ShadedPart { faces: &[], viewpoint: None, material, placed, camera, light, look, is_fixture };
            let [mut wide, mut plain] = [ShadingTerms::default(), ShadingTerms::default()];
            let bits = |lanes: &[BatchColumn; 3]| lanes.map(|channel| channel.map(f32::to_bits));
            shading.pixels.count = CHUNK;
            reflect_chunk::<CHUNK>(&shading, &part, &mut plain);
            reflect(&shading, &part, &mut wide);
            assert_eq!(bits(&wide.color), bits(&plain.color));
            shading.pixels.count = REGISTER;
            let mut few = ShadingTerms::default();
            reflect(&shading, &part, &mut few);
            let first = |lanes: &[BatchColumn; 3]| bits(lanes).map(|channel| channel[..REGISTER].to_vec());
            assert_eq!(first(&few.color), first(&plain.color));
        }
    }
}
