//! Light that spots throw towards the viewer.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::Appearance;
use super::spots::Spots;
use super::tile_nodes::TileNodes;
use crate::assets::Surface;
use crate::develop::{is_compressed, tone_map, tone_map_dark};
use crate::lanes::{CHUNK, Lane, REGISTER, ZERO, dot, lerp, turned, within};
use crate::lighting::Lighting;
use crate::occluders::{Hollow, Mirrored};
use crate::reflectance::{ambient_fresnel, between, schlick_weight, thrown_back};
use crate::sky::{Glossy, Sky};
use crate::table_light::TableLight;
use crate::view::{Lens, PartView};

mod near;

use near::{dim_table, find_hollow, look_down, mirror_near};

/// What is computed between the loops of [`reflect`], and its result.
#[derive(Clone, Debug)]
pub(super) struct Reflected {
    pub normal: [Lane; 3],
    viewer: [Lane; 3],
    /// Cosine between them.
    pub facing: Lane,
    /// From the surroundings: diffuse, and mirrored.
    around: [Lane; 3],
    mirrored: [Lane; 3],
    /// Scale and bias of the reflectance head-on, for light from everywhere.
    scale: Lane,
    bias: Lane,
    /// Cosine between normal and lamp, 0 where it faces away; its light that arrives; and the size and Fresnel weight of its highlight.
    lit: Lane,
    strength: Lane,
    /// How much of the ambient light is held back by what holds back the lamp's.
    veiled: Lane,
    /// How much of the key light the sides of a corner throw on each other is there.
    corner: Lane,
    /// Key light that enters the hollow that is seen, over that which arrives on a surface that faces it.
    hollow: Lane,
    lobe: Lane,
    weight: Lane,
    pub color: [Lane; 3],
}

impl Default for Reflected {
    fn default() -> Self {
        let lanes = [ZERO; 3];
        Self {
            normal: lanes,
            viewer: lanes,
            facing: ZERO,
            around: lanes,
            mirrored: lanes,
            scale: ZERO,
            bias: ZERO,
            lit: ZERO,
            strength: ZERO,
            veiled: ZERO,
            corner: ZERO,
            hollow: ZERO,
            lobe: ZERO,
            weight: ZERO,
            color: lanes,
        }
    }
}

/// Share of the key light that the sides of a corner throw on each other twice, of what they would if all faced it. Fitted
/// to traced pictures.
const CORNER_KEY: f32 = 0.845;
/// How much less of it there is where a surface that faces the key light lies in shadow, and how many times the share of
/// the sky that is seen it is at most: what enters a deep hollow is little. Fitted likewise.
const CORNER_SHADE: f32 = 1.0;
const CORNER_OPEN: f32 = 2.0;

/// Share of the ambient light, for a surface that faces the key light, that comes from around it and is held back with
/// it: on things, and on the table, whose own light knows of most of it. Fitted to traced pictures.
const WITH_KEY: f32 = 0.1725;
const WITH_KEY_ON_TABLE: f32 = 0.091;

/// The light on a part.
#[derive(Debug)]
pub(super) struct Light<'a> {
    pub lighting: &'a Lighting,
    /// The surroundings for surfaces of its roughness.
    pub glossy: Glossy,
    /// Of the table among bodies, and within walls.
    pub table_light: Option<&'a TableLight>,
    /// Height of the table that throws light on it, metres, and how much of it is lit, 0-1.
    pub table_top: Option<f32>,
    pub table_lit: f32,
    pub hollow: Option<Hollow>,
    /// What is mirrored although it is near, the farther first.
    pub mirrored: [Option<Mirrored>; 2],
    /// How much of the light that a surface throws back comes back from what is around it, 0-1.
    pub bounce: f32,
}

impl Light<'_> {
    /// Share of the sky that is seen from the hollow, if there is one.
    fn open(&self) -> f32 {
        self.hollow.map_or(1.0, |hollow| hollow.open)
    }

    fn with_key(&self) -> f32 {
        if self.table_light.is_some() { WITH_KEY_ON_TABLE } else { WITH_KEY }
    }
}

