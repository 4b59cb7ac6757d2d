//! Suites in folders: scenarios selected by rules, certified by the expert, and frozen.
//!
//! ```text
//! NAME/suite.json        record of the selection; hash and certificate of every scenario
//! NAME/scenarios/*.json  the scenarios
//! NAME/assets/*.json.gz  objects of the scenarios, after `freeze`
//! NAME/review.json       human reviews of the scenarios; not frozen
//! NAME/work/             layouts and trials of all candidates, from which an interrupted build resumes
//! ```

mod assets;
pub mod candidates;
mod check;
mod diff;
mod freeze;
pub mod frozen;
pub mod perturb;
mod pictures;
mod review;
mod training;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::distributions::is_of_distributions;
use crate::suite_format::{Marginal, Review, ReviewFile, SuiteFile, marginals};
use genmanip_core::{TaskKind, limits};
use genmanip_workspace::text_table;
use serde::Serialize;

pub use assets::SuiteAssets;
pub use check::{SuiteCheck, check, describe as describe_check};
pub use diff::{Difference, describe as describe_diff, diff};
pub use freeze::{freeze, freeze_images};
pub use perturb::Axis;
pub use review::{describe as describe_review, review, reviews};
pub use training::{Training, TrainingOptions, shared, training};

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Kinds of tasks in a suite: those of the benchmark in the paper.
pub const KINDS: [TaskKind; 4] =
    [TaskKind::Spatial, TaskKind::Appearance, TaskKind::CommonSense, TaskKind::LongHorizon];

/// Folder of a suite, from a path or a name.
///
/// A name is searched in `suites` of the current folder, in the folder `GENMANIP_SUITES`, in `../share/genmanip/suites`
/// relative to the program, and in the repository that the program was built from.
pub fn folder_of(name: &Path) -> PathBuf {
    let is_suite = |folder: &Path| folder.join("suite.json").is_file();
    if is_suite(name) || name.components().count() != 1 {
        return name.to_owned();
    }
    let installed = std::env::current_exe().ok().and_then(|program| {
        let program = program.canonicalize().ok()?;
        Some(program.parent()?.parent()?.join("share/genmanip/suites"))
    });
    let places = [
        Some(PathBuf::from("suites")),
        std::env::var_os("GENMANIP_SUITES").map(PathBuf::from),
        installed,
        Some(PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../suites"))),
    ];
    let found = places.into_iter().flatten().map(|place| place.join(name)).find(|folder| is_suite(folder));
    found.unwrap_or_else(|| name.to_owned())
}

/// [`folder_of`] as a value parser of a command line.
///
/// # Errors
/// Never: an invalid suite is detected when it is opened.
#[allow(clippy::unnecessary_wraps)] // the form of a value parser
pub fn parse_folder(text: &str) -> Result<PathBuf, String> {
    Ok(folder_of(Path::new(text)))
}

/// Reads `suite.json` of a suite's folder.
///
/// # Errors
/// If the file does not exist, or is damaged.
pub fn open(folder: &Path) -> Result<SuiteFile, WorkspaceError> {
    let path = folder.join("suite.json");
    if !path.is_file() {
        return Err(WorkspaceError::input(format!("there is no suite at {}", folder.display()))
            .with_hint("expected a folder with suite.json, as `genmanip suite build --out DIR` makes it"));
    }
    if is_of_distributions(folder) {
        let name = folder.file_name().unwrap_or_default().display();
        let what = format!("{name} is a suite of task distributions, not of frozen scenarios");
        return Err(WorkspaceError::input(what).with_hint(
            "`collect`, `evaluate` and `layout` take it with --split; `suite` shows, checks and freezes it",
        ));
    }
    documents::read_document(&path, limits::SUITE)
}

/// Path of a scenario's file in a suite's folder.
pub fn scenario_file(folder: &Path, id: &str) -> PathBuf {
    folder.join("scenarios").join(format!("{id}.json"))
}

/// Summary of a suite.
#[derive(Clone, Debug, Serialize)]
pub struct SuiteOverview {
    /// Content of `suite.json`.
    #[serde(flatten)]
    pub file: SuiteFile,
    /// Shares of the trait values among the scenarios.
    pub marginals: Vec<Marginal>,
    /// Human reviews of the scenarios.
    pub reviews: Vec<Review>,
}

/// Summary of a suite from its file.
///
/// # Errors
/// As [`open`].
pub fn show(folder: &Path) -> Result<SuiteOverview, WorkspaceError> {
    let file = open(folder)?;
    let marginals = marginals(file.scenarios.iter().map(|entry| &entry.traits));
    Ok(SuiteOverview { file, marginals, reviews: reviews(folder)?.reviews })
}

/// Text summary.
pub fn describe_suite(shown: &SuiteOverview) -> String {
    let file = &shown.file;
    let mut text = format!(
        "{} ({}): {} scenarios, seed {}, genmanip {}, {}\n\n",
        file.name,
        file.suite_hash,
        file.scenarios.len(),
        file.seed,
        file.genmanip_version,
        file.engine
    );
    if let Some(changed) = &file.perturbation {
        text.truncate(text.trim_end().len());
        text += &format!(
            "\n{} with another {}, dial {}, seed {}; the unchanged suite is {}\n\n",
            changed.of, changed.axis, changed.dial, changed.seed, changed.of_hash
        );
    }
    let kinds = KINDS.map(|kind| kind.name());
    let mut rows = vec![std::iter::once("candidates that passed").chain(kinds).map(String::from).collect::<Vec<_>>()];
    for stage in &file.funnel {
        let of = |kind: &&str| stage.passed.get(*kind).copied().unwrap_or(0).to_string();
        rows.push(std::iter::once(stage.asked.clone()).chain(kinds.iter().map(of)).collect());
    }
    text += &text_table(&rows);
    let refused = file.funnel.iter().flat_map(|stage| &stage.refused);
    let reasons: Vec<String> = refused.map(|(reason, count)| format!("  {count:5}  {reason}\n")).collect();
    if !reasons.is_empty() {
        text += &format!("\nrefused\n{}", reasons.concat());
    }
    let mut spread: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for marginal in &shown.marginals {
        let cell = format!("{} {:.0} %", marginal.value, 100.0 * marginal.share);
        spread.entry(&marginal.name).or_default().push(cell);
    }
    if !shown.reviews.is_empty() {
        text += &format!("\n{}", describe_review(&ReviewFile { reviews: shown.reviews.clone() }));
    }
    text += "\nspread\n";
    for (name, cells) in spread {
        text += &format!("  {name:10} {}\n", cells.join(", "));
    }
    text
}
