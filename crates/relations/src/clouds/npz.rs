//! Reads point clouds from NumPy archives (`.npz` with int16 arrays of shape n × 3), the format of the recorded cases.

use std::collections::BTreeMap;

/// Maximum total size of an archive's arrays, bytes: ten times the recorded cases. In memory the points take four times
/// as much, and twice that while reading.
const MAX_BYTES: usize = 64 << 20;

/// Longest part of an array header in an error message, characters.
const MAX_QUOTED: usize = 200;

/// Reason why an archive cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// Not a zip archive, or a damaged one.
    #[error("expected a zip archive, got a damaged one: {0}")]
    Archive(&'static str),
    /// The arrays are together larger than 64 MiB.
    #[error("expected arrays of at most {} MiB together, got more", MAX_BYTES >> 20)]
    TooLarge,
    /// A member is not an int16 array of points.
    #[error("expected `{name}` to be a little-endian int16 array of shape (n, 3), got {got}")]
    Array {
        /// Name of the array in the archive.
        name: String,
        /// Actual type or shape of the array.
        got: String,
    },
}

/// The arrays of an archive by name; metres = value / `scale`.
///
/// # Errors
/// If the bytes are not a zip archive, or an array is not int16 with three columns.
pub fn read_npz(bytes: &[u8], scale: f64) -> Result<BTreeMap<String, Vec<[f64; 3]>>, NpzError> {
    let mut arrays = BTreeMap::new();
    for (name, content) in members(bytes)? {
        let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
        let points = points(&content, scale).map_err(|got| NpzError::Array { name: name.clone(), got })?;
        arrays.insert(name, points);
    }
    Ok(arrays)
}

fn points(npy: &[u8], scale: f64) -> Result<Vec<[f64; 3]>, String> {
    let start = match npy {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, low, high, ..] => {
            10 + usize::from(u16::from_le_bytes([*low, *high]))
        }
        _ => return Err("no NumPy array of version 1".into()),
    };
    let header = npy.get(10..start).map(String::from_utf8_lossy).ok_or("a header cut short")?;
    let plain: String = header.chars().filter(|character| !character.is_whitespace()).collect();
    let known = plain.contains("'descr':'<i2'") && plain.contains("'fortran_order':False");
    let rows = plain.split_once("'shape':(").and_then(|(_, shape)| shape.split_once(",3)"));
    let Some(rows) = rows.and_then(|(rows, _)| rows.parse::<usize>().ok()).filter(|_| known) else {
        return Err(header.trim().chars().take(MAX_QUOTED).collect());
    };
    let held = npy.len() - start;
    if rows.checked_mul(6) != Some(held) {
        return Err(format!("{rows} points in {held} bytes"));
    }
    let values: Vec<f64> =
        npy[start..].chunks_exact(2).map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]])) / scale).collect();
    Ok(values.chunks_exact(3).map(|point| [point[0], point[1], point[2]]).collect())
}

/// Names and contents of the members, from the central directory.
fn members(bytes: &[u8]) -> Result<Vec<(String, Vec<u8>)>, NpzError> {
    let short = |at: usize| bytes.get(at..at + 2).map(|pair| usize::from(u16::from_le_bytes([pair[0], pair[1]])));
    let long = |at: usize| Some(short(at)? | short(at + 2)? << 16);
    let cut = || NpzError::Archive("cut short");
    let end = (0..bytes.len().saturating_sub(21))
        .rev()
        .take(1 << 16)
        .find(|&at| bytes[at..].starts_with(b"PK\x05\x06"))
        .ok_or(NpzError::Archive("no directory"))?;
    let count = short(end + 10).ok_or_else(cut)?;
    let mut entry = long(end + 16).ok_or_else(cut)?;
    let mut found = Vec::new();
    let mut left = MAX_BYTES;
    for _ in 0..count {
        if !bytes.get(entry..).is_some_and(|rest| rest.starts_with(b"PK\x01\x02")) {
            return Err(NpzError::Archive("a wrong directory"));
        }
        let read = || {
            let (method, packed, size) = (short(entry + 10)?, long(entry + 20)?, long(entry + 24)?);
            let (name_length, extra, comment) = (short(entry + 28)?, short(entry + 30)?, short(entry + 32)?);
            let name = bytes.get(entry + 46..entry + 46 + name_length)?;
            let local = long(entry + 42)?;
            let data = local + 30 + short(local + 26)? + short(local + 28)?;
            let content = bytes.get(data..data.checked_add(packed)?)?;
            Some((method, size, name, content, entry + 46 + name_length + extra + comment))
        };
        let (method, size, name, content, next) = read().ok_or_else(cut)?;
        // The declared size may be wrong, so the actual size is limited as well.
        if size > left || content.len() > left {
            return Err(NpzError::TooLarge);
        }
        let content = match method {
            0 => content.to_vec(),
            8 => miniz_oxide::inflate::decompress_to_vec_with_limit(content, size)
                .map_err(|_| NpzError::Archive("data that cannot be inflated to the size it names"))?,
            _ => return Err(NpzError::Archive("an unknown compression")),
        };
        left -= content.len();
        found.push((String::from_utf8_lossy(name).into_owned(), content));
        entry = next;
    }
    Ok(found)
}
