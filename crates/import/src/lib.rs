//! Import of 3D models (GLB, glTF, OBJ, Collada DAE, STL, MSH, URDF, MJCF) as object models.
//!
//! 1. A reader of the format converts the files to a [`raw::RawObject`] ([`formats`]).
//! 2. [`clean`] repairs meshes, [`units_and_frame`] determines unit, up axis and origin, [`simplify`]
//!    reduces the visual meshes.
//! 3. [`collision`] derives convex pieces; objects that are open at the top stay hollow.
//! 4. [`mass`] and [`typical_sizes`] fill in typical masses, [`names_and_colors`] derives names and descriptions.
//! 5. Every guess and every repair is listed in a [`report::Report`].
//!
//! [`import`] performs no IO: the caller reads files, each within a given size limit.
//! [`pack`] is the file format of an imported object; [`packs`] reads and writes folders of them, with baked
//! [`grasps`]; [`audit`] lists implausible objects; [`robots`] reads robots from URDF folders.

pub mod audit;
pub mod build;
pub mod clean;
pub mod collision;
mod error;
pub mod files;
pub mod formats;
pub mod grasps;
pub mod image;
pub mod mass;
pub mod names_and_colors;
pub mod pack;
pub mod packs;
pub mod raw;
pub mod report;
pub mod robots;
pub mod simplify;
pub mod typical_sizes;
pub mod units_and_frame;
mod vertex_colors;

use genmanip_assets::imported::Origin;
use genmanip_core::ObjectModel;

pub use error::ImportError;
pub use files::{Files, ReadFile};
pub use units_and_frame::Given;

/// Result of [`import`]: object model, provenance, and a report of guesses and repairs.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Object model; its asset reference is a hash of the files, the given scale and the given up axis.
    pub model: ObjectModel,
    /// Provenance: source files, licence and creator.
    pub origin: Origin,
    /// Report of guessed properties and repairs.
    pub report: report::Report,
}

/// Names of licence files that are searched in the object's folder and its parents.
const LICENCES: [&str; 6] = ["LICENSE", "LICENSE.txt", "LICENSE.md", "license.txt", "LICENCE", "COPYING"];

/// Imports the object of one file; `read` receives paths relative to the import's root, like `path`.
///
/// # Errors
/// A single error, which names the file and the problem.
///
/// ```
/// use genmanip_import::{Given, import};
/// let cube = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 4 4 0\nv 0 0 4\nv 4 0 4\nv 0 4 4\nv 4 4 4\n\
///             f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
/// let mut read = |path: &str, _| {
///     if path == "cube.obj" { Ok(cube.as_bytes().to_vec()) } else { Err("there is no such file".to_owned()) }
/// };
/// let cube = import("cube.obj", &mut read, &Given::default(), None)?;
/// assert_eq!((cube.model.card.name.as_str(), cube.model.card.shape.as_str()), ("Cube", "box"));
/// assert!(cube.report.guesses.iter().any(|guess| guess.what == "unit"));
/// # Ok::<(), genmanip_import::ImportError>(())
/// ```
pub fn import(
    path: &str,
    read: &mut ReadFile<'_>,
    given: &Given,
    licence: Option<&str>,
) -> Result<Imported, ImportError> {
    let mut files = Files::new(read);
    let raw = formats::read(path, &mut files).map_err(formats::advised)?;
    // `tipped_up` follows from simulating the files, which are hashed already.
    let Given { scale, up, category, .. } = given;
    let named = category.as_ref().map_or_else(String::new, |category| format!(", category: {category:?}"));
    let hash = files.hash(&format!("Given {{ scale: {scale:?}, up: {up:?}{named} }}"));
    let names: Vec<&str> = std::iter::once(path).chain(files.names().filter(|name| *name != path)).collect();
    let source = names.iter().take(20).copied().collect::<Vec<_>>().join(", ");
    let (said, creator) = (raw.licence.clone(), raw.creator.clone());
    let (model, report) = build::build(path, raw, &hash, given).map_err(formats::advised)?;
    let licence = licence.map(str::to_owned).or(said).or_else(|| licence_beside(path, &mut files));
    let origin = Origin { source, licence: licence.unwrap_or_else(|| "unknown".into()), creator };
    Ok(Imported { model, origin, report })
}

/// First line of a licence file in the object's folder or one of its parents; `None` if there is none.
fn licence_beside(path: &str, files: &mut Files<'_>) -> Option<String> {
    let mut folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    loop {
        for name in LICENCES {
            let candidate = if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") };
            let Ok(text) = files.text(&candidate, genmanip_core::limits::SETTINGS) else { continue };
            let line = text.lines().map(str::trim).find(|line| !line.is_empty())?;
            return Some(format!("{} ({candidate})", files::shortened(line)));
        }
        if folder.is_empty() {
            return None;
        }
        folder = folder.rsplit_once('/').map_or("", |(above, _)| above);
    }
}
