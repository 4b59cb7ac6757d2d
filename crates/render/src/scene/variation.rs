//! Variation of a rendering: light, exposure, background, support surface and paint of objects.

use genmanip_core::{MeasuredMaterial, ObjectModel, Seed};
use glam::Vec3A;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::job::FIRST_OBJECT;
use crate::matched::camera_look::CameraLook;
use crate::scene::assets::{Part, RenderAssets};
use crate::scene::material::Material;
use crate::scene::table_tops::TableTop;
use crate::scene::texture::linear_from_srgb;
use crate::scene::walls::Room;

/// Light and appearance of a rendering. Colours are sRGB, each channel 0-1 unless noted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderVariation {
    /// Direction from the scene towards the key light, world frame; any length.
    pub light_direction: [f32; 3],
    /// Colour of the key light.
    pub light_color: [f32; 3],
    /// Brightness (radiance) of a white surface that faces the key light, before exposure.
    pub light_intensity: f32,
    /// Angular radius of the key light (rad), which determines the width of penumbrae.
    pub light_angular_radius: f32,
    /// Colour of the sky.
    pub sky_color: [f32; 3],
    /// Colour of the studio's ground, which reflects light upwards.
    pub ground_color: [f32; 3],
    /// Brightness (radiance) of a white surface that faces the sky and gets no key light, before exposure.
    pub ambient_intensity: f32,
    /// Factor applied before tone mapping.
    pub exposure: f32,
    /// Background colour, 0-255, written without lighting or tone mapping.
    pub background: [u8; 3],
    /// Room shown instead of the background colour, without depth and ids; `None` for the colour.
    pub room: Option<Room>,
    /// Material of the first support surface.
    pub table_top: TableTop,
    /// Tint that multiplies the texture of the first support surface.
    pub table_color: [f32; 3],
    /// Base colour of the first support surface, linear RGB, in place of its material; `None` for the material.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_base: Option<[f32; 3]>,
    /// Measured materials of objects, which replace those of their files.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<MeasuredMaterial>,
    /// Variation of the objects' paint; `None` for the original paint.
    pub objects: Option<ObjectVariation>,
    /// Radius within which surfaces occlude ambient light (m); 0 switches ambient occlusion off.
    pub occlusion_radius_m: f32,
    /// Strength of the ambient occlusion, 0-2, as a factor on the darkening.
    pub occlusion_strength: f32,
    /// Texels along a side of the shadow map, at most 8192; images of at most 128 px use fewer. 0 switches shadows off.
    pub shadow_resolution: u32,
    /// Centre of the sphere in which objects cast shadows, world frame (m).
    pub shadow_center: [f32; 3],
    /// Radius of that sphere (m).
    pub shadow_radius_m: f32,
    /// Responses and photographs of real cameras; images of other cameras get the usual exposure and tone mapping.
    #[serde(skip)]
    pub looks: Vec<CameraLook>,
}

/// Variation of the objects' paint, sampled once per object for all of its parts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectVariation {
    /// Seed of the sampled paints.
    pub seed: Seed,
    /// Largest relative change of each colour channel (0.1 for ±10 %); hues stay recognisable if it is small.
    pub tint: f32,
    /// Largest absolute change of the roughness.
    pub roughness: f32,
    /// Largest absolute change of the metallic parameter of metals; other materials keep theirs.
    #[serde(default)]
    pub metallic: f32,
}

impl RenderVariation {
    /// Materials of all parts of the assets under this variation, by part index.
    #[doc(hidden)]
    pub fn materials(&self, assets: &RenderAssets) -> Vec<Material> {
        let mut materials: Vec<Material> =
            assets.parts.iter().map(|part| self.painted(part.instance, &self.as_measured(part, assets))).collect();
        if let Some(first) = assets.supports().first() {
            let top = Material::new(&self.table_top.material());
            materials[first.part] = match self.table_base {
                Some(base) => Material::matt(Vec3A::from_array(base)),
                None => Material { base: top.base * linear_from_srgb(self.table_color), ..top },
            };
        }
        materials
    }

    /// Material of a part before the paint is varied.
    fn as_measured(&self, part: &Part, assets: &RenderAssets) -> Material {
        let own = part.material.clone();
        let measured = |object: &ObjectModel| self.measured.iter().find(|it| it.is_of(&object.card.uid, &part.name));
        let Some(found) = assets.object_of(part).and_then(measured) else { return own };
        let factor = Vec3A::from_array(found.color_factor.map(|factor| factor as f32));
        // No surface reflects more light than it gets; a texture's dark texels may be brightened beyond that.
        let texture = own.texture.as_ref().map_or(Vec3A::ONE, |texture| texture.mean());
        let base = (own.base * factor).min(Vec3A::ONE / texture.max(Vec3A::splat(1e-3)));
        let roughness = found.roughness.map_or(own.roughness, |roughness| (roughness as f32).clamp(0.05, 1.0));
        Material { base, roughness, ..own }
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
            ground_color: [0.80, 0.78, 0.75],   // light from below
            ambient_intensity: 0.42,            // shadows stay readable
            exposure: 1.1,                      // a white sheet facing the light becomes sRGB 241
            background: [255, 255, 255],        // the benchmark's plain white
            room: None,                         // the background colour
            table_top: TableTop::default(),     // a calm light wood
            table_color: [1.0, 1.0, 1.0],       // the texture as it is
            table_base: None,                   // the material
            measured: Vec::new(),               // materials of the objects' files
            objects: None,                      // as they are
            occlusion_radius_m: 0.09,           // shadows around hand-sized things
            occlusion_strength: 1.4,            // corners as dark as in path-traced images
            shadow_resolution: 1024,            // 2 mm per texel, finer than a pixel of the default cameras
            shadow_center: [0.4, 0.0, 0.3],     // between the arm and its usable area
            shadow_radius_m: 1.0,               // the ball holds the arm and its usable area
            looks: Vec::new(),                  // no real cameras
        }
    }
}
