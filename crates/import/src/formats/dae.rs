//! Collada 1.4 and 1.5: meshes placed by the nodes of the scene, diffuse colours and textures.

use std::collections::{BTreeMap, HashMap};

use genmanip_core::Material;
use genmanip_core::limits::IMPORTED_MESH;
use glam::{DMat4, DVec3};
use roxmltree::{Document, Node, ParsingOptions};

use super::{PLAIN, obj};
use crate::ImportError;
use crate::files::{Files, shortened};
use crate::raw::{RawLink, RawMesh, RawObject, Surface, Unit, Up};

/// Maximum nesting depth of nodes, and (`MAX_PLACED`) maximum number of instantiated nodes and meshes. Bounds time for
/// hostile files.
const MAX_DEPTH: usize = 64;
const MAX_PLACED: usize = 4096;
/// Maximum number of XML nodes. Bounds time and memory for hostile files.
const MAX_NODES: u32 = 2_000_000;

/// Reads the object of a Collada file, in metres.
///
/// # Errors
/// As [`surfaces`].
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut notes = Vec::new();
    let Scene { surfaces, up } = surfaces(path, files, &mut notes)?;
    let link = RawLink { name: "body".into(), surfaces, ..RawLink::default() };
    Ok(RawObject { name: String::new(), links: vec![link], unit: Unit::Metre, up, licence: None, creator: None, notes })
}

/// Contents of a Collada file.
pub struct Scene {
    /// Surfaces in metres, in the axes of the file.
    pub surfaces: Vec<Surface>,
    /// Up axis stated by the file; the readers of robots ignore it.
    pub up: Up,
}

/// The surfaces of a Collada file, scaled to metres.
///
/// # Errors
/// If the file is not Collada, an index or number is invalid, or it holds too many triangles.
pub fn surfaces(path: &str, files: &mut Files<'_>, notes: &mut Vec<String>) -> Result<Scene, ImportError> {
    let text = files.text(path, IMPORTED_MESH)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options);
    let document = document.map_err(|error| ImportError::new(path, format!("not XML: {error}")))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(ImportError::new(path, "expected <COLLADA> as the outermost element"));
    }
    let ids = root.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let asset = child(root, "asset");
    let unit = asset.and_then(|asset| child(asset, "unit")?.attribute("meter")?.trim().parse().ok());
    let unit: f64 = unit.filter(|unit: &f64| unit.is_finite() && *unit > 0.0).unwrap_or(1.0);
    let up = match asset.and_then(|asset| child(asset, "up_axis")?.text()).map(str::trim) {
        Some("Z_UP") => Up::Z,
        Some("X_UP") => Up::Unknown,
        Some(_) | None => Up::Y,
    };
    let mut reader =
        Reader { path, ids, files, notes, materials: BTreeMap::new(), surfaces: Vec::new(), placed: 0, triangles: 0 };
    let to_metres = DMat4::from_scale(DVec3::splat(unit));
    let scene = child(root, "scene").and_then(|scene| reader.target(child(scene, "instance_visual_scene")?));
    let scene = scene.or_else(|| child(child(root, "library_visual_scenes")?, "visual_scene"));
    match scene {
        Some(scene) => reader.nodes(scene, &to_metres, 0)?,
        None => {
            let geometries = children(root, "library_geometries").flat_map(|library| children(library, "geometry"));
            for geometry in geometries.collect::<Vec<_>>() {
                reader.geometry(geometry, None, &to_metres)?;
            }
        }
    }
    Ok(Scene { surfaces: reader.surfaces, up })
}

struct Reader<'a, 'i, 'f> {
    path: &'a str,
    ids: HashMap<&'i str, Node<'i, 'i>>,
    files: &'a mut Files<'f>,
    notes: &'a mut Vec<String>,
    /// Materials by the id of their element.
    materials: BTreeMap<String, Material>,
    surfaces: Vec<Surface>,
    placed: usize,
    triangles: usize,
}

