//! Report as a folder: an overview, and one page with diagrams and film strip per episode; existing pages are reused.
//!
//! ```text
//! report/index.html                overview, whose table links every page
//! report/episodes/ID.html          an attempt at a demonstration
//! report/evaluation/LABEL/ID.html  an evaluated episode whose frames were stored
//! report/pictures/KEY.jpg          film strips, named by a hash of their content
//! report/made.jsonl                key of every existing page
//! ```
//!
//! The key of a page is a hash of everything that it shows. A page whose key is in the list is not made again, so an
//! interrupted call continues, and ten further episodes need only ten further pages.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use genmanip_benchmark::report::{EpisodePage, episode_page};
use genmanip_benchmark::{EpisodeRow, ReportSettings, report_html};
use genmanip_core::hexadecimal;
use genmanip_data::files;
use genmanip_rollout::collect::in_parallel;
use sha2::{Digest, Sha256};

use super::Opened;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::documents::sweep;
use genmanip_workspace::resume_ledger::{Entry, Ledger};

/// Result of [`report_full`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FullReport {
    /// Path of the overview.
    pub index: PathBuf,
    /// Number of episode pages.
    pub pages: usize,
    /// Number of these pages that this call made.
    pub made: usize,
}

/// Version of the page layout; to be changed when pages change.
const LOOKS: &str = "full-report-1";

/// Name of the file that lists the pages.
const LIST: &str = "made.jsonl";

/// Writes the report of a run as a folder; keeps up-to-date pages and images.
///
/// # Errors
/// When there is no run, an episode cannot be read or rendered, or a file cannot be written.
pub fn report_full(
    run: &Path,
    out: &Path,
    settings: &ReportSettings,
    workers: usize,
    progress: &dyn Progress,
) -> Result<FullReport, WorkspaceError> {
    let opened = Opened::new(run, progress)?;
    let rows: Vec<&EpisodeRow> = opened.rows.episodes.iter().filter(|row| row.page().is_some()).collect();
    let keys = keys(&opened, &rows, workers)?;
    sweep(out)?;
    let ledger = Ledger::open(&out.join(LIST))?;
    let pages: Vec<(&EpisodeRow, String, &String)> =
        rows.iter().zip(&keys).filter_map(|(row, key)| Some((*row, row.page()?, key))).collect();
    let left: Vec<_> = pages
        .iter()
        .filter(|(_, page, key)| {
            let is_known = ledger.known(page).is_some_and(|entry| entry.key == **key);
            !(is_known && files::is_file_no_follow(&out.join(page)))
        })
        .collect();
    let damaged = AtomicUsize::new(0);
    progress.begin("drawing", left.len());
    in_parallel(&left, workers, &AtomicBool::new(false), &|(row, page, key)| {
        let is_damaged = draw(&opened, out, row, page, key)?;
        damaged.fetch_add(usize::from(is_damaged), Ordering::Relaxed);
        ledger.add(&entry(page, key))?;
        progress.advance();
        Ok::<_, WorkspaceError>(())
    })?;
    progress.end();
    if damaged.load(Ordering::Relaxed) > 0 {
        progress.note(&format!("{} damaged episodes have pages that say so", damaged.load(Ordering::Relaxed)));
    }
    remove_strangers(out, &pages)?;
    ledger.close(pages.iter().map(|(_, page, key)| entry(page, key)).collect(), |_| false)?;
    let (count, made) = (pages.len(), left.len());
    let input = opened.into_input(Vec::new(), true);
    let html =
        report_html(&input, settings).map_err(|error| WorkspaceError::broken("cannot make the report", error))?;
    let index = out.join("index.html");
    documents::write_file(&index, html.as_bytes())?;
    Ok(FullReport { index, pages: count, made })
}

/// Key of each episode's page: a hash of the episode's record, which contains the hashes of its files, and of the data
/// that
/// the run adds.
fn keys(opened: &Opened, rows: &[&EpisodeRow], workers: usize) -> Result<Vec<String>, WorkspaceError> {
    in_parallel(rows, workers, &AtomicBool::new(false), &|row| {
        let mut hasher = Sha256::new();
        let drawing = opened.drawing();
        if let Some(store) = drawing.store_of(row)? {
            match store.record_hash(&row.id) {
                Ok(hash) => hasher.update(hash),
                Err(error) => hasher.update(error.to_string()),
            }
        }
        let task = serde_json::to_string(&opened.run.tasks.read(row.task)?).unwrap_or_default();
        let about = (LOOKS, env!("CARGO_PKG_VERSION"), &row.evaluation, row.wall_s.map(f64::to_bits), task);
        hasher.update(format!("{about:?}"));
        Ok(hexadecimal(&hasher.finalize()[..16]))
    })
}

/// Writes one page and its film strip; true if the episode is damaged.
fn draw(opened: &Opened, out: &Path, row: &EpisodeRow, page: &str, key: &str) -> Result<bool, WorkspaceError> {
    let picture = format!("pictures/{key}.jpg");
    let alone = opened.drawing().alone(row, &mut |jpeg| {
        // The name is a hash of the content, so an existing file is up to date.
        if files::is_file_no_follow(&out.join(&picture)) {
            return Ok(());
        }
        documents::write_file(&out.join(&picture), &jpeg()?)
    })?;
    let up = "../".repeat(page.matches('/').count());
    let html = episode_page(&EpisodePage {
        section: &alone.section,
        strip: alone.has_strip.then(|| format!("{up}{picture}")),
        damaged: alone.damaged.as_deref(),
        id: &row.id,
        index: &format!("{up}index.html"),
    });
    documents::write_file(&out.join(page), html.as_bytes())?;
    Ok(alone.damaged.is_some())
}

fn entry(page: &str, key: &str) -> Entry {
    Entry { name: page.into(), key: key.into(), refused: None }
}

/// Removes pages and images of episodes that no longer exist or have changed.
fn remove_strangers(out: &Path, pages: &[(&EpisodeRow, String, &String)]) -> Result<(), WorkspaceError> {
    let mut own: BTreeSet<PathBuf> = pages.iter().map(|(_, page, _)| out.join(page)).collect();
    own.extend(pages.iter().map(|(_, _, key)| out.join(format!("pictures/{key}.jpg"))));
    let labels =
        fs::read_dir(out.join("evaluation")).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    for folder in
        labels.chain([out.join("episodes"), out.join("pictures")]).filter(|path| files::is_folder_no_follow(path))
    {
        let listed = fs::read_dir(&folder).map_err(|error| WorkspaceError::file("list", &folder, error))?;
        for path in listed.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| !own.contains(path)) {
            let is_ours = path.extension().is_some_and(|ending| ending == "html" || ending == "jpg");
            if is_ours && files::is_file_no_follow(&path) {
                fs::remove_file(&path).map_err(|error| WorkspaceError::file("remove", &path, error))?;
            }
        }
        files::sweep(&folder).map_err(|error| WorkspaceError::of_file("write", &folder, error))?;
    }
    Ok(())
}
