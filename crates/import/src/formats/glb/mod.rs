//! glTF 2.0, binary (GLB) or JSON: meshes of the default scene, materials, textures.

mod values;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::limits::{IMPORTED_MESH, IMPORTED_PICTURE};
use genmanip_core::{Material, Texture};
use glam::{DMat4, DVec3};
use gltf::Semantic;
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use serde::Deserialize;

use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::image;
use crate::raw::{MAX_TRIANGLES, RawLink, RawMesh, RawObject, Surface, Unit, Up};
use crate::vertex_colors;
use values::{QUANTIZED, SMALL, floats};

/// Maximum nesting depth of nodes, and (`MAX_NODES`) maximum number of nodes. Bounds time for hostile files.
const MAX_DEPTH: usize = 64;
const MAX_NODES: usize = 10_000;
/// Maximum number of textures of an object. Bounds memory for hostile files.
const MAX_TEXTURES: usize = 16;

/// Reads an object from one GLB or glTF file.
///
/// # Errors
/// If the file is truncated, violates the standard, or needs an unsupported extension such as Draco.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let bytes = files.bytes(path, IMPORTED_MESH)?;
    check_header(path, &bytes)?;
    let gltf = parsed(path, &bytes)?;
    let Old { glossy, webp } = old_extensions(&gltf, &bytes);
    let is_quantized = gltf.as_json().extensions_used.iter().any(|name| name == QUANTIZED);
    let mut reader = Reader {
        path,
        gltf: &gltf,
        glossy,
        webp,
        is_quantized,
        buffers: Vec::new(),
        notes: Vec::new(),
        textures: BTreeMap::new(),
    };
    for buffer in gltf.buffers() {
        let bytes = reader.buffer(&buffer, files)?;
        if bytes.len() < buffer.length() {
            let message = format!("buffer {} has {} bytes; expected {}", buffer.index(), bytes.len(), buffer.length());
            return Err(ImportError::new(path, message).hint("the file may be cut off"));
        }
        reader.buffers.push(bytes);
    }
    // Some exporters leave the default scene empty.
    let scenes = || gltf.default_scene().into_iter().chain(gltf.scenes());
    let scene = scenes().find(has_mesh).or_else(|| scenes().next());
    let Some(scene) = scene else { return Err(ImportError::new(path, "contains no scene")) };
    let (mut surfaces, mut nodes) = (Vec::new(), 0);
    let mut open: Vec<(gltf::Node<'_>, DMat4, usize)> = scene.nodes().map(|node| (node, DMat4::IDENTITY, 0)).collect();
    while let Some((node, world_from_parent, depth)) = open.pop() {
        nodes += 1;
        if depth > MAX_DEPTH || nodes > MAX_NODES {
            return Err(ImportError::new(
                path,
                format!(
                    "node {}: more than {MAX_NODES} nodes, or nested deeper than {MAX_DEPTH}: do nodes contain each other?",
                    node.index()
                ),
            ));
        }
        let own = DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)));
        let world_from_node = world_from_parent * own;
        if let Some(mesh) = node.mesh() {
            if node.skin().is_some() {
                reader.notes.push(format!("node {}: its skin is ignored, the mesh is in its rest pose", node.index()));
            }
            let name = node.name().or(mesh.name()).unwrap_or("surface").to_owned();
            for primitive in mesh.primitives() {
                let Some((mesh, material)) = reader.primitive(&primitive, files)? else { continue };
                surfaces.push(Surface { name: name.clone(), mesh: mesh.transformed(&world_from_node), material });
                let triangles: usize = surfaces.iter().map(|surface| surface.mesh.triangles.len()).sum();
                if triangles > MAX_TRIANGLES {
                    let message = format!("more than {MAX_TRIANGLES} triangles");
                    return Err(ImportError::new(path, message).hint("reduce it in a modelling program first"));
                }
            }
        }
        open.extend(node.children().map(|child| (child, world_from_node, depth + 1)));
    }
    if surfaces.is_empty() {
        return Err(ImportError::new(path, "its scene contains no triangles"));
    }
    let others: Vec<String> = gltf
        .scenes()
        .filter(|other| other.index() != scene.index())
        .map(|other| other.name().map_or_else(|| other.index().to_string(), shortened))
        .collect();
    if !others.is_empty() {
        let own = scene.name().map_or_else(|| scene.index().to_string(), shortened);
        reader.notes.push(format!("of its scenes {own} is read, not {}", others.join(", ")));
    }
    let name = scene.nodes().next().and_then(|node| node.name().map(str::to_owned)).unwrap_or_default();
    let copyright = gltf.as_json().asset.copyright.clone();
    let link = RawLink { name: "body".into(), surfaces, ..RawLink::default() };
    Ok(RawObject {
        name,
        links: vec![link],
        unit: Unit::Metre,
        up: Up::Y,
        licence: copyright.as_deref().map(shortened),
        creator: None,
        notes: reader.notes,
    })
}