/// `<input>` of a primitive: offset of its index within the indices of a vertex, and the values it refers to, `stride`
/// per element.
struct Input {
    offset: usize,
    values: Vec<f64>,
    stride: usize,
}

impl<'i> Reader<'_, 'i, '_> {
    fn wrong(&self, node: Node, message: impl std::fmt::Display) -> ImportError {
        let line = node.document().text_pos_at(node.range().start).row;
        ImportError::new(self.path, format!("line {line}: <{}>: {message}", shortened(node.tag_name().name())))
    }

    /// The element that a `url`, `source` or `target` refers to. `None` if the file has no such element.
    fn target(&self, node: Node<'i, 'i>) -> Option<Node<'i, 'i>> {
        let named = ["url", "source", "target"].into_iter().find_map(|key| node.attribute(key))?;
        self.ids.get(named.trim().trim_start_matches('#')).copied()
    }

    fn numbers(&self, node: Node) -> Result<Vec<f64>, ImportError> {
        let text = node.text().unwrap_or_default();
        let number = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite());
        let values: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
        values.ok_or_else(|| self.wrong(node, "expected finite numbers"))
    }

    fn indices(&self, node: Node) -> Result<Vec<usize>, ImportError> {
        let text = node.text().unwrap_or_default();
        let values: Option<Vec<usize>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        values.ok_or_else(|| self.wrong(node, "expected indices"))
    }

    fn nodes(&mut self, parent: Node<'i, 'i>, outer: &DMat4, depth: usize) -> Result<(), ImportError> {
        if depth > MAX_DEPTH {
            return Err(self.wrong(parent, format!("nodes are nested deeper than {MAX_DEPTH}")));
        }
        self.count(parent)?;
        let mut here = *outer;
        for node in parent.children().filter(Node::is_element) {
            match node.tag_name().name() {
                "matrix" | "translate" | "rotate" | "scale" => here *= self.transform(node)?,
                "node" => self.nodes(node, &here, depth + 1)?,
                "instance_node" => {
                    if let Some(target) = self.target(node) {
                        self.nodes(target, &here, depth + 1)?;
                    }
                }
                "instance_geometry" | "instance_controller" => {
                    let mut target = self.target(node);
                    // A skin deforms a geometry; the import uses its undeformed shape.
                    if let Some(skin) = target.and_then(|controller| child(controller, "skin")) {
                        target = self.target(skin);
                    }
                    let Some(geometry) = target else {
                        return Err(self.wrong(node, "refers to a geometry that does not exist"));
                    };
                    self.geometry(geometry, Some(node), &here)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Counts an instantiated node or mesh, and fails above the limit: nodes that instantiate each other would not end.
    fn count(&mut self, node: Node) -> Result<(), ImportError> {
        self.placed += 1;
        if self.placed > MAX_PLACED {
            return Err(self.wrong(node, format!("more than {MAX_PLACED} placed nodes, meshes and lists of polygons")));
        }
        Ok(())
    }

    fn transform(&self, node: Node) -> Result<DMat4, ImportError> {
        let values = self.numbers(node)?;
        match (node.tag_name().name(), values.as_slice()) {
            ("matrix", rows) if rows.len() == 16 => {
                Ok(DMat4::from_cols_array(&std::array::from_fn(|index| rows[index])).transpose())
            }
            ("translate", &[x, y, z]) => Ok(DMat4::from_translation(DVec3::new(x, y, z))),
            ("scale", &[x, y, z]) => Ok(DMat4::from_scale(DVec3::new(x, y, z))),
            ("rotate", &[x, y, z, degrees]) => {
                let axis = DVec3::new(x, y, z).try_normalize();
                Ok(axis.map_or(DMat4::IDENTITY, |axis| DMat4::from_axis_angle(axis, degrees.to_radians())))
            }
            (_, values) => Err(self.wrong(node, format!("unexpected number of values: {}", values.len()))),
        }
    }

    fn geometry(
        &mut self,
        geometry: Node<'i, 'i>,
        instance: Option<Node<'i, 'i>>,
        file_from_mesh: &DMat4,
    ) -> Result<(), ImportError> {
        self.count(geometry)?;
        let Some(mesh) = child(geometry, "mesh") else { return Ok(()) };
        for primitive in mesh.children().filter(Node::is_element) {
            let kind = primitive.tag_name().name();
            if !matches!(kind, "triangles" | "polylist" | "polygons" | "trifans" | "tristrips") {
                continue;
            }
            self.count(primitive)?;
            let triangles = self.triangles_of(primitive)?;
            if triangles.triangles.is_empty() {
                continue;
            }
            let material = self.material(primitive, instance);
            let name = geometry.attribute("name").or_else(|| geometry.attribute("id")).unwrap_or_default().to_owned();
            self.surfaces.push(Surface { name, mesh: triangles.transformed(file_from_mesh), material });
        }
        Ok(())
    }

    fn input(&self, node: Node<'i, 'i>, offset: usize) -> Result<Input, ImportError> {
        let source = self.target(node).ok_or_else(|| self.wrong(node, "refers to a source that does not exist"))?;
        let accessor = child(source, "technique_common").and_then(|technique| child(technique, "accessor"));
        let number = |key: &str| accessor.and_then(|accessor| accessor.attribute(key)?.trim().parse::<usize>().ok());
        let array = accessor.and_then(|accessor| self.target(accessor)).or_else(|| child(source, "float_array"));
        let array = array.ok_or_else(|| self.wrong(source, "expected a <float_array>"))?;
        let mut values = self.numbers(array)?;
        values.drain(..number("offset").unwrap_or(0).min(values.len()));
        Ok(Input { offset, values, stride: number("stride").unwrap_or(3).clamp(1, 64) })
    }

    fn triangles_of(&mut self, primitive: Node<'i, 'i>) -> Result<RawMesh, ImportError> {
        let (mut corners, mut places, mut width) = (None, None, 1);
        for node in children(primitive, "input") {
            let offset: usize = node.attribute("offset").and_then(|text| text.trim().parse().ok()).unwrap_or(0);
            if offset > 64 {
                return Err(self.wrong(node, format!("offset {offset}; at most 64 are read")));
            }
            width = width.max(offset + 1);
            match node.attribute("semantic") {
                Some("VERTEX") => {
                    let vertices = self.target(node).ok_or_else(|| self.wrong(node, "refers to nothing"))?;
                    let position =
                        children(vertices, "input").find(|node| node.attribute("semantic") == Some("POSITION"));
                    let position = position.ok_or_else(|| self.wrong(vertices, "expected positions"))?;
                    corners = Some(self.input(position, offset)?);
                }
                Some("TEXCOORD") if places.is_none() => places = self.input(node, offset).ok(),
                _ => {}
            }
        }
        let Some(corners) = corners else { return Ok(RawMesh::default()) };
        let places = places.filter(|places: &Input| places.stride >= 2);
        let mut builder = Builder { corners, places, known: HashMap::new(), mesh: RawMesh::default() };
        let kind = primitive.tag_name().name();
        let counts = child(primitive, "vcount").map(|counts| self.indices(counts)).transpose()?;
        for list in children(primitive, "p") {
            let list = self.indices(list)?;
            let vertices: Vec<&[usize]> = list.chunks_exact(width).collect();
            let mut polygons: Vec<(usize, usize)> = Vec::new();
            match (kind, &counts) {
                ("polylist", Some(counts)) => {
                    let mut start = 0_usize;
                    for &count in counts {
                        polygons.push((start, count));
                        start = start.saturating_add(count);
                    }
                }
                ("polygons" | "trifans", _) => polygons.push((0, vertices.len())),
                ("tristrips", _) => polygons.extend((0..vertices.len().saturating_sub(2)).map(|start| (start, 3))),
                _ => polygons.extend((0..vertices.len() / 3).map(|index| (3 * index, 3))),
            }
            for (start, count) in polygons {
                let Some(polygon) = start.checked_add(count).and_then(|end| vertices.get(start..end)) else {
                    return Err(self.wrong(primitive, "a polygon has more vertices than are listed"));
                };
                self.triangles += count.saturating_sub(2);
                if self.triangles > self.files.max_triangles {
                    let message = format!("more than {} triangles", self.files.max_triangles);
                    return Err(ImportError::new(self.path, message).hint("reduce it in a modelling program first"));
                }
                let flipped = kind == "tristrips" && start % 2 == 1;
                builder.polygon(polygon, flipped).ok_or_else(|| self.wrong(primitive, "an index is out of range"))?;
            }
        }
        Ok(builder.mesh)
    }

    fn material(&mut self, primitive: Node<'i, 'i>, instance: Option<Node<'i, 'i>>) -> Material {
        let symbol = primitive.attribute("material");
        let bound = instance.and_then(|instance| {
            let mut bound = instance.descendants().filter(|node| node.has_tag_name_local("instance_material"));
            bound.find(|node| node.attribute("symbol") == symbol).and_then(|node| self.target(node))
        });
        let Some(material) = bound.or_else(|| self.ids.get(symbol?).copied()) else {
            return Material::plain(PLAIN, 0.5);
        };
        let id = material.attribute("id").unwrap_or_default().to_owned();
        if let Some(known) = self.materials.get(&id) {
            return known.clone();
        }
        let made = self.effect(material).unwrap_or_else(|| Material::plain(PLAIN, 0.5));
        self.materials.insert(id, made.clone());
        made
    }

    fn effect(&mut self, material: Node<'i, 'i>) -> Option<Material> {
        let effect = self.target(child(material, "instance_effect")?)?;
        let diffuse = effect.descendants().find(|node| node.has_tag_name_local("diffuse"))?;
        if let Some(color) = child(diffuse, "color") {
            let values = self.numbers(color).ok()?;
            let &[r, g, b, ..] = values.as_slice() else { return None };
            return Some(Material::plain([r, g, b].map(|value| value.clamp(0.0, 1.0) as f32), 0.5));
        }
        let sampler = child(diffuse, "texture")?.attribute("texture")?;
        let parameter = |sid: &str| {
            effect.descendants().find(|node| node.has_tag_name_local("newparam") && node.attribute("sid") == Some(sid))
        };
        let text = |node: Option<Node<'i, 'i>>, tag: &str| {
            node?.descendants().find(|node| node.has_tag_name_local(tag))?.text().map(str::trim)
        };
        let surface = text(parameter(sampler), "source").unwrap_or(sampler);
        let image = text(parameter(surface), "init_from").unwrap_or(surface);
        let image = self.ids.get(image).copied();
        let file = text(image, "init_from").filter(|_| !self.files.geometry_only)?;
        let texture = obj::texture(self.path, file, self.files, self.notes);
        let color = if texture.is_some() { [1.0; 3] } else { PLAIN };
        Some(Material { texture, ..Material::plain(color, 0.5) })
    }
}

/// Mesh under construction: one vertex per distinct pair of position and texture coordinate.
struct Builder {
    corners: Input,
    places: Option<Input>,
    known: HashMap<(usize, usize), u32>,
    mesh: RawMesh,
}

impl Builder {
    /// Adds a convex polygon as a fan; `None` if an index is out of range.
    fn polygon(&mut self, polygon: &[&[usize]], flipped: bool) -> Option<()> {
        let vertices = polygon.iter().map(|indices| self.vertex(indices)).collect::<Option<Vec<_>>>()?;
        for pair in vertices.get(1..).unwrap_or_default().windows(2) {
            let (b, c) = if flipped { (pair[1], pair[0]) } else { (pair[0], pair[1]) };
            self.mesh.triangles.push([vertices[0], b, c]);
        }
        Some(())
    }

    fn vertex(&mut self, indices: &[usize]) -> Option<u32> {
        let corner = *indices.get(self.corners.offset)?;
        let place = self.places.as_ref().and_then(|places| indices.get(places.offset)).copied().unwrap_or(0);
        if let Some(&known) = self.known.get(&(corner, place)) {
            return Some(known);
        }
        let start = corner.checked_mul(self.corners.stride)?;
        let position = self.corners.values.get(start..start.checked_add(3)?)?;
        self.mesh.positions.push(DVec3::from_slice(position));
        if let Some(places) = &self.places {
            let start = place.checked_mul(places.stride)?;
            let uv = places.values.get(start..start.checked_add(2)?)?;
            self.mesh.uvs.push([uv[0] as f32, 1.0 - uv[1] as f32]);
        }
        let index = self.mesh.positions.len() as u32 - 1;
        self.known.insert((corner, place), index);
        Some(index)
    }
}

/// Tag names without their namespace.
trait LocalName {
    fn has_tag_name_local(&self, name: &str) -> bool;
}

impl LocalName for Node<'_, '_> {
    fn has_tag_name_local(&self, name: &str) -> bool {
        self.is_element() && self.tag_name().name() == name
    }
}

fn children<'i>(node: Node<'i, 'i>, tag: &'static str) -> impl Iterator<Item = Node<'i, 'i>> {
    node.children().filter(move |child| child.has_tag_name_local(tag))
}

fn child<'i>(node: Node<'i, 'i>, tag: &'static str) -> Option<Node<'i, 'i>> {
    children(node, tag).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit square in centimetres, translated and rotated by its nodes.
    const SQUARE: &str = r##"<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
      <asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>
      <library_effects><effect id="red-fx"><profile_COMMON><technique sid="common"><lambert><diffuse>
        <color>1 0 0 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
      <library_materials><material id="red"><instance_effect url="#red-fx"/></material></library_materials>
      <library_geometries><geometry id="g"><mesh>
        <source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
          <technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <polylist material="m" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
          <input semantic="NORMAL" source="#p" offset="1"/><vcount>4</vcount><p>0 0 1 0 2 0 3 0</p></polylist>
      </mesh></geometry></library_geometries>
      <library_visual_scenes><visual_scene id="s"><node><translate>0 0 100</translate><rotate>0 0 1 90</rotate>
        <node><matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</matrix><instance_geometry url="#g"><bind_material>
          <technique_common><instance_material symbol="m" target="#red"/></technique_common></bind_material>
        </instance_geometry></node></node></visual_scene></library_visual_scenes>
      <scene><instance_visual_scene url="#s"/></scene></COLLADA>"##;

    fn scene(text: &str) -> Result<Scene, ImportError> {
        let bytes = text.as_bytes().to_vec();
        let mut read = move |_: &str, _| Ok(bytes.clone());
        surfaces("a.dae", &mut Files::new(&mut read), &mut Vec::new())
    }

    #[test]
    fn nodes_place_meshes_in_metres() {
        let Scene { surfaces, up } = scene(SQUARE).unwrap();
        let [surface] = surfaces.as_slice() else { panic!("{} surfaces", surfaces.len()) };
        let expected = [[0.0, 0.0, 1.0], [0.0, 0.02, 1.0], [-0.02, 0.02, 1.0], [-0.02, 0.0, 1.0]];
        for (found, expected) in surface.mesh.positions.iter().zip(expected) {
            assert!(found.abs_diff_eq(DVec3::from_array(expected), 1e-12), "{found}");
        }
        assert_eq!(surface.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!((surface.material.base_color, up), ([1.0, 0.0, 0.0], Up::Z));
    }

    #[test]
    fn broken_files_are_located() {
        for (old, new, expected) in [
            ("<COLLADA", "<COLADA", "not XML"),
            ("3 0</p>", "9 0</p>", "an index is out of range"),
            ("<vcount>4", "<vcount>5", "more vertices than are listed"),
            ("url=\"#g\"", "url=\"#h\"", "geometry that does not exist"),
            ("0 0 100", "0 0 nan", "expected finite numbers"),
        ] {
            let Err(error) = scene(&SQUARE.replacen(old, new, 1)) else { panic!("{new} was read") };
            assert!(error.to_string().contains(expected), "{new}: {error}");
        }
    }
}