/// Light reflected towards the viewer, developed.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn reflect(spots: &Spots, appearance: &Appearance<'_>, out: &mut Reflected) {
    if spots.pixels.count <= REGISTER {
        reflect_chunk::<REGISTER>(spots, appearance, out);
    } else {
        reflect_chunk::<CHUNK>(spots, appearance, out);
    }
}

/// What [`reflect`] is compiled from, for the widest registers of the machine and for none.
#[inline(always)]
fn reflect_chunk<const LANES: usize>(spots: &Spots, appearance: &Appearance<'_>, out: &mut Reflected) {
    let &Appearance { surface, placed, lens, ref light, .. } = appearance;
    face_viewer::<LANES>(spots, placed, lens, out);
    look_around::<LANES>(&light.lighting.sky, &light.glossy, out);
    if let Some(top) = light.table_top {
        look_down::<LANES>(light, lens.eye.z - top, spots, placed, out);
    }
    for thing in light.mirrored.iter().flatten() {
        mirror_near::<LANES>(thing, spots, lens, light.lighting, out);
    }
    if let Some(table_light) = light.table_light {
        dim_table(table_light, spots.pixels.count, &spots.place, &mut out.around);
    }
    find_highlights::<LANES>(surface.roughness, light.lighting, out);
    hold_back_key::<LANES>(&spots.key, light.with_key(), out);
    if surface.metallic > 0.0 {
        add_up::<LANES>(spots, surface, light, out);
    } else {
        find_hollow::<LANES>(light.hollow, spots, out);
        mirror::<LANES>(surface.reflectance, out);
        add_up_dielectric::<LANES>(spots, surface.scatters(), light, out);
    }
    develop::<LANES>(surface.opacity < 1.0, out);
}

/// What is reflected at the nodes of an opaque dielectric, before the key light is held back.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn reflect_nodes(nodes: &Spots, appearance: &Appearance<'_>, out: &mut Reflected) {
    let &Appearance { surface, placed, lens, ref light, .. } = appearance;
    face_viewer::<REGISTER>(nodes, placed, lens, out);
    look_around::<REGISTER>(&light.lighting.sky, &light.glossy, out);
    if let Some(top) = light.table_top {
        look_down::<REGISTER>(light, lens.eye.z - top, nodes, placed, out);
    }
    find_hollow::<REGISTER>(light.hollow, nodes, out);
    if let Some(table_light) = light.table_light {
        dim_table(table_light, nodes.pixels.count, &nodes.place, &mut out.around);
    }
    find_highlights::<REGISTER>(surface.roughness, light.lighting, out);
    mirror::<REGISTER>(surface.reflectance, out);
}

/// [`reflect`] for a tile between nodes at which [`reflect_nodes`] found the light, which is linear between them.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn reflect_flat(
    spots: &Spots,
    nodes: &Reflected,
    around: &TileNodes,
    appearance: &Appearance<'_>,
    out: &mut Reflected,
) {
    let light = &appearance.light;
    for channel in 0..3 {
        around.spread(&nodes.around[channel], &mut out.around[channel]);
        around.spread(&nodes.mirrored[channel], &mut out.mirrored[channel]);
    }
    around.spread(&nodes.lit, &mut out.lit);
    if light.hollow.is_some() {
        around.spread(&nodes.hollow, &mut out.hollow);
    }
    around.spread(&nodes.lobe, &mut out.lobe);
    hold_back_key::<CHUNK>(&spots.key, light.with_key(), out);
    add_up_dielectric::<CHUNK>(spots, 1.0, light, out);
    develop::<CHUNK>(false, out);
}

