//! Normal channel of the output.

use glam::{Vec3A, Vec4};

use crate::gbuffer::view::{View, part_and_triangle};
use crate::scene::assets::RenderAssets;

/// Unit normal towards the camera in camera axes, times 127, at every pixel centre; zero for the background.
pub(crate) fn write<'a>(
    assets: &RenderAssets,
    view: &View,
    seen: impl Iterator<Item = (&'a [f32], &'a [u32])>,
    out: &mut Vec<[i8; 3]>,
) {
    let normal_at = |x: usize, y: usize, reversed_z: f32, id: u32| {
        let Some((part, triangle)) = part_and_triangle(id) else { return [0; 3] };
        let (part, placed, camera) = (&assets.parts[part], &view.parts[part], &view.camera);
        let [x, y] = [x as f32, y as f32];
        let ray = Vec3A::new((x - camera.center.x) / camera.focal.x, (y - camera.center.y) / camera.focal.y, 1.0);
        let direction = placed.body_from_camera * ray;
        let place = placed.viewpoint_in_body + direction / reversed_z;
        let face = &placed.mesh(part).faces[triangle];
        let plane = Vec3A::from_vec4(face.plane);
        let [a, b, c, d] = face.columns;
        let mixed = Vec3A::from_vec4(a * place.x + b * place.y + c * place.z + d * Vec4::ONE);
        let normal = placed.body_from_camera.transpose() * mixed.normalize_or(plane);
        let towards = if plane.dot(direction) > 0.0 { -normal } else { normal };
        (towards * 127.0).to_array().map(|value| value.round() as i8)
    };
    for (y, (reversed_z, ids)) in seen.enumerate() {
        out.extend(
            reversed_z.iter().zip(ids).enumerate().map(|(x, (&reversed_z, &id))| normal_at(x, y, reversed_z, id)),
        );
    }
}