/// True if a node of a scene, or one below it, has a mesh.
fn has_mesh(scene: &gltf::Scene<'_>) -> bool {
    let (mut open, mut seen): (Vec<gltf::Node<'_>>, _) = (scene.nodes().collect(), BTreeSet::new());
    while let Some(node) = open.pop() {
        if node.mesh().is_some() {
            return true;
        }
        if seen.insert(node.index()) {
            open.extend(node.children());
        }
    }
    false
}

/// Parses and validates the file.
fn parsed(path: &str, bytes: &[u8]) -> Result<gltf::Gltf, ImportError> {
    let unreadable = |error: gltf::Error| {
        ImportError::new(path, format!("not a readable glTF 2.0 file: {error}"))
            .hint("compressed meshes (Draco, meshopt) are not supported: export without compression")
    };
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes).map_err(unreadable)?;
    let mut json = document.into_json();
    // These extensions are read by this program, not by the library.
    json.extensions_required.retain(|name| ![GLOSSY, WEBP, QUANTIZED].contains(&name.as_str()));
    // The library accesses positions before it validates their accessor.
    for (index, mesh) in json.meshes.iter().enumerate() {
        let mut accessors = mesh.primitives.iter().flat_map(|primitive| primitive.attributes.values());
        if let Some(missing) = accessors.find(|accessor| accessor.value() >= json.accessors.len()) {
            let message = format!("mesh {index} refers to accessor {} of {}", missing.value(), json.accessors.len());
            return Err(ImportError::new(path, message));
        }
    }
    let document = gltf::Document::from_json(json).map_err(unreadable)?;
    Ok(gltf::Gltf { document, blob })
}

/// Deprecated extension for materials by diffuse colour, specular colour and glossiness, which the library does not
/// read.
const GLOSSY: &str = "KHR_materials_pbrSpecularGlossiness";

/// A material of the specular-glossiness extension.
#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Glossy {
    diffuse_factor: [f32; 4],
    diffuse_texture: Option<TextureRef>,
    specular_factor: [f32; 3],
    glossiness_factor: f32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct TextureRef {
    index: usize,
    #[serde(default)]
    tex_coord: u32,
}

impl Default for Glossy {
    fn default() -> Self {
        Self { diffuse_factor: [1.0; 4], diffuse_texture: None, specular_factor: [1.0; 3], glossiness_factor: 1.0 }
    }
}

