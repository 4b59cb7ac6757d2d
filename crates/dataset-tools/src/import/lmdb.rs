//! Reader of LMDB files: index of the keys, and access to their values.
//!
//! Opening reads each page of the tree once, without mmap; pointers outside the file and cycles are rejected. Only the
//! main database is read.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use genmanip_data::{DataError, files};

const MAGIC: u32 = 0xBEEF_C0DE;
/// Size of the header of a page, bytes.
const HEADER: usize = 16;
/// Page type flags, of branch, leaf and overflow pages.
const BRANCH: u16 = 1;
const LEAF: u16 = 2;
const OVERFLOW: u16 = 4;
/// Node flag: the value is on overflow pages.
const BIG: u16 = 1;
/// Invalid page number (an empty tree).
const NO_PAGE: u64 = u64::MAX;
/// Maximum number of keys. An hour at 30 Hz with colour and depth of ten cameras has about 2.2 million.
const MAX_KEYS: usize = 20_000_000;
/// Maximum key length written by LMDB, bytes.
const MAX_KEY_BYTES: usize = 511;
/// Maximum size of a value, bytes. Bounds memory for damaged or hostile files.
const MAX_VALUE_BYTES: u64 = 1 << 30;

/// An open LMDB file with its keys in memory.
pub(super) struct Lmdb {
    path: PathBuf,
    file: File,
    page_size: usize,
    /// Offset in the file and length of each value by its key, bytes.
    values: BTreeMap<Vec<u8>, (u64, u64)>,
}

impl Lmdb {
    /// Opens `data.mdb` and reads its keys.
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        let file = files::open(path)?;
        let mut lmdb = Self { path: path.into(), file, page_size: 0, values: BTreeMap::new() };
        let (page_size, root) = lmdb.newest()?;
        lmdb.page_size = page_size;
        if root != NO_PAGE {
            lmdb.walk(root)?;
        }
        Ok(lmdb)
    }

    /// Value of a key, read from the file; `None` if the key does not exist.
    pub(super) fn get(&self, key: &str) -> Result<Option<Vec<u8>>, DataError> {
        let Some((at, length)) = self.values.get(key.as_bytes()) else { return Ok(None) };
        self.bytes(*at, usize::try_from(*length).unwrap_or(usize::MAX)).map(Some)
    }

    /// All keys that are valid UTF-8, in byte order.
    pub(super) fn keys(&self) -> impl Iterator<Item = &str> {
        self.values.keys().filter_map(|key| std::str::from_utf8(key).ok())
    }

    fn broken(&self, why: &str) -> DataError {
        DataError::mismatch(self.path.display().to_string(), "an LMDB file", why)
    }

    fn bytes(&self, at: u64, length: usize) -> Result<Vec<u8>, DataError> {
        let mut bytes = vec![0; length];
        self.file.read_exact_at(&mut bytes, at).map_err(|_| self.broken("a page beyond the end of the file"))?;
        Ok(bytes)
    }

    /// Page size and root page of the newer of the two meta pages.
    fn newest(&self) -> Result<(usize, u64), DataError> {
        let state = |at: u64| -> Option<(u64, usize, u64)> {
            let page = self.bytes(at, HEADER + 136).ok()?;
            let meta = &page[HEADER..];
            if number(meta, 0, 4)? != u64::from(MAGIC) || number(meta, 4, 4)? != 1 {
                return None;
            }
            // Layout of a meta page after the map's address and size: the free-list database, whose padding field holds
            // the page size; the main database, whose last field is the root page; the last page; the transaction id.
            let page_size = usize::try_from(number(meta, 24, 4)?).ok()?;
            Some((number(meta, 128, 8)?, page_size, number(meta, 112, 8)?))
        };
        let first = state(0).ok_or_else(|| self.broken("another file format"))?;
        let page_size = first.1;
        if !(512..=65536).contains(&page_size) || !page_size.is_power_of_two() {
            return Err(self.broken("an invalid page size"));
        }
        let newest = state(page_size as u64).filter(|second| second.0 > first.0 && second.1 == page_size);
        Ok((page_size, newest.unwrap_or(first).2))
    }

    /// Indexes all keys of the tree below the page `root`.
    fn walk(&mut self, root: u64) -> Result<(), DataError> {
        let file_length = self.file.metadata().map_err(DataError::io("read", &self.path))?.len();
        let (mut seen, mut all) = (BTreeSet::new(), 0);
        let mut pages = vec![root];
        while let Some(number_of_page) = pages.pop() {
            if !seen.insert(number_of_page) {
                return Err(self.broken("a cycle of pages"));
            }
            let at = self.place(number_of_page)?;
            let page = self.bytes(at, self.page_size)?;
            let broken = || self.broken("a damaged page");
            let kind = number(&page, 10, 2).ok_or_else(broken)? as u16;
            let lower = number(&page, 12, 2).ok_or_else(broken)? as usize;
            let nodes = (lower.checked_sub(HEADER).ok_or_else(broken)?) / 2;
            let (mut found, mut within) = (Vec::new(), 0);
            for node in 0..nodes {
                let offset = number(&page, HEADER + 2 * node, 2).ok_or_else(broken)? as usize;
                let field = |index: usize| number(&page, offset + 2 * index, 2).ok_or_else(broken);
                let (low, high, flags, key) = (field(0)?, field(1)?, field(2)?, field(3)? as usize);
                if kind & BRANCH != 0 {
                    pages.push(low | high << 16 | flags << 32);
                    continue;
                }
                if kind & LEAF == 0 {
                    return Err(broken());
                }
                // Nodes that overlap would let a small file expand to a huge index.
                within += 8 + key;
                if key > MAX_KEY_BYTES || within > self.page_size {
                    return Err(broken());
                }
                let name = page.get(offset + 8..offset + 8 + key).ok_or_else(broken)?.to_vec();
                let length = low | high << 16;
                all += length;
                if length > MAX_VALUE_BYTES || all > file_length {
                    return Err(self.broken("values larger than the file"));
                }
                let data = offset + 8 + key;
                let place = if flags as u16 & BIG == 0 {
                    page.get(data..data + length as usize).ok_or_else(broken)?;
                    at + data as u64
                } else {
                    self.overflow(number(&page, data, 8).ok_or_else(broken)?)?
                };
                found.push((name, (place, length)));
            }
            self.values.extend(found);
            if self.values.len() > MAX_KEYS {
                return Err(self.broken("too many keys"));
            }
        }
        Ok(())
    }

    /// Offset in the file of a value that starts on an overflow page.
    fn overflow(&self, page: u64) -> Result<u64, DataError> {
        let at = self.place(page)?;
        let kind = number(&self.bytes(at, HEADER)?, 10, 2).unwrap_or(0) as u16;
        if kind & OVERFLOW == 0 { Err(self.broken("a damaged page")) } else { Ok(at + HEADER as u64) }
    }

    fn place(&self, page: u64) -> Result<u64, DataError> {
        page.checked_mul(self.page_size as u64).ok_or_else(|| self.broken("a page beyond the end of the file"))
    }
}

/// Little-endian integer of `length` bytes (at most 8) at offset `at`; `None` if it exceeds `bytes`.
fn number(bytes: &[u8], at: usize, length: usize) -> Option<u64> {
    let mut wide = [0; 8];
    wide[..length].copy_from_slice(bytes.get(at..at.checked_add(length)?)?);
    Some(u64::from_le_bytes(wide))
}
