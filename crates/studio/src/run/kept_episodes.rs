//! Episodes that were kept of a scenario: in the run that it belongs to, and those that the studio ran.

use std::path::{Path, PathBuf};

use genmanip_core::names::is_file_name;
use genmanip_core::{Document, Ending, EpisodeResult, Failure, Scenario, hexadecimal};
use genmanip_data::EpisodeStore;
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::collections::sorted_names;

/// Most episodes of a list.
const MAX_EPISODES: usize = 500;
/// Hexadecimal digits of a scenario's hash in the name of its run folder.
const DIGITS: usize = 12;

/// Store and id of an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Folder of the store.
    pub store: PathBuf,
    /// Id of the episode.
    pub id: String,
}

/// An episode with where it comes from.
#[derive(Clone, Debug)]
pub struct KeptEpisode {
    /// Store and id.
    pub place: Place,
    /// Label of its policy's evaluation; `None` for one that was collected.
    pub label: Option<String>,
    /// Collection: `studio`, or the name of the run.
    pub source: String,
    /// Newest revision of the scenario that is the one of the episode.
    pub revision: Option<u64>,
}

/// An episode in a list.
#[derive(Clone, Debug, Serialize)]
pub struct EpisodeRow {
    /// Key in addresses.
    pub episode: String,
    /// Label of its policy.
    pub policy: String,
    /// Collection that it belongs to.
    pub source: String,
    /// Newest revision of the scenario that is the one of the episode; absent if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub revision: Option<u64>,
    /// True if its states were stored, so that it can be played back.
    pub recorded: bool,
    /// True if the policy read simulator ground truth.
    pub oracle: bool,
    /// True if the goal holds at the end.
    pub success: bool,
    /// Outcome; null if it never began.
    pub ending: Option<Ending>,
    /// Most decisive cause of the failure, with the evidence of all; absent on success.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Simulated duration, s.
    pub duration_s: f64,
    /// True if questions and answers of an agent were kept.
    pub has_transcript: bool,
}

/// Name of the run folder of a scenario: it changes with every byte of it, and with the version of the program.
pub fn run_folder_name(scenario: &Scenario) -> String {
    format!("{}{}", prefix(&scenario.id, &hash(scenario)), env!("CARGO_PKG_VERSION"))
}

fn prefix(id: &str, hash: &str) -> String {
    format!("{id}-{}-", &hash[..DIGITS.min(hash.len())])
}

/// SHA-256 of a scenario's document.
fn hash(scenario: &Scenario) -> String {
    hexadecimal(&Sha256::digest(scenario.to_json().as_bytes()))
}

/// Episodes of a scenario: those of the run that its file lies in, then those in `runs`, the newest revision first.
///
/// `hashes` are the SHA-256 of the scenario's document at each revision.
pub fn kept_episodes(file: &Path, id: &str, hashes: &[String], runs: &Path) -> Vec<KeptEpisode> {
    let mut kept = of_own_run(file);
    let names = sorted_names(runs);
    for (revision, hash) in hashes.iter().enumerate().rev() {
        // An undone change has brought an earlier document back.
        if hashes[revision + 1..].contains(hash) {
            continue;
        }
        let prefix = prefix(id, hash);
        for name in names.iter().filter(|name| name.starts_with(&prefix)) {
            kept.extend(of_evaluations(&runs.join(name), "studio", Some(revision as u64), &|_| true));
        }
    }
    kept.truncate(MAX_EPISODES);
    kept
}

