//! Path tracing from the camera to the lights.

use glam::{Mat3A, Vec2, Vec3A, Vec4};

use super::lamps::LightSample;
use super::reflection::{Reflection, dielectric};
use super::samples::Samples;
use crate::scene::{Body, Brought, Reference};
use genmanip_render::internals::{Face, Material};

/// Largest number of interfaces and scattering events of a path.
const LONGEST: usize = 24;
/// Number of scattering events before Russian roulette begins.
const SURE: usize = 3;
/// Largest indirect contribution of a path, relative to a white surface that faces a key light of intensity 1. Clamping
/// suppresses fireflies, and makes images slightly too dark.
const BRIGHTEST: f32 = 4.0;
/// Smallest squared roughness of surfaces hit after a scattering event: sharp caustics would only be found by rare
/// paths (Kaplanyan and Dachsbacher, "Path Space Regularization", 2013).
const DULLEST: f32 = 0.2;
/// Offset of ray origins from a surface against self-intersection (m).
const LIFT_M: f32 = 1e-4;

/// Intersection of a ray with a surface.
struct Point {
    place: Vec3A,
    /// Unit normals on the side from which the ray comes: geometric, then interpolated.
    flat: Vec3A,
    smooth: Vec3A,
    /// True if the ray hits the front face of the triangle.
    is_outside: bool,
    base: Vec3A,
}

impl Reference<'_> {
    /// Follows a ray with unit direction until it leaves the scene or is absorbed; returns the contribution of the
    /// path.
    pub(crate) fn follow(&self, mut origin: Vec3A, mut direction: Vec3A, samples: &mut Samples) -> Brought {
        let mut brought = Brought::default();
        let mut share = Vec3A::ONE;
        // Probability density of the last scattering event; `None` after specular events only.
        let mut chance: Option<f32> = None;
        let (mut is_view, mut scattered) = (true, 0);
        for _ in 0..LONGEST {
            let Some(hit) = self.bvh.nearest(origin, direction) else {
                if is_view {
                    brought.behind = share;
                    brought.background = share * self.backdrop.color(origin, direction);
                } else {
                    brought.add(share * self.arriving(direction, chance), scattered);
                }
                break;
            };
            let (body, material) = (&self.bodies[hit.part], &self.materials[hit.part]);
            let face = &body.mesh.faces[hit.triangle];
            let point = body.point(material, face, origin + direction * hit.distance, direction);
            let side = material.scatters();
            if side < 1.0 {
                // After a scattering event, rays pass transparent objects without refraction, as shadow rays do.
                let bends = body.mesh.closed && scattered == 0;
                let index = material.index_of_refraction();
                let ratio = if point.is_outside || !bends { 1.0 / index } else { index };
                let cosine = -direction.dot(point.smooth);
                let Vec2 { x: mirror, y: cover } = samples.two();
                if mirror < dielectric(cosine, ratio) {
                    direction = (direction + point.smooth * (2.0 * cosine)).normalize();
                    (origin, is_view, chance) = (point.above(direction), false, None);
                    continue;
                }
                if cover >= side {
                    share *= material.tint(point.base, cosine, !body.mesh.closed);
                    if bends {
                        let behind = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).max(0.0).sqrt();
                        direction = (direction * ratio + point.smooth * (ratio * cosine - behind)).normalize();
                    }
                    origin = point.above(direction);
                    continue;
                }
            }
            is_view = false;
            let reflection = reflection_of(material, point.base, side);
            let least = if scattered > 0 { DULLEST } else { 0.0 };
            let reflection = Reflection { alpha: reflection.alpha.max(least), ..reflection };
            let (right, up) = point.smooth.any_orthonormal_pair();
            let frame = Mat3A::from_cols(right, up, point.smooth);
            let out = frame.transpose() * -direction;
            for sample in [self.lamps.draw_key(samples.two()), self.lamps.draw_studio(samples.one(), samples.two())] {
                brought.add(share * self.lit(&reflection, &frame, out, &point, sample), scattered);
            }
            let into = reflection.sample(out, samples.one(), samples.two());
            let (value, drawn) = reflection.evaluate(out, into);
            direction = (frame * into).normalize();
            if drawn <= 0.0 || direction.dot(point.flat) <= 0.0 {
                break;
            }
            share *= value / drawn;
            (origin, chance) = (point.above(direction), Some(drawn));
            scattered += 1;
            if scattered > SURE {
                let stays = share.max_element().clamp(0.05, 0.95);
                if samples.one() >= stays {
                    break;
                }
                share /= stays;
            }
        }
        brought
    }

    /// Environment and key light along a ray that leaves the scene, weighted by multiple importance sampling (Veach and
    /// Guibas, "Optimally Combining Sampling Techniques", 1995).
    fn arriving(&self, direction: Vec3A, chance: Option<f32>) -> Vec3A {
        let weight = |lamp: f32| chance.map_or(1.0, |chance| power(chance, lamp));
        let lamps = &self.lamps;
        lamps.studio(direction) * weight(lamps.studio_chance(direction))
            + lamps.key(direction) * weight(lamps.key_chance(direction))
    }

    /// Contribution of a sampled light direction: light reflected towards the viewer, weighted by multiple importance
    /// sampling.
    fn lit(&self, reflection: &Reflection, frame: &Mat3A, out: Vec3A, point: &Point, sample: LightSample) -> Vec3A {
        let LightSample { direction, radiance, chance } = sample;
        if direction.dot(point.flat) <= 0.0 {
            return Vec3A::ZERO;
        }
        let (value, scattered) = reflection.evaluate(out, frame.transpose() * direction);
        if value == Vec3A::ZERO {
            return Vec3A::ZERO;
        }
        value * radiance * self.passing(point.above(direction), direction) * (power(chance, scattered) / chance)
    }

    /// Transmittance along a shadow ray, per colour channel.
    fn passing(&self, origin: Vec3A, direction: Vec3A) -> Vec3A {
        let mut share = Vec3A::ONE;
        self.bvh.walk(origin, direction, |triangle, distance| {
            let part = triangle.part as usize;
            let (body, material) = (&self.bodies[part], &self.materials[part]);
            let side = material.scatters();
            share = if side < 1.0 && share != Vec3A::ZERO {
                let face = &body.mesh.faces[triangle.index as usize];
                let point = body.point(material, face, origin + direction * distance, direction);
                // The ray passes without refraction, so both interfaces are treated as entered from outside.
                let ratio = 1.0 / material.index_of_refraction();
                let cosine = -direction.dot(point.smooth);
                let tint = material.tint(point.base, cosine, !body.mesh.closed);
                share * tint * ((1.0 - side) * (1.0 - dielectric(cosine, ratio)))
            } else {
                Vec3A::ZERO
            };
            if share == Vec3A::ZERO { 0.0 } else { f32::INFINITY }
        });
        share
    }
}

