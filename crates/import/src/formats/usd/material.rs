//! Materials: UsdPreviewSurface with a colour texture, OmniPBR (MDL) with its constants and colour texture, and
//! constants of MaterialX's standard surface.

use std::collections::BTreeMap;

use genmanip_core::Material;
use glam::Vec2;

use super::value::At;
use crate::files::{Files, shortened};
use crate::formats::glb::srgb;
use crate::formats::{PLAIN, extension};

/// Maximum number of connections that are followed from one input.
const MAX_HOPS: usize = 8;
/// Maximum number of colour textures that are loaded per stage.
const MAX_TEXTURES: usize = 16;

/// A material, and the transform of its texture coordinates.
#[derive(Clone)]
pub struct Bound {
    /// The material, with its colour texture if it has one.
    pub material: Material,
    /// Name of the primvar with the texture coordinates, without `primvars:`.
    pub coordinates: String,
    scale: Vec2,
    rotation_rad: f32,
    translation: Vec2,
    /// True if the base colour is the mesh's `displayColor` instead of the material's.
    pub is_painted: bool,
}

impl Bound {
    /// Material of a prim without one: the colour is the mesh's `displayColor`.
    pub fn painted() -> Self {
        Self {
            material: Material::plain(PLAIN, 0.5),
            coordinates: "st".into(),
            scale: Vec2::ONE,
            rotation_rad: 0.0,
            translation: Vec2::ZERO,
            is_painted: true,
        }
    }

    /// Texture coordinates with the origin at the top left of the image, from the USD coordinates (`st`, origin at the
    /// bottom left) after the material's UsdTransform2d.
    pub fn placed(&self, st: Vec2) -> [f32; 2] {
        let st = Vec2::from_angle(self.rotation_rad).rotate(st * self.scale) + self.translation;
        [st.x, 1.0 - st.y]
    }
}

/// Names of the inputs of a surface shader.
struct Inputs {
    color: &'static str,
    roughness: &'static str,
    metallic: &'static str,
    opacity: &'static str,
    ior: &'static str,
    /// Input with the path of the colour texture; empty for shaders that connect a texture reader instead.
    texture: &'static str,
}

const PREVIEW: Inputs = Inputs {
    color: "inputs:diffuseColor",
    roughness: "inputs:roughness",
    metallic: "inputs:metallic",
    opacity: "inputs:opacity",
    ior: "inputs:ior",
    texture: "",
};
const OMNI_PBR: Inputs = Inputs {
    color: "inputs:diffuse_color_constant",
    roughness: "inputs:reflection_roughness_constant",
    metallic: "inputs:metallic_constant",
    opacity: "inputs:opacity_constant",
    ior: "inputs:glass_ior",
    texture: "inputs:diffuse_texture",
};
const STANDARD: Inputs = Inputs {
    color: "inputs:base_color",
    roughness: "inputs:specular_roughness",
    metallic: "inputs:metalness",
    opacity: "",
    ior: "inputs:specular_IOR",
    texture: "",
};

/// Reader of materials, which reads each material once.
#[derive(Default)]
pub struct Materials {
    known: BTreeMap<String, Bound>,
    textures: usize,
}

impl Materials {
    /// Reads a material prim; inputs that are not used are noted. A material without a supported surface shader leaves
    /// the colour to the mesh.
    pub fn read(&mut self, material: &At, files: &mut Files<'_>, notes: &mut Vec<String>) -> Bound {
        let path = material.prim.path().to_string();
        if let Some(known) = self.known.get(&path) {
            return known.clone();
        }
        let read = self.surface(material, files, notes).unwrap_or_else(|| {
            notes.push(format!("material {}: it has no surface that is known", shortened(&path)));
            Bound::painted()
        });
        self.known.insert(path, read.clone());
        read
    }

    fn surface(&mut self, material: &At, files: &mut Files<'_>, notes: &mut Vec<String>) -> Option<Bound> {
        let outputs = ["outputs:surface", "outputs:mdl:surface", "outputs:mtlx:surface"];
        let (output, shader) = outputs.iter().find_map(|output| {
            let (shader, _) = held(material, output);
            (shader.prim.path() != material.prim.path()).then_some((*output, shader))
        })?;
        let id = shader.text("info:id").unwrap_or_default();
        let name = shortened(&material.prim.path().to_string());
        let inputs = match id.as_str() {
            "UsdPreviewSurface" | "ND_UsdPreviewSurface_surfaceshader" => PREVIEW,
            "ND_standard_surface_surfaceshader" => STANDARD,
            _ if output == "outputs:mdl:surface" || !shader.properties("info:mdl").is_empty() => {
                notes.push(format!("material {name}: of its MDL, colour, texture and constants are read"));
                OMNI_PBR
            }
            _ => return None,
        };
        let number = |input: &str, otherwise: f64| {
            let (holder, name) = held(&shader, input);
            holder.number(&name).filter(|value| value.is_finite()).unwrap_or(otherwise) as f32
        };
        let mut bound = Bound { is_painted: false, ..Bound::painted() };
        let (holder, color_name) = held(&shader, inputs.color);
        let color = holder.vector(&color_name).map_or([0.18; 3], |color| color.as_vec3().to_array());
        // The opacity of OmniPBR applies only if `enable_opacity` is true.
        let is_clear = inputs.texture.is_empty() || shader.flag("inputs:enable_opacity") == Some(true);
        bound.material = Material {
            roughness: number(inputs.roughness, 0.5).clamp(0.05, 1.0),
            metallic: number(inputs.metallic, 0.0).clamp(0.0, 1.0),
            opacity: if is_clear { number(inputs.opacity, 1.0).clamp(0.05, 1.0) } else { 1.0 },
            ior: number(inputs.ior, 1.5).clamp(1.0, 2.5),
            ..Material::plain(color.map(srgb), 0.5)
        };
        if holder.prim.path() != shader.prim.path() {
            self.color_source(&holder, &mut bound, files, notes);
        } else if let Some((written, found)) = shader.file(inputs.texture).filter(|_| !inputs.texture.is_empty()) {
            bound.material.base_color = [1.0; 3];
            self.texture(&written, found, &mut bound, files, notes);
        }
        let unused: Vec<&str> =
            [inputs.roughness, inputs.metallic, inputs.opacity, "inputs:normal", "inputs:emissiveColor"]
                .into_iter()
                .filter(|input| !input.is_empty())
                .filter(|input| {
                    let (holder, _) = held(&shader, input);
                    holder.prim.path() != shader.prim.path() && holder.kind() == "Shader"
                })
                .map(|input| input.trim_start_matches("inputs:"))
                .collect();
        if !unused.is_empty() {
            notes.push(format!("material {name}: textures of {} are not used", unused.join(", ")));
        }
        Some(bound)
    }

