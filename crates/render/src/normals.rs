//! The channel of surface normals.

use glam::{Vec3A, Vec4};

use crate::assets::RenderAssets;
use crate::raster::Target;
use crate::view::{View, part_and_triangle};

/// Unit surface normal towards the camera in camera axes times 127 at every pixel's centre; zero where nothing is seen.
pub(crate) fn write(assets: &RenderAssets, view: &View, seen: &Target, out: &mut Vec<[i8; 3]>) {
    let normal_at = |x: usize, y: usize, nearness: f32, id: u32| {
        let Some((part, triangle)) = part_and_triangle(id) else { return [0; 3] };
        let (part, placed, lens) = (&assets.parts[part], &view.parts[part], &view.lens);
        let [x, y] = [x as f32, y as f32];
        let ray = Vec3A::new((x - lens.center.x) / lens.focal.x, (y - lens.center.y) / lens.focal.y, 1.0);
        let direction = placed.body_from_camera * ray;
        let place = placed.eye_in_body + direction / nearness;
        let face = &placed.mesh(part).faces[triangle];
        let plane = Vec3A::from_vec4(face.plane);
        let [a, b, c, d] = face.columns;
        let mixed = Vec3A::from_vec4(a * place.x + b * place.y + c * place.z + d * Vec4::ONE);
        let normal = placed.body_from_camera.transpose() * mixed.normalize_or(plane);
        let towards = if plane.dot(direction) > 0.0 { -normal } else { normal };
        (towards * 127.0).to_array().map(|value| value.round() as i8)
    };
    for (y, (nearness, ids)) in seen.rows().enumerate() {
        out.extend(nearness.iter().zip(ids).enumerate().map(|(x, (&nearness, &id))| normal_at(x, y, nearness, id)));
    }
}
