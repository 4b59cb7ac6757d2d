//! Encoder of binary glTF 2.0 (GLB): the meshes of a link, or a whole scenario for modelling programs.
//!
//! Meshes keep the project's axes (metres, z up) in the frame of their link. glTF requires y up, so a whole scenario,
//! which other programs open, has a root node that rotates it.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3, Vec3};
use genmanip_core::{Camera, CameraMount, Material, ObjectModel, Pose, RobotModel, Scenario, Texture, VisualPart};
use genmanip_render::color::linear_from_srgb;
use genmanip_render::encode::{EncodeError, jpeg_rgb, png_rgb};
use genmanip_render::internals::{Mesh, fixtures};
use serde_json::{Value, json};

/// Size from which a texture is stored as JPEG, if that is smaller, bytes. Smaller textures are stored losslessly.
const EXACT_TEXTURE: usize = 64 << 10;
/// Quality of JPEG textures, 1-100. Chosen by hand: compression with full chroma is hardly visible at this value.
const JPEG_QUALITY: u8 = 92;
/// Index of refraction that glTF assumes by default.
const USUAL_IOR: f32 = 1.5;

/// Component types and buffer targets of glTF.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// GLB with the visual parts of one link, in the frame of the link (z up).
///
/// # Errors
/// When the number of a texture's pixels contradicts its size.
pub fn link_glb(name: &str, visual: &[VisualPart]) -> Result<Vec<u8>, EncodeError> {
    let mut glb = Writer::default();
    let root = glb.node(name, &Pose::IDENTITY, visual, Vec::new())?;
    Ok(glb.finish(root))
}

/// GLB with the initial scene of a scenario: surfaces, robot, objects and cameras under a root node that converts z up
/// to
/// y up.
///
/// `models` are the models of the scenario's objects, in the order of the objects.
///
/// # Errors
/// As [`link_glb`].
pub fn scenario_glb(
    scenario: &Scenario,
    models: &[Arc<ObjectModel>],
    robot: &RobotModel,
) -> Result<Vec<u8>, EncodeError> {
    let fixed: Vec<VisualPart> = fixtures(&scenario.world).into_iter().map(|fixture| fixture.visual).collect();
    let mut glb = Writer::default();
    let mut children = vec![glb.node("surfaces", &Pose::IDENTITY, &fixed, Vec::new())?];
    let link_poses = robot.link_poses(scenario.world.robot.start(), robot.gripper.max_width);
    let mut links = Vec::new();
    for (link, pose) in robot.links.iter().zip(&link_poses) {
        links.push(glb.node(&link.name, pose, &link.visual, Vec::new())?);
    }
    children.push(glb.node(&robot.name, &Pose::IDENTITY, &[], links)?);
    for (placed, model) in scenario.objects.iter().zip(models) {
        let mut links = Vec::new();
        for (link, pose) in model.links.iter().zip(model.link_poses(&placed.joint_positions)) {
            links.push(glb.node(&link.name, &pose, &link.visual, Vec::new())?);
        }
        let name = format!("{} {}", placed.id, model.card.name);
        children.push(glb.node(&name, &placed.pose, &[], links)?);
    }
    let world_from_hand = link_poses.get(robot.hand).copied().unwrap_or_default();
    for camera in &scenario.world.cameras {
        let world_from_camera = match camera.mount {
            CameraMount::World => camera.mount_from_camera,
            CameraMount::Hand => world_from_hand * camera.mount_from_camera,
        };
        children.push(glb.camera(camera, &world_from_camera));
    }
    let root = glb.node(&scenario.id, &Z_UP_TO_Y_UP, &[], children)?;
    Ok(glb.finish(root))
}

/// `gltf_from_world`: rotation by -90 degrees about x.
const Z_UP_TO_Y_UP: Pose = Pose {
    position: DVec3::ZERO,
    rotation: DQuat::from_xyzw(-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2),
};

/// Rotation by 180 degrees about x, from the optical axes of OpenCV (y down, z forwards) to those of glTF (y up, z
/// backwards).
const OPTICAL_FROM_GLTF: Pose = Pose { position: DVec3::ZERO, rotation: DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0) };

/// A file under construction: the JSON lists of glTF, and the binary chunk that they refer to.
#[derive(Default)]
struct Writer<'a> {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    cameras: Vec<Value>,
    materials: Vec<(Surface<'a>, Value)>,
    textures: Vec<(&'a Texture, usize)>,
    images: Vec<Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
    /// Index of the mesh for visual parts at this address, which the copies of an object share.
    known: BTreeMap<*const VisualPart, usize>,
}

/// A material, single- or double-sided.
#[derive(Clone, Copy, PartialEq)]
struct Surface<'a> {
    material: &'a Material,
    is_double_sided: bool,
}

