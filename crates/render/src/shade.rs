//! The colour of a surface: metallic-roughness reflection of the key light and of the surroundings.
//!
//! GGX distribution with Hammon's approximation of the Smith visibility and Schlick's Fresnel term;
//! the surroundings through Karis' analytic fit of the split sum ("Physically Based Shading on Mobile", 2014).
//! A chunk of points of one part at a time.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec3A, Vec4};
use multiversion::multiversion;

use crate::arrival::Arrival;
use crate::assets::{Part, Surface, TRIANGLE_BITS};
use crate::job::ROBOT;
use crate::lanes::{CHUNK, Lane, REGISTER, ZERO};
use crate::layers::TILE;
use crate::mesh::Face;
use crate::points::Pixels;
use crate::scene::Scene;
use crate::texture::{Samples, find_codes, octave, srgb_table};
use crate::view::{Lens, PartView};

mod reflect;

use reflect::{Light, Reflected, reflect, reflect_flat};

/// Roughness from which the light on a plane is taken to be linear over a tile, and the focal length, pixels: a tile then
/// spans less than 2.3 degrees, less than the width of the sharpest highlight.
const SMOOTH: f32 = 0.25;
const NARROW_PX: f32 = 200.0;

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
    /// Pixels at the corners of a tile on one plane.
    corners: Spots,
    samples: Samples,
    reflected: Reflected,
    /// Places of the colours in the table of bytes.
    codes: [[u32; CHUNK]; 3],
}

impl Default for Shading {
    fn default() -> Self {
        let (spots, corners, samples, reflected) = Default::default();
        Self { spots, corners, samples, reflected, codes: [[0; CHUNK]; 3] }
    }
}

