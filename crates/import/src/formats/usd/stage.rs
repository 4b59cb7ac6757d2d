//! Opening a stage: its layers come from the import's files, and archives (usdz) are unpacked in memory.
//!
//! The library requests layers while it composes. Requested layers that are not loaded yet are recorded and loaded, and
//! the stage is opened again, until no further layer is found.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Cursor, Read};
use std::rc::Rc;
use std::sync::Arc;

use genmanip_core::limits::IMPORTED_MESH;
use openusd::ar::{Asset, ResolvedPath, Resolver};
use openusd::sdf::Path;
use openusd::usd::{PrimPredicate, Stage};

use super::{binary, text};
use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::formats::extension;

/// Maximum number of times that a stage is opened, which bounds the depth of references to other layers.
const MAX_ROUNDS: usize = 32;
/// Maximum number of prims of a stage.
const MAX_PRIMS: usize = 50_000;
/// File name extensions of layers.
const LAYERS: [&str; 4] = ["usd", "usda", "usdc", "usdz"];

/// A composed stage with notes on what is missing from it.
pub struct Opened {
    /// The composed stage.
    pub stage: Stage,
    /// Notes on missing or damaged layers, other composition errors, and prims that are empty.
    pub notes: Vec<String>,
}

/// True for a path with the extension of a USD layer: usd, usda, usdc or usdz.
pub fn is_layer(path: &str) -> bool {
    LAYERS.contains(&extension(path).as_str())
}

/// Opens a stage with everything that it refers to.
///
/// # Errors
/// If the root layer cannot be read, there are too many prims, or layers refer to each other too deeply.
pub fn open(path: &str, files: &mut Files<'_>) -> Result<Opened, ImportError> {
    let known = Rc::new(RefCell::new(Known::default()));
    known.borrow_mut().add(path, files)?;
    let mut refused: BTreeMap<String, String> = BTreeMap::new();
    for _ in 0..MAX_ROUNDS {
        let stage = Stage::builder()
            .resolver(Layers(Rc::clone(&known)))
            .open(path)
            .map_err(|error| ImportError::new(path, format!("not a readable USD file: {}", plain(&error))))?;
        let empty = compose(path, &stage)?;
        let wanted = std::mem::take(&mut known.borrow_mut().wanted);
        let mut found = 0;
        for layer in wanted {
            if refused.contains_key(&layer) {
                continue;
            }
            match known.borrow_mut().add(&layer, files) {
                Ok(()) => found += 1,
                Err(error) => _ = refused.insert(layer, error.message),
            }
        }
        if found == 0 {
            let mut notes: Vec<String> =
                stage.composition_errors().iter().map(|error| about(error, &refused)).collect();
            // The library reports no error for references to prims that do not exist.
            notes.extend(
                empty
                    .iter()
                    .filter(|prim| !notes.iter().any(|note| note.contains(*prim)))
                    .take(5)
                    .map(|prim| format!("{} is empty; if it refers to a prim, there is no such prim", shortened(prim)))
                    .collect::<Vec<_>>(),
            );
            notes.dedup();
            return Ok(Opened { stage, notes });
        }
    }
    Err(ImportError::new(path, format!("refers to layers that refer to layers, more than {MAX_ROUNDS} deep")))
}

/// Composes every prim, which requests every layer; returns the paths of prims without type or of type `Xform` that
/// have no children.
fn compose(path: &str, stage: &Stage) -> Result<Vec<String>, ImportError> {
    let wrong = |error: &dyn std::fmt::Display| ImportError::new(path, format!("cannot be composed: {}", plain(error)));
    let (mut open, mut count, mut empty) = (vec![stage.prim(Path::abs_root())], 0_usize, Vec::new());
    while let Some(prim) = open.pop() {
        let status = stage.prim_status(prim.path().clone()).map_err(|error| wrong(&error))?;
        // Children of a skipped prim are skipped as well.
        if count > 0 && !PrimPredicate::DEFAULT_PROXIES.matches(status) {
            continue;
        }
        let children = prim.children().map_err(|error| wrong(&error))?;
        let kind = prim.type_name().ok().flatten();
        if count > 0 && children.is_empty() && kind.is_none_or(|kind| kind.as_str() == "Xform") {
            empty.push(prim.path().to_string());
        }
        open.extend(children);
        count += 1;
        if count > MAX_PRIMS {
            return Err(ImportError::new(path, format!("more than {MAX_PRIMS} prims are not supported"))
                .hint("it is a scene: export one object, or open the file of one object"));
        }
    }
    Ok(empty)
}

/// Note on a composition error. `refused` maps the paths of layers that could not be loaded to the reason.
fn about(error: &openusd::pcp::Error, refused: &BTreeMap<String, String>) -> String {
    use openusd::pcp::Error;
    let (layer, place) = match error {
        Error::UnresolvedLayer { asset_path, arc, site_path, .. } => {
            (asset_path, format!("{} of {site_path}", format!("{arc:?}").to_lowercase()))
        }
        Error::UnresolvedSublayer { asset_path, introduced_by, .. } => {
            (asset_path, format!("sublayer of {introduced_by}"))
        }
        other => return format!("left out: {}", shortened_note(&other.to_string())),
    };
    // The library reports the path as authored, not the resolved one.
    let bare = layer.trim_start_matches("./");
    let why = refused.iter().find(|(known, _)| std::path::Path::new(known).ends_with(bare)).map(|(_, why)| why);
    let why = why.map_or("no path within the imported folder", String::as_str);
    format!("left out: {}, a {place}: {}", shortened(layer), shortened_note(why))
}

