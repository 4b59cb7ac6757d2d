//! The objects of a frozen suite, out of its folder.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{AssetError, AssetSource, FrozenAsset};
use genmanip_bench::suite::{FrozenFile, SuiteFile, sha256};
use genmanip_core::{AssetHashes, AssetRef, Document, ObjectCard, ObjectModel, limits};

use crate::inputs;

/// Objects that are read when they are first asked for. Only those of the suite are known.
pub struct SuiteAssets {
    folder: PathBuf,
    files: HashMap<AssetRef, FrozenFile>,
    /// What was read; only looked up.
    known: Mutex<HashMap<AssetRef, (Arc<ObjectModel>, AssetHashes)>>,
}

impl SuiteAssets {
    /// Those of a suite; `None` when its objects were not frozen.
    pub fn of(folder: &Path, suite: &SuiteFile) -> Option<Self> {
        let files = suite.assets.iter().map(|file| (file.asset.clone(), file.clone())).collect();
        (!suite.assets.is_empty()).then(|| Self { folder: folder.to_owned(), files, known: Mutex::default() })
    }

    /// A frozen object, when its file is the one that was frozen.
    ///
    /// # Errors
    /// In words, with the name of the file.
    pub fn read(folder: &Path, file: &FrozenFile) -> Result<FrozenAsset, String> {
        let path = path(folder, file);
        let bytes = inputs::read_bytes(&path, limits::FROZEN_ASSET).map_err(|error| error.to_string())?;
        let name = &file.file;
        let sha256 = sha256(&bytes);
        if sha256 != file.sha256 {
            let was = &file.sha256;
            return Err(format!(
                "assets/{name} is not as it was frozen: its SHA-256 begins with {sha256:.12}, not {was:.12}"
            ));
        }
        let text = String::from_utf8(bytes).map_err(|error| format!("assets/{name}: {error}"))?;
        FrozenAsset::from_json(&text).map_err(|error| format!("assets/{name}: {error}"))
    }

    fn model_and_hashes(&self, asset: &AssetRef) -> Result<(Arc<ObjectModel>, AssetHashes), AssetError> {
        if let Some(known) = self.known.lock().unwrap_or_else(PoisonError::into_inner).get(asset) {
            return Ok(known.clone());
        }
        let wrong = |message: String| AssetError::NotFrozen { asset: asset.clone(), message };
        let file = self.files.get(asset).ok_or_else(|| wrong("the suite has no such object".into()))?;
        let model = Self::read(&self.folder, file).map_err(wrong)?.model()?;
        let made = (Arc::new(model.clone()), model.hashes());
        // Another thread may have made it meanwhile; everybody gets the same.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(known.entry(asset.clone()).or_insert(made).clone())
    }
}

impl AssetSource for SuiteAssets {
    fn cards(&self) -> &[ObjectCard] {
        &[]
    }

    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError> {
        self.model_and_hashes(asset).map(|(model, _)| model)
    }

    fn hashes(&self, asset: &AssetRef) -> Result<AssetHashes, AssetError> {
        self.model_and_hashes(asset).map(|(_, hashes)| hashes)
    }
}

/// The file of an object in the folder of its suite.
pub(super) fn path(folder: &Path, file: &FrozenFile) -> PathBuf {
    folder.join("assets").join(&file.file)
}

/// One of each object that scenarios have, by the name of its file.
pub(super) fn distinct<'a>(
    objects: impl Iterator<Item = &'a AssetRef>,
    uid: impl Fn(&AssetRef) -> Result<String, AssetError>,
) -> Result<BTreeMap<String, AssetRef>, AssetError> {
    let mut names = BTreeMap::new();
    for asset in objects {
        names.entry(format!("{}.json", uid(asset)?)).or_insert_with(|| asset.clone());
    }
    Ok(names)
}
