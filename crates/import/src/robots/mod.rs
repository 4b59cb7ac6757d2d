//! Robots from URDF: a description with its meshes in ROS packages, and its SRDF.

pub mod add;
mod cuts;
pub mod hulls;
mod model;
mod mount;
mod plausible;
mod srdf;
mod tool_frame;
mod visual;

use std::fs;
use std::path::{Path, PathBuf};

use genmanip_core::limits;
use genmanip_core::limits::Limit;
use genmanip_data::files as disk;
use genmanip_workspace::{WorkspaceError, documents};

pub use model::{Choices, PlannedRobot, build};
pub use plausible::{MAX_JOINTS, MAX_LINKS, MAX_PIECES, MAX_REACH_M};
pub use srdf::Semantics;

use crate::ImportError;
use crate::files::{Files, Packages};
use crate::formats::urdf;

/// Settings of reading a robot: where its meshes are, and options of the reader.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Folders of ROS packages, in which meshes are searched.
    pub packages: Packages,
    /// Options of the reader.
    pub choices: Choices,
}

impl Settings {
    /// Settings with named packages and options, and the packages of the environment variable `ROS_PACKAGE_PATH`.
    pub fn new(packages: &[(String, PathBuf)], choices: Choices) -> Self {
        let Self { packages: Packages { search, .. }, .. } = Self::of_environment();
        Self { packages: Packages { named: packages.iter().cloned().collect(), search }, choices }
    }

    /// Settings with default options, and the packages of the environment variable `ROS_PACKAGE_PATH`.
    pub fn of_environment() -> Self {
        let listed = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
        let search = std::env::split_paths(&listed).filter(|path| !path.as_os_str().is_empty()).collect();
        Self { packages: Packages { search, ..Packages::default() }, choices: Choices::default() }
    }
}

/// Reads the robot of a folder (its only URDF, or the one named like the folder), or of a URDF file.
///
/// Of several SRDF files next to it, the one that disables the fewest collisions is used.
/// If a convex hull `MESH.convex.stl` exists next to a mesh, it is read instead.
///
/// # Errors
/// If there is no such file, there are several, or the planner cannot use it.
pub fn read(path: &Path, settings: &Settings) -> Result<PlannedRobot, WorkspaceError> {
    let urdf = if path.is_dir() { only_urdf(path)? } else { path.to_owned() };
    documents::read_bytes(&urdf, limits::ROBOT)?;
    let absolute = urdf.canonicalize().map_err(|error| WorkspaceError::file("read", &urdf, error))?;
    let folder = absolute.parent().unwrap_or(Path::new("/"));
    let rules = with_extension(folder, "srdf")?;
    let mut from_disk =
        |path: &str, limit: Limit| disk::read(Path::new(path), limit).map_err(|error| error.to_string());
    let mut files = Files::of_robot(&mut from_disk, settings.packages.clone());
    files.geometry_only = !settings.choices.visible;
    let read = |files: &mut Files<'_>| {
        let file = absolute.display().to_string();
        let robot = urdf::robot(&file, files)?;
        let semantics = rules.iter().map(|rules| srdf::read(&rules.display().to_string(), files));
        let semantics = semantics.collect::<Result<Vec<_>, _>>()?;
        let fewest = semantics.into_iter().min_by_key(|semantics| semantics.disabled.len()).unwrap_or_default();
        build(&robot, &fewest, &settings.choices, files)
    };
    read(&mut files).map_err(|error| refused(&urdf, error))
}

fn refused(urdf: &Path, error: ImportError) -> WorkspaceError {
    let hint =
        if error.hint.is_empty() { "expected URDF: <robot> with <link> and <joint> elements" } else { &error.hint };
    let hint = hint.to_owned();
    WorkspaceError::input(format!("{} is not a robot that can be used for planning", urdf.display()))
        .because(error)
        .with_hint(hint)
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
