//! Transcript of an episode: questions, images, answers and robot actions.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_core::{Document, FailedStage};
use genmanip_llm::Usage;
use serde::{Deserialize, Serialize};

use super::answer::Answer;
use super::chosen;
use super::question::Question;
use super::question_kind::{PromptStamp, QuestionKind};
use crate::image::RgbImage;

/// First words of the description of a pick, by which picks are counted.
pub(crate) const TAKES: &str = "takes ";

/// Transcript of one episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transcript {
    /// Instruction of the whole task.
    pub instruction: String,
    /// Name of the settings' preset: `paper` or `full`.
    pub preset: String,
    /// Events in chronological order.
    pub moments: Vec<TranscriptEvent>,
    /// Failure that ended the episode; `None` if there was none.
    pub failure: Option<FailedStage>,
}

impl Document for Transcript {
    const SCHEMA: &'static str = "genmanip.agent_transcript/1";
}

impl Transcript {
    /// Number of picks that the arm carried out.
    pub fn picks(&self) -> usize {
        let is_pick = |moment: &&TranscriptEvent| matches!(moment, TranscriptEvent::Acted { what, .. } if what.starts_with(TAKES));
        self.moments.iter().filter(is_pick).count()
    }

    /// Description of the last robot action; `None` before the first one.
    pub fn last_act(&self) -> Option<String> {
        self.moments.iter().rev().find_map(|moment| match moment {
            TranscriptEvent::Acted { what, .. } => Some(what.clone()),
            TranscriptEvent::Asked(_) => None,
        })
    }
}

/// An event of the episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TranscriptEvent {
    /// A question and its answer, or the failure to answer.
    Asked(Exchange),
    /// A robot action, or a failure to plan one.
    Acted {
        /// Time since the start of the episode (s).
        time_s: f64,
        /// Description of the action, or of the failure to plan it.
        what: String,
    },
}

/// A question and its answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exchange {
    /// Index of the ask in the episode, from 0.
    pub ask: usize,
    /// Kind of question.
    pub stage: QuestionKind,
    /// Identity of the prompt.
    pub prompt: PromptStamp,
    /// Instruction in the question: the whole task, or the sub-task.
    pub instruction: String,
    /// File names of the images sent.
    pub pictures: Vec<String>,
    /// File name of the image that shows the chosen mark and the place that it refers to; `None` for answers in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen: Option<String>,
    /// Text of the answer, truncated.
    pub answer: String,
    /// Reason for rejecting the answer; `None` if it was accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Token usage, if the service reports it; `None` otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
}

/// Recorder of a transcript, shared between the agent and its caller.
#[derive(Clone, Debug, Default)]
pub struct TranscriptRecorder(Arc<Mutex<Kept>>);

#[derive(Clone, Debug, Default)]
struct Kept {
    transcript: Transcript,
    pictures: Vec<(String, Arc<RgbImage>)>,
    asks: usize,
    keeps_pictures: bool,
}

impl TranscriptRecorder {
    /// Creates a recorder that keeps the images themselves (`true`) or only their names.
    pub fn new(keeps_pictures: bool) -> Self {
        Self(Arc::new(Mutex::new(Kept { keeps_pictures, ..Kept::default() })))
    }

    /// The transcript so far.
    pub fn transcript(&self) -> Transcript {
        self.lock().transcript.clone()
    }

    /// The images so far, by file name.
    pub fn pictures(&self) -> Vec<(String, Arc<RgbImage>)> {
        self.lock().pictures.clone()
    }

    /// Independent copy with the events so far.
    pub(crate) fn copied(&self) -> Self {
        Self(Arc::new(Mutex::new(self.lock().clone())))
    }

    /// Number of questions asked so far, retries included; also the index of the next one.
    pub fn asks(&self) -> usize {
        self.lock().asks
    }

    /// Starts the transcript of a new episode.
    pub(crate) fn begin(&self, instruction: &str, preset: &str) {
        let mut kept = self.lock();
        let transcript = Transcript { instruction: instruction.into(), preset: preset.into(), ..Transcript::default() };
        *kept = Kept { transcript, keeps_pictures: kept.keeps_pictures, ..Kept::default() };
    }

    pub(crate) fn next_ask(&self) -> usize {
        let mut kept = self.lock();
        kept.asks += 1;
        kept.asks - 1
    }

    pub(crate) fn acted(&self, time_s: f64, what: String) {
        self.lock().transcript.moments.push(TranscriptEvent::Acted { time_s, what });
    }

    pub(crate) fn failed(&self, failure: &FailedStage) {
        self.lock().transcript.failure = Some(failure.clone());
    }

    /// Adds a question with its valid answer, and the image of the answer.
    pub(crate) fn answered(&self, question: &Question, answer: &Answer, text: &str, usage: Option<Usage>) {
        let keeps = self.lock().keeps_pictures;
        let picture = keeps.then(|| chosen::picture(question, answer)).flatten();
        let chosen = picture.map(|picture| (chosen::CHOSEN, Arc::new(picture)));
        self.exchange(question, text, chosen, None, usage);
    }

    /// Adds a question with an answer that was rejected.
    pub(crate) fn refused(&self, question: &Question, text: &str, reason: &str, usage: Option<Usage>) {
        self.exchange(question, text, None, Some(reason), usage);
    }

    fn exchange(
        &self,
        question: &Question,
        answer: &str,
        chosen: Option<(&'static str, Arc<RgbImage>)>,
        refused: Option<&str>,
        usage: Option<Usage>,
    ) {
        let mut kept = self.lock();
        let mut name_of = |name: &str, picture: &Arc<RgbImage>| {
            let name = format!("{:03}_{}_{name}.png", question.ask, question.stage.name());
            if kept.keeps_pictures {
                kept.pictures.push((name.clone(), Arc::clone(picture)));
            }
            name
        };
        let pictures = question.pictures.iter().map(|shown| name_of(shown.name, &shown.picture)).collect();
        let chosen = chosen.map(|(name, picture)| name_of(name, &picture));
        kept.transcript.moments.push(TranscriptEvent::Asked(Exchange {
            ask: question.ask,
            stage: question.stage,
            prompt: question.prompt.clone(),
            instruction: question.instruction.clone(),
            pictures,
            chosen,
            answer: super::shortened::shortened(answer),
            refused: refused.map(Into::into),
            usage,
        }));
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
