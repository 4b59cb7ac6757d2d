//! The colour of a surface: metallic-roughness reflection of the key light and of the surroundings.
//!
//! GGX distribution with Hammon's approximation of the Smith visibility and Schlick's Fresnel term;
//! the surroundings through Karis' analytic fit of the split sum ("Physically Based Shading on Mobile", 2014).
//! A chunk of points of one part at a time.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec3A;
use multiversion::multiversion;

use crate::assets::{Part, Surface, TRIANGLE_BITS};
use crate::develop::tone_map;
use crate::lanes::{CHUNK, Lane, ZERO, within};
use crate::layers::TILE;
use crate::mesh::Face;
use crate::points::Pixels;
use crate::reflectance::{ambient_fresnel, between, schlick_weight};
use crate::sky::{Glossy, Sky, dot};
use crate::texture::{Samples, find_codes, linear_from_srgb, srgb_table};
use crate::variation::RenderVariation;
use crate::view::{Lens, PartView};

/// All light of a scene.
#[derive(Debug)]
pub(crate) struct Lighting {
    pub sky: Sky,
    pub to_light: Vec3A,
    /// Brightness of a white diffuse surface that faces the light.
    pub key: Vec3A,
    exposure: f32,
}

impl Lighting {
    /// The light of a variation on things made of some surfaces: the table among them throws light back.
    pub fn new(variation: &RenderVariation, surfaces: &[Surface]) -> Self {
        let table = surfaces.iter().find(|surface| surface.is_table).map(Surface::mean_color);
        Self {
            sky: Sky::new(variation, table),
            to_light: Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z),
            key: linear_from_srgb(variation.light_color) * variation.light_intensity,
            exposure: variation.exposure,
        }
    }
}

impl Lighting {
    /// Brightness of a white diffuse surface with a unit normal in the ambient light.
    pub fn around(&self, normal: Vec3A) -> Vec3A {
        Vec3A::from_array(self.sky.diffuse(normal.to_array()))
    }

    /// What is seen of the surroundings in a unit direction, developed.
    pub fn surroundings(&self, direction: Vec3A) -> Vec3A {
        let light = Vec3A::from_array(self.sky.glossy(0.0).at(direction.to_array()));
        Vec3A::from_array(tone_map((light * self.exposure).to_array()))
    }
}

/// A place on the image where a surface is shaded.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Spot {
    /// Visibility id.
    pub id: u32,
    /// Pixels; integers at pixel centres.
    pub x: f32,
    pub y: f32,
    pub depth: f32,
    /// Share of the key light that arrives.
    pub key: f32,
    /// Share of the ambient light that arrives.
    pub ambient: f32,
}

/// Shades spots of one part.
#[derive(Debug)]
pub(crate) struct Shading {
    spots: Spots,
    samples: Samples,
    reflected: Reflected,
    /// Places of the colours in the table of bytes.
    codes: [[u32; CHUNK]; 3],
}

impl Default for Shading {
    fn default() -> Self {
        let (spots, samples, reflected) = Default::default();
        Self { spots, samples, reflected, codes: [[0; CHUNK]; 3] }
    }
}

/// Spots of one part, component by component.
#[derive(Clone, Debug)]
struct Spots {
    count: usize,
    x: Lane,
    y: Lane,
    depth: Lane,
    key: Lane,
    ambient: Lane,
    triangle: [u32; CHUNK],
    /// In the body's frame.
    place: [Lane; 3],
    /// Normal between the corners', not of unit length, and texture coordinates.
    normal: [Lane; 3],
    u: Lane,
    v: Lane,
    /// Square texture units per square metre, then texels per pixel.
    texels: Lane,
    base: [Lane; 3],
}

impl Default for Spots {
    fn default() -> Self {
        Self {
            count: 0,
            x: ZERO,
            y: ZERO,
            depth: ZERO,
            key: ZERO,
            ambient: ZERO,
            triangle: [0; CHUNK],
            place: [ZERO; 3],
            normal: [ZERO; 3],
            u: ZERO,
            v: ZERO,
            texels: ZERO,
            base: [ZERO; 3],
        }
    }
}

