//! Discovery of importable objects in files and folders.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_core::limits;

use crate::files::Files;
use crate::formats::usd;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Maximum number of files, and (`MAX_DEPTH`) maximum nesting depth of folders that are searched. Bounds the time for a
/// folder named by mistake.
const MAX_FILES: usize = 50_000;
const MAX_DEPTH: usize = 16;
/// Extensions of importable files, in order of preference: of several files with the same stem in one folder, only the
/// most preferred one is imported.
const EXTENSIONS: [&str; 12] =
    ["urdf", "xml", "usdz", "usd", "usda", "usdc", "glb", "gltf", "obj", "dae", "stl", "msh"];
/// Parts of names of collision meshes, which accompany visual meshes and are not imported.
const COLLISION_WORDS: [&str; 5] = ["collision", "_col", "vhacd", "coacd", "convex"];
/// YCB folders with alternative reconstructions of the same object.
const OTHER_SCANS: [&str; 3] = ["poisson", "tsdf", "clouds"];

/// A file that contains an object.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Candidate {
    /// Folder that the object's files must not leave.
    pub root: PathBuf,
    /// File, relative to the root, with `/`.
    pub path: String,
}

/// Importable objects among files and folders. A file is one object. A folder contains descriptions (URDF, MJCF), and
/// meshes that no description refers to. An object's files must lie in `root`; without `root`, in the given folder or
/// in the file's folder.
///
/// # Errors
/// If a path cannot be read or lies outside `root`, a folder cannot be listed, has more than `MAX_FILES` files or
/// contains nothing importable.
pub fn candidates(paths: &[PathBuf], root: Option<&Path>) -> Result<Vec<Candidate>, WorkspaceError> {
    let mut found = BTreeSet::new();
    for path in paths {
        let about = fs::metadata(path).map_err(|error| {
            WorkspaceError::file("read", path, error)
                .with_hint("check the path; relative paths start at the current folder")
        })?;
        if let Some(root) = root {
            let inside = path.strip_prefix(root).map_err(|_| {
                WorkspaceError::input(format!("{} is not inside {}", path.display(), root.display()))
                    .with_hint("write both relative to the same folder, e.g. `--root assets assets/objects/can.xml`")
            })?;
            let inside = inside.to_string_lossy().replace('\\', "/");
            let within = |one: Candidate| Candidate { root: root.to_owned(), path: format!("{inside}/{}", one.path) };
            if about.is_dir() {
                found.extend(of_folder(path)?.into_iter().map(within));
            } else {
                found.insert(Candidate { root: root.to_owned(), path: inside });
            }
        } else if about.is_dir() {
            found.extend(of_folder(path)?);
        } else {
            let root = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            found.insert(Candidate { root: root.to_owned(), path: name });
        }
    }
    Ok(found.into_iter().collect())
}

fn of_folder(root: &Path) -> Result<Vec<Candidate>, WorkspaceError> {
    let mut paths = Vec::new();
    list(root, String::new(), 0, &mut paths)?;
    paths.sort();
    let mut named: BTreeMap<String, Vec<Reference>> = BTreeMap::new();
    let mut descriptions = Vec::new();
    for path in paths.iter().filter(|path| matches!(extension(path), "urdf" | "xml")) {
        // Unreadable text is reported by the import itself.
        let Ok(bytes) = documents::read_bytes(&root.join(path), limits::IMPORTED_DESCRIPTION) else { continue };
        let text = String::from_utf8_lossy(&bytes);
        for (name, reference) in referenced_files(path, &text) {
            named.entry(name).or_default().push(reference);
        }
        let is_object = match extension(path) {
            "xml" => text.contains("<mujoco ") || text.contains("<mujoco>"),
            _ => text.contains("<robot"),
        };
        if is_object && (extension(path) != "xml" || text.contains("<worldbody")) {
            descriptions.push(path.clone());
        }
    }
    let mut meshes: BTreeMap<String, String> = BTreeMap::new();
    for path in paths.iter().filter(|path| !matches!(extension(path), "urdf" | "xml")) {
        let (folder, name) = path.rsplit_once('/').unwrap_or(("", path));
        let is_other_scan = folder.split('/').any(|part| OTHER_SCANS.contains(&part));
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let beside =
            |other: &String| other != path && other.rsplit_once('/').map_or("", |(folder, _)| folder) == folder;
        let is_collision = COLLISION_WORDS.iter().any(|word| stem.to_lowercase().contains(word));
        let is_plain = stem == "nontextured" && paths.iter().any(|other| beside(other) && other.contains("/textured."));
        if named.get(name).is_some_and(|references| references.iter().any(|reference| reference.reaches(path)))
            || is_other_scan
            || is_plain
            || (is_collision
                && paths.iter().any(|other| beside(other) && !COLLISION_WORDS.iter().any(|word| other.contains(word))))
        {
            continue;
        }
        let kept = meshes.entry(format!("{folder}/{stem}")).or_insert_with(|| path.clone());
        if rank(path) < rank(kept) {
            kept.clone_from(path);
        }
    }
    let parts = layers_of_others(root, meshes.values());
    meshes.retain(|_, path| !parts.contains(path));
    if descriptions.is_empty() && meshes.is_empty() {
        let expected = format!("expected files that end in .{} (.xml: MJCF)", EXTENSIONS.join(", ."));
        return Err(WorkspaceError::input(format!("nothing to import in {}", root.display())).with_hint(expected));
    }
    let all = descriptions.into_iter().chain(meshes.into_values());
    Ok(all.map(|path| Candidate { root: root.to_owned(), path }).collect())
}

