//! Asking a vision-language model: what is asked, what it may answer, and what is kept of it.
//!
//! A question goes out with pictures and the marks that were drawn on them; only an answer that names drawn marks in
//! the exact form is taken. Any other is sent back with what is wrong, a bounded number of times, and then the stage
//! fails: no mark is ever taken by default.

mod answer;
mod complaint;
mod model;
mod prompt;
mod question;
mod recorded;
mod stage;
mod transcript;

pub use answer::{
    Answer, CheckAnswer, DecomposeAnswer, GrabPointAnswer, MarkAnswer, PathAnswer, PathCell, PointAnswer, parse,
};
pub use complaint::{Complaint, Refused};
pub use model::{Answered, ChatService, ServiceError, VisionModel};
pub(crate) use prompt::Inputs;
pub use prompt::{PromptError, PromptSet};
pub use question::{Marks, Question, Shown};
pub use recorded::{Mismatch, RecordedAnswer, RecordedAnswers, Thumbnail, Tolerance};
pub use stage::{PromptStamp, Stage};
pub use transcript::{Exchange, FailedStage, Moment, Transcribed, Transcript};

/// An answer that fits the question, however often it takes to get one: `1 + reasks` times at most.
///
/// # Errors
/// What was wrong with the last answer; under the cause [`FailedStage::SERVICE`], why there was none.
pub fn ask(
    model: &dyn VisionModel,
    question: &mut Question,
    reasks: usize,
    transcribed: &Transcribed,
) -> Result<Answer, FailedStage> {
    let stage = question.stage.name();
    let failed = |cause: &str, evidence: String| FailedStage::new(stage, cause, evidence);
    let mut last = failed("format", String::new());
    for asked in 1..=reasks + 1 {
        question.ask = transcribed.next_ask();
        let (text, usage, complaint) = match model.answer(question) {
            Ok(Answered { text, usage }) => match parse(question, &text) {
                Ok(answer) => {
                    transcribed.exchange(question, &text, None, usage);
                    return Ok(answer);
                }
                Err(complaint) => (text, usage, complaint),
            },
            Err(ServiceError::Unreadable(what)) => (String::new(), None, Complaint::Format(what)),
            Err(error @ (ServiceError::Garbled(_) | ServiceError::Unreachable(_))) => {
                transcribed.exchange(question, "", Some(&error.to_string()), None);
                last = failed(FailedStage::SERVICE, error.to_string());
                if matches!(error, ServiceError::Unreachable(_)) {
                    return Err(last);
                }
                continue;
            }
        };
        transcribed.exchange(question, &text, Some(&complaint.to_string()), usage);
        last = failed(complaint.cause(), format!("{complaint} (asked {asked} times)"));
        question.refused.push(Refused { answer: shortened(&text), complaint });
    }
    Err(last)
}

/// Longest part of an answer that is kept and sent back, bytes.
const LONGEST_KEPT: usize = 2000;

/// The beginning of an answer.
pub(crate) fn shortened(text: &str) -> String {
    if text.len() <= LONGEST_KEPT {
        return text.to_owned();
    }
    let end = (0..=LONGEST_KEPT).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    format!("{} … ({} bytes in all)", &text[..end], text.len())
}