/// Spots of one part, component by component.
#[derive(Clone, Debug)]
struct Spots {
    count: usize,
    /// Whether they are the pixels of a whole tile, row by row.
    is_tile: bool,
    /// Whether all show the same triangle.
    is_one: bool,
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
            is_tile: false,
            is_one: true,
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
        (self.spots.count, self.spots.is_tile, self.spots.is_one) = (0, false, true);
    }

    /// Adds a spot.
    pub fn push(&mut self, spot: Spot) {
        let spots = &mut self.spots;
        let i = spots.count;
        (spots.x[i], spots.y[i], spots.depth[i]) = (spot.x, spot.y, spot.depth);
        (spots.key[i], spots.ambient[i]) = (spot.key, spot.ambient);
        spots.triangle[i] = spot.id & ((1 << TRIANGLE_BITS) - 1);
        spots.is_one &= spots.triangle[i] == spots.triangle[0];
        spots.count += 1;
    }

    /// The centres of pixels, with the shares of the key light and of the ambient light that arrive.
    pub fn take(&mut self, pixels: &Pixels, arrival: &Arrival) {
        let (key, ambient) = (&arrival.key, &arrival.ambient);
        let spots = &mut self.spots;
        (spots.count, spots.is_tile, spots.is_one) = (pixels.count, pixels.is_tile, pixels.is_flat);
        match pixels.is_flat {
            true => spots.triangle[0] = pixels.triangle[0],
            false => spots.triangle = pixels.triangle,
        }
        (spots.x, spots.y, spots.depth) = (pixels.column, pixels.row, pixels.depth);
        if pixels.is_tile {
            let tile = arrival.tile_of(pixels.pixel[0]);
            for (lane, field) in [(&mut spots.key, key), (&mut spots.ambient, ambient)] {
                if let Some(value) = field.even(tile) {
                    *lane = [value; CHUNK];
                    continue;
                }
                for (lane, &first) in lane.chunks_exact_mut(TILE).zip(pixels.pixel.iter().step_by(TILE)) {
                    lane.copy_from_slice(&field[first as usize..][..TILE]);
                }
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

    /// Writes the spots, which are those pixels, into an image: linear display colours, unless they are an empty list, which
    /// only the pixels of a tile may get, and bytes.
    pub fn write(&mut self, pixels: &Pixels, colors: &mut [Vec3A], rgb: &mut [u8]) {
        find_codes(&self.reflected.color, &mut self.codes);
        let table = srgb_table();
        let code = |channel: usize, spot: usize| table[self.codes[channel][spot] as usize & 4095];
        if pixels.is_tile {
            for (step, &first) in pixels.pixel.iter().step_by(TILE).enumerate() {
                let (from, to) = (step * TILE, first as usize);
                if !colors.is_empty() {
                    for (x, color) in colors[to..to + TILE].iter_mut().enumerate() {
                        *color = self.color_of(from + x);
                    }
                }
                let [a, b, c, d, e, f, g, h] = std::array::from_fn(|x| {
                    let [red, green, blue] = [0, 1, 2].map(|channel| u64::from(code(channel, from + x)));
                    red | green << 8 | blue << 16
                });
                // Three bytes each, as three words.
                let words = [a | b << 24 | c << 48, c >> 16 | d << 8 | e << 32 | f << 56, f >> 8 | g << 16 | h << 40];
                let bytes = rgb[to * 3..(to + TILE) * 3].as_chunks_mut().0;
                bytes.iter_mut().zip(words).for_each(|(bytes, word)| *bytes = word.to_le_bytes());
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
    pub fn shade(&mut self, part: &Part, surface: &Surface, placed: &PartView, lens: &Lens, scene: &Scene<'_>) {
        let Self { spots, corners, samples, reflected, .. } = self;
        let mesh = placed.mesh(part);
        let eye = (!part.hides_back(mesh)).then_some(placed.eye_in_body);
        let (first, is_one) = (spots.triangle[0], spots.is_one);
        let is_dull = surface.metallic == 0.0 && surface.opacity >= 1.0 && surface.roughness >= SMOOTH;
        let is_flat =
            is_one && is_dull && spots.is_tile && lens.focal.min_element() >= NARROW_PX && corners.span(spots);
        let texture = surface.texture.as_deref();
        // Texels per pixel where they are much the same all over the tile.
        let mut even_texels = None;
        if is_flat {
            let face = &mesh.faces[first as usize];
            locate::<REGISTER>(corners, placed, lens);
            interpolate_one::<REGISTER>(corners, face, eye);
            if let Some(texture) = texture {
                find_footprints::<REGISTER>(corners, placed, lens, texture.texels());
                even_texels = corners.even_texels();
                locate::<CHUNK>(spots, placed, lens);
                if even_texels.is_some() {
                    place_on_texture(spots, face);
                } else {
                    interpolate_one::<CHUNK>(spots, face, eye);
                }
            }
        } else {
            match spots.count <= REGISTER {
                true => locate::<REGISTER>(spots, placed, lens),
                false => locate::<CHUNK>(spots, placed, lens),
            }
            if is_one {
                interpolate_one::<CHUNK>(spots, &mesh.faces[first as usize], eye);
            } else {
                spots.interpolate(&mesh.faces, eye, texture.is_some());
            }
        }
        let tint = surface.base;
        if let Some(texture) = texture {
            match even_texels {
                Some(texels) => spots.texels = [texels; CHUNK],
                None => find_footprints::<CHUNK>(spots, placed, lens, texture.texels()),
            }
            texture.sample(spots.count, [&spots.u, &spots.v], &spots.texels, samples, &mut spots.base);
            for (channel, tint) in spots.base.iter_mut().zip(tint.to_array()) {
                channel.iter_mut().for_each(|value| *value *= tint);
            }
        } else {
            spots.base = [[tint.x; CHUNK], [tint.y; CHUNK], [tint.z; CHUNK]];
        }
        let light = Light {
            lighting: scene.lighting,
            glossy: scene.lighting.sky.glossy(surface.roughness),
            table_light: surface.is_table.then_some(scene.table_light),
            hollow: part.body.and_then(|body| scene.occluders.hollow_of(body)),
            held: (part.instance == ROBOT && surface.metallic > 0.0).then(|| scene.occluders.held()).flatten(),
            bounce: part.body.map_or(1.0, |body| scene.occluders.bounce_of(body)),
        };
        if is_flat {
            reflect_flat([spots, corners], surface, placed, lens, &light, reflected);
        } else {
            reflect(spots, surface, placed, lens, &light, reflected);
        }
    }
}

impl Spots {
    /// Becomes the corners of a tile on one plane, each pixel of which is `tile`'s; says whether all are before the eye.
    fn span(&mut self, tile: &Self) -> bool {
        const BEYOND: f32 = TILE as f32 / (TILE - 1) as f32;
        // Nearness is linear on the image.
        let [first, right, down] = [0, TILE - 1, TILE * (TILE - 1)].map(|pixel| 1.0 / tile.depth[pixel]);
        let (right, down) = ((right - first) * BEYOND, (down - first) * BEYOND);
        let nearness = [first, first + right, first + down, first + right + down];
        for (corner, &nearness) in nearness.iter().enumerate() {
            self.x[corner] = tile.x[0] + (corner % 2 * TILE) as f32;
            self.y[corner] = tile.y[0] + (corner / 2 * TILE) as f32;
            self.depth[corner] = 1.0 / nearness;
        }
        nearness.into_iter().fold(f32::INFINITY, f32::min) > 0.5 * first
    }

    /// Texels per pixel at corners, if the same size of the texture fits all of them.
    fn even_texels(&self) -> Option<f32> {
        let octaves = [0, 1, 2, 3].map(|corner| octave(self.texels[corner]));
        (octaves == [octaves[0]; 4]).then_some(self.texels[0])
    }

    /// Normals and texture coordinates on several triangles; seen from an eye, if both sides can be seen.
    fn interpolate(&mut self, faces: &[Face], eye: Option<Vec3A>, is_textured: bool) {
        let mut mixed = [Vec4::ZERO; CHUNK];
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
            mixed[i] = normal_u;
            if is_textured {
                self.v[i] = face.v.x * x + face.v.y * y + face.v.z * z + face.v.w;
                self.texels[i] = face.plane.w;
            }
        }
        take_apart(&mixed, self);
    }
}

/// Normals and the first texture coordinate, component by component.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn take_apart(mixed: &[Vec4; CHUNK], spots: &mut Spots) {
    for i in 0..CHUNK {
        let [x, y, z, u] = mixed[i].to_array();
        (spots.normal[0][i], spots.normal[1][i], spots.normal[2][i], spots.u[i]) = (x, y, z, u);
    }
}

/// The same where all spots lie on one triangle, with the same bits.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn interpolate_one<const LANES: usize>(spots: &mut Spots, face: &Face, eye: Option<Vec3A>) {
    let columns = face.columns.map(|column| column.to_array());
    let v = face.v.to_array();
    let plane = face.plane.to_array();
    let (eye, can_turn) = eye.map_or(([0.0; 3], false), |eye| (eye.to_array(), true));
    for i in 0..LANES {
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

/// Texture coordinates where all spots lie on one triangle, with the bits of [`interpolate_one`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn place_on_texture(spots: &mut Spots, face: &Face) {
    let columns = face.columns.map(|column| column.w);
    let v = face.v.to_array();
    for i in 0..CHUNK {
        let [x, y, z] = [spots.place[0][i], spots.place[1][i], spots.place[2][i]];
        spots.u[i] = columns[0] * x + columns[1] * y + columns[2] * z + columns[3];
        spots.v[i] = v[0] * x + v[1] * y + v[2] * z + v[3];
    }
}

/// Places in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn locate<const LANES: usize>(spots: &mut Spots, placed: &PartView, lens: &Lens) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let eye = placed.eye_in_body.to_array();
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    for i in 0..LANES {
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
fn find_footprints<const LANES: usize>(spots: &mut Spots, placed: &PartView, lens: &Lens, texels: f32) {
    let inverse_focal = 1.0 / lens.focal.x;
    let eye = placed.eye_in_body.to_array();
    for i in 0..LANES {
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