impl Shading {
    /// Starts a new chunk.
    pub fn clear(&mut self) {
        self.spots.count = 0;
    }

    /// Adds a spot.
    pub fn push(&mut self, spot: Spot) {
        let spots = &mut self.spots;
        let i = spots.count;
        (spots.x[i], spots.y[i], spots.depth[i]) = (spot.x, spot.y, spot.depth);
        (spots.key[i], spots.ambient[i]) = (spot.key, spot.ambient);
        spots.triangle[i] = spot.id & ((1 << TRIANGLE_BITS) - 1);
        spots.count += 1;
    }

    /// The centres of pixels, with the shares of the key light and of the ambient light per pixel of the image.
    pub fn take(&mut self, pixels: &Pixels, key: &[f32], ambient: &[f32]) {
        let spots = &mut self.spots;
        (spots.count, spots.triangle) = (pixels.count, pixels.triangle);
        (spots.x, spots.y, spots.depth) = (pixels.column, pixels.row, pixels.depth);
        if pixels.is_tile {
            for (step, &first) in pixels.pixel.iter().step_by(TILE).enumerate() {
                let (from, to) = (first as usize, step * TILE);
                spots.key[to..to + TILE].copy_from_slice(&key[from..from + TILE]);
                spots.ambient[to..to + TILE].copy_from_slice(&ambient[from..from + TILE]);
            }
        } else {
            for (i, &pixel) in pixels.pixel.iter().enumerate().take(pixels.count) {
                (spots.key[i], spots.ambient[i]) = (key[pixel as usize], ambient[pixel as usize]);
            }
        }
        for key in &mut spots.key {
            *key = if *key > 0.0 { *key } else { 0.0 };
        }
    }

    /// Writes the spots, which are those pixels, into an image: linear display colours, and bytes.
    pub fn write(&mut self, pixels: &Pixels, colors: &mut [Vec3A], rgb: &mut [u8]) {
        find_codes(&self.reflected.color, &mut self.codes);
        let table = srgb_table();
        let code = |channel: usize, spot: usize| table[self.codes[channel][spot] as usize & 4095];
        if pixels.is_tile {
            for (step, &first) in pixels.pixel.iter().step_by(TILE).enumerate() {
                let (from, to) = (step * TILE, first as usize);
                for (x, color) in colors[to..to + TILE].iter_mut().enumerate() {
                    *color = self.color_of(from + x);
                }
                for (x, bytes) in rgb[to * 3..(to + TILE) * 3].chunks_exact_mut(3).enumerate() {
                    bytes.copy_from_slice(&std::array::from_fn::<u8, 3, _>(|channel| code(channel, from + x)));
                }
            }
        } else {
            for (spot, &pixel) in pixels.pixel.iter().enumerate().take(pixels.count) {
                colors[pixel as usize] = self.color_of(spot);
                let bytes: [u8; 3] = std::array::from_fn(|channel| code(channel, spot));
                rgb[pixel as usize * 3..][..3].copy_from_slice(&bytes);
            }
        }
    }

    /// Linear display colour of a spot.
    #[inline(always)]
    pub fn color_of(&self, spot: usize) -> Vec3A {
        let [r, g, b] = &self.reflected.color;
        Vec3A::new(r[spot], g[spot], b[spot])
    }

    /// Unit normal at a spot in the world, and its cosine to the direction to the viewer.
    pub fn facing_of(&self, spot: usize) -> (Vec3A, f32) {
        let normal = self.reflected.normal.each_ref().map(|axis| axis[spot]);
        (Vec3A::from_array(normal), self.reflected.facing[spot])
    }

    /// Linear colour of the material at a spot.
    pub fn base_of(&self, spot: usize) -> Vec3A {
        Vec3A::from_array(self.spots.base.each_ref().map(|channel| channel[spot]))
    }

