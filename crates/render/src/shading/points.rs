//! Batches of shading points: positions, normals and texture coordinates on the surface.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec3A;
use multiversion::multiversion;

use crate::gbuffer::points::Pixels;
use crate::gbuffer::view::{CameraView, PartView};
use crate::scene::material::Material;
use crate::scene::mesh::Face;
use crate::scene::texture::Samples;
use crate::simd::{BatchColumn, CHUNK, dot, turned};

/// Batch of shading points of one part.
#[derive(Clone, Debug, Default)]
pub(super) struct ShadingPoints {
    /// Image positions, depths and triangles of the points; positions need not be pixel centres.
    pub pixels: Pixels,
    /// Shadow mask and ambient occlusion: unoccluded shares of key light and ambient light, 0-1.
    pub shadow: BatchColumn,
    pub ambient: BatchColumn,
    /// Positions in the body's frame (m).
    pub place: [BatchColumn; 3],
    /// Interpolated normals, not normalised, and texture coordinates.
    pub normal: [BatchColumn; 3],
    pub u: BatchColumn,
    pub v: BatchColumn,
    /// Texture area per surface area (1/m²), later replaced by texels per pixel.
    pub texels: BatchColumn,
    pub base: [BatchColumn; 3],
    /// 1 where the base colour is photographed, else 0.
    pub photographed: BatchColumn,
}

impl ShadingPoints {
    /// Samples the linear base colour at all points, from texture or material.
    pub fn paint(&mut self, material: &Material, samples: &mut Samples) {
        let tint = material.base.to_array();
        match &material.texture {
            Some(texture) => {
                texture.sample(self.pixels.count, [&self.u, &self.v], &self.texels, tint, samples, &mut self.base);
            }
            None => self.base = tint.map(BatchColumn::of),
        }
    }
}

/// Interpolates normals and texture coordinates where points lie on different triangles; `viewpoint` is `None` if no
/// back face is visible.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn interpolate(points: &mut ShadingPoints, faces: &[Face], viewpoint: Option<Vec3A>, is_textured: bool) {
    let viewpoint = viewpoint.map(|viewpoint| viewpoint.to_array());
    let mut mixed = [[0.0; 4]; CHUNK];
    for i in 0..points.pixels.count.min(CHUNK) {
        let face = &faces[points.pixels.triangle[i] as usize];
        let place = [points.place[0][i], points.place[1][i], points.place[2][i]];
        let columns = face.columns.map(|column| column.to_array());
        for row in 0..4 {
            mixed[i][row] = at(columns.map(|column| column[row]), place);
        }
        // A back face's normal is flipped towards the viewer.
        if let Some(viewpoint) = viewpoint
            && is_away(face, place, viewpoint)
        {
            (0..3).for_each(|axis| mixed[i][axis] = -mixed[i][axis]);
        }
        if is_textured {
            points.v[i] = at(face.v.to_array(), place);
            points.texels[i] = face.plane.w;
        }
    }
    for i in 0..CHUNK {
        let [x, y, z, u] = mixed[i];
        (points.normal[0][i], points.normal[1][i], points.normal[2][i], points.u[i]) = (x, y, z, u);
    }
}

/// Value at a position of a linear function, given by gradient and constant.
#[inline(always)]
fn at([x, y, z, first]: [f32; 4], place: [f32; 3]) -> f32 {
    dot([x, y, z], place) + first
}

/// True if the viewer sees a triangle's back face at a position; all in the body's frame.
#[inline(always)]
fn is_away(face: &Face, place: [f32; 3], viewpoint: [f32; 3]) -> bool {
    let [x, y, z, _] = face.plane.to_array();
    dot([x, y, z], [place[0] - viewpoint[0], place[1] - viewpoint[1], place[2] - viewpoint[2]]) > 0.0
}

/// [`interpolate`] for points on a single triangle; results have the same bits.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn interpolate_one<const LANES: usize>(points: &mut ShadingPoints, face: &Face, viewpoint: Option<Vec3A>) {
    let columns = face.columns.map(|column| column.to_array());
    let v = face.v.to_array();
    let (viewpoint, can_turn) = viewpoint.map_or(([0.0; 3], false), |viewpoint| (viewpoint.to_array(), true));
    for i in 0..LANES {
        let place = [points.place[0][i], points.place[1][i], points.place[2][i]];
        let mixed = |row: usize| at(columns.map(|column| column[row]), place);
        let side = if can_turn & is_away(face, place, viewpoint) { -1.0 } else { 1.0 };
        points.normal[0][i] = mixed(0) * side;
        points.normal[1][i] = mixed(1) * side;
        points.normal[2][i] = mixed(2) * side;
        points.u[i] = mixed(3);
        points.v[i] = at(v, place);
        points.texels[i] = face.plane.w;
    }
}

/// Computes the positions of the points in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn locate<const LANES: usize>(points: &mut ShadingPoints, placed: &PartView, camera: &CameraView) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let viewpoint = placed.viewpoint_in_body.to_array();
    let (inverse_x, inverse_y) = (1.0 / camera.focal.x, 1.0 / camera.focal.y);
    for i in 0..LANES {
        let depth = points.pixels.depth[i];
        let x = (points.pixels.column[i] - camera.center.x) * inverse_x * depth;
        let y = (points.pixels.row[i] - camera.center.y) * inverse_y * depth;
        for axis in 0..3 {
            points.place[axis][i] = turned(&turn, axis, [x, y, depth]) + viewpoint[axis];
        }
    }
}

/// Replaces the texture area per surface area by texels per pixel; `texels` is the number of texels of the texture.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn find_footprints<const LANES: usize>(
    points: &mut ShadingPoints,
    placed: &PartView,
    camera: &CameraView,
    texels: f32,
) {
    let inverse_focal = 1.0 / camera.focal.x;
    let viewpoint = placed.viewpoint_in_body.to_array();
    for i in 0..LANES {
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let ray =
            [points.place[0][i] - viewpoint[0], points.place[1][i] - viewpoint[1], points.place[2][i] - viewpoint[2]];
        let along = dot(normal, ray).abs();
        let facing = along / dot(ray, ray).mul_add(dot(normal, normal), 1e-20).sqrt();
        // At grazing angles a pixel covers an elongated area of the texture; the square root is a compromise between
        // its length and width.
        let facing = (if facing > 0.05 { facing } else { 0.05 }).sqrt();
        points.texels[i] = (points.texels[i] * texels).sqrt() * points.pixels.depth[i] * inverse_focal / facing;
    }
}