impl Glossy {
    /// Metalness estimated from the specular colour: 0 for dielectrics, whose specular reflectance is about 0.04.
    fn metallic(&self) -> f32 {
        let specular = self.specular_factor.into_iter().fold(0.0, f32::max);
        let diffuse = self.diffuse_factor[..3].iter().copied().fold(0.0, f32::max);
        if specular > 0.3 && specular > diffuse { ((specular - 0.04) / 0.96).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// The extension by which textures refer to WebP images.
const WEBP: &str = "EXT_texture_webp";

/// Contents of extensions that the library does not read.
#[derive(Default)]
struct Old {
    /// Materials of specular and glossiness by index.
    glossy: BTreeMap<usize, Glossy>,
    /// WebP image of each texture by index.
    webp: BTreeMap<usize, usize>,
}

fn old_extensions(gltf: &gltf::Gltf, bytes: &[u8]) -> Old {
    if !gltf.as_json().extensions_used.iter().any(|name| name == GLOSSY || name == WEBP) {
        return Old::default();
    }
    let json = match bytes.get(12..16).and_then(|length| length.try_into().ok()).map(u32::from_le_bytes) {
        Some(length) if bytes.starts_with(b"glTF") => {
            bytes.get(20..20_usize.saturating_add(length as usize)).unwrap_or_default()
        }
        _ => bytes,
    };
    let json: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    let listed = |name: &str| json[name].as_array().into_iter().flatten().enumerate();
    let glossy = |(index, material): (usize, &serde_json::Value)| {
        Some((index, Glossy::deserialize(material.get("extensions")?.get(GLOSSY)?).ok()?))
    };
    let webp = |(index, texture): (usize, &serde_json::Value)| {
        let image = texture.get("extensions")?.get(WEBP)?.get("source")?.as_u64()?;
        Some((index, usize::try_from(image).ok()?))
    };
    Old {
        glossy: listed("materials").filter_map(glossy).collect(),
        webp: listed("textures").filter_map(webp).collect(),
    }
}

/// Checks the length in a GLB header.
fn check_header(path: &str, bytes: &[u8]) -> Result<(), ImportError> {
    if !bytes.starts_with(b"glTF") {
        return Ok(());
    }
    let length = bytes.get(8..12).and_then(|length| length.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    if length > bytes.len() || length < 20 {
        let message = format!("{} bytes; its header says {length}", bytes.len());
        return Err(ImportError::new(path, message).hint("the file is cut off: copy or export it again"));
    }
    Ok(())
}

struct Reader<'a> {
    path: &'a str,
    gltf: &'a gltf::Gltf,
    /// Materials of the specular-glossiness extension by index.
    glossy: BTreeMap<usize, Glossy>,
    /// WebP image of each texture by index.
    webp: BTreeMap<usize, usize>,
    /// True if positions and texture coordinates may be small integers.
    is_quantized: bool,
    buffers: Vec<Vec<u8>>,
    notes: Vec<String>,
    /// Textures by image index; `None` for images that could not be read.
    textures: BTreeMap<usize, Option<Arc<Texture>>>,
}

impl Reader<'_> {
    fn buffer(&self, buffer: &gltf::Buffer<'_>, files: &mut Files<'_>) -> Result<Vec<u8>, ImportError> {
        match buffer.source() {
            gltf::buffer::Source::Bin => self.gltf.blob.clone().ok_or_else(|| {
                ImportError::new(self.path, format!("buffer {} is missing", buffer.index()))
                    .hint("the file may be cut off")
            }),
            gltf::buffer::Source::Uri(uri) => self.uri(uri, IMPORTED_MESH, files),
        }
    }

    fn uri(
        &self,
        uri: &str,
        limit: genmanip_core::limits::Limit,
        files: &mut Files<'_>,
    ) -> Result<Vec<u8>, ImportError> {
        if let Some(data) = uri.strip_prefix("data:") {
            let encoded = data.split_once(";base64,").map(|(_, encoded)| encoded);
            let decoded = encoded.and_then(|encoded| STANDARD.decode(encoded).ok());
            return decoded.ok_or_else(|| ImportError::new(self.path, "a data URI is not base64"));
        }
        let plain = uri.replace("%20", " ");
        Ok(files.bytes(&beside(self.path, &plain)?, limit)?.to_vec())
    }

    /// Triangles and material of a primitive; `None` for points and lines.
    fn primitive(
        &mut self,
        primitive: &gltf::Primitive<'_>,
        files: &mut Files<'_>,
    ) -> Result<Option<(RawMesh, Material)>, ImportError> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.notes.push("points and lines are ignored".into());
            return Ok(None);
        }
        let mut material = self.material(&primitive.material(), files)?;
        let glossy = primitive.material().index().and_then(|index| self.glossy.get(&index));
        let set = match glossy {
            Some(glossy) => glossy.diffuse_texture.as_ref().map_or(0, |texture| texture.tex_coord),
            None => {
                let texture = primitive.material().pbr_metallic_roughness().base_color_texture();
                texture.map_or(0, |info| info.tex_coord())
            }
        };
        let small: &[DataType] = if self.is_quantized { &SMALL } else { &[] };
        for (semantic, accessor) in primitive.attributes() {
            match semantic {
                Semantic::Positions => {
                    self.check_accessor(&accessor, Dimensions::Vec3, &[&[DataType::F32][..], small].concat())?;
                }
                Semantic::TexCoords(_) => {
                    let usual = [DataType::F32, DataType::U8, DataType::U16];
                    self.check_accessor(&accessor, Dimensions::Vec2, &[&usual[..], small].concat())?;
                }
                Semantic::Colors(0) => {
                    let three = accessor.dimensions() == Dimensions::Vec3;
                    let dimensions = if three { Dimensions::Vec3 } else { Dimensions::Vec4 };
                    self.check_accessor(&accessor, dimensions, &[DataType::F32, DataType::U8, DataType::U16])?;
                }
                _ => {}
            }
        }
        if let Some(accessor) = primitive.indices() {
            let counting = [DataType::U8, DataType::U16, DataType::U32];
            self.check_accessor(&accessor, Dimensions::Scalar, &counting)?;
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let wrong = |message: String| ImportError::new(self.path, message);
        let buffer = |accessor: &gltf::Accessor<'_>| {
            let view = accessor.view().map(|view| view.buffer().index());
            view.and_then(|index| self.buffers.get(index)).map_or(&[][..], Vec::as_slice)
        };
        let held = primitive.get(&Semantic::Positions).ok_or_else(|| wrong("a primitive has no positions".into()))?;
        let positions: Vec<DVec3> = floats::<3>(&held, buffer(&held))
            .into_iter()
            .map(|[x, y, z]| DVec3::new(x.into(), y.into(), z.into()))
            .collect();
        let coordinates = primitive.get(&Semantic::TexCoords(set)).filter(|_| material.texture.is_some());
        let uvs = coordinates.map_or_else(Vec::new, |held| floats::<2>(&held, buffer(&held)));
        let uvs = if uvs.len() == positions.len() { self.transformed_uvs(uvs, primitive) } else { Vec::new() };
        let order: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(index) = order.iter().find(|&&index| index as usize >= positions.len()) {
            return Err(wrong(format!("a face refers to vertex {index} of {}", positions.len())));
        }
        let triangles: Vec<[u32; 3]> = match primitive.mode() {
            Mode::TriangleStrip => {
                let turned =
                    |(index, t): (usize, &[u32])| if index % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
                order.windows(3).enumerate().map(turned).collect()
            }
            Mode::TriangleFan => order.windows(2).skip(1).map(|t| [order[0], t[0], t[1]]).collect(),
            _ => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        };
        let colors: Vec<[f32; 3]> = reader
            .read_colors(0)
            .map_or_else(Vec::new, |colors| colors.into_rgb_f32().map(|color| color.map(srgb)).collect());
        let mesh = RawMesh { positions, uvs, triangles };
        if colors.len() != mesh.positions.len() {
            return Ok(Some((mesh, material)));
        }
        if material.texture.is_some() {
            self.notes.push("colours of vertices under a texture are ignored".into());
            return Ok(Some((mesh, material)));
        }
        let mesh = vertex_colors::paint(mesh, &colors, &mut material);
        Ok(Some((mesh, material)))
    }