    /// Shades the spots, which show one part made of `surface`.
    pub fn shade(&mut self, part: &Part, surface: &Surface, placed: &PartView, lens: &Lens, lighting: &Lighting) {
        let Self { spots, samples, reflected, .. } = self;
        locate(spots, placed, lens);
        let mesh = placed.mesh(part);
        let eye = (!part.hides_back(mesh)).then_some(placed.eye_in_body);
        let first = spots.triangle[0];
        if spots.triangle[..spots.count].iter().fold(0, |differ, &other| differ | (other ^ first)) == 0 {
            interpolate_one(spots, &mesh.faces[first as usize], eye);
        } else {
            spots.interpolate(&mesh.faces, eye, surface.texture.is_some());
        }
        let tint = surface.base;
        if let Some(texture) = &surface.texture {
            find_footprints(spots, placed, lens, texture.texels());
            texture.sample(spots.count, [&spots.u, &spots.v], &spots.texels, samples, &mut spots.base);
            for (channel, tint) in spots.base.iter_mut().zip(tint.to_array()) {
                channel.iter_mut().for_each(|value| *value *= tint);
            }
        } else {
            spots.base = [[tint.x; CHUNK], [tint.y; CHUNK], [tint.z; CHUNK]];
        }
        let glossy = lighting.sky.glossy(surface.roughness);
        reflect(spots, surface, placed, lens, lighting, &glossy, reflected);
    }
}

impl Spots {
    /// Normals and texture coordinates on several triangles; seen from an eye, if both sides can be seen.
    fn interpolate(&mut self, faces: &[Face], eye: Option<Vec3A>, is_textured: bool) {
        for i in 0..self.count {
            let face = &faces[self.triangle[i] as usize];
            let [x, y, z] = [self.place[0][i], self.place[1][i], self.place[2][i]];
            let [a, b, c, d] = face.columns;
            let mut normal_u = a * x + b * y + c * z + d;
            // The side that is seen is the one towards the eye.
            if let Some(eye) = eye
                && face.plane.x * (x - eye.x) + face.plane.y * (y - eye.y) + face.plane.z * (z - eye.z) > 0.0
            {
                normal_u = (-normal_u).with_w(normal_u.w);
            }
            let [nx, ny, nz, u] = normal_u.to_array();
            (self.normal[0][i], self.normal[1][i], self.normal[2][i]) = (nx, ny, nz);
            if is_textured {
                self.u[i] = u;
                self.v[i] = face.v.x * x + face.v.y * y + face.v.z * z + face.v.w;
                self.texels[i] = face.plane.w;
            }
        }
    }
}

/// The same where all spots lie on one triangle, with the same bits.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn interpolate_one(spots: &mut Spots, face: &Face, eye: Option<Vec3A>) {
    let columns = face.columns.map(|column| column.to_array());
    let v = face.v.to_array();
    let plane = face.plane.to_array();
    let (eye, can_turn) = eye.map_or(([0.0; 3], false), |eye| (eye.to_array(), true));
    for i in 0..CHUNK {
        let [x, y, z] = [spots.place[0][i], spots.place[1][i], spots.place[2][i]];
        // In the order in which [`Spots::interpolate`] adds.
        let mixed = |row: usize| columns[0][row] * x + columns[1][row] * y + columns[2][row] * z + columns[3][row];
        let away = plane[0] * (x - eye[0]) + plane[1] * (y - eye[1]) + plane[2] * (z - eye[2]);
        let side = if can_turn & (away > 0.0) { -1.0 } else { 1.0 };
        spots.normal[0][i] = mixed(0) * side;
        spots.normal[1][i] = mixed(1) * side;
        spots.normal[2][i] = mixed(2) * side;
        spots.u[i] = mixed(3);
        spots.v[i] = v[0] * x + v[1] * y + v[2] * z + v[3];
        spots.texels[i] = plane[3];
    }
}

