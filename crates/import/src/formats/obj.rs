//! Wavefront OBJ with its materials and textures.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use genmanip_core::Material;
use genmanip_core::limits::{IMPORTED_DESCRIPTION, IMPORTED_MESH};
use glam::DVec3;

use super::PLAIN;
use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::raw::{RawLink, RawMesh, RawObject, Surface, Unit, Up};
use crate::vertex_colors;

/// Maximum number of surfaces; faces of the same group and material belong to one surface.
const MAX_SURFACES: usize = 4096;
/// Reads an object from one OBJ file.
///
/// # Errors
/// With the number of the invalid line. Unavailable materials and textures are noted and ignored.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut notes = Vec::new();
    let surfaces = surfaces(path, files, &mut notes)?;
    let link = RawLink { name: "body".into(), surfaces, ..RawLink::default() };
    Ok(RawObject {
        name: String::new(),
        links: vec![link],
        unit: Unit::Unknown,
        up: Up::Unknown,
        licence: None,
        creator: None,
        notes,
    })
}

/// Triangles of an OBJ file by their corners; if it has no faces, its vertices as triangles with three equal corners.
///
/// # Errors
/// If a vertex or face is damaged.
pub fn triangles(path: &str, files: &mut Files<'_>) -> Result<Vec<[DVec3; 3]>, ImportError> {
    let bytes = files.bytes(path, IMPORTED_MESH)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = Reader { path, ..Reader::default() };
    let mut triangles = Vec::new();
    for (number, line) in lines(&text) {
        reader.line = number;
        let mut words = line.split_whitespace();
        match words.next().unwrap_or_default() {
            "v" => reader.corner(words)?,
            "vt" => reader.place(words)?,
            "f" => {
                let named =
                    words.map(|word| Ok(reader.corners[reader.named(word)?.0])).collect::<Result<Vec<_>, _>>()?;
                triangles.extend(named.windows(2).skip(1).map(|pair| [named[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    if triangles.is_empty() {
        triangles = reader.corners.iter().map(|&corner| [corner; 3]).collect();
    }
    Ok(triangles)
}

/// The surfaces of an OBJ file, one per group and material.
///
/// # Errors
/// As [`read`].
pub fn surfaces(path: &str, files: &mut Files<'_>, notes: &mut Vec<String>) -> Result<Vec<Surface>, ImportError> {
    let bytes = files.bytes(path, IMPORTED_MESH)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = Reader { path, max_triangles: files.max_triangles, ..Reader::default() };
    let mut materials = BTreeMap::new();
    for (number, line) in lines(&text) {
        reader.line = number;
        let mut words = line.split_whitespace();
        match words.next().unwrap_or_default() {
            "v" => reader.corner(words)?,
            "vt" => reader.place(words)?,
            "f" => reader.face(words)?,
            "o" | "g" => reader.group = words.collect::<Vec<_>>().join(" "),
            "usemtl" => reader.material = words.collect::<Vec<_>>().join(" "),
            "mtllib" if files.geometry_only => {}
            "mtllib" => materials.extend(libraries(path, line.trim_start()[6..].trim(), files, notes)),
            _ => {}
        }
    }
    let surfaces: Vec<Surface> = reader
        .surfaces
        .into_iter()
        .map(|((name, material), Part { mesh, corners, .. })| {
            let Some(material) = materials.get(&material).cloned() else {
                let is_colored = reader.colors.len() == reader.corners.len();
                let colors: Vec<[f32; 3]> =
                    corners.iter().filter(|_| is_colored).map(|corner| reader.colors[*corner]).collect();
                let mut material = Material::plain(if is_colored { [1.0; 3] } else { PLAIN }, 0.5);
                let mesh = if is_colored { vertex_colors::paint(mesh, &colors, &mut material) } else { mesh };
                return Surface { name, mesh, material };
            };
            Surface { name, mesh, material }
        })
        .collect();
    if surfaces.is_empty() {
        return Err(ImportError::new(path, "contains no faces").hint("expected an OBJ with lines `f 1 2 3`"));
    }
    Ok(surfaces)
}

/// Lines with their numbers; one that ends with a backslash goes on in the next.
fn lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut rest = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (index, first) = rest.next()?;
        let mut line = Cow::Borrowed(first);
        while line.ends_with('\\') {
            let joined = line.to_mut();
            joined.pop();
            joined.push(' ');
            joined.push_str(rest.next().map_or("", |(_, next)| next));
        }
        Some((index + 1, line))
    })
}

/// State of the parser.
#[derive(Default)]
struct Reader<'a> {
    path: &'a str,
    line: usize,
    corners: Vec<DVec3>,
    colors: Vec<[f32; 3]>,
    places: Vec<[f32; 2]>,
    group: String,
    material: String,
    triangles: usize,
    max_triangles: usize,
    /// Surfaces under construction, by group and material.
    surfaces: BTreeMap<(String, String), Part>,
}

/// A surface under construction, with a map from the file's vertex indices to its own; the map is never iterated, so
/// its order does not matter.
#[derive(Default)]
struct Part {
    mesh: RawMesh,
    known: HashMap<(usize, usize), u32>,
    /// Position index in the file of each vertex of the surface.
    corners: Vec<usize>,
}

impl Reader<'_> {
    fn wrong(&self, message: impl std::fmt::Display) -> ImportError {
        ImportError::new(self.path, format!("line {}: {message}", self.line))
    }

    /// At least `least` numbers; `nan` is accepted here and rejected by the cleaning step.
    fn numbers(&self, words: std::str::SplitWhitespace<'_>, least: usize) -> Result<Vec<f64>, ImportError> {
        let values: Option<Vec<f64>> = words.take(6).map(|word| word.parse().ok()).collect();
        let values = values.ok_or_else(|| self.wrong("expected numbers"))?;
        if values.len() < least {
            return Err(self.wrong(format!("{} numbers; expected at least {least}", values.len())));
        }
        Ok(values)
    }

    fn corner(&mut self, words: std::str::SplitWhitespace<'_>) -> Result<(), ImportError> {
        let values = self.numbers(words, 3)?;
        self.corners.push(DVec3::from_slice(&values));
        if let [_, _, _, r, g, b] = values[..] {
            self.colors.push([r, g, b].map(|value| value as f32));
        }
        Ok(())
    }

    fn place(&mut self, words: std::str::SplitWhitespace<'_>) -> Result<(), ImportError> {
        let values = self.numbers(words, 1)?;
        self.places.push([values[0] as f32, 1.0 - values.get(1).copied().unwrap_or(0.0) as f32]);
        Ok(())
    }

    /// Reads a polygon as a triangle fan.
    fn face(&mut self, words: std::str::SplitWhitespace<'_>) -> Result<(), ImportError> {
        let corners = words.map(|word| self.named(word)).collect::<Result<Vec<_>, _>>()?;
        if corners.len() < 3 {
            return Err(self.wrong(format!("a face with {} vertices", corners.len())));
        }
        self.triangles += corners.len() - 2;
        if self.triangles > self.max_triangles {
            return Err(self
                .wrong(format!("more than {} triangles", self.max_triangles))
                .hint("reduce it in a modelling program first"));
        }
        let key = (self.group.clone(), self.material.clone());
        if self.surfaces.len() == MAX_SURFACES && !self.surfaces.contains_key(&key) {
            return Err(self.wrong(format!("more than {MAX_SURFACES} groups")));
        }
        let part = self.surfaces.entry(key).or_default();
        let indices: Vec<u32> = corners
            .into_iter()
            .map(|(corner, place)| {
                *part.known.entry((corner, place.unwrap_or(usize::MAX))).or_insert_with(|| {
                    part.mesh.positions.push(self.corners[corner]);
                    part.corners.push(corner);
                    part.mesh.uvs.push(place.map_or([0.0; 2], |place| self.places[place]));
                    part.mesh.positions.len() as u32 - 1
                })
            })
            .collect();
        part.mesh.triangles.extend(indices.windows(2).skip(1).map(|pair| [indices[0], pair[0], pair[1]]));
        Ok(())
    }

    /// Parses `vertex/texture/normal`, where indices count from 1, or from the end if negative; returns indices from 0.
    fn named(&self, word: &str) -> Result<(usize, Option<usize>), ImportError> {
        let mut parts = word.split('/');
        let number = |part: Option<&str>, count: usize, what: &str| -> Result<Option<usize>, ImportError> {
            let Some(part) = part.filter(|part| !part.is_empty()) else { return Ok(None) };
            let wrong = || self.wrong(format!("refers to {what} `{}` of {count}", shortened(part)));
            let index: i64 = part.parse().map_err(|_| wrong())?;
            let index = if index < 0 { count as i64 + index } else { index - 1 };
            usize::try_from(index).ok().filter(|index| *index < count).map(Some).ok_or_else(wrong)
        };
        let corner = number(parts.next(), self.corners.len(), "vertex")?;
        let place = number(parts.next(), self.places.len(), "texture coordinate")?;
        Ok((corner.ok_or_else(|| self.wrong("a face without vertices"))?, place))
    }
}

/// A material as defined in MTL.
#[derive(Default)]
struct Mtl {
    color: Option<[f32; 3]>,
    shininess: Option<f32>,
    opacity: Option<f32>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    texture: Option<String>,
}

/// Textures of a material that are not used.
const UNUSED: [&str; 9] = ["map_Ka", "map_Ks", "map_Ns", "map_d", "map_Bump", "map_bump", "bump", "norm", "disp"];

/// Materials of the libraries that a line names: one file whose name may contain blanks, or several files.
fn libraries(path: &str, named: &str, files: &mut Files<'_>, notes: &mut Vec<String>) -> BTreeMap<String, Material> {
    match library(path, named, files, notes) {
        Ok(found) => found,
        Err(_) if named.contains(char::is_whitespace) => {
            named.split_whitespace().flat_map(|one| libraries(path, one, files, notes)).collect()
        }
        Err(error) => {
            notes.push(format!("materials ignored: {error}"));
            BTreeMap::new()
        }
    }
}

/// Materials of a library by name; unreadable properties are ignored, other textures than that of the colour noted.
fn library(
    path: &str,
    named: &str,
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Result<BTreeMap<String, Material>, ImportError> {
    let mtl = beside(path, named)?;
    let text = files.text(&mtl, IMPORTED_DESCRIPTION)?;
    let mut read: BTreeMap<String, Mtl> = BTreeMap::new();
    let mut current: Option<&mut Mtl> = None;
    let mut unused = BTreeSet::new();
    for line in text.lines() {
        let (key, rest) = line.trim().split_once(char::is_whitespace).unwrap_or((line.trim(), ""));
        if key == "newmtl" {
            current = Some(read.entry(rest.trim().to_owned()).or_default());
            continue;
        }
        let Some(material) = &mut current else { continue };
        let numbers: Vec<f32> =
            rest.split_whitespace().filter_map(|word| word.parse().ok()).filter(|v: &f32| v.is_finite()).collect();
        match (key, numbers.as_slice()) {
            ("Kd", &[r, g, b]) => material.color = Some([r, g, b]),
            ("Ns", &[n]) => material.shininess = Some(n),
            ("d", &[opacity]) => material.opacity = Some(opacity),
            ("Tr", &[transparency]) => material.opacity = Some(1.0 - transparency),
            ("Pr", &[roughness]) => material.roughness = Some(roughness),
            ("Pm", &[metallic]) => material.metallic = Some(metallic),
            ("map_Kd", _) => material.texture = Some(rest.trim().to_owned()),
            _ if UNUSED.contains(&key) => unused.extend([key]),
            _ => {}
        }
    }
    if !unused.is_empty() {
        notes.push(format!("{mtl}: not used: {}", unused.into_iter().collect::<Vec<_>>().join(", ")));
    }
    Ok(read.into_iter().map(|(name, material)| (name, finish(&mtl, &material, files, notes))).collect())
}

/// Converts an MTL material to the metallic-roughness model; unspecified properties default to those of matt plastic.
fn finish(mtl: &str, material: &Mtl, files: &mut Files<'_>, notes: &mut Vec<String>) -> Material {
    let mut color = material.color.unwrap_or(PLAIN).map(|value| value.clamp(0.0, 1.0));
    let texture = material.texture.as_deref().and_then(|named| {
        // Options such as `-s 1 1 1` precede the name; names may contain blanks.
        let name = if named.starts_with('-') { named.split_whitespace().last().unwrap_or(named) } else { named };
        texture(mtl, name, files, notes)
    });
    // Many exporters write black for "not set" under a texture.
    if texture.is_some() && color.iter().all(|&value| value < 0.05) {
        color = [1.0; 3];
    }
    // Conversion of the Phong exponent to roughness, after Walter et al. 2007: alpha = sqrt(2 / (n + 2)).
    let alpha = material.shininess.filter(|n| *n >= 0.0).map_or(0.5, |n| (2.0 / (n + 2.0)).sqrt());
    let roughness = material.roughness.unwrap_or(alpha.sqrt()).clamp(0.15, 0.95);
    let opacity = material.opacity.unwrap_or(1.0).clamp(0.05, 1.0);
    let metallic = material.metallic.unwrap_or(0.0).clamp(0.0, 1.0);
    Material { opacity, metallic, texture, ..Material::plain(color, roughness) }
}

/// Texture that a file refers to by name; `None` with a note if it is unavailable.
pub fn texture(
    file: &str,
    named: &str,
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Option<Arc<genmanip_core::Texture>> {
    match beside(file, named) {
        Ok(path) => image(&path, files, notes),
        Err(error) => {
            notes.push(format!("texture ignored: {error}"));
            None
        }
    }
}

/// Texture at a path; `None` with a note if it is unavailable.
pub fn image(path: &str, files: &mut Files<'_>, notes: &mut Vec<String>) -> Option<Arc<genmanip_core::Texture>> {
    match files.image(path) {
        Ok((texture, note)) => {
            notes.extend(note);
            Some(texture)
        }
        Err(error) => {
            notes.push(format!("texture ignored: {error}"));
            None
        }
    }
}
