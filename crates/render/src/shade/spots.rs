//! Places on the image where a part is shaded, as points of its surface.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec3A;
use multiversion::multiversion;

use crate::assets::Surface;
use crate::lanes::{CHUNK, Lane, ZERO, dot, turned};
use crate::mesh::Face;
use crate::points::Pixels;
use crate::texture::{Detail, Samples};
use crate::view::{Lens, PartView};

/// Spots of one part, component by component.
#[derive(Clone, Debug)]
pub(super) struct Spots {
    /// Where they are on the image, not always at the centres of pixels, and what is seen there.
    pub pixels: Pixels,
    /// Shares of the key light and of the ambient light that arrive.
    pub key: Lane,
    pub ambient: Lane,
    /// In the body's frame.
    pub place: [Lane; 3],
    /// Normal between the corners', not of unit length, and texture coordinates.
    pub normal: [Lane; 3],
    pub u: Lane,
    pub v: Lane,
    /// Square texture units per square metre, then texels per pixel.
    pub texels: Lane,
    pub base: [Lane; 3],
}

impl Default for Spots {
    fn default() -> Self {
        Self {
            pixels: Pixels::default(),
            key: ZERO,
            ambient: ZERO,
            place: [ZERO; 3],
            normal: [ZERO; 3],
            u: ZERO,
            v: ZERO,
            texels: ZERO,
            base: [ZERO; 3],
        }
    }
}

impl Spots {
    /// Finds the linear colour of the material at all spots; with as many texels per pixel everywhere, or as many as each
    /// of them has.
    pub fn paint(&mut self, surface: &Surface, even_texels: Option<f32>, samples: &mut Samples) {
        let tint = surface.base.to_array();
        match &surface.texture {
            Some(texture) => {
                let detail = even_texels.map_or(Detail::Each(&self.texels), Detail::Even);
                texture.sample(self.pixels.count, [&self.u, &self.v], detail, tint, samples, &mut self.base);
            }
            None => self.base = tint.map(|tint| [tint; CHUNK]),
        }
    }
}

/// Normals and texture coordinates on several triangles; seen from an eye, if both sides can be seen.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn interpolate(spots: &mut Spots, faces: &[Face], eye: Option<Vec3A>, is_textured: bool) {
    let eye = eye.map(|eye| eye.to_array());
    let mut mixed = [[0.0; 4]; CHUNK];
    for i in 0..spots.pixels.count.min(CHUNK) {
        let face = &faces[spots.pixels.triangle[i] as usize];
        let place = [spots.place[0][i], spots.place[1][i], spots.place[2][i]];
        let columns = face.columns.map(|column| column.to_array());
        for row in 0..4 {
            mixed[i][row] = at(columns.map(|column| column[row]), place);
        }
        // The side that is seen is the one towards the eye.
        if let Some(eye) = eye
            && is_away(face, place, eye)
        {
            (0..3).for_each(|axis| mixed[i][axis] = -mixed[i][axis]);
        }
        if is_textured {
            spots.v[i] = at(face.v.to_array(), place);
            spots.texels[i] = face.plane.w;
        }
    }
    for i in 0..CHUNK {
        let [x, y, z, u] = mixed[i];
        (spots.normal[0][i], spots.normal[1][i], spots.normal[2][i], spots.u[i]) = (x, y, z, u);
    }
}

/// A linear function, given by its slopes and its value at the origin, at a place.
#[inline(always)]
fn at([x, y, z, first]: [f32; 4], place: [f32; 3]) -> f32 {
    dot([x, y, z], place) + first
}

/// Whether a triangle shows its back at a place.
#[inline(always)]
fn is_away(face: &Face, place: [f32; 3], eye: [f32; 3]) -> bool {
    let [x, y, z, _] = face.plane.to_array();
    dot([x, y, z], [place[0] - eye[0], place[1] - eye[1], place[2] - eye[2]]) > 0.0
}

/// [`interpolate`] where all spots lie on one triangle, with the same bits.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn interpolate_one<const LANES: usize>(spots: &mut Spots, face: &Face, eye: Option<Vec3A>) {
    let columns = face.columns.map(|column| column.to_array());
    let v = face.v.to_array();
    let (eye, can_turn) = eye.map_or(([0.0; 3], false), |eye| (eye.to_array(), true));
    for i in 0..LANES {
        let place = [spots.place[0][i], spots.place[1][i], spots.place[2][i]];
        let mixed = |row: usize| at(columns.map(|column| column[row]), place);
        let side = if can_turn & is_away(face, place, eye) { -1.0 } else { 1.0 };
        spots.normal[0][i] = mixed(0) * side;
        spots.normal[1][i] = mixed(1) * side;
        spots.normal[2][i] = mixed(2) * side;
        spots.u[i] = mixed(3);
        spots.v[i] = at(v, place);
        spots.texels[i] = face.plane.w;
    }
}

/// Places in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn locate<const LANES: usize>(spots: &mut Spots, placed: &PartView, lens: &Lens) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let eye = placed.eye_in_body.to_array();
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    for i in 0..LANES {
        let depth = spots.pixels.depth[i];
        let x = (spots.pixels.column[i] - lens.center.x) * inverse_x * depth;
        let y = (spots.pixels.row[i] - lens.center.y) * inverse_y * depth;
        for axis in 0..3 {
            spots.place[axis][i] = turned(&turn, axis, [x, y, depth]) + eye[axis];
        }
    }
}

/// Texels per pixel; square texture units per square metre go in.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn find_footprints<const LANES: usize>(spots: &mut Spots, placed: &PartView, lens: &Lens, texels: f32) {
    let inverse_focal = 1.0 / lens.focal.x;
    let eye = placed.eye_in_body.to_array();
    for i in 0..LANES {
        let normal = [spots.normal[0][i], spots.normal[1][i], spots.normal[2][i]];
        let ray = [spots.place[0][i] - eye[0], spots.place[1][i] - eye[1], spots.place[2][i] - eye[2]];
        let along = dot(normal, ray).abs();
        let facing = along / dot(ray, ray).mul_add(dot(normal, normal), 1e-20).sqrt();
        // A grazing view stretches the pixel along one direction; the square root is the compromise.
        let facing = (if facing > 0.05 { facing } else { 0.05 }).sqrt();
        spots.texels[i] = (spots.texels[i] * texels).sqrt() * spots.pixels.depth[i] * inverse_focal / facing;
    }
}
