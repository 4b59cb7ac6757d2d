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

/// Part of MuJoCo's message about a moving body without mass, as in files that are meant to be merged into others.
const TOO_LIGHT: &str = "mjMINVAL";

/// Smallest mass (kg) and moment of inertia (kg m²) of bodies in a file that has moving bodies without mass: those of a
/// cube with sides of 1 cm, as heavy as water.
const LEAST_MASS_KG: f64 = 0.001;
const LEAST_INERTIA: f64 = 1.7e-8;

/// Reads an MJCF file as one object, ignoring floors.
///
/// # Errors
/// If a file is missing or not XML, or MuJoCo's compiler rejects it (with its message, file and line).
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let mut notes = Vec::new();
    let source = Source::of(path, files, &mut notes)?;
    let flat = match Flattened::compile(&source.xml, &source.files) {
        Err(error) if error.to_string().contains(TOO_LIGHT) => {
            notes.push(format!("{error}; such bodies have a mass of {LEAST_MASS_KG} kg now").replace('\n', " "));
            Flattened::compile(&source.with_least_mass(), &source.files)
        }
        compiled => compiled,
    }
    .map_err(|error| source.refused(path, &error))?;
    notes.extend(flat.warnings.iter().map(|warning| format!("MuJoCo warns: {}", source.located(warning))));
    let links = object::links(&flat, path, &source.textures, &mut notes)?;
    Ok(RawObject { name: source.model, links, unit: Unit::Metre, up: Up::Z, licence: None, creator: None, notes })
}