/// Files of USD that other files of USD are composed of.
fn layers_of_others<'a>(root: &Path, paths: impl Iterator<Item = &'a String>) -> BTreeSet<String> {
    let stages: Vec<&String> = paths.filter(|path| usd::is_layer(path)).collect();
    let mut parts = BTreeSet::new();
    if stages.len() < 2 {
        return parts;
    }
    let mut read = |path: &str, limit: limits::Limit| {
        documents::read_bytes(&root.join(path), limit).map_err(|error| error.to_string())
    };
    for path in stages {
        parts.extend(usd::layers(path, &mut Files::new(&mut read)));
    }
    parts
}

fn extension(path: &str) -> &str {
    path.rsplit_once('.').map_or("", |(_, extension)| extension)
}

fn rank(path: &str) -> usize {
    EXTENSIONS.iter().position(|known| extension(path).eq_ignore_ascii_case(known)).unwrap_or(EXTENSIONS.len())
}

/// Reference of a description to a mesh.
struct Reference {
    /// Folder of the description.
    folder: String,
    /// True if the reference leaves that folder, or names a package.
    leaves: bool,
}

impl Reference {
    fn reaches(&self, path: &str) -> bool {
        self.leaves
            || self.folder.is_empty()
            || path.strip_prefix(&self.folder).is_some_and(|rest| rest.starts_with('/'))
    }
}

/// Names, without folders, of files that a description mentions in quotation marks.
fn referenced_files<'a>(path: &'a str, text: &'a str) -> impl Iterator<Item = (String, Reference)> + 'a {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    // Folders of meshes are named apart from the meshes.
    let all_leave = text.contains("dir=\"..") || text.contains("dir='..");
    let quoted = text.split(['"', '\'']).filter(|part| part.len() < 300 && part.contains('.') && !part.contains('<'));
    quoted.map(move |part| {
        let name = part.rsplit(['/', '\\']).next().unwrap_or(part).to_owned();
        let leaves = all_leave || part.contains("..") || part.contains("://") || part.starts_with('/');
        (name, Reference { folder: folder.to_owned(), leaves })
    })
}

fn list(root: &Path, under: String, depth: usize, found: &mut Vec<String>) -> Result<(), WorkspaceError> {
    let folder = root.join(&under);
    let entries = fs::read_dir(&folder).map_err(|error| WorkspaceError::file("list", &folder, error))?;
    for entry in entries {
        let entry = entry.map_err(|error| WorkspaceError::file("list", &folder, error))?;
        let Ok(kind) = entry.file_type() else { continue };
        let Some(name) = entry.file_name().to_str().map(str::to_owned) else { continue };
        let path = if under.is_empty() { name.clone() } else { format!("{under}/{name}") };
        // Links are not followed: they may form loops or leave the root.
        if kind.is_dir() && depth < MAX_DEPTH && !name.starts_with('.') {
            list(root, path, depth + 1, found)?;
        } else if kind.is_file() && rank(&name) < EXTENSIONS.len() {
            if found.len() == MAX_FILES {
                return Err(WorkspaceError::input(format!("more than {MAX_FILES} files in {}", root.display()))
                    .with_hint("import its subfolders separately"));
            }
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptions_take_precedence_over_their_meshes() {
        let root = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("can.xml", "<mujoco model='can'><asset><mesh file=\"meshes/can.stl\"/></asset><worldbody/></mujoco>");
        write("part.xml", "<mujocoinclude/>");
        write("meshes/can.stl", "");
        write("meshes/cup.stl", "");
        write("meshes/cup.obj", "");
        write("mug/visual.glb", "");
        write("mug/visual_collision.obj", "");
        write("002_can/google_16k/textured.obj", "");
        write("002_can/google_16k/nontextured.stl", "");
        write("002_can/poisson/textured.obj", "");
        write("door/mobility.urdf", "<robot name='door'><mesh filename=\"textured_objs/a.obj\"/></robot>");
        write("door/textured_objs/a.obj", "");
        // Equal names of meshes are common; a description refers to its own.
        write("tin/tin.xml", "<mujoco><asset><mesh file='mesh.obj'/></asset><worldbody/></mujoco>");
        write("tin/mesh.obj", "");
        write("jar/mesh.obj", "");
        let found: Vec<String> =
            candidates(&[root.path().to_owned()], None).unwrap().into_iter().map(|one| one.path).collect();
        assert_eq!(
            found,
            [
                "002_can/google_16k/textured.obj",
                "can.xml",
                "door/mobility.urdf",
                "jar/mesh.obj",
                "meshes/cup.obj",
                "mug/visual.glb",
                "tin/tin.xml"
            ]
        );
        let empty = tempfile::tempdir().unwrap();
        for root in [None, Some(empty.path())] {
            let refusal = candidates(&[empty.path().to_owned()], root).unwrap_err();
            assert!(refusal.to_string().starts_with("nothing to import in "), "{refusal}");
        }
        let can = root.path().join("can.xml");
        let [one] = &candidates(std::slice::from_ref(&can), Some(root.path())).unwrap()[..] else { panic!("not one") };
        assert_eq!((one.root.as_path(), one.path.as_str()), (root.path(), "can.xml"));
        assert!(candidates(&[can], Some(empty.path())).is_err());
    }
}