/// Episodes of the run that a scenario's file belongs to: `RUN/episodes/ID/scenario.json` or `RUN/scenarios/ID.json`.
fn of_own_run(file: &Path) -> Vec<KeptEpisode> {
    let Some(file) = std::path::absolute(file).ok() else { return Vec::new() };
    let Some(folder) = file.parent() else { return Vec::new() };
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let owner = folder.parent();
    let is_recorded = name(&file) == "scenario.json" && owner.is_some_and(|store| store.join("store.json").is_file());
    let (run, id) = match owner {
        Some(store) if is_recorded => (store.parent(), name(folder)),
        Some(run) if name(folder) == "scenarios" => (Some(run), name(&file.with_extension(""))),
        _ => return Vec::new(),
    };
    let run = run.filter(|run| run.join("run.json").is_file());
    let source = run.map_or_else(|| "episodes".into(), |run| format!("run {}", name(run)));
    let mut kept = Vec::new();
    if let (true, Some(store)) = (is_recorded, owner) {
        let place = Place { store: store.to_owned(), id: id.clone() };
        kept.push(KeptEpisode { place, label: None, source: source.clone(), revision: Some(0) });
    }
    let is_meant = |other: &str| {
        other.strip_prefix(&id).is_some_and(|rest| {
            rest.is_empty() || rest.strip_prefix('+').is_some_and(|number| number.parse::<usize>().is_ok())
        })
    };
    kept.extend(run.into_iter().flat_map(|run| of_evaluations(run, &source, Some(0), &is_meant)));
    kept
}

/// Episodes that the evaluations of a run kept.
fn of_evaluations(
    run: &Path,
    source: &str,
    revision: Option<u64>,
    is_meant: &dyn Fn(&str) -> bool,
) -> Vec<KeptEpisode> {
    let folder = run.join("evaluation");
    let mut kept = Vec::new();
    for label in sorted_names(&folder) {
        let root = folder.join(&label).join("episodes");
        let Ok(ids) = EpisodeStore::open(&root).and_then(|store| store.ids()) else { continue };
        kept.extend(ids.into_iter().filter(|id| is_meant(id)).map(|id| KeptEpisode {
            place: Place { store: root.clone(), id },
            label: Some(label.clone()),
            source: source.to_owned(),
            revision,
        }));
    }
    kept
}

impl Place {
    /// Key of the episode in addresses: a hash that tells nothing about folders.
    pub fn key(&self) -> String {
        let text = format!("{}\n{}", self.store.display(), self.id);
        hexadecimal(&Sha256::digest(text.as_bytes())[..8])
    }
}

impl KeptEpisode {
    /// The episode as a row of a list; `None` if it is damaged.
    pub fn row(&self) -> Option<EpisodeRow> {
        let store = EpisodeStore::open(&self.place.store).ok()?;
        let (result, recorded) = store.read_attempt(&self.place.id).ok()?;
        let has_transcript = self.transcript(&result).is_some();
        Some(EpisodeRow {
            episode: self.place.key(),
            policy: self.label.clone().unwrap_or_else(|| result.policy.clone()),
            source: self.source.clone(),
            revision: self.revision,
            recorded,
            oracle: result.oracle,
            success: result.success,
            ending: result.ending,
            failure: result.failure(),
            duration_s: result.duration_s,
            has_transcript,
        })
    }

    /// Folder with the transcript of an agent: the one that its result names, or that of the studio.
    pub fn transcript(&self, result: &EpisodeResult) -> Option<PathBuf> {
        let named = result.agent_failure.as_ref().and_then(|failure| failure.transcript.as_ref());
        let named = named.and_then(|path| Some(Path::new(path).parent()?.to_owned()));
        // RUN/evaluation/LABEL/episodes, RUN/transcripts/LABEL/NUMBER/ID
        let own = || {
            let label = self.place.store.parent()?;
            let number = self.place.id.rsplit_once('+').map_or("0", |(_, number)| number);
            let run = label.parent()?.parent()?;
            Some(run.join("transcripts").join(label.file_name()?).join(number).join(&result.scenario_id))
        };
        named.or_else(own).filter(|folder| folder.join(TRANSCRIPT).is_file())
    }

    /// A file of the transcript with its media type: its page, or one of its images.
    pub fn transcript_file(&self, name: &str) -> Option<(Vec<u8>, &'static str)> {
        let result = EpisodeStore::open(&self.place.store).ok()?.read_result(&self.place.id).ok()?;
        let path = self.transcript(&result)?.join(name);
        let kind = match path.extension()?.to_str()? {
            "png" => "image/png",
            _ if name == TRANSCRIPT => "text/html; charset=utf-8",
            _ => return None,
        };
        if !is_file_name(name) {
            return None;
        }
        Some((genmanip_data::files::read_no_follow(&path, genmanip_core::limits::ATTACHMENT).ok()?, kind))
    }
}

/// Page of a transcript.
pub const TRANSCRIPT: &str = "transcript.html";
