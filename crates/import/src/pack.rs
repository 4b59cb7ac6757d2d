//! How an imported object is kept: one file of a header in JSON and the numbers of its meshes and pictures.
//!
//! `GMOBJ1\n`, the header's length (u32), the header, then in the order of the header's parts: positions and normals
//! (three f32 per corner), texture coordinates (two), triangles (three u32), and pictures (rows of RGB).
//! Numbers are little-endian. Nothing in such a file is trusted: every length and every index is checked.

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
/// Most corners, triangles and pixels of one part.
const MOST: u64 = 4 << 20;

/// What is kept of an imported object besides meshes and pictures.
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
    /// Number of the picture over it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture: Option<usize>,
    /// Width and height of that picture, where this part is the first that has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture_size: Option<[u32; 2]>,
}

/// The bytes of the file of an object.
pub fn to_bytes(object: &Imported) -> Vec<u8> {
    let (mut numbers, mut pictures, mut known) = (Vec::new(), Vec::new(), BTreeMap::new());
    let model = &object.model;
    let links = model.links.iter().map(|link| Link {
        name: link.name.clone(),
        joint: link.joint.clone(),
        pieces: link.pieces.clone(),
        cavity: link.cavity.clone(),
        mass_kg: link.mass.mass_kg,
        center: link.mass.center,
        inertia: link.mass.inertia,
        parts: link.visual.iter().map(|part| to_part(part, &mut numbers, &mut pictures, &mut known)).collect(),
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
    bytes.append(&mut pictures);
    bytes
}

fn to_part(
    part: &VisualPart,
    numbers: &mut Vec<u8>,
    pictures: &mut Vec<u8>,
    known: &mut BTreeMap<usize, usize>,
) -> Part {
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
            pictures.extend(&texture.rgb);
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

/// The object of a file; the words say what is wrong with it.
///
/// # Errors
/// When the file is cut off, or its header does not fit what follows.
pub fn from_bytes(bytes: &[u8]) -> Result<Imported, String> {
    let rest = bytes.strip_prefix(MARK).ok_or("no file of an imported object")?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or("cut off in the header")?;
    let length = u32::from_le_bytes(*length) as usize;
    let (header, numbers) = rest.split_at_checked(length).ok_or("cut off in the header")?;
    let header: Header =
        serde_json::from_slice(header).map_err(|error| format!("no header of an imported object: {error}"))?;
    let all = header.links.iter().flat_map(|link| &link.parts);
    let mut needed = 0_u64;
    for part in all.clone() {
        let [width, height] = part.texture_size.unwrap_or([0, 0]).map(u64::from);
        if part.corners > MOST || part.triangles > MOST || width > 8192 || height > 8192 {
            return Err(format!("part {} is too large", part.name));
        }
        needed += 4 * (8 * part.corners + 3 * part.triangles) + 3 * width * height;
    }
    if needed != numbers.len() as u64 {
        return Err(format!("{} bytes of meshes and pictures; its header speaks of {needed}", numbers.len()));
    }
    let meshes: usize = all.clone().map(|part| 4 * (8 * part.corners + 3 * part.triangles) as usize).sum();
    let (mut numbers, mut pictures) = numbers.split_at(meshes);
    let mut textures: Vec<Arc<Texture>> = Vec::new();
    let mut links = Vec::new();
    for (index, link) in header.links.into_iter().enumerate() {
        let visual = link.parts.iter().map(|part| from_part(part, &mut numbers, &mut pictures, &mut textures));
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
        return Err(format!("joint {}: expected a parent before it, a rising range and a unit axis", joint.name));
    }
    Ok(joint)
}

fn from_part(
    part: &Part,
    numbers: &mut &[u8],
    pictures: &mut &[u8],
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
        return Err(format!("part {}: a triangle names a corner that there is not", part.name));
    }
    if let Some([width, height]) = part.texture_size {
        let (rgb, rest) =
            pictures.split_at_checked(width as usize * height as usize * 3).ok_or("cut off in a picture")?;
        *pictures = rest;
        textures.push(Arc::new(Texture { width, height, rgb: rgb.to_vec() }));
    }
    let texture = match part.texture {
        Some(number) => Some(
            textures.get(number).cloned().ok_or_else(|| format!("part {}: there is no picture {number}", part.name))?,
        ),
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
