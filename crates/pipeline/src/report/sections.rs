//! Second pass over a run: diagrams and images of the selected cases.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_benchmark::rows::cases::Case;
use genmanip_benchmark::{AttemptRow, EpisodeImage, EpisodeRow, EvaluationReport, TaskSection};
use genmanip_core::{AttemptOutcome, Episode, EpisodeResult, Failure, FailureCause};
use genmanip_data::EpisodeStore;
use genmanip_rollout::Stage;
use genmanip_viz::{graph_svg, layout_svg};

use super::rows::{Rows, kept_store, locate_transcript, results};
use crate::evaluate::Unfinished;
use crate::folder::{Run, RunFolder};
use genmanip_viz::scene_images;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::worlds;

/// Maximum number of images in a film strip on the page of a run.
const FILM_FRAMES: usize = 12;

/// Number of images in a film strip on the page of a single episode.
const STRIP_FRAMES: usize = 8;

/// Width of an image in a film strip, and of the first and the last image, pixels.
const FILM_WIDTH: u32 = 256;
const PICTURE_WIDTH: u32 = 512;

/// Data of a run needed to render cases.
pub(super) struct Drawing<'a> {
    pub folder: &'a RunFolder,
    pub store: &'a EpisodeStore,
    pub run: &'a Run,
    pub evaluations: &'a [EvaluationReport],
    pub unfinished: &'a [Unfinished],
    pub rows: &'a Rows,
}

impl Drawing<'_> {
    /// Section of a case. A damaged episode is omitted, with a message in `left_out`.
    ///
    /// # Errors
    /// When the case's episode cannot be read or rendered.
    pub fn section(&self, case: Case, left_out: &mut Vec<String>) -> Result<TaskSection, WorkspaceError> {
        let episode = case.episode;
        let own = self.rows.episodes.iter().filter(|row| row.task == case.task && row.is_attempt());
        let attempts = own.map(attempt).collect();
        let mut section = self.empty(case, attempts)?;
        let results = results(self.evaluations, self.unfinished).flat_map(|(_, results)| results);
        section.results = results.filter(|result| result.task_id == section.task.id).cloned().collect();
        if let Some(row) = episode.map(|index| &self.rows.episodes[index])
            && let Some(store) = self.store_of(row)?
        {
            match add_episode(&mut section, &store, row) {
                Err(Unshown::Damaged(why)) => {
                    left_out.push(format!("episode {} is damaged and not shown: {why}", row.id));
                    section.shown = None;
                }
                Err(Unshown::Broken(error)) => return Err(error),
                Ok(Some(episode)) => add_pictures(&mut section, &episode)?,
                Ok(None) => {}
            }
        }
        Ok(section)
    }

    /// A single episode. If its frames were stored, `keep` receives a function that renders its film strip, which it
    /// calls only if needed.
    ///
    /// # Errors
    /// When the episode cannot be read or rendered, or `keep` fails.
    pub fn alone(&self, row: &EpisodeRow, keep: &mut KeepStrip) -> Result<Alone, WorkspaceError> {
        let attempts = if row.is_attempt() { vec![attempt(row)] } else { Vec::new() };
        let mut alone = Alone {
            section: self.empty(Case { task: row.task, episode: None, why: None }, attempts)?,
            has_strip: false,
            damaged: None,
        };
        let Some(store) = self.store_of(row)? else { return Ok(alone) };
        match add_episode(&mut alone.section, &store, row) {
            Err(Unshown::Damaged(why)) => (alone.section.shown, alone.damaged) = (None, Some(why)),
            Err(Unshown::Broken(error)) => return Err(error),
            Ok(Some(episode)) => {
                keep(&|| scene_images::film_strip(&stage(&episode)?, &episode, STRIP_FRAMES))?;
                alone.has_strip = true;
            }
            Ok(None) => {}
        }
        Ok(alone)
    }

    fn empty(&self, case: Case, attempts: Vec<AttemptRow>) -> Result<TaskSection, WorkspaceError> {
        let task = self.run.tasks.read(case.task)?;
        Ok(TaskSection {
            why: case.why,
            episode: case.episode,
            scenario: None,
            graph: graph_svg(&task),
            task,
            layout: None,
            first_image: None,
            last_image: None,
            film: Vec::new(),
            shown: None,
            attempts,
            results: Vec::new(),
        })
    }

    /// Store that holds an episode; `None` if the episode was not stored.
    pub fn store_of(&self, row: &EpisodeRow) -> Result<Option<EpisodeStore>, WorkspaceError> {
        match &row.evaluation {
            None => Ok(Some(self.store.clone())),
            // A store that cannot be read was already reported when the rows were made.
            Some(label) => {
                let kept = kept_store(self.folder, label).ok().flatten();
                Ok(kept.filter(|store| store.contains(&row.id)))
            }
        }
    }
}

