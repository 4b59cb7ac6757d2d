//! OpenUSD, as text (usda), binary (usdc) or archive (usdz), through the composed stage: one object of meshes and
//! shapes with UsdPreviewSurface materials, and with rigid bodies, colliders, masses and joints of UsdPhysics.
//!
//! Lengths become metres by `metersPerUnit`, masses kilograms by `kilogramsPerUnit`. Animated values are read at the
//! stage's start time. Contents that an object cannot represent are listed in its notes.

mod binary;
mod binding;
mod bodies;
mod geometry;
mod mass;
mod material;
mod stage;
mod text;
mod tree;
mod units;
mod value;

use genmanip_data::panics;
use openusd::sdf::{Path, Value};
use openusd::usd::Stage;

use crate::ImportError;
use crate::files::{Files, shortened};
use crate::raw::{RawLink, RawObject, Unit, Up};
use crate::units_and_frame::bounds;
use bodies::contents;
use units::Units;

pub use stage::is_layer;

/// Default of `metersPerUnit` in the USD specification.
const CENTIMETRE: f64 = 0.01;
/// Longest side below which an object without `metersPerUnit`, read as centimetres, is read as metres instead, m.
const SMALLEST_M: f64 = 0.02;
/// Names of root prims that do not describe their contents, so that they do not become the object's name.
const PLACES: [&str; 4] = ["World", "world", "Scene", "geometry"];

/// Reads the only object of a stage, in metres and kilograms; its up axis is that of the stage.
///
/// # Errors
/// If a layer is damaged, a mesh is inconsistent, or the stage contains no geometry or several objects.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    guarded(path, || {
        let stage::Opened { stage, mut notes } = stage::open(path, files)?;
        let object = object(path, &stage, files, &mut notes)?;
        Ok(RawObject { notes, ..object })
    })
}

/// Paths of the layers that a stage is composed of besides its root layer; empty if it cannot be opened.
pub fn layers(path: &str, files: &mut Files<'_>) -> Vec<String> {
    let opened = guarded(path, || stage::open(path, files));
    let names = opened.map(|opened| opened.stage.layer_identifiers()).unwrap_or_default();
    names.into_iter().filter(|name| name != path).collect()
}

/// Reports a panic of the `openusd` library, e.g. on an index beyond a table, as an error about the file.
fn guarded<T>(path: &str, read: impl FnOnce() -> Result<T, ImportError>) -> Result<T, ImportError> {
    panics::caught(read).unwrap_or_else(|reason| {
        let reason = stage::plain(&reason);
        Err(ImportError::new(path, format!("damaged, or of a kind that the reader of USD does not know ({reason})")))
    })
}

fn object(path: &str, stage: &Stage, files: &mut Files<'_>, notes: &mut Vec<String>) -> Result<RawObject, ImportError> {
    let wrong = |message: String| ImportError::new(path, message);
    let number = |name: &str| match stage.stage_metadata(name).ok().flatten() {
        Some(value) => value.cast::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0),
        None => None,
    };
    let stated = number("metersPerUnit");
    let units = Units { metres: stated.unwrap_or(CENTIMETRE), kilograms: number("kilogramsPerUnit").unwrap_or(1.0) };
    let roots = roots(stage, notes).map_err(wrong)?;
    let mut own_notes = Vec::new();
    let found = contents(stage, &roots, units, files, &mut own_notes).map_err(wrong)?;
    let label = found.label.clone();
    let mut links = tree::links(found, units, &mut own_notes).map_err(|message| {
        wrong(message).hint("expected one object per file, not a scene; a default prim names the one that is meant")
    })?;
    let mut raw = RawObject {
        name: label.unwrap_or_else(|| name(&roots)),
        links: Vec::new(),
        unit: Unit::Metre,
        up: up(stage),
        licence: None,
        creator: None,
        notes: Vec::new(),
    };
    raw.links = std::mem::take(&mut links);
    let longest = bounds(&raw).size().max_element();
    if stated.is_none() && longest < SMALLEST_M {
        // Read the stage again, since lengths, inertia and densities depend on the unit.
        own_notes.clear();
        let units = Units { metres: 1.0, ..units };
        let found = contents(stage, &roots, units, files, &mut own_notes).map_err(wrong)?;
        raw.links = tree::links(found, units, &mut own_notes).map_err(wrong)?;
        own_notes.push("metersPerUnit is not stated; read as metres, since as centimetres it would be tiny".into());
    } else if stated.is_none() {
        own_notes.push("metersPerUnit is not stated; read as centimetres, as the standard says".into());
    }
    let is_empty = |link: &RawLink| link.surfaces.is_empty() && link.collision.is_empty();
    if raw.links.iter().all(is_empty) {
        let missing = notes.first().map_or_else(String::new, |note| format!(" ({note})"));
        return Err(wrong(format!("contains no geometry{missing}"))
            .hint("import the file of the object itself, together with the folder of what it refers to"));
    }
    notes.append(&mut own_notes);
    notes.sort();
    notes.dedup();
    Ok(raw)
}

/// The default prim, or all root prims without one.
fn roots(stage: &Stage, notes: &mut Vec<String>) -> Result<Vec<Path>, String> {
    let names = stage.root_prims().map_err(|error| stage::plain(&error))?;
    let path = |name: &str| Path::new(&format!("/{name}")).map_err(|error| stage::plain(&error));
    let chosen = stage.default_prim();
    let Some(chosen) = chosen.filter(|chosen| names.iter().any(|name| name.as_str() == chosen.as_str())) else {
        return names.iter().map(|name| path(name.as_str())).collect();
    };
    let others: Vec<String> =
        names.iter().map(|name| name.as_str()).filter(|name| *name != chosen.as_str()).map(shortened).collect();
    if !others.is_empty() {
        notes.push(format!("besides the default prim, {} are not read", others.join(", ")));
    }
    Ok(vec![path(chosen.as_str())?])
}

/// Name of the only root prim; empty for several roots or a name in [`PLACES`].
fn name(roots: &[Path]) -> String {
    let [root] = roots else { return String::new() };
    let name = root.name().unwrap_or_default();
    if PLACES.contains(&name) { String::new() } else { shortened(name) }
}

fn up(stage: &Stage) -> Up {
    let value = stage.stage_metadata("upAxis").ok().flatten();
    match value.as_ref().and_then(Value::as_str) {
        Some("Z") => Up::Z,
        // Default of `upAxis` in the USD specification.
        _ => Up::Y,
    }
}
