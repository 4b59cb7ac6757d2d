//! The files of one import: confined to a root folder, read once each, and hashed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_core::limits::{IMPORTED_MESH, IMPORTED_PICTURE, Limit, SETTINGS};
use genmanip_core::{Texture, hexadecimal};
use sha2::{Digest, Sha256};

use crate::raw::MAX_TRIANGLES;
use crate::{ImportError, image};

/// Hint on expressions of xacro, the macro language of ROS, in a file that should have none left.
pub const XACRO: &str = "expand the file first: `xacro FILE > robot.urdf`, with ROS or after `pip install xacro`";

/// Version of the pipeline, part of the hash: versions may build different objects from the same files.
const PIPELINE: &str = "genmanip.import/1";
/// Maximum number of files of one object. Bounds time and memory for hostile files.
const MAX_FILES: usize = 512;
/// Maximum total size of one object's files, bytes. Bounds time and memory for hostile files.
const MAX_BYTES: u64 = 256 << 20;
/// Maximum total size of a robot's files, bytes, and (`MAX_ROBOT_TRIANGLES`) maximum number of triangles of one of its
/// meshes.
const MAX_ROBOT_BYTES: u64 = 1 << 30;
const MAX_ROBOT_TRIANGLES: usize = 2_000_000;

/// Reads a file by its path relative to the root; errors are messages.
pub type ReadFile<'a> = dyn FnMut(&str, Limit) -> Result<Vec<u8>, String> + 'a;

/// The files of an object, read on demand.
pub struct Files<'a> {
    read: &'a mut ReadFile<'a>,
    known: BTreeMap<String, Arc<Vec<u8>>>,
    bytes: u64,
    /// Decoded textures by path.
    images: BTreeMap<String, Arc<Texture>>,
    /// Remaining budget of pixels to decode.
    pub pixels_left: usize,
    /// Maximum number of triangles of a mesh.
    pub max_triangles: usize,
    /// True to skip materials and textures.
    pub geometry_only: bool,
    /// Folders on the disk to search for packages; `None` if paths are relative to the root and must stay inside.
    packages: Option<Packages>,
    max_bytes: u64,
}

/// Folders of ROS packages, in the order of the search: named packages, then packages in `ROS_PACKAGE_PATH`, then
/// folders above the file.
#[derive(Clone, Debug, Default)]
pub struct Packages {
    /// Folder of each named package.
    pub named: BTreeMap<String, PathBuf>,
    /// Folders whose subfolders may be packages.
    pub search: Vec<PathBuf>,
}

impl<'a> Files<'a> {
    /// An empty set of files.
    pub fn new(read: &'a mut ReadFile<'a>) -> Self {
        Self {
            read,
            known: BTreeMap::new(),
            bytes: 0,
            images: BTreeMap::new(),
            pixels_left: image::MAX_PIXELS,
            max_triangles: MAX_TRIANGLES,
            geometry_only: false,
            packages: None,
            max_bytes: MAX_BYTES,
        }
    }

    /// The files of a robot: absolute paths anywhere on the disk, and larger meshes.
    pub fn of_robot(read: &'a mut ReadFile<'a>, packages: Packages) -> Self {
        Self {
            packages: Some(packages),
            max_triangles: MAX_ROBOT_TRIANGLES,
            max_bytes: MAX_ROBOT_BYTES,
            ..Self::new(read)
        }
    }

    /// True for the files of an object, some of which may be missing; false for those of a robot.
    pub fn is_object(&self) -> bool {
        self.packages.is_none()
    }

