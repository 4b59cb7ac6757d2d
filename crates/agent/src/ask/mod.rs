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

/// How often a question is put again after an answer that does not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reasks {
    /// Times at most.
    pub most: usize,
    /// Whether also after the answer that no mark fits. It is taken at once where another view can be shown instead.
    pub not_found: bool,
}

/// An answer that fits the question, however often it takes to get one: `1 + reasks.most` times at most.
///
/// # Errors
/// What was wrong with the last answer; under the cause [`FailedStage::SERVICE`], why there was none.
pub fn ask(
    model: &dyn VisionModel,
    question: Question,
    reasks: Reasks,
    transcribed: &Transcribed,
) -> Result<Answer, FailedStage> {
    let [answer] = ask_each(model, [question], reasks, transcribed);
    answer
}

/// The same for questions that do not depend on each other: all are asked at once, then those again of which the answer
/// does not fit. Asks are numbered in the order of the questions.
pub fn ask_each<const COUNT: usize>(
    model: &dyn VisionModel,
    mut questions: [Question; COUNT],
    reasks: Reasks,
    transcribed: &Transcribed,
) -> [Result<Answer, FailedStage>; COUNT] {
    let mut answers =
        questions.each_ref().map(|question| Err(FailedStage::new(question.stage.name(), "format", String::new())));
    let mut open: Vec<usize> = (0..COUNT).collect();
    for asked in 1..=reasks.most + 1 {
        for &index in &open {
            questions[index].ask = transcribed.next_ask();
        }
        let asking: Vec<&Question> = open.iter().map(|&index| &questions[index]).collect();
        let replies = model.answer_each(&asking);
        let mut again = Vec::new();
        for (index, reply) in std::mem::take(&mut open).into_iter().zip(replies) {
            let (answer, is_final) = heard(&mut questions[index], reply, (asked, reasks), transcribed);
            answers[index] = answer;
            if !is_final {
                again.push(index);
            }
        }
        open = again;
        if open.is_empty() {
            break;
        }
    }
    answers
}

/// What a reply comes to, and whether that is the end of it; what was wrong with it is added to the question.
fn heard(
    question: &mut Question,
    reply: Result<Answered, ServiceError>,
    (asked, reasks): (usize, Reasks),
    transcribed: &Transcribed,
) -> (Result<Answer, FailedStage>, bool) {
    let failed = |cause: &str, evidence: String| Err(FailedStage::new(question.stage.name(), cause, evidence));
    let (text, usage, complaint) = match reply {
        Ok(Answered { text, usage }) => match parse(question, &text) {
            Ok(answer) => {
                transcribed.exchange(question, &text, None, usage);
                return (Ok(answer), true);
            }
            Err(complaint) => (text, usage, complaint),
        },
        Err(ServiceError::Unreadable(what)) => (String::new(), None, Complaint::Format(what)),
        Err(error @ (ServiceError::Garbled(_) | ServiceError::Unreachable(_))) => {
            transcribed.exchange(question, "", Some(&error.to_string()), None);
            let is_final = matches!(error, ServiceError::Unreachable(_));
            return (failed(FailedStage::SERVICE, error.to_string()), is_final);
        }
    };
    transcribed.exchange(question, &text, Some(&complaint.to_string()), usage);
    let last = failed(complaint.cause(), format!("{complaint} (asked {asked} times)"));
    let is_final = matches!(complaint, Complaint::NotFound(_)) && !reasks.not_found;
    question.refused.push(Refused { answer: shortened(&text), complaint });
    (last, is_final)
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
