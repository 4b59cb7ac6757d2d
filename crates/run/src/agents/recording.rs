//! A model whose answers are recorded, one file per scenario, and given again to the same questions.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{Answered, Question, RecordedAnswer, RecordedAnswers, ServiceError, Tolerance, VisionModel};
use genmanip_core::{Document, limits};

use crate::error::RunError;
use crate::inputs;

/// Answers of one episode, before a model or without one.
///
/// What is recorded is answered from the file, at no cost; what is not is asked of the model and kept at once, so that
/// nothing that was paid for is lost. A question that differs from the recorded one has no answer: the episode is not
/// run, and the reason says what differs.
pub struct Recording {
    model: Option<Arc<dyn VisionModel>>,
    path: PathBuf,
    tolerance: Tolerance,
    kept: Mutex<RecordedAnswers>,
}

impl Recording {
    /// The answers of a scenario in a folder; `model` answers what is not recorded.
    ///
    /// # Errors
    /// A file that cannot be read, or is of another scenario.
    pub fn open(folder: &Path, scenario: &str, model: Option<Arc<dyn VisionModel>>) -> Result<Self, RunError> {
        let path = folder.join(format!("{scenario}.json"));
        let kept = match path.exists() {
            false => RecordedAnswers { scenario: scenario.into(), answers: Vec::new() },
            true => {
                let text = inputs::read_text(&path, limits::CASSETTE)?;
                RecordedAnswers::from_json(&text).map_err(|error| RunError::file("read", &path, error))?
            }
        };
        if kept.scenario != scenario {
            let found = &kept.scenario;
            return Err(RunError::input(format!("{} holds answers of scenario {found}", path.display()))
                .with_hint(format!("expected those of {scenario}")));
        }
        Ok(Self { model, path, tolerance: Tolerance::default(), kept: Mutex::new(kept) })
    }
}

impl VisionModel for Recording {
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError> {
        let recorded = {
            let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            let is_known = kept.answers.iter().any(|answer| answer.ask == question.ask);
            (is_known || self.model.is_none()).then(|| kept.answer(question, &self.tolerance))
        };
        let unanswered = |message: String| ServiceError::Unreachable(format!("{}: {message}", self.path.display()));
        let model = match (recorded, &self.model) {
            (Some(Ok(answered)), _) => return Ok(answered),
            (Some(Err(mismatch)), _) => return Err(unanswered(mismatch.to_string())),
            (None, Some(model)) => model,
            (None, None) => return Err(unanswered("nobody answers".into())),
        };
        let answered = model.answer(question)?;
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.answers.push(RecordedAnswer::new(question, &answered));
        inputs::write_file(&self.path, kept.to_json().as_bytes()).map_err(|error| unanswered(error.to_string()))?;
        Ok(answered)
    }
}
