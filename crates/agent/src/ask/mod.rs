//! Questions to a vision-language model: prompt, validation of the answer, transcript.
//!
//! A question is sent with images and the marks drawn on them. Only an answer that names drawn marks is accepted; small
//! errors of format are tolerated. An invalid answer is returned to the model with an explanation, up to a fixed number
//! of retries, after which the stage fails. An answer that was cut off fails at once. No mark is ever chosen by
//! default.

mod answer;
mod chosen;
mod model;
mod prompt;
mod question;
mod question_kind;
mod recorded;
mod rejection;
mod shortened;
mod transcript;

use genmanip_core::{FailedStage, StageCause};

pub use answer::{
    Answer, CheckAnswer, DecomposeAnswer, GrabPointAnswer, MarkAnswer, PathAnswer, PathCell, PointAnswer, parse,
};

pub use model::{ChatService, ModelReply, ServiceError, VisionModel};
pub(crate) use prompt::{Inputs, PromptVariant};
pub use prompt::{PromptError, PromptSet};
pub use question::{Marks, Question, QuestionImage};
pub use question_kind::{PromptStamp, QuestionKind};
pub use recorded::{Mismatch, RecordedAnswer, RecordedAnswers, Thumbnail, Tolerance};
pub use rejection::{RejectedAnswer, Rejection};
use shortened::shortened;
pub(crate) use transcript::TAKES;
pub use transcript::{Exchange, Transcript, TranscriptEvent, TranscriptRecorder};

/// Reason for rejecting an answer whose end is missing.
const CUT_OFF: &str = "the model was stopped at its limit of tokens: raise `max_tokens` in the settings of the model";

/// Retry limits for invalid answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryLimits {
    /// Maximum number of retries.
    pub most: usize,
    /// True to retry after the answer that no mark fits; false if another view can be shown instead.
    pub not_found: bool,
}

/// Asks a question up to `1 + reasks.most` times, until the answer is valid.
///
/// # Errors
/// Reports why the last answer was invalid; the cause [`StageCause::Service`] means that the service did not answer.
pub fn ask(
    model: &dyn VisionModel,
    question: Question,
    reasks: RetryLimits,
    transcribed: &TranscriptRecorder,
) -> Result<Answer, FailedStage> {
    let [answer] = ask_each(model, [question], reasks, transcribed);
    answer
}

/// Asks independent questions concurrently, then repeats each question whose answer was invalid. Ask indices follow the
/// order of the questions.
pub fn ask_each<const COUNT: usize>(
    model: &dyn VisionModel,
    mut questions: [Question; COUNT],
    reasks: RetryLimits,
    transcribed: &TranscriptRecorder,
) -> [Result<Answer, FailedStage>; COUNT] {
    let mut answers =
        questions.each_ref().map(|question| Err(FailedStage::new(question.stage, StageCause::Format, String::new())));
    let mut open: Vec<usize> = (0..COUNT).collect();
    for asked in 1..=reasks.most + 1 {
        for &index in &open {
            questions[index].ask = transcribed.next_ask();
        }
        let asking: Vec<&Question> = open.iter().map(|&index| &questions[index]).collect();
        let replies = model.answer_each(&asking);
        let mut again = Vec::new();
        for (index, reply) in std::mem::take(&mut open).into_iter().zip(replies) {
            let (answer, is_final) = process_reply(&mut questions[index], reply, (asked, reasks), transcribed);
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

/// Validates a reply; returns the result and whether it is final. Adds the complaint about an invalid answer to the
/// question.
fn process_reply(
    question: &mut Question,
    reply: Result<ModelReply, ServiceError>,
    (asked, reasks): (usize, RetryLimits),
    transcribed: &TranscriptRecorder,
) -> (Result<Answer, FailedStage>, bool) {
    let failed = |cause, evidence: String| Err(FailedStage::new(question.stage, cause, evidence));
    let (text, usage, rejection, cut_off) = match reply {
        Ok(ModelReply { text, usage, cut_off }) => match parse(question, &text) {
            Ok(answer) => {
                transcribed.answered(question, &answer, &text, usage);
                return (Ok(answer), true);
            }
            Err(_) if cut_off => (text, usage, Rejection::Format(CUT_OFF.into()), true),
            Err(rejection) => (text, usage, rejection, false),
        },
        Err(ServiceError::Unreadable(what)) => (String::new(), None, Rejection::Format(what), false),
        Err(ServiceError::CutOff(what)) => (String::new(), None, Rejection::Format(what), true),
        Err(error @ (ServiceError::Garbled(_) | ServiceError::Unreachable(_))) => {
            transcribed.refused(question, "", &error.to_string(), None);
            let is_final = matches!(error, ServiceError::Unreachable(_));
            return (failed(StageCause::Service, error.to_string()), is_final);
        }
    };
    transcribed.refused(question, &text, &rejection.to_string(), usage);
    let last = failed(rejection.cause(), format!("{rejection} (asked {asked} times)"));
    let is_final = cut_off || matches!(rejection, Rejection::NotFound(_)) && !reasks.not_found;
    question.refused.push(RejectedAnswer { answer: shortened(&text), rejection });
    (last, is_final)
}
