//! MJCF as written by robosuite, RoboCasa, LIBERO, MolmoSpaces, MetaWorld and gymnasium-robotics, read by MuJoCo's own
//! compiler: `source` gathers the file with all files that it includes or refers to, the compiler resolves it, and
//! `object` converts the compiled model to one object. Actuators, sensors and equality constraints are not used.

mod object;
mod source;

use genmanip_sim::Flattened;

use crate::ImportError;
use crate::files::Files;
use crate::raw::{RawObject, Unit, Up};
use source::Source;

/// Reads an MJCF file as one object, ignoring floors.
///
/// # Errors
/// If a file is missing or not XML, or MuJoCo's compiler rejects it (with its message, file and line).
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut notes = Vec::new();
    let source = Source::of(path, files, &mut notes)?;
    let flat = Flattened::compile(&source.xml, &source.files).map_err(|error| source.refused(path, &error))?;
    notes.extend(flat.warnings.iter().map(|warning| format!("MuJoCo warns: {}", source.located(warning))));
    let links = object::links(&flat, path, &source.textures, &mut notes)?;
    Ok(RawObject { name: source.model, links, unit: Unit::Metre, up: Up::Z, licence: None, creator: None, notes })
}
