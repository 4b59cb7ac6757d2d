//! The objects of a frozen suite, out of its folder.

use std::collections::{BTreeMap, HashMap};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::suite::{FrozenFile, SuiteFile, sha256};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use genmanip_assets::{AssetError, AssetSource, FrozenAsset};
use genmanip_core::names::is_file_name;
use genmanip_core::{AssetHashes, AssetRef, Document, ObjectCard, ObjectModel, limits};

use genmanip_workspace::documents;

/// Most bytes of an object, unpacked; chosen, a hundred times a usual one.
const MOST_BYTES: u64 = 4 << 20;

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

    /// A frozen object, when its file is the one that was frozen and not larger than any object is.
    ///
    /// # Errors
    /// In words, with the name of the file.
    pub fn read(folder: &Path, file: &FrozenFile) -> Result<FrozenAsset, String> {
        if !is_file_name(&file.file) {
            return Err(format!("suite.json names a file `{}`: expected one in assets/", file.file));
        }
        let path = path(folder, file);
        let bytes = documents::read_bytes(&path, limits::FROZEN_ASSET).map_err(|error| error.to_string())?;
        let name = &file.file;
        let sha256 = sha256(&bytes);
        if sha256 != file.sha256 {
            let was = &file.sha256;
            return Err(format!(
                "assets/{name} is not as it was frozen: its SHA-256 begins with {sha256:.12}, not {was:.12}"
            ));
        }
        let mut text = String::new();
        let unpacked = GzDecoder::new(bytes.as_slice()).take(MOST_BYTES + 1).read_to_string(&mut text);
        unpacked.map_err(|error| format!("assets/{name}: {error}"))?;
        if text.len() as u64 > MOST_BYTES {
            return Err(format!("assets/{name}: expected at most {MOST_BYTES} bytes, unpacked"));
        }
        let frozen = FrozenAsset::from_json(&text).map_err(|error| format!("assets/{name}: {error}"))?;
        match frozen.asset == file.asset {
            true => Ok(frozen),
            false => Err(format!("assets/{name} is {}, not {}", frozen.asset, file.asset)),
        }
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

/// The bytes of an object's file: one line of JSON, compressed, since its numbers are exact and many.
pub(super) fn to_bytes(frozen: &FrozenAsset) -> std::io::Result<Vec<u8>> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    writeln!(packed, "{}", frozen.to_value())?;
    packed.finish()
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
    let mut names: BTreeMap<String, AssetRef> = BTreeMap::new();
    for asset in objects {
        let uid = uid(asset)?;
        // Two versions of one object have one uid.
        let name = |again: usize| if again == 0 { format!("{uid}.json.gz") } else { format!("{uid}+{again}.json.gz") };
        let free = (0..).map(name).find(|name| names.get(name).is_none_or(|known| known == asset));
        names.insert(free.unwrap_or_default(), asset.clone());
    }
    Ok(names)
}
