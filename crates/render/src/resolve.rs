//! From visible samples to colours.
//!
//! Samples of a pixel that see the same smooth piece of surface are shaded once;
//! only pixels on edges cost more.

use glam::{Vec3, Vec3A};

use crate::assets::{Face, Part, RenderAssets, TRIANGLE_BITS};
use crate::occlusion::Arrival;
use crate::raster::Target;
use crate::shade::{Lighting, SurfacePoint};
use crate::shadow::ShadowMap;
use crate::texture::{linear_from_srgb, linear_from_srgb8, srgb8_from_linear};
use crate::variation::RenderVariation;
use crate::view::{PartView, View, part_and_triangle};

/// Everything a pixel's colour depends on.
pub(crate) struct Resolve<'a> {
    pub assets: &'a RenderAssets,
    pub view: &'a View,
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub arrival: &'a Arrival,
    pub shadow: &'a ShadowMap,
    /// Opaque surfaces with `supersample`² samples per pixel.
    pub opaque: &'a Target,
    /// Sides of transparent surfaces facing away and facing the viewer, sampled alike; `None` without any.
    pub glass: Option<[&'a Target; 2]>,
    pub supersample: usize,
}

/// Largest number of samples per pixel.
const MAX_SAMPLES: usize = 16;

/// Samples of one pixel that are shaded together: at the mean of those that see the first one's triangle.
#[derive(Clone, Copy, Default)]
struct Group {
    id: u32,
    x: f32,
    y: f32,
    count: f32,
}

/// The point of a surface under a sample.
struct Hit<'a> {
    part: &'a Part,
    depth: f32,
    /// Not normalised, world frame.
    ray: Vec3A,
    point: Vec3A,
    /// Unit, towards the viewer.
    normal: Vec3A,
    base: Vec3A,
}

