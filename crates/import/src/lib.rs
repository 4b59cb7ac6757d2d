//! Objects from files: GLB, glTF, OBJ, STL, MSH, URDF and MJCF become objects of the catalogue by one automatic pipeline.
//!
//! 1. A reader of the format makes a [`raw::RawObject`] of what the files say ([`formats`]).
//! 2. [`clean`] mends triangles, [`place`] finds unit, upright and origin, [`simplify`] reduces what is drawn.
//! 3. [`collision`] finds convex pieces; things that are open at the top stay hollow.
//! 4. [`mass`] and [`prior`] fill in what things of that kind weigh, [`words`] how they are called.
//! 5. Every guess and every repair stands in a [`report::Report`].
//!
//! [`import`] touches no disk: the caller reads files, each within the bound that it is told.
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
pub mod mass;
pub mod pack;
pub mod packs;
pub mod picture;
pub mod place;
pub mod prior;
pub mod raw;
pub mod report;
pub mod robots;
pub mod simplify;
pub mod words;

use genmanip_assets::imported::Origin;
use genmanip_core::ObjectModel;

pub use error::ImportError;
pub use files::{Files, ReadFile};
pub use place::Given;

/// An object that came in.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The object; it is named by the hash of its files.
    pub model: ObjectModel,
    /// Where it is from.
    pub origin: Origin,
    /// What was guessed and mended.
    pub report: report::Report,
}

/// Names of files beside an object's that say its licence.
const LICENCES: [&str; 6] = ["LICENSE", "LICENSE.txt", "LICENSE.md", "license.txt", "LICENCE", "COPYING"];

/// Imports the object of one file; `read` gets paths relative to the root of the import, as `path` is.
///
/// # Errors
/// One clear error: what is wrong in which file.
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
    // How it tipped over follows from the files, so it is no part of the name.
    let Given { scale, up, .. } = given;
    let hash = files.hash(&format!("Given {{ scale: {scale:?}, up: {up:?} }}"));
    let names: Vec<&str> = std::iter::once(path).chain(files.names().filter(|name| *name != path)).collect();
    let source = names.iter().take(20).copied().collect::<Vec<_>>().join(", ");
    let (said, creator) = (raw.licence.clone(), raw.creator.clone());
    let (model, report) = build::build(path, raw, &hash, given).map_err(formats::advised)?;
    let licence = licence.map(str::to_owned).or(said).or_else(|| licence_beside(path, &mut files));
    let origin = Origin { source, licence: licence.unwrap_or_else(|| "unknown".into()), creator };
    Ok(Imported { model, origin, report })
}

/// First line of a licence file in the folder of an object or one above it.
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