    /// Resolves the name of a mesh or texture in a description; `package://NAME/` is a folder of that name, or one with
    /// a `package.xml` of that name, on the way from the description to the root.
    ///
    /// # Errors
    /// As [`beside`]; for files on the disk, also if none of the candidates exists.
    pub fn locate(&mut self, file: &str, named: &str) -> Result<String, ImportError> {
        let named = named.trim().replace('\\', "/");
        let in_package = ["package://", "model://"].into_iter().find_map(|scheme| named.strip_prefix(scheme));
        let Some(packages) = self.packages.clone() else {
            let Some(rest) = in_package else { return beside(file, &named) };
            let plain = beside(file, rest.split_once('/').map_or(rest, |(_, inside)| inside));
            let found = in_folders_above(file, rest).into_iter().find(|path| self.bytes(path, IMPORTED_MESH).is_ok());
            return found.map_or(plain, Ok);
        };
        let plain = named.strip_prefix("file://").unwrap_or(&named);
        if named.contains("$(") || named.contains("${") {
            let message = format!("refers to the mesh `{}`, an expression of xacro", shortened(&named));
            return Err(ImportError::new(file, message).hint(XACRO));
        }
        if plain.is_empty() || plain.contains(['\0', '\n']) {
            return Err(ImportError::new(file, format!("refers to the file `{}`, which is no path", shortened(plain))));
        }
        let mut candidates: Vec<PathBuf> = Vec::new();
        match in_package {
            Some(rest) => {
                let (package, inside) = rest.split_once('/').unwrap_or(("", rest));
                candidates.extend(packages.named.get(package).map(|folder| folder.join(inside)));
                candidates.extend(packages.search.iter().map(|folder| folder.join(rest)));
                candidates.extend(in_folders_above(file, rest).into_iter().map(PathBuf::from));
            }
            None => {
                candidates.push(Path::new(file).with_file_name(plain));
                // Some exporters write paths relative to the package.
                candidates.extend(Path::new(file).ancestors().skip(2).map(|folder| folder.join(plain)));
            }
        }
        // A blank or another special character of a URI may be written as its code.
        candidates.extend(candidates.iter().filter_map(|path| decoded(path.to_str()?)).collect::<Vec<_>>());
        if let Some(found) = candidates.iter().find(|path| path.is_file()) {
            return Ok(found.display().to_string());
        }
        let error = ImportError::new(file, format!("refers to the mesh `{}`: no such file", shortened(&named)));
        if let Some(other) = candidates.iter().find_map(|path| in_another_case(path)) {
            return Err(error.hint(format!("{other} differs from it in upper and lower case only: rename one of them")));
        }
        Err(match in_package.map(|rest| rest.split('/').next().unwrap_or_default()) {
            Some(package) => error.hint(format!(
                "name the package's folder: --package {}=DIR; or set ROS_PACKAGE_PATH to the folder that contains it",
                shortened(package)
            )),
            None => error.hint("paths are relative to the URDF; package://NAME/… is found by --package NAME=DIR"),
        })
    }

    /// The contents of a file.
    ///
    /// # Errors
    /// If it cannot be read, exceeds the limit, or there are too many files.
    pub fn bytes(&mut self, path: &str, limit: Limit) -> Result<Arc<Vec<u8>>, ImportError> {
        if let Some(bytes) = self.known.get(path) {
            return Ok(Arc::clone(bytes));
        }
        if self.known.len() == MAX_FILES {
            return self.hold(path, Vec::new());
        }
        let bytes = (self.read)(path, limit).map_err(|message| ImportError::new(path, message))?;
        self.hold(path, bytes)
    }

    /// Adds a file that was unpacked from another one; its place is that of the archive as a folder.
    ///
    /// # Errors
    /// If the files become too many or too large.
    pub fn hold(&mut self, path: &str, bytes: Vec<u8>) -> Result<Arc<Vec<u8>>, ImportError> {
        if self.known.len() == MAX_FILES {
            return Err(ImportError::new(path, format!("an object refers to more than {MAX_FILES} files")));
        }
        self.bytes += bytes.len() as u64;
        if self.bytes > self.max_bytes {
            let message = format!("the files of the object exceed {} MiB in total", self.max_bytes >> 20);
            return Err(ImportError::new(path, message));
        }
        let bytes = Arc::new(bytes);
        self.known.insert(path.to_owned(), Arc::clone(&bytes));
        Ok(bytes)
    }

