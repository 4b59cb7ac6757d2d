//! What may differ between two drawings of the same episode: light, exposure, background, table, paint of the objects.

use genmanip_core::Seed;
use glam::Vec3A;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::job::FIRST_OBJECT;
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::scene::table_tops::TableTop;
use crate::scene::texture::linear_from_srgb;
use crate::scene::walls::Room;

/// Light and look of a drawing. Colours are sRGB, 0-1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderVariation {
    /// Direction from the scene towards the key light, world frame; any length.
    pub light_direction: [f32; 3],
    /// Colour of the key light.
    pub light_color: [f32; 3],
    /// Brightness of a white surface that faces the key light, before exposure.
    pub light_intensity: f32,
    /// Angular radius of the key light, radians: how soft its shadows are.
    pub light_angular_radius: f32,
    /// Colour of the light from above.
    pub sky_color: [f32; 3],
    /// Colour of the light reflected from below.
    pub ground_color: [f32; 3],
    /// Brightness of a white surface that faces the sky only, before exposure.
    pub ambient_intensity: f32,
    /// Everything is multiplied by this before the tone map.
    pub exposure: f32,
    /// Where nothing is seen; written as it is, neither lit nor tone mapped.
    pub background: [u8; 3],
    /// A room that is seen instead of that colour; it has neither depth nor ids.
    pub room: Option<Room>,
    /// What the table's top is made of.
    pub table_top: TableTop,
    /// Multiplied with the table's own texture.
    pub table_color: [f32; 3],
    /// Paint of the objects; as it is without.
    pub objects: Option<ObjectVariation>,
    /// Radius of the ambient occlusion, metres; 0 switches it off.
    pub occlusion_radius_m: f32,
    /// Strength of the ambient occlusion, 0-2.
    pub occlusion_strength: f32,
    /// Pixels per side of the shadow map; 0 switches shadows off.
    pub shadow_resolution: u32,
    /// Centre of the ball in which things cast shadows, world frame, metres.
    pub shadow_center: [f32; 3],
    /// Radius of that ball, metres.
    pub shadow_radius_m: f32,
}

/// How much the paint of the objects differs from their own, each object and part by its own chance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectVariation {
    /// Of what each object gets.
    pub seed: Seed,
    /// Largest change of each colour channel, as a share: what is red stays red when it is small.
    pub tint: f32,
    /// Largest change of the roughness.
    pub roughness: f32,
    /// Largest change of how metallic metals are; other things stay what they are.
    #[serde(default)]
    pub metallic: f32,
}

impl RenderVariation {
    /// What the parts of the assets are made of.
    #[doc(hidden)]
    pub fn surfaces(&self, assets: &RenderAssets) -> Vec<Material> {
        let top = Material { is_table: true, ..Material::new(&self.table_top.material()) };
        let surface = |part: &crate::scene::assets::Part| match part.surface.is_table {
            true => Material { base: top.base * linear_from_srgb(self.table_color), ..top.clone() },
            false => self.painted(part.instance, &part.surface),
        };
        assets.parts.iter().map(surface).collect()
    }

    fn painted(&self, instance: u16, surface: &Material) -> Material {
        let Some(ObjectVariation { seed, tint, roughness, metallic }) =
            self.objects.filter(|_| instance >= FIRST_OBJECT)
        else {
            return surface.clone();
        };
        let mut rng = seed.fork_index(u64::from(instance)).rng();
        let mut within = |most: f32| most * (2.0 * rng.random::<f32>() - 1.0);
        let factor = Vec3A::new(1.0 + within(tint), 1.0 + within(tint), 1.0 + within(tint));
        let roughness = (surface.roughness + within(roughness)).clamp(0.05, 1.0);
        let change = within(metallic);
        let metallic =
            if surface.metallic > 0.5 { (surface.metallic + change).clamp(0.5, 1.0) } else { surface.metallic };
        Material { base: (surface.base * factor).min(Vec3A::ONE), roughness, metallic, ..surface.clone() }
    }
}

impl Default for RenderVariation {
    fn default() -> Self {
        Self {
            light_direction: [0.35, 0.50, 1.0], // over the left shoulder of the `static` camera
            light_color: [1.0, 0.975, 0.94],    // a little warm
            light_intensity: 0.62,              // with the ambient light a white sheet stays just below clipping
            light_angular_radius: 0.075,        // a softbox: 8.6 degrees across
            sky_color: [0.95, 0.975, 1.0],      // a little cool
            ground_color: [0.80, 0.78, 0.75],   // light from the table
            ambient_intensity: 0.42,            // shadows stay readable
            exposure: 1.1,                      // a white sheet facing the light becomes sRGB 241
            background: [255, 255, 255],        // the benchmark's plain white
            room: None,                         // one colour
            table_top: TableTop::default(),     // a calm light wood
            table_color: [1.0, 1.0, 1.0],       // the texture as it is
            objects: None,                      // as they are
            occlusion_radius_m: 0.09,           // shadows around hand-sized things
            occlusion_strength: 1.4,            // as dark as traced ones
            shadow_resolution: 1024,            // 2 mm per texel, finer than a pixel of the default cameras
            shadow_center: [0.4, 0.0, 0.3],     // the arm and the table's usable area …
            shadow_radius_m: 1.0,               // … fit into this ball
        }
    }
}