impl Resolve<'_> {
    /// Writes 8-bit sRGB, three bytes per pixel.
    pub fn write_rgb(&self, rgb: &mut Vec<u8>) {
        let (width, height) = (self.view.lens.width, self.view.lens.height);
        rgb.clear();
        rgb.reserve(width * height * 3);
        let table_tint = linear_from_srgb(self.variation.table_color);
        for y in 0..height {
            for x in 0..width {
                rgb.extend(self.pixel(x, y, table_tint));
            }
        }
    }

    fn pixel(&self, x: usize, y: usize, table_tint: Vec3A) -> [u8; 3] {
        let n = self.supersample;
        let first = y * n * self.opaque.width + x * n;
        let sample = |index: usize| first + index / n * self.opaque.width + index % n;
        let samples = n * n;
        let has_glass =
            self.glass.is_some_and(|layers| (0..samples).any(|s| layers.iter().any(|layer| layer.ids[sample(s)] != 0)));
        let id = self.opaque.ids[first];
        let is_uniform = !has_glass && (1..samples).all(|index| self.opaque.ids[sample(index)] == id);
        if is_uniform {
            if id == 0 {
                return self.variation.background;
            }
            return srgb8_from_linear(self.opaque_color([x, y], id, [x as f32, y as f32], table_tint));
        }
        let place = |index: usize| {
            let along = |pixel: usize, step: usize| pixel as f32 + (step as f32 + 0.5) / n as f32 - 0.5;
            [along(x, index % n), along(y, index / n)]
        };
        let mut groups = [Group::default(); MAX_SAMPLES];
        let mut group_of = [0; MAX_SAMPLES];
        let mut count = 0;
        for (index, group_of) in group_of.iter_mut().enumerate().take(samples) {
            let id = self.opaque.ids[sample(index)];
            let [x, y] = place(index);
            let group = (0..count).find(|&group| self.is_same_surface(groups[group].id, id)).unwrap_or(count);
            if group == count {
                groups[group].id = id;
                count += 1;
            }
            let entry = &mut groups[group];
            if entry.id == id {
                (entry.x, entry.y, entry.count) = (entry.x + x, entry.y + y, entry.count + 1.0);
            }
            *group_of = group;
        }
        let background = linear_from_srgb8(self.variation.background);
        let mut colors = [background; MAX_SAMPLES];
        for (group, color) in groups.iter().zip(&mut colors).take(count) {
            if group.id != 0 {
                let middle = [group.x / group.count, group.y / group.count];
                *color = self.opaque_color([x, y], group.id, middle, table_tint);
            }
        }
        let mut sum = Vec3A::ZERO;
        for (index, &group) in group_of.iter().enumerate().take(samples) {
            let color = colors[group];
            sum += if has_glass { self.behind_glass(color, sample(index), [x, y], place(index)) } else { color };
        }
        srgb8_from_linear(sum / samples as f32)
    }

    /// Whether two visibility ids belong to one smooth piece of surface.
    fn is_same_surface(&self, a: u32, b: u32) -> bool {
        if a == b || a >> TRIANGLE_BITS != b >> TRIANGLE_BITS {
            return a == b;
        }
        let (Some((part, first)), Some((_, second))) = (part_and_triangle(a), part_and_triangle(b)) else {
            return false;
        };
        let faces = &self.assets.parts[part].faces;
        faces[first].normal.dot(faces[second].normal) > 0.94
    }

    /// Linear display colour of an opaque surface.
    fn opaque_color(&self, pixel: [usize; 2], id: u32, at: [f32; 2], table_tint: Vec3A) -> Vec3A {
        let Some(hit) = self.hit(id, at, table_tint) else { return Vec3A::ZERO };
        let [key_share, ambient_share] =
            self.arrival.at(pixel[0], pixel[1], id >> TRIANGLE_BITS, hit.depth).unwrap_or_else(|| {
                let pattern = (pixel[0] % 4) * 4 + pixel[1] % 4;
                let is_on = self.shadow.is_on();
                [if is_on { self.shadow.visibility(hit.point, hit.normal, pattern) } else { 1.0 }, 1.0]
            });
        let light = self.lighting.reflect(&hit.part.surface, &hit.surface_point(key_share, ambient_share));
        self.lighting.develop(light.diffuse + light.specular)
    }

    /// A sample's colour seen through the transparent sides in front of it, the farther one first.
    fn behind_glass(&self, behind: Vec3A, sample: usize, pixel: [usize; 2], at: [f32; 2]) -> Vec3A {
        let Some([mut far, mut near]) = self.glass else { return behind };
        if far.nearness[sample] > near.nearness[sample] {
            std::mem::swap(&mut far, &mut near);
        }
        let opaque = self.opaque.nearness[sample];
        [far, near].into_iter().filter(|layer| layer.nearness[sample] > opaque).fold(behind, |behind, layer| {
            let Some(hit) = self.hit(layer.ids[sample], at, Vec3A::ONE) else { return behind };
            let key_share = if self.shadow.is_on() {
                self.shadow.visibility(hit.point, hit.normal, (pixel[0] % 4) * 4 + pixel[1] % 4)
            } else {
                1.0
            };
            let surface = &hit.part.surface;
            let light = self.lighting.reflect(surface, &hit.surface_point(key_share, 1.0));
            // Most sights pass two sides: each covers so much that both together have the material's opacity.
            let side = 1.0 - (1.0 - surface.opacity).sqrt();
            let cover = side + (1.0 - side) * light.grazing;
            // What passes takes on some of the glass's colour.
            let tint = Vec3A::ONE.lerp(hit.base, 0.25);
            self.lighting.develop(light.diffuse * side + light.specular) + behind * tint * (1.0 - cover)
        })
    }

    /// Where the ray through a point of the image meets the plane of a triangle, and what is there.
    fn hit(&self, id: u32, [x, y]: [f32; 2], table_tint: Vec3A) -> Option<Hit<'_>> {
        let (part_index, triangle) = part_and_triangle(id)?;
        let (part, placed) = (&self.assets.parts[part_index], &self.view.parts[part_index]);
        let in_camera = self.view.lens.ray(x, y);
        let face = &part.faces[triangle];
        let (depth, weights) = intersect(face, placed, in_camera);
        let corners = part.triangles[triangle];
        let mix = |values: &[Vec3]| {
            let [a, b, c] = corners.map(|index| Vec3A::from(values[index as usize]));
            a * weights[0] + b * weights[1] + c * weights[2]
        };
        let ray = self.view.lens.turn * in_camera;
        let face = placed.world_from_body * Vec3A::from(face.normal);
        let side = if face.dot(ray) > 0.0 { -1.0 } else { 1.0 };
        let normal = (placed.world_from_body * mix(&part.normals)).normalize_or(face) * side;
        let mut base = part.surface.base;
        if let Some(texture) = &part.surface.texture {
            let [a, b, c] = corners.map(|index| part.uvs[index as usize]);
            let uv = a * weights[0] + b * weights[1] + c * weights[2];
            // A grazing view stretches the pixel along one direction; the square root is the compromise.
            let facing = (face.dot(ray).abs() / ray.length()).max(0.05);
            let pixel_m = depth / self.view.lens.focal.x / facing.sqrt();
            base *= texture.sample(uv, part.texel_density[triangle] * pixel_m);
        }
        if part.surface.is_table {
            base *= table_tint;
        }
        Some(Hit { part, depth, ray, point: self.view.lens.eye + ray * depth, normal, base })
    }
}

impl Hit<'_> {
    fn surface_point(&self, key_share: f32, ambient_share: f32) -> SurfacePoint {
        let to_viewer = -self.ray.normalize();
        SurfacePoint { base: self.base, normal: self.normal, to_viewer, key_share, ambient_share }
    }
}

/// Depth and corner weights where a camera ray meets a triangle's plane; weights are kept within the triangle.
#[inline]
pub(crate) fn intersect(face: &Face, placed: &PartView, in_camera: Vec3A) -> (f32, [f32; 3]) {
    let direction = placed.body_from_camera * in_camera;
    let normal = Vec3A::from(face.normal);
    let along = normal.dot(direction);
    let depth = if along.abs() > 1e-12 { (face.offset - normal.dot(placed.eye_in_body)) / along } else { 0.0 };
    let point = placed.eye_in_body + direction * depth;
    let v = (Vec3A::from(face.weight1).dot(point) + face.offset1).clamp(0.0, 1.0);
    let w = (Vec3A::from(face.weight2).dot(point) + face.offset2).clamp(0.0, 1.0 - v);
    (depth, [1.0 - v - w, v, w])
}