/// Vertices and triangles of all parts with the same surface.
#[derive(Default)]
struct Primitive {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<[f32; 2]>,
    triangles: Vec<[u32; 3]>,
}

impl<'a> Writer<'a> {
    /// Adds a node with its pose `parent_from_node`; returns the index of the node.
    fn node(
        &mut self,
        name: &str,
        pose: &Pose,
        visual: &'a [VisualPart],
        children: Vec<usize>,
    ) -> Result<usize, EncodeError> {
        let mut node = json!({ "name": name });
        if *pose != Pose::IDENTITY {
            node["translation"] = json!(pose.position.to_array());
            node["rotation"] = json!(pose.rotation.to_array());
        }
        if !children.is_empty() {
            node["children"] = json!(children);
        }
        if visual.iter().any(|part| !part.render_mesh.triangles.is_empty()) {
            node["mesh"] = json!(self.mesh(name, visual)?);
        }
        self.nodes.push(node);
        Ok(self.nodes.len() - 1)
    }

    /// Adds a node with a pinhole camera of the same vertical field of view; lens distortion is omitted.
    fn camera(&mut self, camera: &Camera, world_from_camera: &Pose) -> usize {
        let seen = &camera.intrinsics;
        self.cameras.push(json!({
            "name": camera.name,
            "type": "perspective",
            "perspective": {
                "aspectRatio": f64::from(seen.width) / f64::from(seen.height),
                "yfov": seen.vertical_fov(),
                "znear": 0.01,
                "zfar": 20.0,
            },
        }));
        let pose = *world_from_camera * OPTICAL_FROM_GLTF;
        self.nodes.push(json!({
            "name": camera.name,
            "translation": pose.position.to_array(),
            "rotation": pose.rotation.to_array(),
            "camera": self.cameras.len() - 1,
        }));
        self.nodes.len() - 1
    }