/// Places in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn locate(spots: &mut Spots, placed: &PartView, lens: &Lens) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let eye = placed.eye_in_body.to_array();
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    for i in 0..CHUNK {
        let depth = spots.depth[i];
        let x = (spots.x[i] - lens.center.x) * inverse_x * depth;
        let y = (spots.y[i] - lens.center.y) * inverse_y * depth;
        for axis in 0..3 {
            spots.place[axis][i] = turn[0][axis] * x + turn[1][axis] * y + turn[2][axis] * depth + eye[axis];
        }
    }
}

/// Texels per pixel; square texture units per square metre go in.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn find_footprints(spots: &mut Spots, placed: &PartView, lens: &Lens, texels: f32) {
    let inverse_focal = 1.0 / lens.focal.x;
    let eye = placed.eye_in_body.to_array();
    for i in 0..CHUNK {
        let normal = [spots.normal[0][i], spots.normal[1][i], spots.normal[2][i]];
        let ray = [spots.place[0][i] - eye[0], spots.place[1][i] - eye[1], spots.place[2][i] - eye[2]];
        let along = (normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]).abs();
        let lengths = (ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
            * (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
        let facing = along / (lengths + 1e-20).sqrt();
        // A grazing view stretches the pixel along one direction; the square root is the compromise.
        let facing = (if facing > 0.05 { facing } else { 0.05 }).sqrt();
        spots.texels[i] = (spots.texels[i] * texels).sqrt() * spots.depth[i] * inverse_focal / facing;
    }
}

/// What is computed between the loops of [`reflect`], and its result.
#[derive(Clone, Debug)]
struct Reflected {
    normal: [Lane; 3],
    viewer: [Lane; 3],
    /// Cosine between them.
    facing: Lane,
    /// From the surroundings: diffuse, and mirrored.
    around: [Lane; 3],
    mirrored: [Lane; 3],
    /// Scale and bias of the reflectance head-on, for light from everywhere.
    scale: Lane,
    bias: Lane,
    /// Light of the lamp that arrives, and the size and Fresnel weight of its highlight.
    strength: Lane,
    /// How much of the ambient light is held back by what holds back the lamp's.
    veiled: Lane,
    /// How much of the key light the sides of a corner throw on each other is there.
    corner: Lane,
    lobe: Lane,
    weight: Lane,
    color: [Lane; 3],
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
            strength: ZERO,
            veiled: ZERO,
            corner: ZERO,
            lobe: ZERO,
            weight: ZERO,
            color: lanes,
        }
    }
}

/// Share of the key light that the sides of a corner throw on each other twice, of what they would if all faced it. Fitted
/// to traced pictures.
const CORNER_KEY: f32 = 0.8;
/// How much less of it there is where a surface that faces the key light lies in shadow, and how many times the share of
/// the sky that is seen it is at most: what enters a deep hollow is little. Fitted likewise.
const CORNER_SHADE: f32 = 0.6;
const CORNER_OPEN: f32 = 2.0;

/// Share of the ambient light, for a surface that faces the key light, that comes from around it and is held back with
/// it. Fitted to traced pictures.
const WITH_KEY: f32 = 0.15;
/// How much more of their surroundings metals mirror in corners than other things do. Fitted to traced pictures.
const METAL_CORNER: f32 = 0.1;

/// Light reflected towards the viewer, developed.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn reflect(
    spots: &Spots,
    surface: &Surface,
    placed: &PartView,
    lens: &Lens,
    lighting: &Lighting,
    glossy: &Glossy,
    out: &mut Reflected,
) {
    reflect_chunk(spots, surface, placed, lens, lighting, glossy, out);
}

/// What [`reflect`] is compiled from, for the widest registers of the machine and for none.
#[inline(always)]
fn reflect_chunk(
    spots: &Spots,
    surface: &Surface,
    placed: &PartView,
    lens: &Lens,
    lighting: &Lighting,
    glossy: &Glossy,
    out: &mut Reflected,
) {
    face_viewer(spots, placed, lens, out);
    look_around(&lighting.sky, glossy, out);
    find_highlights(surface.roughness, lighting.to_light.to_array(), &spots.key, out);
    add_up(spots, surface, lighting, out);
}

