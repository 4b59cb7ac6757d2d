//! Hostile answers are asked again within the bound, then a stage fails; no mark is ever taken by default.

use std::sync::{Arc, Mutex};

use genmanip_agent::ask::{
    Answer, ChatService, Marks, PromptStamp, Question, QuestionKind, RetryLimits, TranscriptEvent, TranscriptRecorder,
    VisionModel, ask,
};
use genmanip_agent::grid::{Cell, Grid};
use genmanip_agent::segmentation::Mask;
use genmanip_core::glam::DVec3;
use genmanip_core::{Intrinsics, Pose, RgbdImage};
use genmanip_llm::fake::ScriptedChat;
use genmanip_llm::{ChatError, ChatModel, ChatReply, ChatRequest};
use proptest::prelude::*;

const REASKS: RetryLimits = RetryLimits { most: 2, not_found: true };

pub fn question(stage: QuestionKind) -> Question {
    let mask = || Mask { width: 16, height: 9, pixels: vec![true; 144] };
    let grid = Grid::usual(16, 9);
    let marks = match stage {
        QuestionKind::Object | QuestionKind::Part => Marks::Masks(vec![mask(), mask(), mask()].into()),
        QuestionKind::GrabPoint => Marks::Points(vec![1, 2, 3, 4, 5]),
        QuestionKind::GridPath | QuestionKind::PointToPoint => Marks::Grid {
            grid,
            // Everywhere but in the last cell.
            targets: grid.cells().filter(|cell| cell.to_string() != "I16").map(|cell| (cell, DVec3::ZERO)).collect(),
            moved: mask(),
            turns: stage == QuestionKind::PointToPoint,
        },
        QuestionKind::Decompose | QuestionKind::Check => Marks::None,
    };
    let image = RgbdImage::of_depth(Intrinsics::from_vertical_fov(16, 9, 1.0), Pose::IDENTITY, vec![1.0; 144]);
    Question {
        stage,
        ask: 0,
        prompt: PromptStamp { id: "test".into(), version: 1, sha256: String::new() },
        text: "?".into(),
        instruction: "?".into(),
        pictures: Vec::new(),
        marks,
        view: Arc::new(image),
        reasoning: false,
        refused: Vec::new(),
    }
}

fn service(answers: &[&str]) -> (Arc<ScriptedChat>, ChatService) {
    let script = Arc::new(ScriptedChat::new(answers.iter().copied()));
    let chat: Arc<dyn genmanip_llm::ChatModel> = script.clone();
    (script, ChatService { chat, model: "script".into(), parameters: Default::default() })
}

#[test]
fn reasons_are_taken_where_they_were_asked_for() {
    let answer = r#"{"reasoning": "The cup is red.", "number": 2, "object_name": "cup", "color": "red"}"#;
    let mut asked = question(QuestionKind::Object);
    asked.reasoning = true;
    assert!(matches!(genmanip_agent::ask::parse(&asked, answer), Ok(Answer::Mark(mark)) if mark.mask == 1));
    assert!(asked.schema()["required"].as_array().unwrap().contains(&"reasoning".into()));
    let request = asked.request("m", &Default::default()).unwrap();
    assert!(format!("{:?}", request.messages).contains("`reasoning`"));
}

