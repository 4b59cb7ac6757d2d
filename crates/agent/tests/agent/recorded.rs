//! Recorded answers match only the questions they were recorded for.

use std::sync::Arc;

use genmanip_agent::ask::{
    Marks, ModelReply, Question, QuestionImage, QuestionKind, RecordedAnswer, RecordedAnswers, RejectedAnswer,
    Rejection, Tolerance,
};
use genmanip_agent::image::RgbImage;
use genmanip_agent::segmentation::Mask;
use genmanip_core::Document;

use crate::answers;

/// An image of 64 x 36 pixels with a bright square.
fn picture(left: usize, shade: u8) -> Arc<RgbImage> {
    let mut picture = RgbImage::plain(64, 36, [shade; 3]);
    picture.rectangle([left as f64, 10.0], [left as f64 + 12.0, 22.0], [250; 3], 1.0);
    Arc::new(picture)
}

fn question(left: usize, shade: u8) -> Question {
    let shown = QuestionImage { name: "masks", picture: picture(left, shade) };
    Question { ask: 3, pictures: vec![shown], ..answers::question(QuestionKind::Object) }
}

fn moved(pixels: usize) -> Marks {
    let inside = |index: usize| (index % 16) >= pixels && (index % 16) < pixels + 8;
    Marks::Masks(vec![Mask { width: 16, height: 9, pixels: (0..144).map(inside).collect() }].into())
}

#[test]
fn a_question_that_differs_is_reported_and_never_answered() {
    let asked = Question { marks: moved(0), ..question(8, 40) };
    let answered = ModelReply { text: "{}".into(), usage: None, cut_off: false };
    let recorded = RecordedAnswers { scenario: "s-1".into(), answers: vec![RecordedAnswer::new(&asked, &answered)] };
    let recorded = RecordedAnswers::from_json(&recorded.to_json()).unwrap();
    let tolerance = Tolerance::default();
    assert_eq!(recorded.answer(&asked, &tolerance).unwrap(), answered);
    // The last digit of a colour differs from machine to machine.
    let mut near = asked.clone();
    let mut pixels = (*picture(8, 40)).clone();
    pixels.rgb.iter_mut().step_by(7).for_each(|value| *value += 1);
    near.pictures[0].picture = Arc::new(pixels);
    assert_eq!(recorded.answer(&near, &tolerance).unwrap(), answered);

    // An earlier question is no longer asked.
    assert_eq!(recorded.answer(&Question { ask: 2, ..asked.clone() }, &tolerance).unwrap(), answered);

    let refused = RejectedAnswer { answer: "x".into(), rejection: Rejection::Format("no".into()) };
    let prompt = genmanip_agent::ask::PromptStamp { version: 2, ..asked.prompt.clone() };
    let cases: [(Question, &str); 9] = [
        (Question { ask: 4, ..asked.clone() }, "ask 4 (object) of s-1 is not recorded"),
        (Question { stage: QuestionKind::Part, ..asked.clone() }, "another stage: object, not part"),
        (Question { prompt, ..asked.clone() }, "another prompt: test version 1 (), not test version 2 ()"),
        (Question { text: "Which?".into(), ..asked.clone() }, "another text: ?, not Which?"),
        (Question { refused: vec![refused], ..asked.clone() }, "another conversation: 0 refused answers, not 1"),
        (Question { marks: moved(4), ..asked.clone() }, "another mark: "),
        (Question { marks: Marks::None, ..asked.clone() }, "another number of marks: 1, not 0"),
        (Question { marks: moved(0), ..question(30, 40) }, "another picture: masks, not one that differs by"),
        (Question { marks: moved(0), ..question(8, 44) }, "at most 1.5 and 20 are tolerated"),
    ];
    for (other, expected) in cases {
        let error = recorded.answer(&other, &tolerance).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}, expected {expected}");
    }
}
