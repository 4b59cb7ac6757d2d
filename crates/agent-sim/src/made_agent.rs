//! Agent of one episode, with its transcript and the judgements of its answers.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{TranscriptEvent, TranscriptRecorder};
use genmanip_core::{
    ActionChunk, AgentFailure, AgentStage, Document, EpisodeStart, Frame, Observation, Policy, PolicyError, PolicySpec,
};
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

use super::failure::{EpisodeJudgements, classify};
use super::transcript_page::transcript_page;
use super::{GroundTruth, TurnSnapshots};

/// Agent of one episode with its records.
pub struct MadeAgent {
    policy: Box<dyn Policy>,
    /// Transcript of questions, answers and actions.
    pub transcribed: TranscriptRecorder,
    /// Ground truth that oracle services and annotator use; `None` without them.
    pub truth: Option<GroundTruth>,
    /// Judgements of the agent's answers; empty without ground truth.
    pub judgements: Arc<Mutex<EpisodeJudgements>>,
    /// Snapshots of the agent before each turn; `None` if they are not kept.
    pub turns: Option<TurnSnapshots>,
    /// Folder to which the transcript is written after each turn; `None` for no transcript.
    folder: Option<PathBuf>,
    /// Number of images written so far.
    written: usize,
}

impl MadeAgent {
    pub(super) fn new(
        policy: impl Policy + 'static,
        transcribed: TranscriptRecorder,
        truth: Option<GroundTruth>,
        judgements: Arc<Mutex<EpisodeJudgements>>,
    ) -> Self {
        let policy = Box::new(policy);
        Self { policy, transcribed, truth, judgements, turns: None, folder: None, written: 0 }
    }

    pub(super) fn keeping(self, turns: Option<TurnSnapshots>) -> Self {
        Self { turns, ..self }
    }

    /// Writes the transcript and its images into `folder`, if given, after each turn.
    #[must_use]
    pub fn transcribing(self, folder: Option<PathBuf>) -> Self {
        Self { folder, ..self }
    }
}

impl Policy for MadeAgent {
    fn spec(&self) -> PolicySpec {
        self.policy.spec()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.written = 0;
        self.policy.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let chunk = self.policy.act(observation);
        if let Some(folder) = &self.folder {
            let kept = keep(&self.transcribed, self.written, folder);
            self.written = kept.map_err(|error| PolicyError::Broken(Arc::new(error)))?;
        }
        chunk
    }

    fn analyse(&self, frames: &[Frame]) -> Option<AgentFailure> {
        let transcript = self.transcribed.transcript();
        let analysis = match (&self.truth, transcript.failure) {
            (Some(_), failure) => {
                let judgements = self.judgements.lock().unwrap_or_else(PoisonError::into_inner);
                classify(&judgements, failure.as_ref(), frames)
            }
            (None, failure) => {
                let last = transcript.moments.iter().rev().find_map(|moment| match moment {
                    TranscriptEvent::Asked(exchange) => Some(AgentStage::from(exchange.stage)),
                    TranscriptEvent::Acted { .. } => None,
                });
                AgentFailure {
                    class: None,
                    stage: failure.as_ref().map(|failure| failure.stage).or(last).unwrap_or(AgentStage::Segmentation),
                    ask: None,
                    evidence: failure.map_or_else(String::new, |failure| failure.to_string()),
                    transcript: None,
                }
            }
        };
        if let Some(folder) = &self.folder {
            // If the disk is full, the page remains as after the last turn, without the analysis.
            let page = transcript_page(&self.transcribed.transcript(), Some(&analysis));
            let _ = documents::write_file(&folder.join(PAGE), page.as_bytes());
        }
        let transcript = self.folder.as_ref().map(|folder| folder.join(TRANSCRIPT).display().to_string());
        Some(AgentFailure { transcript, ..analysis })
    }
}

/// File names of a transcript and of its HTML page.
const TRANSCRIPT: &str = "transcript.json";
const PAGE: &str = "transcript.html";

/// Writes a transcript, its HTML page and its images from index `first` on into a folder; returns the total number of
/// images.
///
/// # Errors
/// A file that cannot be written, or an image that cannot be encoded.
pub fn keep(transcribed: &TranscriptRecorder, first: usize, folder: &Path) -> Result<usize, WorkspaceError> {
    let pictures = transcribed.pictures();
    for (name, picture) in pictures.iter().skip(first) {
        let path = folder.join(name);
        let png = picture.png().map_err(|error| WorkspaceError::file("write", &path, error))?;
        documents::write_file(&path, &png)?;
    }
    let transcript = transcribed.transcript();
    documents::write_file(&folder.join(TRANSCRIPT), transcript.to_json().as_bytes())?;
    documents::write_file(&folder.join(PAGE), transcript_page(&transcript, None).as_bytes())?;
    Ok(pictures.len())
}