    /// The text of a file in UTF-8, or in UTF-16 with a byte order mark; invalid characters are replaced, because they
    /// can only occur in names and comments.
    ///
    /// # Errors
    /// As [`Files::bytes`].
    pub fn text(&mut self, path: &str, limit: Limit) -> Result<String, ImportError> {
        let bytes = self.bytes(path, limit)?;
        let wide = |unit: fn([u8; 2]) -> u16| {
            let units: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
            String::from_utf16_lossy(&units)
        };
        Ok(match bytes[..] {
            [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
            [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
            _ => String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').to_owned(),
        })
    }

    /// An image, decoded once, with a note if it was downscaled.
    ///
    /// # Errors
    /// As [`Files::bytes`], and if it cannot be decoded.
    pub fn image(&mut self, path: &str) -> Result<(Arc<Texture>, Option<String>), ImportError> {
        if let Some(known) = self.images.get(path) {
            return Ok((Arc::clone(known), None));
        }
        let bytes = self.bytes(path, IMPORTED_PICTURE)?;
        let (texture, note) =
            image::texture(&bytes, &mut self.pixels_left).map_err(|message| ImportError::new(path, message))?;
        let texture = Arc::new(texture);
        self.images.insert(path.to_owned(), Arc::clone(&texture));
        Ok((texture, note.map(|note| format!("{path}: {note}"))))
    }

    /// Paths of the files read so far.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.known.keys().map(String::as_str)
    }

    /// Hash of paths and contents of the files read, of the user's choices, and of the pipeline version.
    pub fn hash(&self, chosen: &str) -> String {
        let mut hash = Sha256::new();
        let mut part = |bytes: &[u8]| {
            hash.update((bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        };
        part(PIPELINE.as_bytes());
        part(chosen.as_bytes());
        for (name, bytes) in &self.known {
            part(name.as_bytes());
            part(bytes);
        }
        hexadecimal(&hash.finalize()[..8])
    }
}

/// Resolves a file name relative to the file that refers to it; returns a path relative to the root.
///
/// # Errors
/// If the name is absolute, leaves the root, or is not a path.
pub fn beside(file: &str, named: &str) -> Result<String, ImportError> {
    let wrong = |what: &str| {
        Err(ImportError::new(file, format!("refers to the file `{}`, {what}", shortened(named))).hint(
            "expected a path relative to the file, within the imported folder; if files refer to sibling folders, \
                 import the folder that contains all of them",
        ))
    };
    let plain = named.trim().strip_prefix("file://").unwrap_or(named.trim()).replace('\\', "/");
    if plain.is_empty() || plain.contains(['\0', '\n']) {
        return wrong("which is not a path");
    }
    if plain.starts_with('/') || plain.as_bytes().get(1) == Some(&b':') || plain.contains("://") {
        return wrong("which is absolute");
    }
    let mut parts: Vec<&str> = file.split('/').collect();
    parts.pop();
    for part in plain.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    return wrong("which lies outside the imported folder");
                }
            }
            part => parts.push(part),
        }
    }
    Ok(parts.join("/"))
}

/// Longest path of a file in a package, bytes. Longer ones are not searched.
const MAX_NAME: usize = 1024;