/// Message of an error of the library with its causes, in one line of at most 200 characters.
pub fn plain(error: &dyn std::fmt::Display) -> String {
    shortened_note(&format!("{error:#}"))
}

fn shortened_note(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    words.chars().filter(|c| !c.is_control()).take(200).collect()
}

/// Loaded layers by their path relative to the import's folder; layers in an archive have the archive as a folder.
#[derive(Default)]
struct Known {
    bytes: BTreeMap<String, Arc<Vec<u8>>>,
    /// Path of the first layer of each archive, by the archive's path.
    first: BTreeMap<String, String>,
    /// Paths of layers that the library requested but that are not loaded.
    wanted: BTreeSet<String>,
}

impl Known {
    fn add(&mut self, path: &str, files: &mut Files<'_>) -> Result<(), ImportError> {
        let bytes = files.bytes(path, IMPORTED_MESH)?;
        if extension(path) == "usdz" {
            return self.unpack(path, &bytes, files);
        }
        check(path, &bytes)?;
        self.bytes.insert(path.to_owned(), bytes);
        Ok(())
    }

    /// Adds the files of an archive; its first layer becomes the one that the archive's path refers to.
    fn unpack(&mut self, path: &str, bytes: &[u8], files: &mut Files<'_>) -> Result<(), ImportError> {
        let damaged = |error: &dyn std::fmt::Display| {
            ImportError::new(path, format!("not a readable USDZ archive: {error}")).hint("copy or export it again")
        };
        let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
        for index in 0..archive.len() {
            let mut entry = archive.by_index(index).map_err(|error| damaged(&error))?;
            let Ok(name) = beside(&format!("{path}/entry"), entry.name()) else { continue };
            if entry.is_dir() || !name.starts_with(path) {
                continue;
            }
            let mut held = Vec::new();
            entry.by_ref().take(IMPORTED_MESH.bytes + 1).read_to_end(&mut held).map_err(|error| damaged(&error))?;
            if held.len() as u64 > IMPORTED_MESH.bytes {
                return Err(damaged(&format!("{name} exceeds {} MiB", IMPORTED_MESH.bytes >> 20)));
            }
            let held = files.hold(&name, held)?;
            if is_layer(&name) && extension(&name) != "usdz" {
                check(&name, &held)?;
                self.first.entry(path.to_owned()).or_insert_with(|| name.clone());
                self.bytes.insert(name, held);
            }
        }
        if self.first.contains_key(path) { Ok(()) } else { Err(damaged(&"it contains no layer")) }
    }
}

/// Refuses layers that are neither usda nor usdc, or whose parsing would exhaust stack or memory.
fn check(path: &str, bytes: &[u8]) -> Result<(), ImportError> {
    let wrong = |message: String| ImportError::new(path, message);
    if bytes.starts_with(binary::MAGIC) {
        return binary::check(bytes).map_err(wrong);
    }
    if !bytes.starts_with(b"#usda") && !bytes.starts_with(b"#sdf") {
        return Err(wrong("neither USD text, which starts with `#usda`, nor USD binary".into()));
    }
    text::check(bytes).map_err(wrong)
}

/// Resolver that gives the library access to the loaded layers.
struct Layers(Rc<RefCell<Known>>);

impl Resolver for Layers {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        // `a.usdz[b.usd]` is a file in an archive.
        let inside = asset_path.strip_suffix(']').map(|path| path.replacen('[', "/", 1));
        let named = inside.as_deref().unwrap_or(asset_path);
        let Some(anchor) = anchor else { return named.to_owned() };
        beside(&anchor.to_string_lossy(), named).unwrap_or_else(|_| named.to_owned())
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        let mut known = self.0.borrow_mut();
        if known.bytes.contains_key(asset_path) {
            return Some(ResolvedPath::new(asset_path));
        }
        if let Some(first) = known.first.get(asset_path) {
            return Some(ResolvedPath::new(first));
        }
        // False for absolute paths and those that leave the import's folder.
        let is_inside = beside("", asset_path).is_ok_and(|inside| inside == asset_path);
        if !is_layer(asset_path) {
            return is_inside.then(|| ResolvedPath::new(asset_path));
        }
        if is_inside {
            known.wanted.insert(asset_path.to_owned());
        }
        None
    }

    fn resolve_for_new_asset(&self, _: &str) -> Option<ResolvedPath> {
        None
    }

    fn open_asset(&self, resolved: &ResolvedPath) -> io::Result<Box<dyn Asset>> {
        let known = self.0.borrow();
        let bytes = known.bytes.get(&*resolved.to_string_lossy());
        let bytes = bytes.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not among the import's files"))?;
        Ok(Box::new(Cursor::new(bytes.as_ref().clone())))
    }

    fn get_modification_timestamp(&self, _: &str, _: &ResolvedPath) -> Option<std::time::SystemTime> {
        None
    }
}
