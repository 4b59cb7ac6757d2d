//! Readers of file formats: each converts file contents to a [`crate::raw::RawObject`] without guessing.

pub mod dae;
pub mod glb;
pub mod mjcf;
pub mod obj;
mod solid;
pub mod stl;
pub mod urdf;
pub mod usd;
pub(crate) mod xml;

use genmanip_core::limits::IMPORTED_MESH;

use crate::ImportError;
use crate::files::Files;
use crate::raw::{RawLink, RawMesh, RawObject, Surface, Unit, Up};
use genmanip_core::Material;
use glam::DVec3;

/// Colour of surfaces without a material, as in STL.
const PLAIN: [f32; 3] = [0.7, 0.7, 0.7];

/// Lower-case extension of a path.
pub fn extension(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or_default();
    name.rsplit_once('.').map_or_else(String::new, |(_, extension)| extension.to_ascii_lowercase())
}

/// Reads an object, choosing the format by the file's extension.
///
/// # Errors
/// As the format's reader, or if the extension is unknown.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    match extension(path).as_str() {
        "obj" => obj::read(path, files),
        "dae" => dae::read(path, files),
        "glb" | "gltf" => glb::read(path, files),
        "urdf" => urdf::read(path, files),
        "xml" => mjcf::read(path, files),
        "usd" | "usda" | "usdc" | "usdz" => usd::read(path, files),
        "stl" | "msh" => {
            let surface =
                Surface { name: "body".into(), mesh: mesh(path, files)?, material: Material::plain(PLAIN, 0.5) };
            let link = RawLink { name: "body".into(), surfaces: vec![surface], ..RawLink::default() };
            Ok(RawObject {
                name: String::new(),
                links: vec![link],
                unit: Unit::Unknown,
                up: Up::Z,
                licence: None,
                creator: None,
                notes: Vec::new(),
            })
        }
        other => Err(ImportError::new(path, format!("unsupported file extension `{other}`")).hint(
            "expected .glb, .gltf, .obj, .dae, .stl, .msh, .urdf, .xml (MJCF), .usd, .usda, .usdc or .usdz; \
                 unpack archives first",
        )),
    }
}

/// Adds a format-specific hint to an error without one.
pub fn advised(error: ImportError) -> ImportError {
    if !error.hint.is_empty() {
        return error;
    }
    let hint = match extension(&error.file).as_str() {
        "glb" | "gltf" => "copy or export it again as glTF 2.0; the Khronos glTF validator lists all errors",
        "obj" => "fix it or export it again; lines are `v X Y Z`, `vt U V`, and `f` with vertex indices from 1",
        "dae" => "export it again as Collada 1.4 or 1.5, or convert it to OBJ",
        "stl" => "copy it again, or export it as binary STL",
        "msh" => {
            "expected MuJoCo's MSH: counts of vertices, normals, texture coordinates and faces, then the data; or convert it to OBJ"
        }
        "urdf" => "fix it at this position; `check_urdf` and other readers report the same position",
        "xml" => "fix it at this position; MuJoCo's own compiler documents what it accepts",
        "usd" | "usda" | "usdc" | "usdz" => "copy or export it again; `usdchecker` of Pixar's library lists all errors",
        _ => "expected a file that contains an object",
    };
    error.hint(hint)
}

/// Triangles of a mesh file by their corners; those of points without faces have three equal corners.
///
/// # Errors
/// As [`read`], but a file without triangles is no error.
pub fn triangles(path: &str, files: &mut Files<'_>) -> Result<Vec<[DVec3; 3]>, ImportError> {
    match extension(path).as_str() {
        "stl" => {
            let corners = stl::corners(path, &files.bytes(path, IMPORTED_MESH)?, files.max_triangles)?;
            Ok(corners.chunks(3).map(|some| [some[0], some[some.len() / 2], some[some.len() - 1]]).collect())
        }
        "obj" => obj::triangles(path, files),
        _ => {
            let RawMesh { positions, triangles, .. } = mesh(path, files)?;
            Ok(triangles.iter().map(|triangle| triangle.map(|index| positions[index as usize])).collect())
        }
    }
}

fn joined(surfaces: Vec<Surface>) -> RawMesh {
    let mut all = RawMesh::default();
    surfaces.iter().for_each(|surface| all.append(&surface.mesh));
    all
}

/// Triangles of a mesh file; materials are ignored.
///
/// # Errors
/// As [`read`].
pub fn mesh(path: &str, files: &mut Files<'_>) -> Result<RawMesh, ImportError> {
    match extension(path).as_str() {
        "stl" => stl::read(path, &files.bytes(path, IMPORTED_MESH)?),
        "msh" => stl::read_msh(path, &files.bytes(path, IMPORTED_MESH)?),
        // In the axes of the file, as other readers of robot descriptions interpret it.
        "dae" => Ok(joined(dae::surfaces(path, files, &mut Vec::new())?.surfaces)),
        _ => {
            let object = read(path, files)?;
            Ok(object.all_surfaces())
        }
    }
}
