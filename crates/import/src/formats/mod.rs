//! Readers of file formats: each makes a [`crate::raw::RawObject`] of what its files say, and guesses nothing.

pub mod glb;
pub mod mjcf;
pub mod obj;
mod solid;
pub mod stl;
pub mod urdf;
mod xml;

use genmanip_core::limits::IMPORTED_MESH;

use crate::ImportError;
use crate::files::Files;
use crate::raw::{RawLink, RawMesh, RawObject, Surface, Unit, Up};
use genmanip_core::Material;

/// Of surfaces without a material, as in STL.
const PLAIN: [f32; 3] = [0.7, 0.7, 0.7];

/// The ending of a path, in small letters.
pub fn ending(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or_default();
    name.rsplit_once('.').map_or_else(String::new, |(_, ending)| ending.to_ascii_lowercase())
}

/// Reads the object of a file by its ending.
///
/// # Errors
/// As the reader of the format, or when there is none for the ending.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    match ending(path).as_str() {
        "obj" => obj::read(path, files),
        "glb" | "gltf" => glb::read(path, files),
        "urdf" => urdf::read(path, files),
        "xml" => mjcf::read(path, files),
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
        other => Err(ImportError::new(path, format!("the ending `{other}` is of no format that is read"))
            .hint("expected .glb, .gltf, .obj, .stl, .msh, .urdf or .xml (MJCF); unpack archives first")),
    }
}

/// An error with what helps with files of its format, where nothing better is known.
pub fn advised(error: ImportError) -> ImportError {
    if !error.hint.is_empty() {
        return error;
    }
    let hint = match ending(&error.file).as_str() {
        "glb" | "gltf" => "copy or export it again as glTF 2.0; the Khronos glTF validator names all faults",
        "obj" => "mend it or export it again; lines are `v X Y Z`, `vt U V`, and `f` with numbers of corners from 1",
        "stl" => "copy it again, or export it as binary STL",
        "msh" => {
            "expected MuJoCo's MSH: counts of corners, normals, texture coordinates and faces, then these; convert it to OBJ"
        }
        "urdf" => "mend it there; `check_urdf` and other readers name the same place",
        "xml" => "mend it there; MuJoCo's own compiler says what it accepts",
        _ => "expected a file that an object can be read from",
    };
    error.hint(hint)
}

/// The triangles of a mesh file, whatever their materials.
///
/// # Errors
/// As [`read`].
pub fn mesh(path: &str, files: &mut Files<'_>) -> Result<RawMesh, ImportError> {
    match ending(path).as_str() {
        "stl" => stl::read(path, &files.bytes(path, IMPORTED_MESH)?),
        "msh" => stl::read_msh(path, &files.bytes(path, IMPORTED_MESH)?),
        _ => {
            let object = read(path, files)?;
            Ok(object.all_surfaces())
        }
    }
}