/// Paths of `NAME/inside` of a package in the folders above a file, likeliest first: packages that are called NAME, then
/// any folder that could be the package.
fn in_folders_above(file: &str, rest: &str) -> Vec<String> {
    if rest.len() > MAX_NAME {
        return Vec::new();
    }
    let (package, inside) = rest.split_once('/').unwrap_or(("", rest));
    let is_absolute = file.starts_with('/');
    let mut parts: Vec<&str> = file.split('/').filter(|part| !part.is_empty()).collect();
    let (mut named, mut any, mut deeper) = (Vec::new(), Vec::new(), Vec::new());
    while parts.pop().is_some() {
        let folder = if is_absolute { format!("/{}", parts.join("/")) } else { parts.join("/") };
        let within = |inside: &str| match folder.as_str() {
            "" => inside.to_owned(),
            "/" => format!("/{inside}"),
            folder => format!("{folder}/{inside}"),
        };
        if parts.last() == Some(&package) || is_absolute && is_package(Path::new(&folder), package) {
            named.push(within(inside));
        }
        named.push(within(rest));
        any.push(within(inside));
        // Nested packages are often copied out of their outer package.
        let inner = inside.match_indices('/').map(|(at, _)| &inside[at + 1..]).filter(|inner| inner.contains('/'));
        deeper.extend(inner.map(within));
    }
    named.into_iter().chain(any).chain(deeper).filter(|path| !path.split('/').any(|part| part == "..")).collect()
}

/// Path with every `%20` and the like replaced by its character; `None` if there is none.
fn decoded(path: &str) -> Option<PathBuf> {
    let mut parts = path.split('%');
    let mut plain = parts.next()?.to_owned();
    for part in parts {
        let code = part.get(..2).and_then(|digits| u8::from_str_radix(digits, 16).ok());
        plain.push(char::from(code.filter(u8::is_ascii_graphic).or(code.filter(|code| *code == b' '))?));
        plain.push_str(&part[2..]);
    }
    (plain != path).then(|| plain.into())
}

/// Name of a file beside a missing one that differs from it in case only.
fn in_another_case(missing: &Path) -> Option<String> {
    let wanted = missing.file_name()?;
    let mut beside = std::fs::read_dir(missing.parent()?).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    beside.find(|name| name.eq_ignore_ascii_case(wanted)).map(|name| shortened(&name.to_string_lossy()))
}

/// True if a folder has a `package.xml` with this name.
fn is_package(folder: &Path, name: &str) -> bool {
    let manifest = folder.join("package.xml");
    let text = manifest.is_file().then(|| genmanip_data::files::read(&manifest, SETTINGS).ok()).flatten();
    text.is_some_and(|text| String::from_utf8_lossy(&text).contains(&format!("<name>{name}</name>")))
}

/// Truncates and sanitises a text from a file for use in a message.
pub fn shortened(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { '?' } else { c }).take(80).collect();
    if text.chars().count() > 80 { clean + "…" } else { clean }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_the_root() {
        let found = |file, named| beside(file, named).ok();
        assert_eq!(found("a/b.xml", "c.obj").as_deref(), Some("a/c.obj"));
        assert_eq!(found("a/b.xml", "../t/./c.png").as_deref(), Some("t/c.png"));
        assert_eq!(found("a/b.xml", "m\\c.obj").as_deref(), Some("a/m/c.obj"));
        for hostile in ["/etc/passwd", "../../x", "C:/x", "http://x/y", "", "a\0b", "file:///etc/passwd"] {
            let error = beside("a/b.xml", hostile).unwrap_err();
            assert!(!error.hint.is_empty() && error.file == "a/b.xml", "{hostile}");
        }
    }

    #[test]
    fn the_hash_depends_on_names_contents_and_choices() {
        let hash = |name: &str, bytes: &[u8], chosen: &str| {
            let bytes = bytes.to_vec();
            let mut read = move |_: &str, _: Limit| Ok(bytes.clone());
            let mut files = Files::new(&mut read);
            files.bytes(name, genmanip_core::limits::IMPORTED_MESH).unwrap();
            files.hash(chosen)
        };
        let own = hash("a", b"x", "");
        assert_eq!(own, hash("a", b"x", ""));
        for other in [hash("b", b"x", ""), hash("a", b"y", ""), hash("a", b"x", "scale 2")] {
            assert_ne!(own, other);
        }
    }
}
