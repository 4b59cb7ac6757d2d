//! All evaluations below a folder.

use std::path::{Path, PathBuf};

use crate::EvaluationReport;
use genmanip_core::limits;

use genmanip_workspace::Progress;
use genmanip_workspace::RunError;
use genmanip_workspace::documents;

/// Folders below the named one that are looked into; a run's evaluations lie two below the folder of runs.
const DEPTH: usize = 4;

/// Reads the evaluations in a folder and in the `evaluation` folders below it, in the order of their paths.
///
/// What lies there and is no evaluation is left out, and said.
///
/// # Errors
/// When the folder cannot be listed, or holds none.
pub fn evaluations_below(folder: &Path, progress: &dyn Progress) -> Result<Vec<EvaluationReport>, RunError> {
    let mut files = Vec::new();
    // Beside a run's folder of evaluations lie other files of its own.
    list(folder, !folder.join("run.json").is_file(), DEPTH, &mut files)?;
    files.sort();
    let mut reports = Vec::new();
    for file in &files {
        match documents::read_document::<EvaluationReport>(file, limits::EVALUATION) {
            // The table needs the summary alone.
            Ok(report) => reports.push(EvaluationReport { results: Vec::new(), ..report }),
            Err(error) => progress.note(&format!("left out: {error}")),
        }
    }
    if reports.is_empty() {
        return Err(RunError::input(format!("there is no evaluation below {}", folder.display()))
            .with_hint("expected RUN/evaluation/*.json, as `genmanip evaluate` writes them"));
    }
    Ok(reports)
}

fn list(folder: &Path, is_meant: bool, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), RunError> {
    let entries = std::fs::read_dir(folder).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    for entry in entries.map_err(|error| RunError::file("list", folder, error))? {
        let (path, name) = (entry.path(), entry.file_name());
        let is_hidden = name.to_string_lossy().starts_with('.');
        // Links are not followed, so no folder is met twice.
        let kind = entry.file_type().map_err(|error| RunError::file("list", &path, error))?;
        if is_hidden {
            continue;
        }
        if kind.is_dir() && depth > 0 {
            list(&path, name == "evaluation", depth - 1, files)?;
        } else if kind.is_file() && is_meant && path.extension().is_some_and(|extension| extension == "json") {
            files.push(path);
        }
    }
    Ok(())
}
