//! File format of an imported object: a JSON header followed by binary meshes and textures.
//!
//! `GMOBJ1\n`, the header's length (u32), the header, then in the order of the header's parts: positions and normals
//! (three f32 per vertex), texture coordinates (two), triangles (three u32), and textures (rows of RGB).
//! Numbers are little-endian. Files are untrusted: every length and index is validated.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_assets::imported::Origin;
use genmanip_core::{
    Joint, JointState, MassProperties, Material, ObjectCard, ObjectLink, ObjectModel, Piece, Pose, Texture, TriMesh,
    VisualPart,
};
use glam::{DMat3, DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::Imported;
use crate::report::Report;

const MARK: &[u8] = b"GMOBJ1\n";
/// Maximum number of vertices, triangles and pixels of one part. Bounds memory for hostile files.
const MAX_COUNT: u64 = 4 << 20;

/// JSON header: everything except meshes and textures.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    card: ObjectCard,
    family: String,
    friction: f64,
    links: Vec<Link>,
    states: Vec<JointState>,
    origin: Origin,
    report: Report,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Link {
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    joint: Option<Joint>,
    pieces: Vec<Piece>,
    cavity: Vec<Piece>,
    mass_kg: f64,
    center: DVec3,
    inertia: DMat3,
    parts: Vec<Part>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Part {
    name: String,
    corners: u64,
    triangles: u64,
    link_from_part: Pose,
    base_color: [f32; 3],
    roughness: f32,
    metallic: f32,
    opacity: f32,
    ior: f32,
    thin_walled: bool,
    /// Index of the texture in the file; `None` without texture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture: Option<usize>,
    /// Width and height of the texture (pixels), stored with the first part that uses it. `None` for the other parts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture_size: Option<[u32; 2]>,
}

/// Bytes of an object file.
pub fn to_bytes(object: &Imported) -> Vec<u8> {
    let (mut numbers, mut texels, mut known) = (Vec::new(), Vec::new(), BTreeMap::new());
    let model = &object.model;
    let links = model.links.iter().map(|link| Link {
        name: link.name.clone(),
        joint: link.joint.clone(),
        pieces: link.pieces.clone(),
        cavity: link.cavity.clone(),
        mass_kg: link.mass.mass_kg,
        center: link.mass.center,
        inertia: link.mass.inertia,
        parts: link.visual.iter().map(|part| to_part(part, &mut numbers, &mut texels, &mut known)).collect(),
    });
    let header = Header {
        card: model.card.clone(),
        family: model.family.clone(),
        friction: model.friction,
        links: links.collect(),
        states: model.joint_states.clone(),
        origin: object.origin.clone(),
        report: object.report.clone(),
    };
    let header = serde_json::to_vec(&header).unwrap_or_default();
    let mut bytes = MARK.to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header);
    bytes.append(&mut numbers);
    bytes.append(&mut texels);
    bytes
}

fn to_part(part: &VisualPart, numbers: &mut Vec<u8>, texels: &mut Vec<u8>, known: &mut BTreeMap<usize, usize>) -> Part {
    let (mesh, material) = (&part.mesh, &part.material);
    let mut write = |values: &[f32]| values.iter().for_each(|value| numbers.extend(value.to_le_bytes()));
    mesh.positions.iter().for_each(|position| write(&position.to_array()));
    mesh.normals.iter().for_each(|normal| write(&normal.to_array()));
    mesh.uvs.iter().for_each(|uv| write(&uv.to_array()));
    mesh.triangles.iter().flatten().for_each(|index| numbers.extend(index.to_le_bytes()));
    let mut texture_size = None;
    let texture = material.texture.as_ref().map(|texture| {
        let next = known.len();
        *known.entry(Arc::as_ptr(texture) as usize).or_insert_with(|| {
            texture_size = Some([texture.width, texture.height]);
            texels.extend(&texture.rgb);
            next
        })
    });
    Part {
        name: part.name.clone(),
        corners: mesh.positions.len() as u64,
        triangles: mesh.triangles.len() as u64,
        link_from_part: part.link_from_part,
        base_color: material.base_color,
        roughness: material.roughness,
        metallic: material.metallic,
        opacity: material.opacity,
        ior: material.ior,
        thin_walled: material.thin_walled,
        texture,
        texture_size,
    }
}

/// Deserialises an object.
///
/// # Errors
/// If the file is truncated, or its header does not match the data; the error is a message.
pub fn from_bytes(bytes: &[u8]) -> Result<Imported, String> {
    let rest = bytes.strip_prefix(MARK).ok_or("not a file of an imported object")?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or("truncated in the header")?;
    let length = u32::from_le_bytes(*length) as usize;
    let (header, numbers) = rest.split_at_checked(length).ok_or("truncated in the header")?;
    let header: Header =
        serde_json::from_slice(header).map_err(|error| format!("invalid header of an imported object: {error}"))?;
    let all = header.links.iter().flat_map(|link| &link.parts);
    let mut needed = 0_u64;
    for part in all.clone() {
        let [width, height] = part.texture_size.unwrap_or([0, 0]).map(u64::from);
        if part.corners > MAX_COUNT || part.triangles > MAX_COUNT || width > 8192 || height > 8192 {
            return Err(format!("part {} is too large", part.name));
        }
        needed += 4 * (8 * part.corners + 3 * part.triangles) + 3 * width * height;
    }
    if needed != numbers.len() as u64 {
        return Err(format!("{} bytes of meshes and textures; the header states {needed}", numbers.len()));
    }
    let meshes: usize = all.clone().map(|part| 4 * (8 * part.corners + 3 * part.triangles) as usize).sum();
    let (mut numbers, mut texels) = numbers.split_at(meshes);
    let mut textures: Vec<Arc<Texture>> = Vec::new();
    let mut links = Vec::new();
    for (index, link) in header.links.into_iter().enumerate() {
        let visual = link.parts.iter().map(|part| from_part(part, &mut numbers, &mut texels, &mut textures));
        let visual = visual.collect::<Result<Vec<VisualPart>, String>>()?;
        let joint = link.joint.map(|joint| checked(joint, index)).transpose()?;
        if joint.is_none() != (index == 0)
            || !(link.mass_kg.is_finite() && link.mass_kg > 0.0)
            || !link.center.is_finite()
        {
            return Err(format!("link {}: expected a positive mass, and a joint unless it is the first", link.name));
        }
        links.push(ObjectLink {
            name: link.name,
            joint,
            visual,
            pieces: link.pieces,
            cavity: link.cavity,
            mass: MassProperties { mass_kg: link.mass_kg, center: link.center, inertia: link.inertia },
        });
    }
    if links.is_empty() {
        return Err("an object without links".into());
    }
    let model = ObjectModel {
        asset: header.card.asset.clone(),
        card: header.card,
        family: header.family,
        links,
        friction: header.friction,
        joint_states: header.states,
    };
    Ok(Imported { model, origin: header.origin, report: header.report })
}

fn checked(joint: Joint, index: usize) -> Result<Joint, String> {
    if joint.parent >= index
        || joint.range.iter().any(|end| !end.is_finite())
        || joint.range[0] > joint.range[1]
        || !joint.axis.is_normalized()
    {
        return Err(format!("joint {}: expected a parent before it, an increasing range and a unit axis", joint.name));
    }
    Ok(joint)
}

fn from_part(
    part: &Part,
    numbers: &mut &[u8],
    texels: &mut &[u8],
    textures: &mut Vec<Arc<Texture>>,
) -> Result<VisualPart, String> {
    let mut take = |words: u64| {
        let (taken, rest) = numbers.split_at_checked(4 * words as usize).unwrap_or((&[], &[]));
        *numbers = rest;
        taken
    };
    let vector = |bytes: &[u8]| Vec3::from_array([0, 4, 8].map(|at| single(&bytes[at..at + 4])));
    let positions: Vec<Vec3> = take(3 * part.corners).chunks_exact(12).map(vector).collect();
    let normals: Vec<Vec3> = take(3 * part.corners).chunks_exact(12).map(vector).collect();
    let uvs: Vec<Vec2> =
        take(2 * part.corners).chunks_exact(8).map(|uv| Vec2::new(single(&uv[..4]), single(&uv[4..]))).collect();
    let index = |bytes: &[u8]| bytes.try_into().map_or(u32::MAX, u32::from_le_bytes);
    let triangles: Vec<[u32; 3]> =
        take(3 * part.triangles).chunks_exact(12).map(|t| [index(&t[..4]), index(&t[4..8]), index(&t[8..])]).collect();
    if triangles.iter().flatten().any(|&index| u64::from(index) >= part.corners)
        || !positions.iter().all(|p| p.is_finite())
    {
        return Err(format!("part {}: a triangle refers to a missing vertex", part.name));
    }
    if let Some([width, height]) = part.texture_size {
        let (rgb, rest) =
            texels.split_at_checked(width as usize * height as usize * 3).ok_or("truncated in a texture")?;
        *texels = rest;
        textures.push(Arc::new(Texture { width, height, rgb: rgb.to_vec() }));
    }
    let texture = match part.texture {
        Some(number) => {
            Some(textures.get(number).cloned().ok_or_else(|| format!("part {}: missing texture {number}", part.name))?)
        }
        None => None,
    };
    let material = Material {
        base_color: part.base_color,
        roughness: part.roughness,
        metallic: part.metallic,
        opacity: part.opacity,
        ior: part.ior,
        thin_walled: part.thin_walled,
        texture,
    };
    let mesh = TriMesh { positions, normals, uvs, triangles };
    Ok(VisualPart::new(&part.name, mesh, material, part.link_from_part))
}

fn single(bytes: &[u8]) -> f32 {
    bytes.try_into().map_or(f32::NAN, f32::from_le_bytes)
}
