//! Robots from folders: a URDF, its SRDF and its meshes.

use std::fs;
use std::path::{Path, PathBuf};

use genmanip_core::RobotModel;
use genmanip_core::limits;
use genmanip_data::files;
use genmanip_motion::description::{MeshFile, read_robot};

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Reads the robot of a folder (its only URDF, or the one named like the folder), or of a URDF file.
///
/// Of several SRDF files next to it, the one that disables the fewest collisions is used.
/// If a convex hull `MESH.convex.stl` exists next to a mesh, it is read instead.
///
/// # Errors
/// If there is no such file, there are several, or the planner cannot use it.
pub fn read(path: &Path, tip: Option<&str>) -> Result<RobotModel, WorkspaceError> {
    let urdf = if path.is_dir() { only_urdf(path)? } else { path.to_owned() };
    let folder = urdf.parent().unwrap_or(Path::new("")).to_owned();
    let text = documents::read_text(&urdf, limits::ROBOT)?;
    let mut rules: Vec<String> = Vec::new();
    for file in with_extension(&folder, "srdf")? {
        rules.push(documents::read_text(&file, limits::ROBOT)?);
    }
    let rules = rules.iter().min_by_key(|text| text.matches("<disable_collisions").count());
    let mut mesh = |name: &str| read_mesh(&folder, name);
    read_robot(&text, rules.map(String::as_str), tip, &mut mesh).map_err(|error| {
        let hint = error.hint();
        WorkspaceError::input(format!("{} is not a robot that can be used for planning", urdf.display()))
            .because(error)
            .with_hint(hint)
    })
}

fn only_urdf(folder: &Path) -> Result<PathBuf, WorkspaceError> {
    let found = with_extension(folder, "urdf")?;
    let named = folder.canonicalize().ok().and_then(|folder| Some(folder.file_name()?.to_owned()));
    let same = |file: &&PathBuf| file.file_stem() == named.as_deref();
    match found.as_slice() {
        [only] => Ok(only.clone()),
        several => several.iter().find(same).cloned().ok_or_else(|| {
            WorkspaceError::input(format!("{} contains {} URDF files", folder.display(), several.len()))
                .with_hint("expected one, or one named like the folder; or give the file itself")
        }),
    }
}

fn with_extension(folder: &Path, extension: &str) -> Result<Vec<PathBuf>, WorkspaceError> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let unreadable =
        |error: std::io::Error| WorkspaceError::file("read", folder, error).with_hint("expected the folder of a robot");
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension)) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads a mesh; `package://` refers to the folder, with or without the package's name.
fn read_mesh(folder: &Path, name: &str) -> Result<MeshFile, String> {
    let place = name.trim_start_matches("package://").trim_start_matches("file://");
    let inside = place.split_once('/').map(|(_, rest)| folder.join(rest));
    let candidates = [Some(folder.join(place)), inside].into_iter().flatten();
    let hull = |path: PathBuf| [PathBuf::from(format!("{}.convex.stl", path.display())), path];
    let Some(path) = candidates.flat_map(hull).find(|path| path.is_file()) else {
        return Err(format!("no such file under {}", folder.display()));
    };
    let bytes = files::read(&path, limits::MESH).map_err(|error| error.to_string())?;
    Ok(MeshFile { name: path.display().to_string(), bytes })
}
