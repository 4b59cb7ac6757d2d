//! Objects of a frozen suite, read from its folder.

use std::collections::{BTreeMap, HashMap};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use crate::suite_format::{FrozenFile, SuiteFile, sha256};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use genmanip_assets::{AssetError, AssetSource, FrozenAsset};
use genmanip_core::names::is_file_name;
use genmanip_core::{AssetHashes, AssetRef, AssetUid, Document, ObjectCard, ObjectModel, limits};

use genmanip_workspace::documents;

/// Maximum size of an uncompressed object file, bytes. Chosen by hand, a hundred times the usual size.
const MAX_BYTES: u64 = 4 << 20;

/// Source of a suite's objects only, each read on first use, and again once no scene holds it any more.
pub struct SuiteAssets {
    folder: PathBuf,
    files: HashMap<AssetRef, FrozenFile>,
    /// Objects read so far; only used for lookup.
    known: Mutex<HashMap<AssetRef, Known>>,
}

/// An object that was read. Its model has megabytes of meshes, so it is held weakly: only scenes keep it in memory.
struct Known {
    model: Weak<ObjectModel>,
    hashes: AssetHashes,
}

impl SuiteAssets {
    /// Source of a suite's objects; `None` if they are not frozen.
    pub fn of(folder: &Path, suite: &SuiteFile) -> Option<Self> {
        let files = suite.assets.iter().map(|file| (file.asset.clone(), file.clone())).collect();
        (!suite.assets.is_empty()).then(|| Self { folder: folder.to_owned(), files, known: Mutex::default() })
    }

    /// A frozen object, if its file has the recorded hash and is within the size limit.
    ///
    /// # Errors
    /// Description of the fault with the name of the file.
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
        let unpacked = GzDecoder::new(bytes.as_slice()).take(MAX_BYTES + 1).read_to_string(&mut text);
        unpacked.map_err(|error| format!("assets/{name}: {error}"))?;
        if text.len() as u64 > MAX_BYTES {
            return Err(format!("assets/{name}: expected at most {MAX_BYTES} bytes, unpacked"));
        }
        let frozen = FrozenAsset::from_json(&text).map_err(|error| format!("assets/{name}: {error}"))?;
        match frozen.asset == file.asset {
            true => Ok(frozen),
            false => Err(format!("assets/{name} is {}, not {}", frozen.asset, file.asset)),
        }
    }

    fn known(&self) -> MutexGuard<'_, HashMap<AssetRef, Known>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl AssetSource for SuiteAssets {
    fn cards(&self) -> &[ObjectCard] {
        &[]
    }

    fn model(&self, asset: &AssetRef) -> Result<Arc<ObjectModel>, AssetError> {
        if let Some(model) = self.known().get(asset).and_then(|known| known.model.upgrade()) {
            return Ok(model);
        }
        let wrong = |message: String| AssetError::NotFrozen { asset: asset.clone(), message };
        let file = self.files.get(asset).ok_or_else(|| wrong("the suite has no such object".into()))?;
        let read = Arc::new(Self::read(&self.folder, file).map_err(wrong)?.model()?);
        let mut known = self.known();
        let entry = known.entry(asset.clone()).or_insert_with(|| Known { model: Weak::new(), hashes: read.hashes() });
        // If another thread has read the object meanwhile, all use that one.
        let model = entry.model.upgrade().unwrap_or(read);
        entry.model = Arc::downgrade(&model);
        Ok(model)
    }

    fn hashes(&self, asset: &AssetRef) -> Result<AssetHashes, AssetError> {
        let known = || self.known().get(asset).map(|known| known.hashes.clone());
        match known() {
            Some(hashes) => Ok(hashes),
            None => self.model(asset).map(|model| known().unwrap_or_else(|| model.hashes())),
        }
    }
}

/// Content of an object's file: one line of JSON, compressed with gzip since it holds many exact numbers.
pub(super) fn to_bytes(frozen: &FrozenAsset) -> std::io::Result<Vec<u8>> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    writeln!(packed, "{}", frozen.to_value())?;
    packed.finish()
}

/// Path of an object's file in the folder of its suite.
pub(super) fn path(folder: &Path, file: &FrozenFile) -> PathBuf {
    folder.join("assets").join(&file.file)
}

/// Distinct objects of all scenarios, by the name of their file.
pub(super) fn distinct<'a>(
    objects: impl Iterator<Item = &'a AssetRef>,
    uid: impl Fn(&AssetRef) -> Result<AssetUid, AssetError>,
) -> Result<BTreeMap<String, AssetRef>, AssetError> {
    let mut names: BTreeMap<String, AssetRef> = BTreeMap::new();
    for asset in objects {
        let uid = uid(asset)?;
        // Two versions of one object share a uid.
        let name = |again: usize| if again == 0 { format!("{uid}.json.gz") } else { format!("{uid}+{again}.json.gz") };
        let free = (0..).map(name).find(|name| names.get(name).is_none_or(|known| known == asset));
        names.insert(free.unwrap_or_default(), asset.clone());
    }
    Ok(names)
}
