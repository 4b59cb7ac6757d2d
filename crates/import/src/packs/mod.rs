//! Packs: folders of imported objects that every command can open.
//!
//! `DIR/NAME/pack.json` lists the objects of a pack; each has a file (`UID.object`, see [`crate::pack`]) and a preview
//! (`UID.png`); tried grasps are stored per robot (`grasps-ROBOT.json`).

mod candidates;
mod importing;
mod resting;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::report::Report;
use genmanip_assets::imported::{self, Origin};
use genmanip_assets::{AssetError, AssetSource, GraspFile, cache_grasps};
use genmanip_core::{AssetRef, AssetUid, Document, ObjectCard, ObjectModel, limits};
use genmanip_data::files;
use serde::{Deserialize, Serialize};

pub use candidates::{Candidate, candidates};
pub use importing::{ImportRow, ImportSettings, import, table};
pub use resting::{AtRest, at_rest};

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Name of a pack's index file.
const LIST: &str = "pack.json";
/// Maximum number of packs in a folder, and (`MAX_OBJECTS`) of objects in a pack.
const MAX_PACKS: usize = 1000;
const MAX_OBJECTS: usize = 100_000;

/// Index of a pack, in its `pack.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackList {
    /// Objects, sorted by uid.
    pub objects: Vec<PackEntry>,
}

/// An object of a pack.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackEntry {
    /// Card of the object, for people and language models.
    pub card: ObjectCard,
    /// Provenance: source files, licence and creator.
    pub origin: Origin,
    /// Guesses and repairs of the object's import.
    pub report: Report,
}

impl Document for PackList {
    const SCHEMA: &'static str = "genmanip.pack/1";

    fn check(&self) -> Result<(), genmanip_core::DocumentError> {
        let invalid =
            |path: String, message: &str| Err(genmanip_core::DocumentError::Invalid { path, message: message.into() });
        if self.objects.len() > MAX_OBJECTS {
            return invalid("objects".into(), &format!("more than {MAX_OBJECTS} objects"));
        }
        for (index, PackEntry { card, .. }) in self.objects.iter().enumerate() {
            let uid = card.uid.as_str();
            let fits =
                !uid.is_empty() && !uid.starts_with('.') && uid.chars().all(genmanip_core::names::fits_file_name);
            if !fits || !matches!(card.asset, AssetRef::Imported { .. }) {
                return invalid(
                    format!("objects[{index}].card"),
                    "expected an imported asset whose uid is a valid file name",
                );
            }
        }
        Ok(())
    }
}

/// The opened packs of a folder; objects are read on first use.
pub struct Packs {
    cards: Vec<ObjectCard>,
    /// File and provenance of each object, by the hash of its source files.
    objects: BTreeMap<String, (PathBuf, Origin)>,
    models: Mutex<BTreeMap<String, Arc<ObjectModel>>>,
}

/// Opens every pack in a folder, and registers their objects and tested grasps for the whole process; returns the
/// number of objects.
///
/// # Errors
/// If an index cannot be read or is invalid.
pub fn open(folder: &Path) -> Result<usize, WorkspaceError> {
    let packs = Packs::read(folder)?;
    let count = packs.cards.len();
    imported::open(Arc::new(packs));
    Ok(count)
}

impl Packs {
    /// Reads the indexes of a folder's packs, and registers their grasps.
    ///
    /// # Errors
    /// As [`open`].
    pub fn read(folder: &Path) -> Result<Self, WorkspaceError> {
        let mut packs = Self { cards: Vec::new(), objects: BTreeMap::new(), models: Mutex::default() };
        let entries = fs::read_dir(folder).map_err(|error| WorkspaceError::file("list", folder, error))?;
        let mut folders: Vec<PathBuf> =
            entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir()).collect();
        folders.sort();
        folders.truncate(MAX_PACKS);
        for pack in folders.into_iter().filter(|pack| files::is_file_no_follow(&pack.join(LIST))) {
            let list: PackList = documents::read_document(&pack.join(LIST), limits::PACK)?;
            for PackEntry { card, origin, .. } in list.objects {
                let AssetRef::Imported { hash } = &card.asset else { continue };
                // Several packs may contain the same files.
                if packs.objects.insert(hash.clone(), (object_file(&pack, &card.uid), origin)).is_none() {
                    packs.cards.push(card);
                }
            }
            register_grasps(&pack)?;
        }
        packs.cards.sort_by(|a, b| a.uid.cmp(&b.uid));
        Ok(packs)
    }
}

/// File of an object in its pack's folder.
fn object_file(pack: &Path, uid: &AssetUid) -> PathBuf {
    pack.join(format!("{uid}.object"))
}

/// File of a pack's grasps that were tested with a robot.
fn grasps_file(pack: &Path, robot: &str) -> PathBuf {
    pack.join(format!("grasps-{robot}.json"))
}

/// Registers the tested grasps of a pack.
fn register_grasps(pack: &Path) -> Result<(), WorkspaceError> {
    for robot in genmanip_assets::robots::names() {
        let path = grasps_file(pack, &robot);
        if !files::is_file_no_follow(&path) {
            continue;
        }
        let file: GraspFile = documents::read_document(&path, limits::GRASPS)?;
        let Some(robot_hash) = &file.made_by.robot_hash else { continue };
        for object in file.objects.into_values() {
            cache_grasps(robot_hash, &object.physics_hash, object.grasps);
        }
    }
    Ok(())
}

impl AssetSource for Packs {
    fn cards(&self) -> &[ObjectCard] {
        &self.cards
    }

    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError> {
        let unknown = || AssetError::NotImported { asset: asset.clone() };
        let AssetRef::Imported { hash } = asset else { return Err(unknown()) };
        let mut models = self.models.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(model) = models.get(hash) {
            return Ok(Arc::clone(model));
        }
        let (path, _) = self.objects.get(hash).ok_or_else(unknown)?;
        let wrong = |message: String| AssetError::Data { file: path.display().to_string(), message };
        let bytes = files::read_no_follow(path, limits::PACK_OBJECT).map_err(|error| wrong(error.to_string()))?;
        let object = crate::pack::from_bytes(&bytes).map_err(wrong)?;
        if object.model.asset != *asset {
            return Err(wrong(format!("contains {}; expected {asset}: import the pack again", object.model.asset)));
        }
        let model = Arc::new(object.model);
        models.insert(hash.clone(), Arc::clone(&model));
        Ok(model)
    }
}

impl imported::Packs for Packs {
    fn origin(&self, hash: &str) -> Option<Origin> {
        self.objects.get(hash).map(|(_, origin)| origin.clone())
    }
}
