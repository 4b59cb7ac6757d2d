//! Background: a constant colour or a room.
//!
//! The room is an image behind everything: it has no depth and no ids, and is not reflected.

use std::sync::Arc;

use genmanip_core::Material;
use glam::{Vec2, Vec3A};

use crate::lights::lighting::Lighting;
use crate::scene::texture::{MipTexture, linear_from_srgb8};
use crate::scene::variation::RenderVariation;
use crate::scene::walls::WALL_SIZE_M;
use crate::shading::tone_map::tone_map;

/// Lower and upper corner of the room in the world (m). Chosen by hand around the default cameras, 1 cm below the
/// floor of the default world.
const LOW: Vec3A = Vec3A::new(-1.9, -2.7, -0.75);
const HIGH: Vec3A = Vec3A::new(3.6, 2.9, 2.2);
/// Distance (m) over which a room darkens towards its edges, and the share of light lost there. Chosen by hand.
const EDGE: (f32, f32) = (0.35, 0.3);
/// Brightness of the ceiling relative to the ambient light. Chosen by hand.
const CEILING: f32 = 0.7;
/// Share of the key light that reaches walls and floor. Chosen by hand: the key light is aimed at the scene.
const KEY_SHARE: f32 = 0.4;

/// Background colours after tone mapping.
#[derive(Debug)]
pub struct Backdrop {
    plain: Vec3A,
    room: Option<Lit>,
}

/// Room with its textures and illumination.
#[derive(Debug)]
struct Lit {
    wall: Arc<MipTexture>,
    floor: Arc<MipTexture>,
    /// Radiance of a white diffuse surface times exposure: by axis, at the lower and at the higher coordinate.
    light: [[Vec3A; 2]; 3],
}

impl Backdrop {
    /// Background of a variation, lit by `lighting`.
    pub fn new(variation: &RenderVariation, lighting: &Lighting) -> Self {
        let room = variation.room.and_then(|room| {
            let shared = |material: Material| material.texture.as_ref().and_then(MipTexture::shared);
            let light = |axis: usize, sign: f32| {
                let mut normal = Vec3A::ZERO;
                normal[axis] = sign;
                // Lamps below the ceiling light it: ambient light of an upward surface, scaled by `CEILING`.
                let around =
                    if axis == 2 && sign < 0.0 { lighting.around(Vec3A::Z) * CEILING } else { lighting.around(normal) };
                around + lighting.key * (lighting.to_light.dot(normal).max(0.0) * KEY_SHARE)
            };
            let light =
                [0, 1, 2].map(|axis| [light(axis, 1.0), light(axis, -1.0)].map(|light| light * variation.exposure));
            Some(Lit { wall: shared(room.wall.material())?, floor: shared(room.floor.material())?, light })
        });
        Self { plain: linear_from_srgb8(variation.background), room }
    }

    /// Background colour if it is constant; `None` if there is a room.
    pub fn plain(&self) -> Option<Vec3A> {
        self.room.is_none().then_some(self.plain)
    }

    /// Background colour along a view ray; a room is visible from inside only, from outside the constant colour is.
    pub fn color(&self, viewpoint: Vec3A, ray: Vec3A) -> Vec3A {
        let is_inside = viewpoint.cmpgt(LOW).all() && viewpoint.cmplt(HIGH).all();
        let Some(room) = self.room.as_ref().filter(|_| is_inside) else { return self.plain };
        let side = Vec3A::select(ray.cmpgt(Vec3A::ZERO), HIGH, LOW);
        let way = ((side - viewpoint) / ray).to_array().map(|way| if way.is_finite() { way } else { f32::INFINITY });
        let axis = (0..3).min_by(|&a, &b| way[a].total_cmp(&way[b])).unwrap_or(0);
        let at = viewpoint + ray * way[axis];
        let light = room.light[axis][usize::from(ray[axis] > 0.0)];
        let across = |axis: usize| at[axis] - LOW[axis];
        let (texture, place) = match axis {
            0 => (Some(&room.wall), Vec2::new(across(1), -across(2))),
            1 => (Some(&room.wall), Vec2::new(across(0), -across(2))),
            _ if ray.z < 0.0 => (Some(&room.floor), Vec2::new(across(0), across(1))),
            _ => (None, Vec2::ZERO),
        };
        // The ceiling has no texture: it is plain white.
        let color = texture.map_or(Vec3A::splat(0.8), |texture| texture.at(place / WALL_SIZE_M));
        let (reach, dark) = EDGE;
        let open = (0..3).filter(|&other| other != axis).fold(1.0, |open: f32, other| {
            let distance = (at[other] - LOW[other]).min(HIGH[other] - at[other]).max(0.0);
            open * (1.0 - dark * (-distance / reach).exp())
        });
        Vec3A::from_array(tone_map((color * light * open).to_array()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::table_tops::TableTop;
    use crate::scene::walls::{Room, Wall};

    /// From inside every ray hits the room, whose sides differ; from outside only the constant colour is visible.
    #[test]
    fn rooms_surround_what_is_inside() {
        let room = Room { wall: Wall::try_from("red_brick".to_owned()).unwrap(), floor: TableTop::default() };
        let variation = RenderVariation { room: Some(room), background: [0, 0, 255], ..RenderVariation::default() };
        let backdrop = Backdrop::new(&variation, &Lighting::new(&variation, None));
        assert!(backdrop.plain().is_none());
        let viewpoint = Vec3A::new(1.0, 0.2, 0.9);
        let colors = [Vec3A::X, Vec3A::NEG_X, Vec3A::Y, Vec3A::Z, Vec3A::NEG_Z, Vec3A::new(1.0, 0.0, -1.0)]
            .map(|ray| backdrop.color(viewpoint, ray));
        for color in colors {
            assert!(color.cmpge(Vec3A::ZERO).all() && color.cmple(Vec3A::ONE).all() && color.x > 0.02, "{color}");
        }
        assert!(colors[1].x > 1.3 * colors[1].z, "brick is red: {}", colors[1]);
        assert!(colors[3].x < 1.2 * colors[3].z, "the ceiling is white: {}", colors[3]);
        assert_eq!(backdrop.color(Vec3A::splat(9.0), Vec3A::X), Vec3A::Z);
    }
}
