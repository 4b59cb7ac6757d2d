//! Near-field light: bounce from the support surface, and interreflection in cavities.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use super::part::PartLight;
use super::points::ShadingPoints;
use super::terms::ShadingTerms;
use crate::ambient::cavity::facing_middle;
use crate::ambient::proxies::Proxy;
use crate::gbuffer::view::PartView;
use crate::lights::lighting::Lighting;
use crate::scene::material::Material;
use crate::shading::reflectance::cavity_interreflection;
use crate::simd::dot;

/// Adds the bounce light of the support surface to objects close above it; `eye_height` is the camera's height above
/// the surface (m).
#[inline(always)]
pub(super) fn ground_bounce<const LANES: usize>(
    light: &PartLight<'_>,
    eye_height: f32,
    points: &ShadingPoints,
    placed: &PartView,
    out: &mut ShadingTerms,
) {
    let (sky, lit) = (&light.lighting.sky, light.ground_lit);
    let up = placed.world_from_body.row(2);
    let at_zero = eye_height - up.dot(placed.viewpoint_in_body);
    let up = up.to_array();
    for i in 0..LANES {
        let place = [points.place[0][i], points.place[1][i], points.place[2][i]];
        let height = dot(up, place) + at_zero;
        let seen = sky.near_ground([out.normal[0][i], out.normal[1][i], out.normal[2][i]], height);
        for channel in 0..3 {
            out.around[channel][i] = seen[channel].mul_add(lit, out.around[channel][i]);
        }
    }
}

/// Adds the key light interreflected by the walls of a lit cavity.
#[inline(always)]
pub(super) fn cavity_term<const LANES: usize>(
    cavity: &Proxy,
    points: &ShadingPoints,
    material: &Material,
    lighting: &Lighting,
    out: &mut ShadingTerms,
) {
    let middle = cavity.middle().to_array();
    let opening = cavity.cavity_opening();
    let key = (lighting.key * (cavity.cavity_light() * material.scatters() * lighting.exposure)).to_array();
    for i in 0..LANES {
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let toward = [middle[0] - points.place[0][i], middle[1] - points.place[1][i], middle[2] - points.place[2][i]];
        let lengths = dot(normal, normal) * dot(toward, toward) + 1e-20;
        let facing = facing_middle(dot(normal, toward) / lengths.sqrt());
        for channel in 0..3 {
            let albedo = points.base[channel][i] * (1.0 - material.metallic);
            out.color[channel][i] += cavity_interreflection(albedo, opening) * facing * key[channel];
        }
    }
}
