//! New scenario from one sentence: its noun phrases are resolved, a task is composed as by `task new --text`, and laid
//! out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_core::{AssetUid, ObjectCard, Seed};
use genmanip_layout::LayoutSettings;
use genmanip_pipeline::layouts::{LayoutOutput, lay_out};
use genmanip_tasks::designer::{DesignSettings, SentenceError, phrases_of_sentence};
use genmanip_workspace::designed_tasks::compose_into;
use genmanip_workspace::{NoProgress, WorkspaceError, task_files};
use serde::Serialize;

/// Maximum number of objects listed for a phrase.
const MAX_CANDIDATES: usize = 24;
/// Maximum length of a sentence, bytes.
const MAX_SENTENCE: usize = 400;
/// Folder of the composed tasks, below that of the scenarios.
const TASKS: &str = "tasks";
/// Maximum number of seeds tried until one gives an unused file name.
const MAX_SEEDS: u64 = 1000;
/// Maximum number of scenes tried if they cannot be laid out. Chosen by hand, since each takes seconds.
const MAX_REFUSED: usize = 3;

/// A noun phrase with the objects that it may mean.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhraseChoice {
    /// Words of the phrase.
    pub phrase: String,
    /// True if the candidates fit the phrase; false if no object does and they only share a word with it.
    pub is_known: bool,
    /// Objects of the catalogue, most likely first.
    pub candidates: Vec<Candidate>,
}

/// An object that a phrase may mean.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Candidate {
    /// Uid in the catalogue.
    pub uid: AssetUid,
    /// Name of the object for people.
    pub name: String,
}

/// Noun phrases of a sentence, each with the objects that it may mean.
///
/// # Errors
/// When the sentence cannot be parsed.
pub fn choices(sentence: &str) -> Result<Vec<PhraseChoice>, WorkspaceError> {
    let phrases = phrases_of_sentence(check(sentence)?, cards()).map_err(not_understood)?;
    let candidate = |card: &&ObjectCard| Candidate { uid: card.uid.clone(), name: card.name.clone() };
    let choice = phrases.iter().map(|own| {
        let is_known = !own.meant.is_empty();
        let candidates = if is_known { &own.meant } else { &own.alike };
        let candidates = candidates.iter().take(MAX_CANDIDATES).map(candidate).collect();
        PhraseChoice { phrase: own.phrase.clone(), is_known, candidates }
    });
    Ok(choice.collect())
}

/// Composes a task for a sentence and lays it out into a folder; returns the path of the scenario's file.
///
/// `chosen` gives the uid of the intended object by phrase; for other phrases, one of the fitting objects is drawn.
///
/// # Errors
/// When the sentence cannot be parsed, no layout is found, or a file cannot be written.
pub fn create(sentence: &str, chosen: &BTreeMap<String, AssetUid>, folder: &Path) -> Result<PathBuf, WorkspaceError> {
    let sentence = check(sentence)?;
    let phrases = phrases_of_sentence(sentence, cards()).map_err(not_understood)?;
    let is_chosen = |card: &ObjectCard| chosen.values().any(|uid| *uid == card.uid);
    let is_out = |card: &ObjectCard| {
        let mut asked = phrases.iter().filter(|own| chosen.contains_key(&own.phrase));
        !is_chosen(card) && asked.any(|own| own.meant.iter().any(|meant| meant.uid == card.uid))
    };
    let allowed: Vec<ObjectCard> = cards().iter().filter(|card| !is_out(card)).cloned().collect();
    let taken = || WorkspaceError::input(format!("{} has too many scenarios of this sentence", folder.display()));
    let mut refused = Vec::new();
    for seed in 0..MAX_SEEDS {
        let rows = compose_into(
            &folder.join(TASKS),
            sentence,
            1,
            &allowed,
            Seed::new(seed),
            &DesignSettings::default(),
            &NoProgress,
        );
        let file = match rows {
            Ok(rows) => rows.into_iter().next().and_then(|row| row.file),
            // The file name is taken by the same words with other objects: try the next seed.
            Err(WorkspaceError::Input { .. }) => continue,
            Err(error) => return Err(error),
        };
        let Some(file) = file else { continue };
        let task = task_files::read_task(Path::new(&file))?;
        let scenario = folder.join(format!("{}-000.json", task.id));
        if scenario.exists() {
            continue;
        }
        let output = LayoutOutput { folder: folder.to_owned(), explain: false };
        let (settings, never) = (LayoutSettings::default(), AtomicBool::new(false));
        let world = default_world();
        let rows =
            lay_out(&[task], 1, &world, &settings, Seed::new(seed), &output, 1, &NoProgress, &never, &mut |_| {})?;
        let Some(row) = rows.into_iter().next().filter(|row| row.scenario.is_none()) else { return Ok(scenario) };
        refused.push(row.refused.unwrap_or_default());
        if refused.len() == MAX_REFUSED {
            break;
        }
    }
    if let Some(why) = refused.pop() {
        return Err(WorkspaceError::input(format!("the scene cannot be laid out: {why}"))
            .with_hint("name other objects, or say it otherwise"));
    }
    Err(taken().with_hint("edit one of them, or name another --out"))
}

/// Objects that a sentence can name: those that the designer uses.
fn cards() -> &'static [ObjectCard] {
    Catalogue::builtin().cards()
}

fn check(sentence: &str) -> Result<&str, WorkspaceError> {
    let sentence = sentence.trim();
    let is_fit = (1..=MAX_SENTENCE).contains(&sentence.len()) && !sentence.chars().any(char::is_control);
    is_fit.then_some(sentence).ok_or_else(|| {
        WorkspaceError::input(format!("expected a sentence of at most {MAX_SENTENCE} bytes"))
            .with_hint("such as: put the red mug to the left of the bowl")
    })
}

fn not_understood(error: SentenceError) -> WorkspaceError {
    WorkspaceError::broken("there is no task for the sentence", error).with_hint(
        "say what to move and where, or what to open, close or turn: put the red mug to the left of the bowl",
    )
}