/// Unit normals and directions to the viewer.
#[inline(always)]
fn face_viewer(spots: &Spots, placed: &PartView, lens: &Lens, out: &mut Reflected) {
    let turn = [placed.world_from_body.x_axis, placed.world_from_body.y_axis, placed.world_from_body.z_axis]
        .map(|column| column.to_array());
    let camera = [lens.turn.x_axis, lens.turn.y_axis, lens.turn.z_axis].map(|column| column.to_array());
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    let (center_x, center_y) = (lens.center.x, lens.center.y);
    for i in 0..CHUNK {
        let (ray_x, ray_y) = ((spots.x[i] - center_x) * inverse_x, (spots.y[i] - center_y) * inverse_y);
        let inverse = -1.0 / (ray_x * ray_x + ray_y * ray_y + 1.0).sqrt();
        for axis in 0..3 {
            out.viewer[axis][i] = (camera[0][axis] * ray_x + camera[1][axis] * ray_y + camera[2][axis]) * inverse;
        }
    }
    for i in 0..CHUNK {
        let mixed = [spots.normal[0][i], spots.normal[1][i], spots.normal[2][i]];
        let x = turn[0][0] * mixed[0] + turn[1][0] * mixed[1] + turn[2][0] * mixed[2];
        let y = turn[0][1] * mixed[0] + turn[1][1] * mixed[1] + turn[2][1] * mixed[2];
        let z = turn[0][2] * mixed[0] + turn[1][2] * mixed[1] + turn[2][2] * mixed[2];
        let inverse = 1.0 / (x * x + y * y + z * z + 1e-20).sqrt();
        out.normal[0][i] = x * inverse;
        out.normal[1][i] = y * inverse;
        out.normal[2][i] = z * inverse;
    }
}

/// Light of the surroundings.
#[inline(always)]
fn look_around(sky: &Sky, glossy: &Glossy, out: &mut Reflected) {
    for i in 0..CHUNK {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let around = sky.diffuse(normal);
        out.around[0][i] = around[0];
        out.around[1][i] = around[1];
        out.around[2][i] = around[2];
    }
    for i in 0..CHUNK {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let viewer = [out.viewer[0][i], out.viewer[1][i], out.viewer[2][i]];
        let cosine = dot(normal, viewer);
        out.facing[i] = within(cosine, 1e-3, 1.0);
        let twice = cosine + cosine;
        let mirrored = [normal[0] * twice - viewer[0], normal[1] * twice - viewer[1], normal[2] * twice - viewer[2]];
        let light = glossy.at(mirrored);
        out.mirrored[0][i] = light[0];
        out.mirrored[1][i] = light[1];
        out.mirrored[2][i] = light[2];
    }
}

/// Highlights of the lamp.
#[inline(always)]
fn find_highlights(roughness: f32, to_light: [f32; 3], key: &Lane, out: &mut Reflected) {
    let alpha = roughness * roughness;
    let square_alpha = alpha * alpha;
    for i in 0..CHUNK {
        let normal = [out.normal[0][i], out.normal[1][i], out.normal[2][i]];
        let viewer = [out.viewer[0][i], out.viewer[1][i], out.viewer[2][i]];
        let facing = out.facing[i];
        let lit = dot(normal, to_light);
        let lit = if lit > 0.0 { lit } else { 0.0 };
        out.strength[i] = lit * key[i];
        out.veiled[i] = (lit - out.strength[i]) * WITH_KEY;
        out.corner[i] = 1.0 - within((lit - out.strength[i]) * 4.0, 0.0, 1.0) * CORNER_SHADE;
        let half = [viewer[0] + to_light[0], viewer[1] + to_light[1], viewer[2] + to_light[2]];
        let inverse = 1.0 / (dot(half, half) + 1e-12).sqrt();
        let half = [half[0] * inverse, half[1] * inverse, half[2] * inverse];
        let n_h = within(dot(normal, half), 0.0, 1.0);
        let denominator = n_h * n_h * (square_alpha - 1.0) + 1.0;
        let smith = lit * facing * (2.0 * (1.0 - alpha)) + (lit + facing) * alpha;
        let smith = if smith > 1e-4 { smith } else { 1e-4 };
        // The lamp's strength is its irradiance over π, hence without the π of the distribution.
        out.lobe[i] = square_alpha * 0.5 / (denominator * denominator * smith);
        out.weight[i] = schlick_weight(dot(viewer, half));
    }
    for i in 0..CHUNK {
        (out.scale[i], out.bias[i]) = ambient_fresnel(roughness, out.facing[i]);
    }
}

