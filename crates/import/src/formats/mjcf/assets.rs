//! Meshes, textures and materials of an MJCF file.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{Material, Texture};
use glam::{DMat4, DQuat, DVec3};

use super::settings::Settings;
use crate::ImportError;
use crate::files::{Files, shortened};
use crate::formats::xml::Element;
use crate::formats::{mesh, obj};
use crate::raw::RawMesh;

/// Elements of `<asset>` by name.
pub struct Assets<'a> {
    main: &'a str,
    settings: &'a Settings,
    meshes: BTreeMap<String, Element>,
    textures: BTreeMap<String, Element>,
    materials: BTreeMap<String, Element>,
}

impl<'a> Assets<'a> {
    /// Assets of a file with its includes.
    pub fn of(root: &Element, main: &'a str, settings: &'a Settings) -> Self {
        let named = |tag: &str| {
            let all = root.all("asset").flat_map(|asset| asset.children.iter()).filter(|child| child.tag == tag);
            all.filter_map(|element| Some((name(element)?, element.clone()))).collect()
        };
        Self { main, settings, meshes: named("mesh"), textures: named("texture"), materials: named("material") }
    }

    /// A mesh by name.
    ///
    /// # Errors
    /// If the name is unknown or its file cannot be read.
    pub fn mesh(&self, user: &Element, name: &str, files: &mut Files<'_>) -> Result<RawMesh, ImportError> {
        let element = self.meshes.get(name).ok_or_else(|| user.wrong(format!("unknown mesh `{}`", shortened(name))))?;
        let element = self.settings.complete(element, "main")?;
        let found = match (element.attribute("file"), element.numbers("vertex")?) {
            (Some(file), _) => {
                let folder = &self.settings.mesh_folder;
                mesh(&self.path(folder, file, &element)?, files)?
            }
            (None, Some(numbers)) => {
                let positions: Vec<DVec3> = numbers.chunks_exact(3).map(DVec3::from_slice).collect();
                let (positions, triangles) = crate::collision::hull::convex_hull(&positions)
                    .ok_or_else(|| element.wrong("its vertices enclose no volume"))?;
                RawMesh { positions, uvs: Vec::new(), triangles }
            }
            (None, None) => return Err(element.wrong("expected a file or vertices")),
        };
        let scale = DVec3::from_array(element.exactly::<3>("scale")?.unwrap_or([1.0; 3]));
        let position = DVec3::from_array(element.exactly::<3>("refpos")?.unwrap_or_default());
        let [w, x, y, z] = element.exactly::<4>("refquat")?.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let rotation = DQuat::from_xyzw(x, y, z, w);
        let rotation = if rotation.length() > 1e-9 { rotation.normalize() } else { DQuat::IDENTITY };
        let reference = DMat4::from_rotation_translation(rotation, position).inverse();
        Ok(found.transformed(&DMat4::from_scale(scale)).transformed(&reference))
    }

    /// Material of a geom and its texture repetition; unavailable textures are noted.
    pub fn material(
        &self,
        geom: &Element,
        files: &mut Files<'_>,
        notes: &mut Vec<String>,
    ) -> Result<(Material, [f32; 2]), ImportError> {
        let own = geom.exactly::<4>("rgba")?;
        let Some(name) = geom.attribute("material") else {
            return Ok((colored(own.unwrap_or([0.5, 0.5, 0.5, 1.0]), 0.5), [1.0; 2]));
        };
        let element =
            self.materials.get(name).ok_or_else(|| geom.wrong(format!("unknown material `{}`", shortened(name))))?;
        let element = self.settings.complete(element, "main")?;
        let rgba = own.or(element.exactly::<4>("rgba")?).unwrap_or([1.0; 4]);
        let roughness = 1.0 - 0.8 * element.number("shininess", 0.5)?.clamp(0.0, 1.0) as f32;
        let mut material = colored(rgba, roughness.clamp(0.2, 0.9));
        material.metallic = element.number("metallic", 0.0)?.clamp(0.0, 1.0) as f32;
        let repeat = element.exactly::<2>("texrepeat")?.unwrap_or([1.0; 2]).map(|value| value as f32);
        let layered = element.first("layer").and_then(|layer| layer.attribute("texture"));
        if let Some(name) = element.attribute("texture").or(layered) {
            material.texture = self.texture(&element, name, files, notes)?;
        }
        Ok((material, repeat))
    }

    fn texture(
        &self,
        user: &Element,
        name: &str,
        files: &mut Files<'_>,
        notes: &mut Vec<String>,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        let element =
            self.textures.get(name).ok_or_else(|| user.wrong(format!("unknown texture `{}`", shortened(name))))?;
        let Some(file) = element.attribute("file") else {
            // Use the first colour of a built-in pattern.
            let rgb =
                element.exactly::<3>("rgb1")?.unwrap_or([0.8; 3]).map(|value| (value.clamp(0.0, 1.0) * 255.0) as u8);
            return Ok(Some(Arc::new(Texture { width: 1, height: 1, rgb: rgb.to_vec() })));
        };
        let path = self.path(&self.settings.texture_folder, file, element)?;
        // The path is already relative to the root.
        Ok(obj::texture("", &path, files, notes))
    }

    /// Path of a file in an asset folder, relative to the root.
    fn path(&self, folder: &str, file: &str, element: &Element) -> Result<String, ImportError> {
        let named =
            if folder.is_empty() { file.to_owned() } else { format!("{}/{file}", folder.trim_end_matches('/')) };
        crate::files::beside(self.main, &named).map_err(|error| ImportError { file: element.place.0.clone(), ..error })
    }
}

/// Name of an asset: its attribute, or its file's stem.
fn name(element: &Element) -> Option<String> {
    element.attribute("name").map(str::to_owned).or_else(|| {
        let file = element.attribute("file")?.rsplit(['/', '\\']).next()?;
        Some(file.rsplit_once('.').map_or(file, |(stem, _)| stem).to_owned())
    })
}

fn colored([r, g, b, a]: [f64; 4], roughness: f32) -> Material {
    let [r, g, b, a] = [r, g, b, a].map(|value| value.clamp(0.0, 1.0) as f32);
    Material { opacity: a.max(0.05), ..Material::plain([r, g, b], roughness) }
}
