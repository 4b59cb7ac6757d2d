//! The colour of a surface: metallic-roughness reflection of the key light and of the surroundings.
//!
//! GGX distribution with Hammon's approximation of the Smith visibility and Schlick's Fresnel term;
//! the surroundings through Karis' analytic fit of the split sum ("Physically Based Shading on Mobile", 2014).
//! A chunk of points of one part at a time.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec3A;

use crate::arrival::Arrival;
use crate::assets::Surface;
use crate::job::ROBOT;
use crate::lanes::{CHUNK, Lane, REGISTER};
use crate::layers::TILE;
use crate::mesh::Face;
use crate::points::{Centers, TRIANGLE};
use crate::raster::Planes;
use crate::scene::Scene;
use crate::texture::{Samples, find_codes, srgb_table};
use crate::view::{Lens, PartView, View};

mod flat;
mod reflect;
mod spots;
mod tile_nodes;

use flat::Nodes;
use reflect::{Light, Reflected, reflect, reflect_flat};
use spots::{Spots, find_footprints, interpolate, interpolate_one, locate};

/// A part as it is shaded: what it is made of, how it stands before a lens, and the light on it.
#[derive(Debug)]
pub(crate) struct Appearance<'a> {
    faces: &'a [Face],
    planes: &'a Planes,
    /// In the body's frame, where both sides of triangles can be seen.
    eye: Option<Vec3A>,
    surface: &'a Surface,
    placed: &'a PartView,
    lens: &'a Lens,
    light: Light<'a>,
}

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
    nodes: Nodes,
    samples: Samples,
    reflected: Reflected,
    /// Places of the colours in the table of bytes.
    codes: [[u32; CHUNK]; 3],
}

impl Default for Shading {
    fn default() -> Self {
        let (spots, nodes, samples, reflected) = Default::default();
        Self { spots, nodes, samples, reflected, codes: [[0; CHUNK]; 3] }
    }
}

impl Shading {
    /// Starts a new chunk.
    pub fn clear(&mut self) {
        let pixels = &mut self.spots.pixels;
        (pixels.count, pixels.is_tile, pixels.is_flat) = (0, false, true);
    }

    /// Adds a spot.
    pub fn push(&mut self, spot: Spot) {
        let Spots { pixels, key, ambient, .. } = &mut self.spots;
        let i = pixels.count;
        (pixels.column[i], pixels.row[i], pixels.depth[i]) = (spot.x, spot.y, spot.depth);
        (key[i], ambient[i]) = (spot.key, spot.ambient);
        pixels.triangle[i] = spot.id & TRIANGLE;
        pixels.is_flat &= pixels.triangle[i] == pixels.triangle[0];
        pixels.count += 1;
    }

    /// Takes the centres of listed pixels, which are packed, and the light that arrives there.
    pub fn list(&mut self, places: &[u32], arrival: &Arrival) {
        let Spots { pixels, key, ambient, .. } = &mut self.spots;
        pixels.list(places, arrival.centers());
        for (i, &pixel) in pixels.pixel.iter().enumerate().take(pixels.count) {
            (key[i], ambient[i]) = (arrival.key[pixel as usize], arrival.ambient[pixel as usize]);
        }
        limit(key);
    }

    /// The same of a tile, given by its first pixel, which is packed.
    fn tile(&mut self, place: u32, arrival: &Arrival) {
        self.spots.pixels.tile(place, arrival.centers());
        self.light(place, arrival);
    }

    /// Takes the light that arrives at the pixels of a tile.
    fn light(&mut self, place: u32, arrival: &Arrival) {
        let Spots { key, ambient, .. } = &mut self.spots;
        let (tile, first) = arrival.tile_at(place);
        for (lane, field) in [(&mut *key, &arrival.key), (ambient, &arrival.ambient)] {
            if let Some(value) = field.even(tile) {
                *lane = [value; CHUNK];
                continue;
            }
            for (lane, values) in lane.as_chunks_mut::<TILE>().0.iter_mut().zip(arrival.lines(field, first)) {
                *lane = *values;
            }
        }
        limit(key);
    }

