//! Bounded, non-blocking reading of user-supplied text files.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use genmanip_core::limits::Limit;

/// Reads a regular UTF-8 file within a size limit.
///
/// # Errors
/// Describes the problem, without the path.
pub fn read_text(path: &Path, limit: Limit) -> Result<String, String> {
    let bytes = read(path, limit)?;
    String::from_utf8(bytes).map_err(|error| format!("expected text in UTF-8, got something else: {error}"))
}

/// Reads the bytes of a regular file within a size limit.
///
/// # Errors
/// As [`read_text`].
pub(crate) fn read(path: &Path, limit: Limit) -> Result<Vec<u8>, String> {
    let about = fs::metadata(path).map_err(|error| error.to_string())?;
    if !about.is_file() {
        return Err("expected a file, found a pipe, device or folder".into());
    }
    let too_large =
        |got: u64| format!("expected at most {} for {}, got {got} bytes", limit.human_readable(), limit.what);
    if about.len() > limit.bytes {
        return Err(too_large(about.len()));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| error.to_string())?;
    file.take(limit.bytes + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > limit.bytes { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_small_texts_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let limit = Limit { what: "a note", bytes: 1 << 10 };
        fs::write(at("note"), "hello").unwrap();
        fs::write(at("large"), vec![b' '; 1025]).unwrap();
        fs::write(at("latin"), b"caf\xe9").unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        assert_eq!(read_text(&at("note"), limit).unwrap(), "hello");
        for (name, expected) in [
            ("large", "expected at most 1 KiB for a note, got 1025 bytes"),
            ("latin", "expected text in UTF-8"),
            ("pipe", "found a pipe"),
            ("none", "No such file"),
        ] {
            let error = read_text(&at(name), limit).unwrap_err();
            assert!(error.contains(expected), "{name}: {error}");
        }
    }
}
