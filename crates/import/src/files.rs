//! The files of one import: named relative to a root that none of them may leave, each read once, all of them hashed.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::Texture;
use genmanip_core::limits::{IMPORTED_PICTURE, Limit};
use sha2::{Digest, Sha256};

use crate::{ImportError, picture};

/// Version of the pipeline: objects of the same files differ between versions.
const PIPELINE: &str = "genmanip.import/1";
/// Most files that one object may be made of.
const MOST_FILES: usize = 512;
/// Most bytes that the files of one object may have together.
const MOST_BYTES: u64 = 256 << 20;

/// Reads a file under the root by its path relative to it; the text says what went wrong.
pub type ReadFile<'a> = dyn FnMut(&str, Limit) -> Result<Vec<u8>, String> + 'a;

/// The files that an object is made of.
pub struct Files<'a> {
    read: &'a mut ReadFile<'a>,
    known: BTreeMap<String, Arc<Vec<u8>>>,
    bytes: u64,
    /// Pictures that were decoded already.
    pictures: BTreeMap<String, Arc<Texture>>,
    /// Pixels that may still be decoded.
    pub pixels_left: usize,
}

impl<'a> Files<'a> {
    /// None yet.
    pub fn new(read: &'a mut ReadFile<'a>) -> Self {
        Self { read, known: BTreeMap::new(), bytes: 0, pictures: BTreeMap::new(), pixels_left: picture::MOST_PIXELS }
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// When it cannot be read, is larger than the limit, or one of too many.
    pub fn bytes(&mut self, path: &str, limit: Limit) -> Result<Arc<Vec<u8>>, ImportError> {
        if let Some(bytes) = self.known.get(path) {
            return Ok(Arc::clone(bytes));
        }
        if self.known.len() == MOST_FILES {
            return Err(ImportError::new(path, format!("more than {MOST_FILES} files belong to one object")));
        }
        let bytes = (self.read)(path, limit).map_err(|message| ImportError::new(path, message))?;
        self.bytes += bytes.len() as u64;
        if self.bytes > MOST_BYTES {
            let message = format!("the files of the object have more than {} MiB together", MOST_BYTES >> 20);
            return Err(ImportError::new(path, message));
        }
        let bytes = Arc::new(bytes);
        self.known.insert(path.to_owned(), Arc::clone(&bytes));
        Ok(bytes)
    }

    /// The text of a file; what is not UTF-8 in it is replaced, since it can only stand in names and comments.
    ///
    /// # Errors
    /// As [`Files::bytes`].
    pub fn text(&mut self, path: &str, limit: Limit) -> Result<String, ImportError> {
        Ok(String::from_utf8_lossy(&self.bytes(path, limit)?).trim_start_matches('\u{feff}').to_owned())
    }

    /// A picture, decoded once, and a note when it was scaled down.
    ///
    /// # Errors
    /// As [`Files::bytes`], and when it is no picture that can be decoded.
    pub fn picture(&mut self, path: &str) -> Result<(Arc<Texture>, Option<String>), ImportError> {
        if let Some(known) = self.pictures.get(path) {
            return Ok((Arc::clone(known), None));
        }
        let bytes = self.bytes(path, IMPORTED_PICTURE)?;
        let (texture, note) =
            picture::texture(&bytes, &mut self.pixels_left).map_err(|message| ImportError::new(path, message))?;
        let texture = Arc::new(texture);
        self.pictures.insert(path.to_owned(), Arc::clone(&texture));
        Ok((texture, note.map(|note| format!("{path}: {note}"))))
    }

    /// Names of the files that were read.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.known.keys().map(String::as_str)
    }

    /// Hash of names and contents of the files that were read, of what was chosen besides, and of the pipeline.
    pub fn hash(&self, chosen: &str) -> String {
        let mut hash = Sha256::new();
        let mut part = |bytes: &[u8]| {
            hash.update((bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        };
        part(PIPELINE.as_bytes());
        part(chosen.as_bytes());
        for (name, bytes) in &self.known {
            part(name.as_bytes());
            part(bytes);
        }
        hash.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// The path, relative to the root, of what a file names relative to its own folder.
///
/// # Errors
/// When the name is absolute, leads out of the root, or is no plain path.
pub fn beside(file: &str, named: &str) -> Result<String, ImportError> {
    let wrong = |what: &str| {
        Err(ImportError::new(file, format!("names the file `{}`, {what}", shortened(named))).hint(
            "expected a path relative to the file, within the folder that is imported; to let files name others in \
             folders beside theirs, import the folder that holds all of them",
        ))
    };
    let plain = named.trim().strip_prefix("file://").unwrap_or(named.trim()).replace('\\', "/");
    if plain.is_empty() || plain.contains(['\0', '\n']) {
        return wrong("which is no path");
    }
    if plain.starts_with('/') || plain.as_bytes().get(1) == Some(&b':') || plain.contains("://") {
        return wrong("which is absolute");
    }
    let mut parts: Vec<&str> = file.split('/').collect();
    parts.pop();
    for part in plain.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    return wrong("which lies outside of the folder that is imported");
                }
            }
            part => parts.push(part),
        }
    }
    Ok(parts.join("/"))
}

/// The beginning of a text that a file holds, fit for a message.
pub fn shortened(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { '?' } else { c }).take(80).collect();
    if text.chars().count() > 80 { clean + "…" } else { clean }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_the_root() {
        let found = |file, named| beside(file, named).ok();
        assert_eq!(found("a/b.xml", "c.obj").as_deref(), Some("a/c.obj"));
        assert_eq!(found("a/b.xml", "../t/./c.png").as_deref(), Some("t/c.png"));
        assert_eq!(found("a/b.xml", "m\\c.obj").as_deref(), Some("a/m/c.obj"));
        for hostile in ["/etc/passwd", "../../x", "C:/x", "http://x/y", "", "a\0b", "file:///etc/passwd"] {
            let error = beside("a/b.xml", hostile).unwrap_err();
            assert!(!error.hint.is_empty() && error.file == "a/b.xml", "{hostile}");
        }
    }

    #[test]
    fn the_hash_depends_on_names_contents_and_choices() {
        let hash = |name: &str, bytes: &[u8], chosen: &str| {
            let bytes = bytes.to_vec();
            let mut read = move |_: &str, _: Limit| Ok(bytes.clone());
            let mut files = Files::new(&mut read);
            files.bytes(name, genmanip_core::limits::IMPORTED_MESH).unwrap();
            files.hash(chosen)
        };
        let own = hash("a", b"x", "");
        assert_eq!(own, hash("a", b"x", ""));
        for other in [hash("b", b"x", ""), hash("a", b"y", ""), hash("a", b"x", "scale 2")] {
            assert_ne!(own, other);
        }
    }
}
