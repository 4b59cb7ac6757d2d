//! What is kept of an episode: every question, every picture shown, every answer, and what the hand did.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_core::Document;
use genmanip_llm::Usage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::question::Question;
use super::stage::{PromptStamp, Stage};
use crate::picture::Picture;

/// Everything that was asked and done in one episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transcript {
    /// The task, in words.
    pub instruction: String,
    /// `paper` or `full`.
    pub preset: String,
    /// In the order of time.
    pub moments: Vec<Moment>,
    /// Why the agent gave up, if it did.
    pub failure: Option<FailedStage>,
}

impl Document for Transcript {
    const SCHEMA: &'static str = "genmanip.agent_transcript/1";
}

impl Transcript {
    /// What the hand did last, in words.
    pub fn last_act(&self) -> Option<String> {
        self.moments.iter().rev().find_map(|moment| match moment {
            Moment::Acted { what, .. } => Some(what.clone()),
            Moment::Asked(_) => None,
        })
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Moment {
    /// A question was answered, or was not.
    Asked(Exchange),
    /// The hand did something, or planned to and could not.
    Acted {
        /// Since the start of the episode, s.
        time_s: f64,
        /// What it was, in words.
        what: String,
    },
}

/// One question with its answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exchange {
    /// Number of the ask in the episode, from 0.
    pub ask: usize,
    /// What it was about.
    pub stage: Stage,
    /// Which prompt was used.
    pub prompt: PromptStamp,
    /// The instruction of the stage.
    pub instruction: String,
    /// Pictures that were shown, by the name of their file.
    pub pictures: Vec<String>,
    /// What was answered, its beginning where it was long.
    pub answer: String,
    /// Why it was not taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Tokens, where the service says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
}

/// A stage that failed, which ends the episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{stage} failed ({cause}): {evidence}")]
#[serde(deny_unknown_fields)]
pub struct FailedStage {
    /// The stage, e.g. `object`, `grasp` or `motion`.
    pub stage: String,
    /// The kind of failure, e.g. `not_found`.
    pub cause: String,
    /// What was seen.
    pub evidence: String,
}

impl FailedStage {
    /// The cause of a failure that is the service's: no answer came.
    pub const SERVICE: &str = "service";

    /// A failure.
    pub fn new(stage: &str, cause: &str, evidence: String) -> Self {
        Self { stage: stage.into(), cause: cause.into(), evidence }
    }
}

/// A transcript in the making, shared between the agent and whoever reads it afterwards.
#[derive(Clone, Debug, Default)]
pub struct Transcribed(Arc<Mutex<Kept>>);

#[derive(Clone, Debug, Default)]
struct Kept {
    transcript: Transcript,
    pictures: Vec<(String, Arc<Picture>)>,
    asks: usize,
    keeps_pictures: bool,
}

impl Transcribed {
    /// One that keeps the pictures that were shown, or only their names.
    pub fn new(keeps_pictures: bool) -> Self {
        Self(Arc::new(Mutex::new(Kept { keeps_pictures, ..Kept::default() })))
    }

    /// The transcript so far.
    pub fn transcript(&self) -> Transcript {
        self.lock().transcript.clone()
    }

    /// The pictures so far, with the names of their files.
    pub fn pictures(&self) -> Vec<(String, Arc<Picture>)> {
        self.lock().pictures.clone()
    }

    /// One of its own, with everything so far.
    pub(crate) fn copied(&self) -> Self {
        Self(Arc::new(Mutex::new(self.lock().clone())))
    }

    /// Questions asked so far, repeated ones included: the number of the next.
    pub fn asks(&self) -> usize {
        self.lock().asks
    }

    /// Begins afresh.
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
        self.lock().transcript.moments.push(Moment::Acted { time_s, what });
    }

    pub(crate) fn failed(&self, failure: &FailedStage) {
        self.lock().transcript.failure = Some(failure.clone());
    }

    pub(crate) fn exchange(&self, question: &Question, answer: &str, refused: Option<&str>, usage: Option<Usage>) {
        let mut kept = self.lock();
        let mut names = Vec::new();
        for shown in &question.pictures {
            let name = format!("{:03}_{}_{}.png", question.ask, question.stage.name(), shown.name);
            if kept.keeps_pictures {
                kept.pictures.push((name.clone(), Arc::clone(&shown.picture)));
            }
            names.push(name);
        }
        kept.transcript.moments.push(Moment::Asked(Exchange {
            ask: question.ask,
            stage: question.stage,
            prompt: question.prompt.clone(),
            instruction: question.instruction.clone(),
            pictures: names,
            answer: super::shortened(answer),
            refused: refused.map(Into::into),
            usage,
        }));
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