/// Callback that receives the function to render a film strip.
pub(super) type KeepStrip<'a> =
    dyn FnMut(&dyn Fn() -> Result<Vec<u8>, WorkspaceError>) -> Result<(), WorkspaceError> + 'a;

/// Section with a single episode, without the others of its task.
pub(super) struct Alone {
    pub section: TaskSection,
    /// True if the episode has a film strip.
    pub has_strip: bool,
    /// Description of the damage that prevents showing the episode; `None` if it is intact.
    pub damaged: Option<String>,
}

/// Reason why an episode is not shown.
enum Unshown {
    Damaged(String),
    Broken(WorkspaceError),
}

impl From<WorkspaceError> for Unshown {
    fn from(error: WorkspaceError) -> Self {
        Self::Broken(error)
    }
}

fn attempt(row: &EpisodeRow) -> AttemptRow {
    let outcome = &row.outcome;
    let failure =
        || Failure { cause: outcome.cause.unwrap_or(FailureCause::GoalMissed), evidence: outcome.evidence.clone() };
    AttemptRow {
        id: row.id.clone(),
        outcome: if outcome.success { AttemptOutcome::Verified } else { AttemptOutcome::Failed(failure()) },
        seconds: row.wall_s.unwrap_or(0.0),
    }
}

/// Adds an episode's verdict and layout to a section; returns the episode if its frames were stored.
fn add_episode(section: &mut TaskSection, store: &EpisodeStore, row: &EpisodeRow) -> Result<Option<Episode>, Unshown> {
    let unreadable = |error: genmanip_data::DataError| match error.is_damage() {
        true => Unshown::Damaged(error.to_string()),
        false => Unshown::Broken(
            WorkspaceError::broken("cannot read the episodes", error)
                .with_hint("collect again with --repair: what is damaged is set aside and made anew"),
        ),
    };
    let by_label = |mut result: EpisodeResult| {
        result.policy = row.evaluation.clone().unwrap_or(result.policy);
        result.agent_failure.as_mut().into_iter().for_each(locate_transcript);
        result
    };
    let episode = match row.recorded {
        true => Some(store.read(&row.id).map_err(unreadable)?),
        false => None,
    };
    section.scenario = match &episode {
        Some(episode) => Some(episode.scenario.clone()),
        None => store.read_scenario(&row.id).map_err(unreadable)?,
    };
    if let Some(scenario) = &section.scenario {
        section.layout = Some(layout_svg(&scene_images::top_view(scenario, Catalogue::builtin())?));
    }
    section.shown = Some(by_label(match &episode {
        Some(episode) => episode.result.clone(),
        None => store.read_result(&row.id).map_err(unreadable)?,
    }));
    Ok(episode)
}

fn stage(episode: &Episode) -> Result<Stage, WorkspaceError> {
    let robot = worlds::robot(&episode.scenario.world)?;
    Stage::open(Arc::new(episode.scenario.clone()), Catalogue::builtin(), &robot)
        .map_err(|error| scene_images::not_drawn(&episode.result.id, error))
}

fn add_pictures(section: &mut TaskSection, episode: &Episode) -> Result<(), WorkspaceError> {
    let stage = stage(episode)?;
    let mut painter = scene_images::painter(&stage)?;
    let mut ends = scene_images::stills(&mut painter, episode, 2, PICTURE_WIDTH)?;
    section.last_image = ends.pop();
    section.first_image = ends.pop();
    let strip = scene_images::stills(&mut painter, episode, FILM_FRAMES, FILM_WIDTH)?;
    let duration = episode.frames.last().map_or(0.0, |frame| frame.time_s);
    section.film = strip
        .into_iter()
        .enumerate()
        .map(|(index, jpeg)| EpisodeImage { time_s: duration * index as f64 / (FILM_FRAMES - 1) as f64, jpeg })
        .collect();
    Ok(())
}
