//! Labels of evaluations: short, equal on every machine, and usable as file names.

use std::path::Path;

use genmanip_core::hexadecimal;
use genmanip_core::limits::Limit;
use genmanip_workspace::documents;
use sha2::{Digest, Sha256};

/// Form in which an argument's value appears in a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InLabel {
    /// The value itself.
    Value,
    /// For a URL: the part after the scheme.
    Address,
    /// For a file or folder: its name and a hash of its content.
    Content,
    /// For a folder that is written during the evaluation: its name.
    Name,
    /// Omitted, since it does not change results.
    Omitted,
}

/// Maximum length of a label, bytes.
pub(crate) const MAX_LABEL: usize = 100;
/// Number of hexadecimal digits of a hash in a label.
const DIGITS: usize = 6;
/// Size limit of a file whose content is hashed.
const HASHED: Limit = Limit { what: "a settings file", bytes: 1 << 20 };

impl InLabel {
    /// Form of a value in a label; `None` if it is omitted.
    pub(super) fn of(self, value: &str) -> Option<String> {
        let path = Path::new(value);
        let name = || path.file_stem().map_or_else(|| value.to_owned(), |name| name.to_string_lossy().into_owned());
        match self {
            Self::Value => Some(value.into()),
            Self::Address => Some(value.rsplit("//").next().unwrap_or(value).into()),
            Self::Content if path.exists() => Some(format!("{}-{}", name(), hash(&content(path)))),
            Self::Content => Some(value.into()),
            Self::Name => Some(name()),
            Self::Omitted => None,
        }
    }
}

/// True if a character may occur in a label.
pub(crate) fn fits(c: char) -> bool {
    c.is_ascii_alphanumeric() || "-_.+=@".contains(c)
}

/// A text as a label: characters that do not fit become `_`, and the end of a long text is replaced by a hash.
pub(crate) fn label(text: &str) -> String {
    let label: String = text.chars().map(|c| if fits(c) { c } else { '_' }).collect();
    match label.len() <= MAX_LABEL {
        true => label,
        false => format!("{}-{}", &label[..MAX_LABEL - DIGITS - 1], hash(text.as_bytes())),
    }
}

/// Bytes to hash: the content of a file, or the names and sizes of the files in a folder.
fn content(path: &Path) -> Vec<u8> {
    if !path.is_dir() {
        return documents::read_bytes(path, HASHED).unwrap_or_default();
    }
    // A learned policy's description contains the hash of its weights, so that they need not be read.
    let description = path.join("policy.json");
    if description.is_file() {
        return content(&description);
    }
    let mut listed: Vec<String> = Vec::new();
    let mut open = vec![path.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            match entry.metadata() {
                Ok(about) if about.is_dir() => open.push(entry.path()),
                Ok(about) => {
                    let name = entry.path().strip_prefix(path).map(|name| name.display().to_string());
                    listed.push(format!("{} {}\n", name.unwrap_or_default(), about.len()));
                }
                Err(_) => {}
            }
        }
    }
    listed.sort_unstable();
    listed.concat().into_bytes()
}

fn hash(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))[..DIGITS].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_do_not_depend_on_where_files_are() {
        let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let file = |folder: &Path, text: &str| {
            let path = folder.join("gpt.toml");
            std::fs::write(&path, text).unwrap();
            InLabel::Content.of(path.to_str().unwrap()).unwrap()
        };
        let first = file(here.path(), "model = 1");
        assert!(first.starts_with("gpt-") && first.len() == "gpt-".len() + DIGITS, "{first}");
        assert_eq!(file(there.path(), "model = 1"), first);
        assert_ne!(file(there.path(), "model = 2"), first);
        let folder = |root: &Path, text: &str| {
            let folder = root.join("dataset");
            std::fs::create_dir_all(folder.join("meta")).unwrap();
            std::fs::write(folder.join("meta/info.json"), text).unwrap();
            InLabel::Content.of(folder.to_str().unwrap()).unwrap()
        };
        let first = folder(here.path(), "{}");
        assert!(first.starts_with("dataset-"), "{first}");
        assert_eq!(folder(there.path(), "{}"), first);
        assert_ne!(folder(there.path(), "{ }"), first);
        let cases = [
            (InLabel::Value, "oracle", Some("oracle")),
            (InLabel::Content, "oracle", Some("oracle")),
            (InLabel::Address, "ws://gpu:8000", Some("gpu:8000")),
            (InLabel::Address, "http:http://gpu:1", Some("gpu:1")),
            (InLabel::Address, "rgbd", Some("rgbd")),
            (InLabel::Name, "/somewhere/answers", Some("answers")),
            (InLabel::Omitted, "/somewhere/asked", None),
        ];
        for (form, value, expected) in cases {
            assert_eq!(form.of(value).as_deref(), expected, "{value}");
        }
    }

    #[test]
    fn long_labels_end_in_a_hash() {
        let [one, other] = ["a", "b"].map(|end| label(&format!("{}{end}", "x: ".repeat(50))));
        assert_eq!((one.len(), other.len()), (MAX_LABEL, MAX_LABEL));
        assert_ne!(one, other);
        assert!(one.chars().all(fits), "{one}");
    }
}