    /// Adds a mesh with one primitive per surface, which needs fewer draw calls than one per part; returns its index.
    fn mesh(&mut self, name: &str, visual: &'a [VisualPart]) -> Result<usize, EncodeError> {
        if let Some(&known) = self.known.get(&visual.as_ptr()) {
            return Ok(known);
        }
        let mut groups: Vec<(Surface<'a>, Primitive)> = Vec::new();
        for part in visual.iter().filter(|part| !part.render_mesh.triangles.is_empty()) {
            let is_closed = Mesh::shared(&part.render_mesh, &part.link_from_part).closed;
            let material = &part.material;
            let surface = Surface { material, is_double_sided: !is_closed || material.opacity < 1.0 };
            let place = groups.iter().position(|(known, _)| *known == surface).unwrap_or_else(|| {
                groups.push((surface, Primitive::default()));
                groups.len() - 1
            });
            groups[place].1.add(part);
        }
        let mut primitives = Vec::new();
        for (surface, primitive) in groups {
            let material = self.material(surface)?;
            primitives.push(self.primitive(&primitive, material, surface.material.texture.is_some()));
        }
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        let index = self.meshes.len() - 1;
        self.known.insert(visual.as_ptr(), index);
        Ok(index)
    }

    fn primitive(&mut self, own: &Primitive, material: usize, is_textured: bool) -> Value {
        let (low, high) = own
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)));
        let count = own.positions.len();
        let floats = |values: &[Vec3]| values.iter().flat_map(Vec3::to_array).flat_map(f32::to_le_bytes).collect();
        let positions = self.accessor(floats(&own.positions), ARRAY_BUFFER, FLOAT, count, "VEC3");
        self.accessors[positions]["min"] = json!(low.to_array());
        self.accessors[positions]["max"] = json!(high.to_array());
        let mut attributes = json!({ "POSITION": positions });
        // Without normals, a viewer uses flat shading.
        if own.normals.len() == count {
            attributes["NORMAL"] = json!(self.accessor(floats(&own.normals), ARRAY_BUFFER, FLOAT, count, "VEC3"));
        }
        if is_textured && own.uvs.len() == count {
            let uvs = own.uvs.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
            attributes["TEXCOORD_0"] = json!(self.accessor(uvs, ARRAY_BUFFER, FLOAT, count, "VEC2"));
        }
        let corners = own.triangles.iter().flatten();
        let (bytes, kind): (Vec<u8>, u32) = if count <= usize::from(u16::MAX) {
            (corners.flat_map(|&corner| (corner as u16).to_le_bytes()).collect(), UNSIGNED_SHORT)
        } else {
            (corners.flat_map(|corner| corner.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        let indices = self.accessor(bytes, ELEMENT_ARRAY_BUFFER, kind, own.triangles.len() * 3, "SCALAR");
        json!({ "attributes": attributes, "indices": indices, "material": material })
    }

    fn accessor(&mut self, bytes: Vec<u8>, target: u32, component: u32, count: usize, shape: &str) -> usize {
        let view = self.view(&bytes, Some(target));
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": shape }));
        self.accessors.len() - 1
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    fn material(&mut self, surface: Surface<'a>) -> Result<usize, EncodeError> {
        if let Some(known) = self.materials.iter().position(|(known, _)| *known == surface) {
            return Ok(known);
        }
        let own = surface.material;
        let [r, g, b] = linear_from_srgb(own.base_color).to_array();
        let mut pbr = json!({
            "baseColorFactor": [r, g, b, own.opacity],
            "metallicFactor": own.metallic,
            "roughnessFactor": own.roughness,
        });
        if let Some(texture) = &own.texture {
            pbr["baseColorTexture"] = json!({ "index": self.texture(texture)? });
        }
        let mut material = json!({ "pbrMetallicRoughness": pbr });
        if surface.is_double_sided {
            material["doubleSided"] = json!(true);
        }
        if own.opacity < 1.0 {
            material["alphaMode"] = json!("BLEND");
            if (own.ior - USUAL_IOR).abs() > 1e-3 {
                material["extensions"] = json!({ "KHR_materials_ior": { "ior": own.ior } });
            }
        }
        self.materials.push((surface, material));
        Ok(self.materials.len() - 1)
    }

    fn texture(&mut self, texture: &'a Texture) -> Result<usize, EncodeError> {
        if let Some((_, known)) = self.textures.iter().find(|(known, _)| std::ptr::eq(*known, texture)) {
            return Ok(*known);
        }
        let mut kind = "image/png";
        let mut bytes = png_rgb(texture.width, texture.height, &texture.rgb)?;
        if bytes.len() > EXACT_TEXTURE {
            let jpeg = jpeg_rgb(texture.width, texture.height, &texture.rgb, JPEG_QUALITY)?;
            if jpeg.len() < bytes.len() {
                (kind, bytes) = ("image/jpeg", jpeg);
            }
        }
        let view = self.view(&bytes, None);
        self.images.push(json!({ "bufferView": view, "mimeType": kind }));
        self.textures.push((texture, self.images.len() - 1));
        Ok(self.images.len() - 1)
    }

    /// Content of the file, with this node as the root of its scene.
    fn finish(self, root: usize) -> Vec<u8> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": concat!("genmanip ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": [root] }],
            "nodes": self.nodes,
        });
        let textures: Vec<Value> = (0..self.images.len()).map(|image| json!({ "source": image })).collect();
        let materials: Vec<Value> = self.materials.into_iter().map(|(_, material)| material).collect();
        let uses_ior = materials.iter().any(|material| material.get("extensions").is_some());
        // glTF forbids empty lists, so these are omitted.
        for (name, list) in [
            ("meshes", self.meshes),
            ("cameras", self.cameras),
            ("materials", materials),
            ("textures", textures),
            ("images", self.images),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ] {
            if !list.is_empty() {
                document[name] = Value::Array(list);
            }
        }
        if uses_ior {
            document["extensionsUsed"] = json!(["KHR_materials_ior"]);
        }
        if !self.binary.is_empty() {
            document["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        }
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut chunks = Vec::with_capacity(text.len() + self.binary.len() + 28);
        let mut chunk = |kind: &[u8; 4], bytes: &[u8]| {
            chunks.extend((bytes.len() as u32).to_le_bytes());
            chunks.extend(kind);
            chunks.extend(bytes);
        };
        chunk(b"JSON", &text);
        if !self.binary.is_empty() {
            chunk(b"BIN\0", &self.binary);
        }
        let mut file = b"glTF\x02\0\0\0".to_vec();
        file.extend((chunks.len() as u32 + 12).to_le_bytes());
        file.append(&mut chunks);
        file
    }
}

impl Primitive {
    /// Adds the triangles of a part, transformed to the frame of its link.
    fn add(&mut self, part: &VisualPart) {
        let (mesh, first) = (&part.render_mesh, self.positions.len());
        let count = mesh.positions.len();
        let (place, first_corner) = (&part.link_from_part, first as u32);
        self.positions.extend(mesh.positions.iter().map(|at| place.transform_point(at.as_dvec3()).as_vec3()));
        // An attribute that one part lacks is dropped for all, since its list is then shorter than the positions.
        if mesh.normals.len() == count {
            let turned = |normal: &Vec3| place.transform_vector(normal.as_dvec3()).as_vec3().normalize_or(Vec3::Z);
            self.normals.extend(mesh.normals.iter().map(turned));
        }
        if mesh.uvs.len() == count {
            self.uvs.extend(mesh.uvs.iter().map(|uv| uv.to_array()));
        }
        self.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|corner| corner + first_corner)));
    }
}