/// Unit normals and directions to the viewer.
#[inline(always)]
fn face_viewer<const LANES: usize>(spots: &Spots, placed: &PartView, lens: &Lens, out: &mut Reflected) {
    let turn = [placed.world_from_body.x_axis, placed.world_from_body.y_axis, placed.world_from_body.z_axis]
        .map(|column| column.to_array());
    let camera = [lens.turn.x_axis, lens.turn.y_axis, lens.turn.z_axis].map(|column| column.to_array());
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    let (center_x, center_y) = (lens.center.x, lens.center.y);
    for i in 0..LANES {
        let (ray_x, ray_y) =
            ((spots.pixels.column[i] - center_x) * inverse_x, (spots.pixels.row[i] - center_y) * inverse_y);
        let inverse = -1.0 / ray_x.mul_add(ray_x, ray_y.mul_add(ray_y, 1.0)).sqrt();
        for axis in 0..3 {
            out.viewer[axis][i] = turned(&camera, axis, [ray_x, ray_y, 1.0]) * inverse;
        }
    }
    for i in 0..LANES {
        let mixed = [spots.normal[0][i], spots.normal[1][i], spots.normal[2][i]];
        let normal = [turned(&turn, 0, mixed), turned(&turn, 1, mixed), turned(&turn, 2, mixed)];
        let inverse = 1.0 / (dot(normal, normal) + 1e-20).sqrt();
        for axis in 0..3 {
            out.normal[axis][i] = normal[axis] * inverse;
        }
    }
}

/// Light of the surroundings.
#[inline(always)]
fn look_around<const LANES: usize>(sky: &Sky, glossy: &Glossy, out: &mut Reflected) {
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

/// The unit direction that is seen in a mirror, from twice the cosine between its normal and the direction to the viewer.
#[inline(always)]
fn mirrored(normal: [f32; 3], viewer: [f32; 3], twice: f32) -> [f32; 3] {
    let along = |axis: usize| normal[axis].mul_add(twice, -viewer[axis]);
    [along(0), along(1), along(2)]
}

/// Highlights of the lamp. Its width adds to that of the lobe, as variances do, so that polished things show the lamp in its
/// size.
#[inline(always)]
fn find_highlights<const LANES: usize>(roughness: f32, lighting: &Lighting, out: &mut Reflected) {
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
        // The lamp's strength is its irradiance over π, hence without the π of the distribution.
        out.lobe[i] = square_alpha * 0.5 / (denominator * denominator * smith);
        out.weight[i] = schlick_weight(dot(viewer, half));
    }
    for i in 0..LANES {
        (out.scale[i], out.bias[i]) = ambient_fresnel(roughness, out.facing[i]);
    }
}

/// What is left of the lamp's light behind what holds it back, and what that does to other light.
#[inline(always)]
fn hold_back_key<const LANES: usize>(key: &Lane, with_key: f32, out: &mut Reflected) {
    for i in 0..LANES {
        let lit = out.lit[i];
        out.strength[i] = lit * key[i];
        out.veiled[i] = (lit - out.strength[i]) * with_key;
        out.corner[i] = within((lit - out.strength[i]) * 4.0, 0.0, 1.0).mul_add(-CORNER_SHADE, 1.0);
    }
}