#[test]
fn hostile_answers_are_asked_again_and_then_fail_by_name() {
    let huge = format!("{{\"number\": 1, \"object_name\": \"{}\", \"color\": \"x\"}}", "a".repeat(10 << 20));
    let cases: Vec<(QuestionKind, &str, &str)> = vec![
        (QuestionKind::Object, r#"{"number": 4, "object_name": "cup", "color": "red"}"#, "undrawn"),
        (QuestionKind::Object, r#"{"number": 0, "object_name": "cup", "color": "red"}"#, "undrawn"),
        (QuestionKind::Object, r#"{"number": -1, "object_name": "not_found", "color": "not_found"}"#, "not_found"),
        (QuestionKind::Object, r#"{"number": -2, "object_name": "cup", "color": "red"}"#, "undrawn"),
        (QuestionKind::Object, r#"{"number": 9223372036854775808, "object_name": "cup", "color": "red"}"#, "format"),
        (QuestionKind::Object, r#"{"number": 1.5, "object_name": "cup", "color": "red"}"#, "format"),
        (QuestionKind::Object, r#"{"number": 1, "object_name": "cup"}"#, "format"),
        (QuestionKind::Object, r#"{"number": "one", "object_name": "cup", "color": "red"}"#, "format"),
        (QuestionKind::Object, r#"{"number": "4", "object_name": "cup", "color": "red"}"#, "undrawn"),
        (QuestionKind::Object, r#"{"number": null, "object_name": "cup", "color": "red"}"#, "format"),
        (
            QuestionKind::Object,
            r#"Either {"number": 1, "object_name": "cup", "color": "red"} or {"number": 2, "object_name": "cup", "color": "red"}."#,
            "format",
        ),
        (
            QuestionKind::Object,
            r#"[{"number": 1, "object_name": "cup", "color": "red"}, {"number": 2, "object_name": "cup", "color": "red"}]"#,
            "format",
        ),
        (QuestionKind::Object, "I would pick mask 1.", "format"),
        (QuestionKind::Object, "[1]", "format"),
        (QuestionKind::Object, "[]", "format"),
        (QuestionKind::Object, &huge, "format"),
        (QuestionKind::Part, r#"{"number": 9, "part_name": "lid", "color": "red"}"#, "undrawn"),
        (QuestionKind::GrabPoint, r#"{"selected_point": 6, "reason": ""}"#, "undrawn"),
        (QuestionKind::GrabPoint, r#"{"selected_point": -1, "reason": ""}"#, "undrawn"),
        (QuestionKind::PointToPoint, r#"{"selected_point": {"type": "grid", "label": "Z99"}}"#, "undrawn"),
        (QuestionKind::PointToPoint, r#"{"selected_point": {"type": "grid", "label": "A17"}}"#, "undrawn"),
        (QuestionKind::PointToPoint, r#"{"selected_point": {"type": "grid", "label": "I16"}}"#, "unusable"),
        (QuestionKind::PointToPoint, r#"{"selected_point": {"type": "pixel", "label": "C4"}}"#, "format"),
        (QuestionKind::PointToPoint, r#"{"selected_point": "C4"}"#, "format"),
        (
            QuestionKind::PointToPoint,
            r#"{"selected_point": {"type": "grid", "label": "C4"}, "turn_deg": 900}"#,
            "format",
        ),
        (
            QuestionKind::PointToPoint,
            r#"{"selected_point": {"type": "grid", "label": "C4"}, "turn_deg": "x"}"#,
            "format",
        ),
        (QuestionKind::GridPath, r#"[]"#, "format"),
        (QuestionKind::GridPath, r#"[{"grid_number": "C4", "height_m": 0.2, "claw_orientation": 0}]"#, "format"),
        (
            QuestionKind::GridPath,
            r#"[{"grid_number": "C4", "height_m": NaN, "claw_orientation": 0}, {"grid_number": "C5", "height_m": 0.2, "claw_orientation": 0}]"#,
            "format",
        ),
        (
            QuestionKind::GridPath,
            r#"[{"grid_number": "C4", "height_m": 0.2, "claw_orientation": 0}, {"grid_number": "C5", "height_m": 5.0, "claw_orientation": 0}]"#,
            "format",
        ),
        (
            QuestionKind::GridPath,
            r#"[{"grid_number": "C4", "height_m": 0.2, "claw_orientation": 1e9}, {"grid_number": "C5", "height_m": 0.2, "claw_orientation": 0}]"#,
            "format",
        ),
        (
            QuestionKind::GridPath,
            r#"[{"grid_number": "Z99", "height_m": 0.2, "claw_orientation": 0}, {"grid_number": "C5", "height_m": 0.2, "claw_orientation": 0}]"#,
            "undrawn",
        ),
        (
            QuestionKind::GridPath,
            r#"[{"grid_number": "C4", "height_m": "inf", "claw_orientation": 0}, {"grid_number": "C5", "height_m": 0.2, "claw_orientation": 0}]"#,
            "format",
        ),
        (QuestionKind::Decompose, r#"{"subtasks": []}"#, "format"),
        (QuestionKind::Decompose, r#"{"subtasks": [" "]}"#, "format"),
        (QuestionKind::Check, r#"{"scene_description": "done", "finished": "yes"}"#, "format"),
        (QuestionKind::Check, r#"{"scene_description": "not yet", "finished": false, "remaining": [" "]}"#, "format"),
    ];
    for (stage, answer, cause) in cases {
        let (script, model) = service(&[answer; REASKS.most + 1]);
        let transcribed = TranscriptRecorder::new(false);
        let shown = &answer[..answer.len().min(120)];
        let failure = ask(&model, question(stage), REASKS, &transcribed).expect_err(shown);
        assert_eq!((failure.stage.name(), failure.cause.name()), (stage.name(), cause), "{shown}");
        let seen = script.seen();
        assert_eq!(seen.len(), REASKS.most + 1, "{shown}: asked within the bound");
        let rejection = seen[REASKS.most].messages.last().unwrap().text();
        assert!(rejection.starts_with("This answer cannot be used: "), "{rejection}");
        assert!(seen[REASKS.most].messages.iter().all(|message| message.text().len() < 4000), "what was huge is cut");
        let moments = transcribed.transcript().moments;
        assert_eq!(moments.len(), REASKS.most + 1);
        assert!(
            moments.iter().all(|moment| matches!(moment, TranscriptEvent::Asked(asked) if asked.refused.is_some()))
        );
    }
}

#[test]
fn a_good_answer_after_a_bad_one_is_taken() {
    let good = r#"{"number": 2, "object_name": "cup", "color": "red"}"#;
    let quoted = serde_json::Value::from(good).to_string();
    for good in [
        good.to_owned(),
        format!("```json\n{good}\n```"),
        format!("  {good}\n"),
        format!("The cup is the second.\n```JSON\n{good}\n```\nIt is {{red}}."),
        format!("Sure! {good} Done."),
        format!("{good}\n{good}"),
        format!("[{good}]"),
        format!("{{\"answer\": {good}}}"),
        format!("{{\"answer\": {quoted}}}"),
        quoted,
        good.replace('2', "\"2\""),
        good.replace('2', "2.0"),
        good.replace("{", "{\"reasoning\": \"it is red\", \"confidence\": 0.9, "),
    ] {
        let (script, model) = service(&["no idea", &good]);
        let answer = ask(&model, question(QuestionKind::Object), REASKS, &TranscriptRecorder::new(false)).unwrap();
        assert!(matches!(answer, Answer::Mark(answer) if answer.mask == 1 && answer.name == "cup"));
        assert_eq!(script.seen().len(), 2);
    }
    let path = r#"[{"grid_number": "A1", "height_m": 0.2, "claw_orientation": 0}, {"grid_number": "B2", "height_m": 0.1, "claw_orientation": -90}]"#;
    let quoted = serde_json::Value::from(path).to_string();
    for path in [
        path.to_owned(),
        format!("{{\"path\": {path}}}"),
        format!("{{\"path\": {quoted}}}"),
        format!("Go this way: {path}."),
        path.replace("0.2", "\"0.2\"").replace("-90", "\"-90\""),
    ] {
        let (_, model) = service(&[&path]);
        let answer = ask(
            &model,
            question(QuestionKind::GridPath),
            RetryLimits { most: 0, ..REASKS },
            &TranscriptRecorder::new(false),
        )
        .unwrap();
        let Answer::Path(answer) = answer else { panic!("expected a path, got {answer:?}") };
        assert_eq!(answer.cells[1].cell, Cell { row: 1, column: 1 });
    }
}

/// An answer that was cut off is asked for once, and the reason names the setting; a whole one before the cut is taken.
#[test]
fn an_answer_that_was_cut_off_is_not_paid_for_again() {
    struct CutOff(&'static str, Mutex<usize>);
    impl ChatModel for CutOff {
        fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
            *self.1.lock().unwrap() += 1;
            if self.0.is_empty() {
                return Err(ChatError::NoText { finish_reason: "length".into() });
            }
            let reply = ScriptedChat::new([self.0]).chat(request)?;
            Ok(ChatReply { finish_reason: Some("max_tokens".into()), ..reply })
        }
    }
    let whole = r#"{"number": 2, "object_name": "cup", "color": "red"} It is"#;
    for (text, is_taken) in [(whole, true), (&whole[..20], false), ("<think>Let me look at", false), ("", false)] {
        let chat = Arc::new(CutOff(text, Mutex::new(0)));
        let model = ChatService { chat: chat.clone(), model: "script".into(), parameters: Default::default() };
        let answer = ask(&model, question(QuestionKind::Object), REASKS, &TranscriptRecorder::new(false));
        assert_eq!((answer.is_ok(), *chat.1.lock().unwrap()), (is_taken, 1), "{text}");
        if let Err(failure) = answer {
            assert_eq!(failure.cause.name(), "format");
            assert!(failure.evidence.contains("max_tokens"), "{}", failure.evidence);
        }
    }
}

#[test]
fn a_thing_that_another_view_may_show_is_not_asked_for_again() {
    for (not_found, asked) in [(true, 3), (false, 1)] {
        let (script, model) = service(&[r#"{"number": -1, "object_name": "cup", "color": "red"}"#; 3]);
        let reasks = RetryLimits { not_found, ..REASKS };
        let failure = ask(&model, question(QuestionKind::Object), reasks, &TranscriptRecorder::new(false)).unwrap_err();
        assert_eq!((failure.cause.name(), script.seen().len()), ("not_found", asked));
    }
}

/// Fails in these ways, one after the other, then answers.
struct Troubled(Mutex<Vec<ChatError>>);

impl ChatModel for Troubled {
    fn chat(&self, _request: &ChatRequest) -> Result<ChatReply, ChatError> {
        let mut left = self.0.lock().unwrap();
        match left.is_empty() {
            true => ScriptedChat::new([r#"{"scene_description": "done", "finished": true}"#])
                .chat(&ChatRequest::new("script", Vec::new())),
            false => Err(left.remove(0)),
        }
    }
}

/// Trouble of the service is no failure of the model; what the model says without using words is.
#[test]
fn trouble_of_the_service_and_of_the_model_are_told_apart() {
    let url = || "http://127.0.0.1:1/v1".to_owned();
    let down = || ChatError::Unreachable { url: url(), message: "refused".into() };
    let busy = || ChatError::GaveUp { attempts: 5, last: Box::new(down()) };
    let page = || ChatError::NotJson { url: url(), content_type: "text/html".into(), beginning: "<html>".into() };
    let huge = || ChatError::TooLarge { url: url(), limit_bytes: 4 << 20 };
    for (trouble, asked, cause) in [
        (vec![down()], 1, Some("service")),
        (vec![busy(), busy()], 1, Some("service")),
        (vec![page()], 2, None),
        (vec![page(), huge()], 3, None),
        (vec![page(), page(), page()], 3, Some("service")),
        (vec![huge(), huge(), huge()], 3, Some("format")),
    ] {
        let shown = format!("{trouble:?}");
        let chat = Arc::new(Troubled(Mutex::new(trouble)));
        let model = ChatService { chat, model: "script".into(), parameters: Default::default() };
        let transcribed = TranscriptRecorder::new(false);
        let answer = ask(&model, question(QuestionKind::Check), REASKS, &transcribed);
        assert_eq!(answer.err().map(|failure| failure.cause.name()), cause, "{shown}");
        assert_eq!(transcribed.transcript().moments.len(), asked, "{shown}");
    }
}

#[test]
fn schemas_are_closed_and_hold_only_drawn_numbers() {
    for stage in QuestionKind::ALL {
        let schema = question(stage).schema();
        assert_eq!(schema["additionalProperties"], false, "{}", stage.name());
        let names: Vec<&String> = schema["properties"].as_object().unwrap().keys().collect();
        let required: Vec<&str> =
            schema["required"].as_array().unwrap().iter().filter_map(|name| name.as_str()).collect();
        assert_eq!(names, required);
    }
    assert_eq!(
        question(QuestionKind::Object).schema()["properties"]["number"]["enum"],
        serde_json::json!([-1, 1, 2, 3])
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn nothing_breaks_the_reader_and_only_drawn_marks_come_out(text in "\\PC{0,80}", number in any::<i64>(), label in "[A-Za-z0-9+-]{0,5}") {
        let texts = [
            text,
            format!(r#"{{"number": {number}, "object_name": "x", "color": "y"}}"#),
            format!(r#"{{"selected_point": {number}, "reason": "x"}}"#),
            format!(r#"{{"selected_point": {{"type": "grid", "label": "{label}"}}}}"#),
        ];
        for stage in QuestionKind::ALL {
            let question = question(stage);
            for text in &texts {
                match genmanip_agent::ask::parse(&question, text) {
                    Ok(Answer::Mark(answer)) => prop_assert!(answer.mask < 3 && number == answer.mask as i64 + 1),
                    Ok(Answer::GrabPoint(answer)) => prop_assert!(answer.point < 5),
                    Ok(Answer::Point(answer)) => prop_assert_eq!(answer.cell.to_string(), label.clone()),
                    _ => {}
                }
            }
        }
    }
}

/// The request depends on the question alone, so that recorded answers match.
#[test]
fn the_same_question_is_the_same_request() {
    let key = || question(QuestionKind::Object).request("m", &Default::default()).unwrap().key();
    assert_eq!(key(), key());
    let (_, model) = service(&["x"]);
    assert_eq!(model.answer(&question(QuestionKind::Check)).unwrap().text, "x");
}