    /// Validates an accessor's type and bounds, which the library takes for granted.
    fn check_accessor(
        &self,
        accessor: &gltf::Accessor<'_>,
        dimensions: Dimensions,
        types: &[DataType],
    ) -> Result<(), ImportError> {
        let wrong =
            |message: &str| Err(ImportError::new(self.path, format!("accessor {}: {message}", accessor.index())));
        if accessor.dimensions() != dimensions || !types.contains(&accessor.data_type()) {
            let (got, of) = (accessor.dimensions(), accessor.data_type());
            return wrong(&format!("{got:?} of {of:?}; expected {dimensions:?} of one of {types:?}"));
        }
        if accessor.sparse().is_some() {
            return wrong("sparse accessors are not supported");
        }
        let Some(view) = accessor.view() else { return wrong("has no buffer view: is the mesh compressed?") };
        if accessor.count() == 0 || accessor.count() > 3 * MAX_TRIANGLES {
            return wrong(&format!("{} elements; expected 1 to {}", accessor.count(), 3 * MAX_TRIANGLES));
        }
        let stride = view.stride().unwrap_or(accessor.size());
        if stride < accessor.size() {
            return wrong(&format!("its elements of {} bytes are {stride} bytes apart", accessor.size()));
        }
        let needed = accessor
            .offset()
            .checked_add(stride.saturating_mul(accessor.count() - 1))
            .and_then(|end| end.checked_add(accessor.size()));
        let held = self.buffers.get(view.buffer().index()).map_or(0, Vec::len);
        let end = view.offset().checked_add(view.length());
        if needed.is_none_or(|needed| needed > view.length()) || end.is_none_or(|end| end > held) {
            return wrong("reaches beyond its buffer");
        }
        Ok(())
    }

    /// Applies KHR_texture_transform to texture coordinates.
    fn transformed_uvs(&self, mut uvs: Vec<[f32; 2]>, primitive: &gltf::Primitive<'_>) -> Vec<[f32; 2]> {
        let info = primitive.material().pbr_metallic_roughness().base_color_texture();
        if let Some(transform) = info.and_then(|info| info.texture_transform()) {
            let ([du, dv], [su, sv], (sin, cos)) =
                (transform.offset(), transform.scale(), transform.rotation().sin_cos());
            for [u, v] in &mut uvs {
                let (x, y) = (*u * su, *v * sv);
                (*u, *v) = (cos * x + sin * y + du, cos * y - sin * x + dv);
            }
        }
        uvs
    }

