//! Stored episodes of a scenario: those of the run that the scenario belongs to, and those that the studio ran.

use std::path::{Path, PathBuf};

use genmanip_core::names::is_file_name;
use genmanip_core::{Document, Ending, EpisodeResult, Failure, Scenario, hexadecimal};
use genmanip_data::EpisodeStore;
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::collections::{Collection, sorted_names};

/// Maximum number of episodes in a list.
const MAX_EPISODES: usize = 500;
/// Number of hexadecimal digits of a scenario's hash in the name of its run folder.
const DIGITS: usize = 12;

/// Location of a stored episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Folder of the store.
    pub store: PathBuf,
    /// Id of the episode.
    pub id: String,
}

/// A stored episode with its origin.
#[derive(Clone, Debug)]
pub struct KeptEpisode {
    /// Store and id of the episode.
    pub place: Place,
    /// Label of the evaluation that it belongs to; `None` for an attempt at a demonstration.
    pub label: Option<String>,
    /// Origin: `studio`, or the name of the run.
    pub source: String,
    /// Newest revision of the edited scenario with the same document as the episode's scenario; `None` if there is
    /// none.
    pub revision: Option<u64>,
}

/// Row of an episode in a list.
#[derive(Clone, Debug, Serialize)]
pub struct EpisodeRow {
    /// Key of the episode in URLs.
    pub episode: String,
    /// Label of the episode's policy.
    pub policy: String,
    /// Origin: `studio`, or the name of the run.
    pub source: String,
    /// Newest revision of the edited scenario with the same document as the episode's scenario; `None` if there is
    /// none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub revision: Option<u64>,
    /// True if the states of the episode were stored, so that it can be played back.
    pub recorded: bool,
    /// True if the policy read simulator ground truth.
    pub oracle: bool,
    /// True if the goal holds at the end.
    pub success: bool,
    /// Ending of the episode; `None` if it never began.
    pub ending: Option<Ending>,
    /// Most decisive cause of the failure, with the evidence of all causes; `None` after a success.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// Simulated duration, s.
    pub duration_s: f64,
    /// True if the transcript of an agent was stored.
    pub has_transcript: bool,
}

/// Name of a scenario's run folder; it depends on every byte of the scenario and on the version of this program.
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

/// Stored episodes of a scenario: those of the run that its file lies in, then those in `runs`, newest revision first.
///
/// `hashes` are the SHA-256 of the scenario's document at each revision.
pub fn kept_episodes(file: &Path, id: &str, hashes: &[String], runs: &Path) -> Vec<KeptEpisode> {
    let mut kept = of_own_run(file);
    let names = sorted_names(runs);
    for (revision, hash) in hashes.iter().enumerate().rev() {
        // An undo can restore an earlier document; its episodes then belong to the newer revision.
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

/// Key of the scenario and key of the episode that `ID` or `LABEL/ID` means among the runs of a collection: without the
/// label of an evaluation, an attempt at a demonstration comes first. `None` if there is no such episode.
pub fn find_episode(collection: &Collection, name: &str) -> Option<(String, String)> {
    let (label, id) = name.rsplit_once('/').map_or((None, name), |(label, id)| (Some(label), id));
    let is_meant = |kept: &KeptEpisode| kept.place.id == id && (label.is_none() || kept.label.as_deref() == label);
    collection.iter().filter(|listed| id.starts_with(&listed.summary.id)).find_map(|listed| {
        let kept = of_own_run(&listed.path).into_iter().find(is_meant)?;
        Some((listed.key.clone(), kept.place.key()))
    })
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

/// Episodes that the evaluations of a run stored.
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
    /// Key of the episode in URLs: a hash, which does not reveal folders.
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

    /// Folder with the transcript of an agent: the one that the episode's result names, else that of the studio's run;
    /// `None` without a transcript.
    pub fn transcript(&self, result: &EpisodeResult) -> Option<PathBuf> {
        let named = result.agent_failure.as_ref().and_then(|failure| failure.transcript.as_ref());
        let named = named.and_then(|path| Some(Path::new(path).parent()?.to_owned()));
        // The store is RUN/evaluation/LABEL/episodes, the transcript RUN/transcripts/LABEL/NUMBER/ID.
        let own = || {
            let label = self.place.store.parent()?;
            let number = self.place.id.rsplit_once('+').map_or("0", |(_, number)| number);
            let run = label.parent()?.parent()?;
            Some(run.join("transcripts").join(label.file_name()?).join(number).join(&result.scenario_id))
        };
        named.or_else(own).filter(|folder| folder.join(TRANSCRIPT).is_file())
    }

    /// A file of the transcript (its page or an image) with its media type; `None` if there is no such file.
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

/// File name of a transcript's page.
pub const TRANSCRIPT: &str = "transcript.html";
