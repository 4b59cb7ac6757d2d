//! Search for evaluations below a folder.

use std::path::{Path, PathBuf};

use crate::EvaluationReport;
use genmanip_core::limits;

use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Maximum depth of the search in folders; the evaluations of a run lie two levels below the folder of runs.
const DEPTH: usize = 4;

/// Reads the evaluations in a folder and in the `evaluation` folders below it, in the order of their paths, and passes
/// each to `take`, which returns the part that is needed.
///
/// Anything that is not an evaluation is skipped and reported.
///
/// # Errors
/// If the folder cannot be listed, or holds no evaluation.
pub fn evaluations_below<T>(
    folder: &Path,
    progress: &dyn Progress,
    take: impl Fn(EvaluationReport) -> T,
) -> Result<Vec<T>, WorkspaceError> {
    let mut files = Vec::new();
    // In a run, only its `evaluation` folder is searched, which also holds other files.
    list(folder, !folder.join("run.json").is_file(), DEPTH, &mut files)?;
    files.sort();
    let mut reports = Vec::new();
    for file in &files {
        match documents::read_document::<EvaluationReport>(file, limits::EVALUATION) {
            Ok(report) => reports.push(take(report)),
            Err(error) => progress.note(&format!("left out: {error}")),
        }
    }
    if reports.is_empty() {
        return Err(WorkspaceError::input(format!("there is no evaluation below {}", folder.display()))
            .with_hint("expected RUN/evaluation/*.json, as `genmanip evaluate` writes them"));
    }
    Ok(reports)
}

fn list(folder: &Path, is_meant: bool, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), WorkspaceError> {
    let entries = std::fs::read_dir(folder).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    for entry in entries.map_err(|error| WorkspaceError::file("list", folder, error))? {
        let (path, name) = (entry.path(), entry.file_name());
        let is_hidden = name.to_string_lossy().starts_with('.');
        // Symbolic links are not followed, so no folder is visited twice.
        let kind = entry.file_type().map_err(|error| WorkspaceError::file("list", &path, error))?;
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
