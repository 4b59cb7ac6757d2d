//! LMDB files, read only: where the value of each key lies.
//!
//! Pages are read one by one, each once; nothing is mapped, and what points outside the file or back is refused.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::{DataError, files};

const MAGIC: u32 = 0xBEEF_C0DE;
/// Bytes before a page's contents.
const HEADER: usize = 16;
/// Kinds of pages.
const BRANCH: u16 = 1;
const LEAF: u16 = 2;
const OVERFLOW: u16 = 4;
/// Marks a value that lies on pages of its own.
const BIG: u16 = 1;
/// Where there is no page.
const NOWHERE: u64 = u64::MAX;
/// Most keys: an episode of an hour with ten cameras has a tenth.
const MOST_KEYS: usize = 20_000_000;
/// Longest key that LMDB itself writes, bytes.
const LONGEST_KEY: usize = 511;
/// Largest value, bytes.
const LARGEST: u64 = 1 << 30;

/// An open file.
pub(super) struct Lmdb {
    path: PathBuf,
    file: File,
    page_size: usize,
    /// Where each value lies, and its bytes.
    values: BTreeMap<Vec<u8>, (u64, u64)>,
}

impl Lmdb {
    /// Opens `data.mdb` and reads its keys.
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        let file = files::open(path)?;
        let mut lmdb = Self { path: path.into(), file, page_size: 0, values: BTreeMap::new() };
        let (page_size, root) = lmdb.newest()?;
        lmdb.page_size = page_size;
        if root != NOWHERE {
            lmdb.walk(root)?;
        }
        Ok(lmdb)
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Result<Option<Vec<u8>>, DataError> {
        let Some((at, length)) = self.values.get(key.as_bytes()) else { return Ok(None) };
        self.bytes(*at, usize::try_from(*length).unwrap_or(usize::MAX)).map(Some)
    }

    /// All keys that are text, in order.
    pub(super) fn keys(&self) -> impl Iterator<Item = &str> {
        self.values.keys().filter_map(|key| std::str::from_utf8(key).ok())
    }

    fn broken(&self, why: &str) -> DataError {
        DataError::mismatch(self.path.display().to_string(), "an LMDB file", why)
    }

    fn bytes(&self, at: u64, length: usize) -> Result<Vec<u8>, DataError> {
        let mut bytes = vec![0; length];
        self.file.read_exact_at(&mut bytes, at).map_err(|_| self.broken("a page beyond its end"))?;
        Ok(bytes)
    }

    /// Page size and root page of the newer of the two states that a file keeps.
    fn newest(&self) -> Result<(usize, u64), DataError> {
        let state = |at: u64| -> Option<(u64, usize, u64)> {
            let page = self.bytes(at, HEADER + 136).ok()?;
            let meta = &page[HEADER..];
            if number(meta, 0, 4)? != u64::from(MAGIC) || number(meta, 4, 4)? != 1 {
                return None;
            }
            // Behind the address and size of the map: the list of free pages, whose padding is the page size, then
            // the entries, of which the root comes last; then the last page and the number of the transaction.
            let page_size = usize::try_from(number(meta, 24, 4)?).ok()?;
            Some((number(meta, 128, 8)?, page_size, number(meta, 112, 8)?))
        };
        let first = state(0).ok_or_else(|| self.broken("another kind of file"))?;
        let page_size = first.1;
        if !(512..=65536).contains(&page_size) || !page_size.is_power_of_two() {
            return Err(self.broken("pages of no size"));
        }
        let newest = state(page_size as u64).filter(|second| second.0 > first.0 && second.1 == page_size);
        Ok((page_size, newest.unwrap_or(first).2))
    }

    /// Notes the keys below a page.
    fn walk(&mut self, root: u64) -> Result<(), DataError> {
        let file_length = self.file.metadata().map_err(DataError::io("look at", &self.path))?.len();
        let (mut seen, mut all) = (BTreeSet::new(), 0);
        let mut pages = vec![root];
        while let Some(number_of_page) = pages.pop() {
            if !seen.insert(number_of_page) {
                return Err(self.broken("a page that leads back to itself"));
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
                // Nodes that overlap would make much of little.
                within += 8 + key;
                if key > LONGEST_KEY || within > self.page_size {
                    return Err(broken());
                }
                let name = page.get(offset + 8..offset + 8 + key).ok_or_else(broken)?.to_vec();
                let length = low | high << 16;
                all += length;
                if length > LARGEST || all > file_length {
                    return Err(self.broken("values that are larger than the file"));
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
            if self.values.len() > MOST_KEYS {
                return Err(self.broken("more keys than any episode has"));
            }
        }
        Ok(())
    }

    /// Where a value begins that lies on pages of its own.
    fn overflow(&self, page: u64) -> Result<u64, DataError> {
        let at = self.place(page)?;
        let kind = number(&self.bytes(at, HEADER)?, 10, 2).unwrap_or(0) as u16;
        if kind & OVERFLOW == 0 { Err(self.broken("a damaged page")) } else { Ok(at + HEADER as u64) }
    }

    fn place(&self, page: u64) -> Result<u64, DataError> {
        page.checked_mul(self.page_size as u64).ok_or_else(|| self.broken("a page beyond its end"))
    }
}

/// A number of so many bytes, the least first.
fn number(bytes: &[u8], at: usize, length: usize) -> Option<u64> {
    let mut wide = [0; 8];
    wide[..length].copy_from_slice(bytes.get(at..at.checked_add(length)?)?);
    Some(u64::from_le_bytes(wide))
}