impl Brought {
    fn add(&mut self, light: Vec3A, scattered: usize) {
        let limit = if scattered == 0 { f32::INFINITY } else { BRIGHTEST };
        let peak = light.max_element();
        if peak.is_finite() {
            self.radiance += if peak > limit { light * (limit / peak) } else { light };
        }
    }
}

impl Body<'_> {
    fn point(&self, material: &Material, face: &Face, place: Vec3A, direction: Vec3A) -> Point {
        let local = self.body_from_world.transform_point3a(place);
        let [a, b, c, d] = face.columns;
        let mixed = a * local.x + b * local.y + c * local.z + d;
        let turn = self.body_from_world.matrix3.transpose();
        let flat = turn * Vec3A::from_vec4(face.plane);
        let is_outside = flat.dot(direction) <= 0.0;
        let flat = if is_outside { flat } else { -flat };
        let smooth = (turn * Vec3A::from_vec4(mixed)).normalize_or(flat);
        let smooth = if smooth.dot(flat) < 0.0 { -smooth } else { smooth };
        // At silhouettes, the interpolated normal may face away from the viewer; then the geometric one is used.
        let smooth = if smooth.dot(direction) < -1e-3 { smooth } else { flat };
        let v = face.v.dot(Vec4::from((glam::Vec3::from(local), 1.0)));
        let base = material.texture.as_ref().map_or(Vec3A::ONE, |texture| texture.at(Vec2::new(mixed.w, v)));
        Point { place, flat, smooth, is_outside, base: base * material.base }
    }
}

impl Point {
    /// Origin of a ray that leaves the point in a direction, offset to that side of the surface.
    fn above(&self, direction: Vec3A) -> Vec3A {
        self.place + self.flat * LIFT_M.copysign(direction.dot(self.flat))
    }
}

/// BSDF of a material at a point. A transparent interface reflects specularly in [`Reference::follow`], so only its
/// diffuse part remains here; `side` is the share that it scatters.
fn reflection_of(material: &Material, base: Vec3A, side: f32) -> Reflection {
    let head_on = if side < 1.0 { Vec3A::ZERO } else { Vec3A::splat(material.reflectance) };
    Reflection {
        albedo: base * (1.0 - material.metallic),
        f0: head_on.lerp(base, material.metallic),
        alpha: (material.roughness * material.roughness).max(1e-3),
    }
}

/// Power heuristic: weight of a sample with density `own` where another technique has density `other`.
fn power(own: f32, other: f32) -> f32 {
    let (own, other) = (own * own, other * other);
    if own + other > 0.0 { own / (own + other) } else { 0.0 }
}