/// The sum of all light.
#[inline(always)]
fn add_up<const LANES: usize>(spots: &Spots, surface: &Surface, light: &Light<'_>, out: &mut Reflected) {
    let (lighting, bounce) = (light.lighting, light.bounce);
    let (metallic, reflectance, exposure) = (surface.metallic, surface.reflectance, lighting.exposure);
    let key = lighting.key.to_array();
    let side = surface.scatters();
    for channel in 0..3 {
        let lamp = key[channel];
        for i in 0..LANES {
            let (base, ambient_share) = (spots.base[channel][i], spots.ambient[i]);
            let around = out.around[channel][i] * (1.0 - out.veiled[i]);
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

/// What a surface with a reflectance head-on mirrors of the surroundings and of the lamp, as shares of the light that
/// arrives from there.
#[inline(always)]
fn mirrored_shares(f0: f32, out: &Reflected, i: usize) -> [f32; 2] {
    let ambient = f0.mul_add(out.scale[i], out.bias[i]);
    let direct = lerp(f0, 1.0, out.weight[i]) * out.lobe[i];
    [if ambient > 0.0 { ambient } else { 0.0 }, if direct < 12.0 { direct } else { 12.0 }]
}

/// Light that a surface of an albedo scatters: of the surroundings, of which a share is open, of the lamp as it arrives, and
/// of the lamp, by the share that is there in a corner, as its sides throw it on each other.
#[inline(always)]
fn scattered([albedo, bounce]: [f32; 2], open: f32, around: f32, arriving: f32, [corner, lamp]: [f32; 2]) -> f32 {
    let enclosed = (1.0 - open) * within(open * CORNER_OPEN, 0.0, 1.0);
    let corner = enclosed * corner * albedo * albedo * albedo * lamp * CORNER_KEY;
    albedo * around.mul_add(between(open, albedo * bounce), corner + arriving)
}

/// What a dielectric mirrors, over `mirrored` and, of the lamp, over `lobe`: it does not depend on the colour.
#[inline(always)]
fn mirror<const LANES: usize>(reflectance: f32, out: &mut Reflected) {
    for i in 0..LANES {
        let [ambient, direct] = mirrored_shares(reflectance, out, i);
        out.lobe[i] = direct;
        for channel in 0..3 {
            out.mirrored[channel][i] *= ambient;
        }
    }
}

/// [`add_up`] of a dielectric, after [`mirror`]: a share of one side scatters, and a share of the sky is seen from its hollow.
#[inline(always)]
fn add_up_dielectric<const LANES: usize>(spots: &Spots, side: f32, light: &Light<'_>, out: &mut Reflected) {
    let (mut is_open, mut has_hollow) = (true, false);
    for i in 0..LANES {
        is_open &= spots.ambient[i] == 1.0;
    }
    if light.hollow.is_some() {
        for i in 0..LANES {
            has_hollow |= out.hollow[i] > 0.0;
        }
    }
    // What is zero is not computed; the sums have the same bits.
    match [is_open, has_hollow] {
        [true, false] => add_up_some::<LANES, true, false>(spots, side, light, out),
        [false, false] => add_up_some::<LANES, false, false>(spots, side, light, out),
        [_, true] => add_up_some::<LANES, false, true>(spots, side, light, out),
    }
}

/// [`add_up_dielectric`] where all of the surroundings is seen, and where light is in a hollow.
#[inline(always)]
fn add_up_some<const LANES: usize, const IS_OPEN: bool, const HAS_HOLLOW: bool>(
    spots: &Spots,
    side: f32,
    light: &Light<'_>,
    out: &mut Reflected,
) {
    let (key, exposure, bounce, open) =
        (light.lighting.key.to_array(), light.lighting.exposure, light.bounce, light.open());
    for channel in 0..3 {
        let lamp = key[channel];
        for i in 0..LANES {
            let around = out.around[channel][i] * (1.0 - out.veiled[i]);
            let arriving = lamp * out.strength[i];
            let albedo = spots.base[channel][i];
            let mirrored = out.mirrored[channel][i];
            let (mut diffuse, ambient) = if IS_OPEN {
                (albedo * around.mul_add(between(1.0, albedo * bounce), arriving), mirrored)
            } else {
                let share = spots.ambient[i];
                (scattered([albedo, bounce], share, around, arriving, [out.corner[i], lamp]), mirrored * share)
            };
            if HAS_HOLLOW {
                diffuse = (thrown_back(albedo, open) * out.hollow[i]).mul_add(lamp, diffuse);
            }
            let specular = arriving.mul_add(out.lobe[i], ambient);
            out.color[channel][i] = diffuse.mul_add(side, specular) * exposure;
        }
    }
}

/// Light as a display shows it.
#[inline(always)]
fn develop<const LANES: usize>(is_transparent: bool, out: &mut Reflected) {
    if is_transparent {
        // Added to what is behind, which is developed: only the sum has dark tones.
        for i in 0..LANES {
            for channel in 0..3 {
                let color = out.color[channel][i];
                out.color[channel][i] = if color < 1.0 { color } else { 1.0 };
            }
        }
        return;
    }
    let mut is_bright = false;
    for i in 0..LANES {
        is_bright |= is_compressed([out.color[0][i], out.color[1][i], out.color[2][i]]);
    }
    if !is_bright {
        for i in 0..LANES {
            let color = tone_map_dark([out.color[0][i], out.color[1][i], out.color[2][i]]);
            out.color[0][i] = color[0];
            out.color[1][i] = color[1];
            out.color[2][i] = color[2];
        }
        return;
    }
    for i in 0..LANES {
        let color = tone_map([out.color[0][i], out.color[1][i], out.color[2][i]]);
        out.color[0][i] = color[0];
        out.color[1][i] = color[1];
        out.color[2][i] = color[2];
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3A};

    use super::*;
    use crate::occluders::held_cube as held;
    use crate::raster::Planes;
    use crate::variation::RenderVariation;

    /// Whatever registers the machine has, the bits are those of the plain loop.
    #[test]
    fn wide_registers_give_the_same_bits() {
        let variation = RenderVariation::default();
        let lighting = Lighting::new(&variation, &[]);
        let lens = Lens { focal: Vec2::new(400.0, 410.0), center: Vec2::new(250.0, 140.0), ..Lens::default() };
        let mut state = 1_u32;
        let mut draw = |low: f32, high: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / 16_777_216.0
        };
        for _ in 0..50 {
            let mut shading = Spots::default();
            for i in 0..CHUNK {
                let pixels = &mut shading.pixels;
                (pixels.column[i], pixels.row[i], pixels.depth[i]) =
                    (draw(0.0, 512.0), draw(0.0, 288.0), draw(0.1, 2.0));
                (shading.key[i], shading.ambient[i]) = (draw(0.0, 1.0), draw(0.0, 1.0));
                shading.normal.iter_mut().for_each(|axis| axis[i] = draw(-1.0, 1.0));
                shading.base.iter_mut().for_each(|channel| channel[i] = draw(0.0, 1.0));
            }
            let surface = Surface {
                base: Vec3A::ONE,
                roughness: draw(0.05, 1.0),
                metallic: draw(0.0, 1.0),
                opacity: draw(0.2, 1.2).min(1.0),
                reflectance: 0.04,
                texture: None,
                is_table: false,
            };
            let glossy = lighting.sky.glossy(surface.roughness);
            let mirrored = [[None; 2], [Some(held(true)), None], [Some(held(false)), Some(held(true))]]
                [(draw(0.0, 3.0) as usize).min(2)];
            let (bounce, table_top) = (draw(0.0, 1.0), [None, Some(0.0)][usize::from(draw(0.0, 1.0) < 0.5)]);
            let light = Light {
                lighting: &lighting,
                glossy,
                table_light: None,
                table_top,
                table_lit: 1.0,
                hollow: None,
                mirrored,
                bounce,
            };
            let (surface, placed, lens) = (&surface, &PartView::default(), &lens);
            let appearance =
                Appearance { faces: &[], planes: &Planes::default(), eye: None, surface, placed, lens, light };
            let [mut wide, mut plain] = [Reflected::default(), Reflected::default()];
            let bits = |lanes: &[Lane; 3]| lanes.map(|channel| channel.map(f32::to_bits));
            shading.pixels.count = CHUNK;
            reflect_chunk::<CHUNK>(&shading, &appearance, &mut plain);
            reflect(&shading, &appearance, &mut wide);
            assert_eq!(bits(&wide.color), bits(&plain.color));
            shading.pixels.count = REGISTER;
            let mut few = Reflected::default();
            reflect(&shading, &appearance, &mut few);
            let first = |lanes: &[Lane; 3]| bits(lanes).map(|channel| channel[..REGISTER].to_vec());
            assert_eq!(first(&few.color), first(&plain.color));
        }
    }
}
