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
pub use stage::{PromptStamp, Stage};
pub use transcript::{Exchange, FailedStage, Moment, Transcribed, Transcript};

/// An answer that fits the question, however often it takes to get one: `1 + reasks` times at most.
///
/// # Errors
/// What was wrong with the last answer, or why there was none.
pub fn ask(
    model: &dyn VisionModel,
    question: &mut Question,
    reasks: usize,
    transcribed: &Transcribed,
) -> Result<Answer, FailedStage> {
    let mut last = String::new();
    for _ in 0..=reasks {
        question.ask = transcribed.next_ask();
        let answered = match model.answer(question) {
            Ok(answered) => answered,
            Err(error) => {
                let failed = FailedStage::new(question.stage.name(), "service", error.to_string());
                transcribed.exchange(question, "", Some(&error.to_string()), None);
                return Err(failed);
            }
        };
        match parse(question, &answered.text) {
            Ok(answer) => {
                transcribed.exchange(question, &answered.text, None, answered.usage);
                return Ok(answer);
            }
            Err(complaint) => {
                transcribed.exchange(question, &answered.text, Some(&complaint.to_string()), answered.usage);
                last = complaint.to_string();
                question.refused.push(Refused { answer: shortened(&answered.text), complaint });
            }
        }
    }
    let cause = question.refused.last().map_or("format", |refused| refused.complaint.cause());
    Err(FailedStage::new(question.stage.name(), cause, format!("{last} (asked {} times)", reasks + 1)))
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
