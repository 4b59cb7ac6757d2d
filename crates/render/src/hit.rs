//! Where rays meet triangles, and what is there: four samples of one part at a time.

use glam::{Mat3A, Vec2, Vec3A, Vec4};

use crate::assets::{Part, RenderAssets};
use crate::lanes::{Vec3x4, each, gather, transpose};
use crate::shade::SurfacePoints;
use crate::view::{Lens, PartView, View};

/// Four points of one part.
pub(crate) struct Hits<'a> {
    pub part: &'a Part,
    pub depth: Vec4,
    /// Not normalised, world frame.
    ray: Vec3x4,
    /// World frame.
    pub point: Vec3x4,
    /// Unit, world frame, towards the viewer.
    pub normal: Vec3x4,
    /// Linear colour, texture included.
    pub base: Vec3x4,
}

impl<'a> Hits<'a> {
    /// Where the rays through points of the image meet the planes of triangles of a part.
    #[inline]
    pub fn new(
        assets: &'a RenderAssets,
        view: &View,
        part: usize,
        triangles: [usize; 4],
        [x, y]: [Vec4; 2],
        table_tint: Vec3A,
    ) -> Self {
        let (part, placed) = (&assets.parts[part], &view.parts[part]);
        let in_camera = rays(&view.lens, x, y);
        let Meeting { face, depth, weights } = meet(part, placed, triangles, in_camera);
        let ray = in_camera.turned(&view.lens.turn);
        let face = face.turned(&placed.world_from_body);
        let along = face.dot(ray);
        let side = Vec4::select(along.cmpgt(Vec4::ZERO), Vec4::NEG_ONE, Vec4::ONE);
        let normal = smooth_normal(part, triangles, weights, &placed.world_from_body, face) * side;
        let mut base = Vec3x4::splat(part.surface.base);
        if let Some(texture) = &part.surface.texture {
            // A grazing view stretches the pixel along one direction; the square root is the compromise.
            let facing = (along.abs() / ray.dot(ray).sqrt()).max(Vec4::splat(0.05));
            let pixel_m = (depth / (facing.sqrt() * view.lens.focal.x)).to_array();
            let corners = each(|lane| part.triangles[triangles[lane]]);
            let mut uv = [Vec4::ZERO; 2];
            for (corner, weight) in weights.into_iter().enumerate() {
                let uvs = each(|lane| part.uvs[corners[lane][corner] as usize]);
                uv[0] += gather(|lane| uvs[lane].x) * weight;
                uv[1] += gather(|lane| uvs[lane].y) * weight;
            }
            let (u, v) = (uv[0].to_array(), uv[1].to_array());
            let colors = each(|lane| {
                texture.sample(Vec2::new(u[lane], v[lane]), part.texel_density[triangles[lane]] * pixel_m[lane])
            });
            base = base * Vec3x4::from_lanes(colors);
        }
        if part.surface.is_table {
            base = base * Vec3x4::splat(table_tint);
        }
        Self { part, depth, ray, point: Vec3x4::splat(view.lens.eye) + ray * depth, normal, base }
    }

    /// What shading wants to know.
    #[inline]
    pub fn lit_by(&self, key_share: Vec4, ambient_share: Vec4) -> SurfacePoints {
        let to_viewer = -(self.ray * self.ray.dot(self.ray).sqrt().recip());
        SurfacePoints { base: self.base, normal: self.normal, to_viewer, key_share, ambient_share }
    }
}

/// Unit surface normal towards the camera, in camera axes, where the ray through a pixel meets a triangle.
pub(crate) fn normal_in_camera(
    part: &Part,
    placed: &PartView,
    lens: &Lens,
    triangle: usize,
    [x, y]: [f32; 2],
) -> Vec3A {
    let in_camera = rays(lens, Vec4::splat(x), Vec4::splat(y));
    let Meeting { face, weights, .. } = meet(part, placed, [triangle; 4], in_camera);
    let camera_from_body = placed.body_from_camera.transpose();
    let face = face.turned(&camera_from_body);
    let [normal, ..] = smooth_normal(part, [triangle; 4], weights, &camera_from_body, face).to_lanes();
    if face.dot(in_camera).x > 0.0 { -normal } else { normal }
}

/// Rays through points of the image in camera axes, 1 along the optical axis.
#[inline]
fn rays(lens: &Lens, x: Vec4, y: Vec4) -> Vec3x4 {
    Vec3x4 { x: (x - lens.center.x) / lens.focal.x, y: (y - lens.center.y) / lens.focal.y, z: Vec4::ONE }
}

/// Where camera rays meet the planes of triangles.
struct Meeting {
    /// Unit normals of the planes, body frame.
    face: Vec3x4,
    depth: Vec4,
    /// Of the three corners, kept within the triangle.
    weights: [Vec4; 3],
}

#[inline]
fn meet(part: &Part, placed: &PartView, triangles: [usize; 4], in_camera: Vec3x4) -> Meeting {
    let direction = in_camera.turned(&placed.body_from_camera);
    let eye = Vec3x4::splat(placed.eye_in_body);
    let faces = each(|lane| &part.faces[triangles[lane]]);
    let (face, offset) = transpose(each(|lane| faces[lane].normal.extend(faces[lane].offset)));
    let along = face.dot(direction);
    let is_cut = along.abs().cmpgt(Vec4::splat(1e-12));
    let depth = Vec4::select(is_cut, (offset - face.dot(eye)) / along, Vec4::ZERO);
    let point = eye + direction * depth;
    let (weight1, offset1) = transpose(each(|lane| faces[lane].weight1.extend(faces[lane].offset1)));
    let (weight2, offset2) = transpose(each(|lane| faces[lane].weight2.extend(faces[lane].offset2)));
    let v = (weight1.dot(point) + offset1).max(Vec4::ZERO).min(Vec4::ONE);
    let w = (weight2.dot(point) + offset2).max(Vec4::ZERO).min(Vec4::ONE - v);
    Meeting { face, depth, weights: [Vec4::ONE - v - w, v, w] }
}

/// Unit normals between those of the corners; those of the faces where the corners' cancel out.
#[inline]
fn smooth_normal(part: &Part, triangles: [usize; 4], weights: [Vec4; 3], turn: &Mat3A, face: Vec3x4) -> Vec3x4 {
    let corners = each(|lane| part.triangles[triangles[lane]]);
    let mut sum = Vec3x4::splat(Vec3A::ZERO);
    for (corner, weight) in weights.into_iter().enumerate() {
        let normals = each(|lane| part.normals[corners[lane][corner] as usize].extend(0.0));
        sum += transpose(normals).0 * weight;
    }
    let mixed = sum.turned(turn);
    let square = mixed.dot(mixed);
    let is_usable = square.cmpgt(Vec4::splat(1e-20));
    Vec3x4::select(is_usable, mixed * square.max(Vec4::splat(1e-20)).sqrt().recip(), face)
}
