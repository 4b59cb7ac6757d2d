//! Recording and replay of a model's answers, one file per scenario.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{
    ModelReply, Question, RecordedAnswer, RecordedAnswers, ServiceError, Tolerance, VisionModel,
};
use genmanip_core::{Document, limits};

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Recorded answers of one episode, with or without a model for further questions.
///
/// Recorded questions are answered from the file at no cost. Other questions go to the model, and each answer is
/// written at once, so that no paid answer is lost. A question that differs from the recorded one is an error: the
/// episode is not run, and the reason states the difference.
pub struct Recording {
    model: Option<Arc<dyn VisionModel>>,
    path: PathBuf,
    tolerance: Tolerance,
    kept: Mutex<RecordedAnswers>,
}

impl Recording {
    /// Opens the recorded answers of a scenario in a folder; `model` answers questions that are not recorded.
    ///
    /// # Errors
    /// A file that cannot be read, or that belongs to another scenario.
    pub fn open(folder: &Path, scenario: &str, model: Option<Arc<dyn VisionModel>>) -> Result<Self, WorkspaceError> {
        let path = folder.join(format!("{scenario}.json"));
        let kept = match path.exists() {
            false => RecordedAnswers { scenario: scenario.into(), answers: Vec::new() },
            true => {
                let text = documents::read_text(&path, limits::CASSETTE)?;
                RecordedAnswers::from_json(&text).map_err(|error| WorkspaceError::file("read", &path, error))?
            }
        };
        if kept.scenario != scenario {
            let found = &kept.scenario;
            return Err(WorkspaceError::input(format!("{} holds answers of scenario {found}", path.display()))
                .with_hint(format!("expected those of {scenario}")));
        }
        Ok(Self { model, path, tolerance: Tolerance::default(), kept: Mutex::new(kept) })
    }
}

impl Recording {
    /// Recorded answer to a question, or the error of a differing question; `None` if the model has to answer it.
    fn recorded(&self, question: &Question) -> Option<Result<ModelReply, ServiceError>> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let is_known = kept.answers.iter().any(|answer| answer.ask == question.ask);
        let recorded = (is_known || self.model.is_none()).then(|| kept.answer(question, &self.tolerance))?;
        Some(recorded.map_err(|mismatch| self.unanswered(&mismatch)))
    }

    fn keep(&self, question: &Question, answered: &ModelReply) -> Result<(), ServiceError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.answers.push(RecordedAnswer::new(question, answered));
        documents::write_file(&self.path, kept.to_json().as_bytes()).map_err(|error| self.unanswered(&error))
    }

    fn unanswered(&self, why: &dyn std::fmt::Display) -> ServiceError {
        ServiceError::Unreachable(format!("{}: {why}", self.path.display()))
    }
}

impl VisionModel for Recording {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        self.answer_each(&[question]).remove(0)
    }

    fn answer_each(&self, questions: &[&Question]) -> Vec<Result<ModelReply, ServiceError>> {
        let recorded: Vec<_> = questions.iter().map(|question| self.recorded(question)).collect();
        let open = questions.iter().zip(&recorded).filter(|(_, recorded)| recorded.is_none());
        let open: Vec<&Question> = open.map(|(question, _)| *question).collect();
        let mut asked = match &self.model {
            Some(model) if !open.is_empty() => model.answer_each(&open),
            _ => Vec::new(),
        }
        .into_iter();
        let answer = |(question, recorded): (&&Question, Option<_>)| match recorded {
            Some(recorded) => recorded,
            None => {
                let answered = asked.next().unwrap_or_else(|| Err(self.unanswered(&"nobody answers")))?;
                self.keep(question, &answered)?;
                Ok(answered)
            }
        };
        questions.iter().zip(recorded).map(answer).collect()
    }
}
