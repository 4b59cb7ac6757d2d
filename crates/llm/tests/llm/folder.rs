use std::fs;
use std::path::Path;
use std::time::Duration;

use genmanip_core::Document;
use genmanip_llm::{
    Answered, ChatError, ChatModel, ChatRequest, FolderAnswers, FolderChat, FolderPart, FolderQuestion, FolderSettings,
};
use genmanip_llm::{Message, ReplySchema};

use crate::images::{RED_GREEN, image, png, words};
use crate::question;

/// A folder model with short timeouts.
fn model(folder: &Path, timeout_s: f64) -> FolderChat {
    let folder = folder.to_owned();
    FolderChat::new(FolderSettings { folder, timeout_s, poll_s: 0.005, settle_s: 0.03, max_answer_bytes: 1000 })
        .unwrap()
}

fn shown() -> ChatRequest {
    let reply_schema = Some(ReplySchema::new("mark", serde_json::json!({"type": "object"})));
    let parts = [words("Which number marks"), image(RED_GREEN), words("the cup?")];
    ChatRequest { messages: vec![Message::system("Answer."), Message::user_parts(parts)], reply_schema, ..question("") }
}

#[test]
fn a_question_is_written_whole_and_its_answer_awaited() {
    let folder = tempfile::tempdir().unwrap();
    let answered = std::thread::scope(|scope| {
        let asked = scope.spawn(|| model(folder.path(), 10.0).chat(&shown()));
        let place = folder.path().join("001");
        while !place.exists() {
            std::thread::sleep(Duration::from_millis(2));
        }
        let question = FolderQuestion::from_json(&fs::read_to_string(place.join("question.json")).unwrap()).unwrap();
        assert_eq!(question.reply_schema, shown().reply_schema);
        let [_, FolderPart::Image(picture), _] = &question.messages[1].parts[..] else { panic!("{question:?}") };
        assert_eq!(fs::read(place.join(picture)).unwrap(), png(RED_GREEN));
        fs::write(place.join("answer.json"), "{\"number\": 3}\n").unwrap();
        asked.join().unwrap()
    });
    assert_eq!(answered.unwrap().text, "{\"number\": 3}");
    // Asked again, also by another program, the answer is reused; another question gets the next number.
    assert_eq!(model(folder.path(), 0.05).chat(&shown()).unwrap().text, "{\"number\": 3}");
    let other = model(folder.path(), 0.05).chat(&question("And now?"));
    assert!(matches!(other, Err(ChatError::Unanswered { .. })), "{other:?}");
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
    assert!(folder.path().join("002/question.json").exists());
}

#[test]
fn answers_are_taken_as_people_write_them() {
    let cases = [
        ("\"in words\"", Some("in words")),
        ("{\"a\": 1}", Some("{\"a\": 1}")),
        ("```json\n{\"a\": 1}\n```", Some("```json\n{\"a\": 1}\n```")),
        ("half a sen", Some("half a sen")),
        ("", None),
        ("\"\"", None),
    ];
    for (written, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let model = model(folder.path(), 0.3);
        fs::create_dir_all(folder.path().join("001")).unwrap();
        // Another program's number is never reused.
        let _ = FolderChat::new(FolderSettings {
            timeout_s: 0.001,
            folder: folder.path().into(),
            ..FolderSettings::default()
        })
        .unwrap()
        .chat(&question("?"));
        fs::write(folder.path().join("002/answer.json"), written).unwrap();
        let answered = model.chat(&question("?")).ok().map(|reply| reply.text);
        assert_eq!(answered.as_deref().map(str::trim), expected.map(str::trim), "{written:?}");
    }
}

#[test]
fn an_answer_that_is_too_large_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), 0.01);
    assert!(model.chat(&question("?")).is_err());
    fs::write(folder.path().join("001/answer.json"), "9".repeat(2000)).unwrap();
    let error = model.chat(&question("?")).unwrap_err();
    assert!(error.to_string().starts_with("cannot read the answer: expected at most 1000 bytes"), "{error}");
}

#[test]
fn questions_of_many_threads_get_a_number_each() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), 0.01);
    std::thread::scope(|scope| {
        for index in 0..16 {
            let model = &model;
            scope.spawn(move || model.chat(&question(&format!("question {}", index / 2))));
        }
    });
    let mut names: Vec<String> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, (1..=8).map(|number| format!("{number:03}")).collect::<Vec<_>>());
}

/// A list is requested every few seconds: a file with times is read again only if it has changed.
#[test]
fn times_of_answers_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let _ = model(folder.path(), 0.001).chat(&question("?"));
    let answers = FolderAnswers::new(folder.path().into());
    let listed = || answers.list().unwrap()[0].duration_s;
    let about = |duration_s| Answered { author: "ada".into(), duration_s, at: "2026-01-01T00:00:00Z".into() };
    assert_eq!(listed(), None);
    answers.answer("001", &serde_json::json!("yes"), &about(1.5)).unwrap();
    assert_eq!(listed(), Some(1.5));
    let path = folder.path().join("001/answered.json");
    let at = fs::metadata(&path).unwrap().modified().unwrap();
    let write = |text: String, seconds: u64| {
        fs::write(&path, text).unwrap();
        fs::File::options().append(true).open(&path).unwrap().set_modified(at + Duration::from_secs(seconds)).unwrap();
    };
    for (text, seconds, expected) in [
        (about(2.5).to_json(), 0, Some(1.5)),
        (about(2.5).to_json(), 1, Some(2.5)),
        (about(12.5).to_json(), 1, Some(12.5)),
        ("{".into(), 2, None),
        (about(3.5).to_json(), 3, Some(3.5)),
    ] {
        write(text, seconds);
        assert_eq!(listed(), expected, "{seconds} s");
    }
    fs::remove_file(&path).unwrap();
    assert_eq!(listed(), None);
}
