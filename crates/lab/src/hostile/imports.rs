//! Objects to import: small valid files of every format, kept in `crates/import/testdata/sound`.
//!
//! One folder per kind. Every file in it may be mutated; the call imports one of those with the kind's extension.

use std::path::Path;

use rand::{Rng, RngExt};

use super::child::Ended;
use super::listing;
use crate::LabError;

/// Location of the files in the project.
const FOLDER: &str = "crates/import/testdata/sound";
/// Kinds of input, each with the extension of the files that are passed to `import`.
pub const FORMATS: [(&str, &str); 10] = [
    ("import-glb", ".glb"),
    ("import-gltf", ".gltf"),
    ("import-obj", ".obj"),
    ("import-stl", ".stl"),
    ("import-msh", ".msh"),
    ("import-urdf", ".urdf"),
    ("import-mjcf", ".xml"),
    ("import-usda", ".usda"),
    ("import-usdc", ".usdc"),
    ("import-usdz", ".usdz"),
];

/// File names and contents.
pub type NamedFiles = Vec<(String, Vec<u8>)>;

/// The valid files of one of [`FORMATS`].
///
/// # Errors
/// If the project has none.
pub fn valid(project: &Path, (kind, ending): (&str, &str)) -> Result<NamedFiles, LabError> {
    let folder = project.join(FOLDER).join(kind.trim_start_matches("import-"));
    let files: NamedFiles = listing(&folder).into_iter().collect();
    if files.iter().any(|(name, _)| name.ends_with(ending)) {
        return Ok(files);
    }
    Err(LabError::input(format!("there is no file that ends in {ending} in {}", folder.display()))
        .with_hint("run in the project's folder, or name it with --project"))
}

/// Valid files of all kinds.
pub(super) struct Imports {
    /// In the order of [`FORMATS`].
    files: Vec<NamedFiles>,
}

/// True if the kind is one of [`FORMATS`].
pub(super) fn is_kind(kind: &str) -> bool {
    FORMATS.iter().any(|(known, _)| *known == kind)
}

impl Imports {
    /// Reads the valid files.
    pub(super) fn read(project: &Path) -> Result<Self, LabError> {
        Ok(Self { files: FORMATS.iter().map(|format| valid(project, *format)).collect::<Result<_, _>>()? })
    }

    /// The files of a kind, and the call that imports one of them; `None` for other kinds.
    pub(super) fn case(&self, kind: &str, rng: &mut impl Rng) -> Option<(&NamedFiles, Vec<String>)> {
        let index = FORMATS.iter().position(|(known, _)| *known == kind)?;
        let files = &self.files[index];
        let described: Vec<&String> =
            files.iter().map(|(name, _)| name).filter(|name| name.ends_with(FORMATS[index].1)).collect();
        let chosen = described[rng.random_range(0..described.len())];
        let words = ["--json", "assets", "import", chosen, "--pack", "own", "--packs", "packs", "--no-grasps"];
        Some((files, words.map(String::from).to_vec()))
    }
}

/// Missing part of a refused object's row in the output: file name, description of the error, or hint; `None` if all
/// rows are complete or the output is no JSON array.
pub(super) fn lacks(ended: &Ended) -> Option<&'static str> {
    let Ok(serde_json::Value::Array(rows)) = serde_json::from_str(&ended.stdout) else { return None };
    let is_empty = |row: &serde_json::Value, key: &str| row[key].as_str().is_none_or(|text| text.trim().is_empty());
    rows.iter().filter(|row| !row["error"].is_null()).find_map(|row| {
        let keys = [("file", "no place"), ("error", "nothing that was found"), ("hint", "no hint")];
        keys.into_iter().find(|(key, _)| is_empty(row, key)).map(|(_, lack)| lack)
    })
}