/// The sum of all light, developed.
#[inline(always)]
fn add_up(spots: &Spots, surface: &Surface, lighting: &Lighting, out: &mut Reflected) {
    let (metallic, reflectance, exposure) = (surface.metallic, surface.reflectance, lighting.exposure);
    let key = lighting.key.to_array();
    let side = surface.scatters();
    for channel in 0..3 {
        let lamp = key[channel];
        for i in 0..CHUNK {
            let (base, ambient_share) = (spots.base[channel][i], spots.ambient[i]);
            let around = out.around[channel][i] * (1.0 - out.veiled[i]);
            // Corners that see little of the sky see little of it in their reflection, unless they are metal.
            let glossy_share = ambient_share + (1.0 - ambient_share) * (METAL_CORNER * metallic);
            let f0 = reflectance + (base - reflectance) * metallic;
            let albedo = base * (1.0 - metallic);
            let arriving = lamp * out.strength[i];
            let ambient = f0 * out.scale[i] + out.bias[i];
            let ambient = if ambient > 0.0 { ambient } else { 0.0 };
            let direct = (f0 + (1.0 - f0) * out.weight[i]) * out.lobe[i];
            let direct = if direct < 12.0 { direct } else { 12.0 };
            let enclosed = (1.0 - ambient_share) * within(ambient_share * CORNER_OPEN, 0.0, 1.0);
            let corner = enclosed * out.corner[i] * albedo * albedo * albedo * lamp * CORNER_KEY;
            let diffuse = albedo * (around * between(ambient_share, albedo) + corner + arriving);
            let specular = out.mirrored[channel][i] * ambient * glossy_share + arriving * direct;
            out.color[channel][i] = (diffuse * side + specular) * exposure;
        }
    }
    if surface.opacity < 1.0 {
        // Added to what is behind, which is developed: only the sum has dark tones.
        for i in 0..CHUNK {
            for channel in 0..3 {
                let color = out.color[channel][i];
                out.color[channel][i] = if color < 1.0 { color } else { 1.0 };
            }
        }
        return;
    }
    for i in 0..CHUNK {
        let color = tone_map([out.color[0][i], out.color[1][i], out.color[2][i]]);
        out.color[0][i] = color[0];
        out.color[1][i] = color[1];
        out.color[2][i] = color[2];
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

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
                (shading.x[i], shading.y[i], shading.depth[i]) = (draw(0.0, 512.0), draw(0.0, 288.0), draw(0.1, 2.0));
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
            let (placed, glossy) = (PartView::default(), lighting.sky.glossy(surface.roughness));
            let [mut wide, mut plain] = [Reflected::default(), Reflected::default()];
            reflect(&shading, &surface, &placed, &lens, &lighting, &glossy, &mut wide);
            reflect_chunk(&shading, &surface, &placed, &lens, &lighting, &glossy, &mut plain);
            let bits = |lanes: &[Lane; 3]| lanes.map(|channel| channel.map(f32::to_bits));
            assert_eq!(bits(&wide.color), bits(&plain.color));
        }
    }
}