    fn material(&mut self, material: &gltf::Material<'_>, files: &mut Files<'_>) -> Result<Material, ImportError> {
        if let Some(glossy) = material.index().and_then(|index| self.glossy.remove(&index)) {
            let read = self.glossy_material(material, &glossy, files);
            self.glossy.insert(material.index().unwrap_or_default(), glossy);
            return read;
        }
        let pbr = material.pbr_metallic_roughness();
        let [r, g, b, alpha] = pbr.base_color_factor();
        let texture = match pbr.base_color_texture() {
            Some(info) => self.texture(&info.texture(), files)?,
            None => None,
        };
        let opacity = if material.alpha_mode() == gltf::material::AlphaMode::Opaque { 1.0 } else { alpha };
        let clear = material.transmission().map_or(0.0, |transmission| transmission.transmission_factor());
        Ok(Material {
            roughness: pbr.roughness_factor().clamp(0.05, 1.0),
            metallic: if texture.is_some() && pbr.metallic_roughness_texture().is_some() {
                0.0
            } else {
                pbr.metallic_factor().clamp(0.0, 1.0)
            },
            opacity: opacity.min(1.0 - 0.8 * clear).clamp(0.05, 1.0),
            ior: material.ior().filter(|ior| ior.is_finite()).unwrap_or(1.5).clamp(1.0, 2.5),
            texture,
            ..Material::plain([r, g, b].map(srgb), 0.5)
        })
    }

    /// Converts a material of the specular-glossiness extension.
    fn glossy_material(
        &mut self,
        material: &gltf::Material<'_>,
        glossy: &Glossy,
        files: &mut Files<'_>,
    ) -> Result<Material, ImportError> {
        let source = glossy.diffuse_texture.as_ref().and_then(|named| self.gltf.textures().nth(named.index));
        let texture = match source {
            Some(texture) => self.texture(&texture, files)?,
            None => None,
        };
        let [r, g, b, alpha] = glossy.diffuse_factor;
        let opacity = if material.alpha_mode() == gltf::material::AlphaMode::Opaque { 1.0 } else { alpha };
        let metallic = glossy.metallic();
        let color = if metallic > 0.5 { glossy.specular_factor } else { [r, g, b] };
        Ok(Material {
            roughness: (1.0 - glossy.glossiness_factor).clamp(0.05, 1.0),
            metallic,
            opacity: opacity.clamp(0.05, 1.0),
            texture,
            ..Material::plain(color.map(srgb), 0.5)
        })
    }

    /// The image of a texture: that of an extension, or its own.
    fn texture(
        &mut self,
        texture: &gltf::Texture<'_>,
        files: &mut Files<'_>,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        let webp = self.webp.get(&texture.index()).and_then(|&image| self.gltf.images().nth(image));
        let Some(image) = webp.or_else(|| texture.source()) else {
            self.notes.push(format!("texture {} ignored: it has no image", texture.index()));
            return Ok(None);
        };
        self.image(&image, files)
    }

    fn image(&mut self, image: &gltf::Image<'_>, files: &mut Files<'_>) -> Result<Option<Arc<Texture>>, ImportError> {
        if let Some(known) = self.textures.get(&image.index()) {
            return Ok(known.clone());
        }
        if self.textures.len() == MAX_TEXTURES {
            self.notes.push(format!("image {} ignored: more than {MAX_TEXTURES} textures", image.index()));
            return Ok(None);
        }
        // The library requires a URI or a buffer view, and the media type of an embedded image.
        let declared = self.gltf.as_json().images.get(image.index());
        let is_whole = declared.is_some_and(|image| match image.buffer_view {
            Some(_) => image.mime_type.is_some(),
            None => image.uri.is_some(),
        });
        if !is_whole {
            self.notes.push(format!("image {} ignored: it has no source", image.index()));
            self.textures.insert(image.index(), None);
            return Ok(None);
        }
        let bytes = match image.source() {
            gltf::image::Source::View { view, .. } => {
                let held = self.buffers.get(view.buffer().index()).map_or(&[][..], Vec::as_slice);
                let end = view.offset().saturating_add(view.length());
                Ok(held.get(view.offset()..end).unwrap_or_default().to_vec())
            }
            gltf::image::Source::Uri { uri, .. } => self.uri(uri, IMPORTED_PICTURE, files),
        };
        let read =
            bytes.map_err(|error| error.to_string()).and_then(|bytes| image::texture(&bytes, &mut files.pixels_left));
        let texture = match read {
            Ok((texture, note)) => {
                self.notes.extend(note);
                Some(Arc::new(texture))
            }
            Err(message) => {
                self.notes.push(format!("image {} ignored: {message}", image.index()));
                None
            }
        };
        self.textures.insert(image.index(), texture.clone());
        Ok(texture)
    }
}

/// sRGB encoding of a linear value, IEC 61966-2-1.
pub fn srgb(linear: f32) -> f32 {
    let linear = if linear.is_finite() { linear.clamp(0.0, 1.0) } else { 0.5 };
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