    /// Reads the base colour from a connected shader: a texture, or the mesh's `displayColor`.
    fn color_source(&mut self, shader: &At, bound: &mut Bound, files: &mut Files<'_>, notes: &mut Vec<String>) {
        match shader.text("info:id").unwrap_or_default().as_str() {
            "UsdUVTexture" => {
                let factor = shader.value("inputs:scale").and_then(|value| value.cast::<[f64; 4]>().ok());
                bound.material.base_color = factor.map_or([1.0; 3], |[r, g, b, _]| [r, g, b].map(|v| srgb(v as f32)));
                coordinates(shader, bound);
                let (holder, name) = held(shader, "inputs:file");
                match holder.file(&name) {
                    Some((written, found)) => self.texture(&written, found, bound, files, notes),
                    None => notes.push(format!("{} names no file", shortened(&shader.prim.path().to_string()))),
                }
            }
            "UsdPrimvarReader_float3" => bound.is_painted = true,
            id if shader.kind() == "Shader" => {
                let path = shortened(&shader.prim.path().to_string());
                notes.push(format!(
                    "{path}: a colour from {} is not supported",
                    if id.is_empty() { "code" } else { id }
                ));
            }
            // The connection ends at an input of the material or a node graph, whose value has been read.
            _ => {}
        }
    }

    fn texture(
        &mut self,
        written: &str,
        found: Option<String>,
        bound: &mut Bound,
        files: &mut Files<'_>,
        notes: &mut Vec<String>,
    ) {
        let name = shortened(written);
        let Some(place) = found else {
            notes.push(format!("texture {name} is left out: it is not within the imported folder"));
            bound.material.base_color = PLAIN;
            return;
        };
        if self.textures == MAX_TEXTURES {
            notes.push(format!("texture {name} is left out: more than {MAX_TEXTURES} textures"));
            bound.material.base_color = PLAIN;
            return;
        }
        self.textures += 1;
        let tile = place.replace("<UDIM>", "1001");
        if tile != place {
            notes.push(format!("texture {name}: of its tiles, 1001 is used"));
        }
        match files.image(&tile) {
            Ok((texture, note)) => {
                bound.material.texture = Some(texture);
                notes.extend(note);
            }
            Err(error) => {
                notes.push(format!("texture {name} ({}) is left out: {}", extension(&tile), error.message));
                bound.material.base_color = PLAIN;
            }
        }
    }
}

/// Reads the primvar and the UsdTransform2d of the texture coordinates of a texture reader.
fn coordinates(texture: &At, bound: &mut Bound) {
    let (mut shader, _) = held(texture, "inputs:st");
    if shader.text("info:id").as_deref() == Some("UsdTransform2d") {
        let pair = |name: &str, otherwise: Vec2| {
            let value = shader.value(name).and_then(|value| <[f32; 2]>::try_from(value).ok());
            value.map_or(otherwise, Vec2::from_array)
        };
        (bound.scale, bound.translation) = (pair("inputs:scale", Vec2::ONE), pair("inputs:translation", Vec2::ZERO));
        bound.rotation_rad = shader.number("inputs:rotation").unwrap_or(0.0).to_radians() as f32;
        (shader, _) = held(&shader, "inputs:in");
    }
    let (holder, name) = held(&shader, "inputs:varname");
    if let Some(named) = holder.text(&name) {
        bound.coordinates = named;
    }
}

/// Prim and property that hold the value of an attribute, after following its connections through the inputs and
/// outputs of node graphs.
fn held(prim: &At, name: &str) -> (At, String) {
    let (mut holder, mut held) = (prim.clone(), name.to_owned());
    for _ in 0..MAX_HOPS {
        let Some(source) = (!held.is_empty()).then(|| holder.source(&held)).flatten() else { break };
        held = source.property_suffix().trim_start_matches('.').to_owned();
        holder = holder.other(&source.prim_path());
    }
    (holder, held)
}