    /// Writes the spots, which are the centres of pixels, into an image: linear display colours, unless they are an empty list,
    /// which only the pixels of a tile may get, and bytes.
    pub fn write(&mut self, colors: &mut [Vec3A], rgb: &mut [u8]) {
        find_codes(&self.reflected.color, &mut self.codes);
        let pixels = &self.spots.pixels;
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

    /// Linear display colours of all spots.
    pub fn colors(&self) -> &[Lane; 3] {
        &self.reflected.color
    }

    /// Unit normals in the world, towards the viewer, and their cosines to the direction to the viewer.
    pub fn normals(&self) -> (&[Lane; 3], &Lane) {
        (&self.reflected.normal, &self.reflected.facing)
    }

    /// Linear colours of the material.
    pub fn bases(&self) -> &[Lane; 3] {
        &self.spots.base
    }

    /// Lights nodes around the first of some tiles that show a part, given by their first pixels, as far as they may be
    /// shaded by them; returns how many tiles are ready for [`Shading::shade_tile`]. Several of them show one triangle.
    pub fn light_nodes(&mut self, tiles: &[u32], appearance: &Appearance<'_>, arrival: &Arrival) -> usize {
        if appearance.is_smooth()
            && let Some(triangle) = self.triangle_of(tiles[0], arrival.centers())
        {
            return self.nodes.find(tiles, triangle, appearance, arrival.centers());
        }
        self.nodes.forget();
        tiles.len()
    }

    /// The one triangle that a tile shows.
    fn triangle_of(&mut self, place: u32, centers: Centers<'_>) -> Option<u32> {
        if let Some(id) = centers.only(place) {
            return Some(id & TRIANGLE);
        }
        let pixels = &mut self.spots.pixels;
        pixels.tile(place, centers);
        pixels.is_flat.then_some(pixels.triangle[0])
    }

    /// Shades the pixels of one of the tiles that are ready, given by its first one; returns its index.
    pub fn shade_tile(&mut self, tile: usize, place: u32, appearance: &Appearance<'_>, arrival: &Arrival) -> usize {
        let (index, first) = arrival.tile_at(place);
        let Some(around) = self.nodes.around(tile) else {
            self.tile(place, arrival);
            self.shade(appearance);
            return index;
        };
        self.light(place, arrival);
        let Self { spots, nodes, samples, reflected, .. } = self;
        spots.pixels.begin_tile(first, arrival.centers());
        if appearance.surface.texture.is_some() {
            nodes.place_on_texture(&around, arrival.lines(&arrival.depth, first), [&mut spots.u, &mut spots.v]);
        }
        spots.paint(appearance.surface, Some(nodes.texels(&around)), samples);
        reflect_flat(spots, &nodes.light, &around, appearance, reflected);
        index
    }

    /// Shades the spots, which show a part.
    pub fn shade(&mut self, appearance: &Appearance<'_>) {
        let Self { spots, samples, reflected, .. } = self;
        let &Appearance { faces, eye, surface, placed, lens, .. } = appearance;
        match spots.pixels.count <= REGISTER {
            true => locate::<REGISTER>(spots, placed, lens),
            false => locate::<CHUNK>(spots, placed, lens),
        }
        match spots.pixels.is_flat {
            true => interpolate_one::<CHUNK>(spots, &faces[spots.pixels.triangle[0] as usize], eye),
            false => interpolate(spots, faces, eye, surface.texture.is_some()),
        }
        if let Some(texture) = &surface.texture {
            find_footprints::<CHUNK>(spots, placed, lens, texture.texels());
        }
        spots.paint(surface, None, samples);
        reflect(spots, appearance, reflected);
    }
}

/// Moves estimates of the key light that are less than nothing.
#[inline(always)]
fn limit(key: &mut Lane) {
    for key in key {
        *key = if *key > 0.0 { *key } else { 0.0 };
    }
}

impl<'a> Appearance<'a> {
    /// Of a part in a view.
    pub fn new(scene: &'a Scene<'_>, view: &'a View, index: usize) -> Self {
        let (part, surface, placed) = (&scene.assets.parts[index], &scene.surfaces[index], &view.parts[index]);
        let mesh = placed.mesh(part);
        let light = Light {
            lighting: scene.lighting,
            glossy: scene.lighting.sky.glossy(surface.roughness),
            table_light: surface.is_table.then_some(scene.table_light),
            table_top: part.body.and(scene.table_light.top()),
            table_lit: part.body.map_or(1.0, |body| scene.occluders.lit_of(body)),
            hollow: part.body.and_then(|body| scene.occluders.hollow_of(body)),
            mirrored: match part.body {
                Some(body) if part.instance == ROBOT && surface.metallic > 0.0 => scene.occluders.mirrored_by(body),
                _ => [None; 2],
            },
            bounce: part.body.map_or(1.0, |body| scene.occluders.bounce_of(body)),
        };
        let eye = (!part.hides_back(mesh)).then_some(placed.eye_in_body);
        Self { faces: &mesh.faces, planes: &mesh.planes, eye, surface, placed, lens: &view.lens, light }
    }

    /// Whether light is linear over tiles on a plane of the part.
    fn is_smooth(&self) -> bool {
        let Surface { metallic, opacity, roughness, .. } = *self.surface;
        let is_dull = metallic == 0.0 && opacity >= 1.0 && roughness >= SMOOTH;
        is_dull && self.lens.focal.min_element() >= NARROW_PX
    }
}
