use std::path::{Path, PathBuf};

use genmanip_core::{Document, Seed};
use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{
    Cassette, CassetteChat, CassetteMode, CassetteSettings, ChatError, ChatModel, ChatReply, ChatRequest, Designer,
    GenerationOutcome, HttpChat, LlmSettings, Message, read_cassette,
};
use genmanip_scene::answer::{TaskRequest, Verdict};

use crate::{catalogue, client, impatient, question, recorded_answers};

const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/cassettes");
const NOTE: &str =
    "No language model was asked: a scripted server on loopback gave a recorded answer of the test data.";

fn settings(mode: CassetteMode, folder: &Path) -> CassetteSettings {
    CassetteSettings { mode, folder: folder.into(), note: NOTE.into() }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

#[test]
fn record_then_replay_without_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted(["one", "two\nlines"].map(|text| Behaviour::Answer(text.into()))).unwrap();
    let record = CassetteChat::new(client(&server), settings(CassetteMode::Record, folder.path()), None);
    let (first, second) = (record.chat(&question("1")).unwrap(), record.chat(&question("2")).unwrap());
    assert_eq!(record.chat(&question("1")).unwrap().text, "one", "recorded already, so the server is not asked");
    assert_eq!(server.seen().len(), 2);
    drop(server);

    let replay = CassetteChat::<HttpChat>::replay(settings(CassetteMode::Live, folder.path()));
    for (text, recorded) in [("1", first), ("2", second)] {
        let replayed = replay.chat(&question(text)).unwrap();
        assert_eq!(replayed.attempts, 0);
        assert_eq!(ChatReply { attempts: recorded.attempts, ..replayed }, recorded);
    }
    assert_eq!(files(folder.path()).len(), 2, "no file is left aside");
    let text = std::fs::read_to_string(folder.path().join(format!("{}.json", &question("2").key()[..24]))).unwrap();
    insta::assert_snapshot!(text);
}

#[test]
fn live_neither_reads_nor_writes() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted(["one", "two"].map(|text| Behaviour::Answer(text.into()))).unwrap();
    let live = CassetteChat::new(client(&server), settings(CassetteMode::Live, folder.path()), None);
    assert_eq!(live.chat(&question("1")).unwrap().text, "one");
    assert_eq!(live.chat(&question("1")).unwrap().text, "two");
    assert!(files(folder.path()).is_empty());
}

#[test]
fn failures_are_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted([]).unwrap();
    let record = CassetteChat::new(client(&server), settings(CassetteMode::Record, folder.path()), None);
    assert!(record.chat(&question("1")).is_err());
    assert!(files(folder.path()).is_empty());
}

#[test]
fn a_miss_names_the_key_and_the_nearest_cassette() {
    let folder = tempfile::tempdir().unwrap();
    let replay = CassetteChat::<HttpChat>::replay(settings(CassetteMode::Replay, folder.path()));
    let error = replay.chat(&question("1")).unwrap_err().to_string();
    assert!(error.contains(&question("1").key()) && !error.contains("nearest"), "{error}");

    let server = FakeServer::scripted(["a", "b"].map(|text| Behaviour::Answer(text.into()))).unwrap();
    let record = CassetteChat::new(client(&server), settings(CassetteMode::Record, folder.path()), None);
    record.chat(&question("milk\nthe red mug\nthe pan")).unwrap();
    record.chat(&question("something else\nentirely")).unwrap();
    let asked = question("milk\nthe blue mug\nthe pan");
    let near = &question("milk\nthe red mug\nthe pan").key()[..24];
    let error = replay.chat(&asked).unwrap_err().to_string();
    let expected = format!(
        "no cassette {} in {}; nearest is {near}.json, which differs at messages[1] line 2: \
         asked \"the blue mug\", recorded \"the red mug\"",
        asked.key(),
        folder.path().display()
    );
    assert_eq!(error, expected);
    type Change = fn(&mut ChatRequest);
    let changes: [(Change, &str); 4] = [
        (|q| q.model = "other".into(), "model"),
        (|q| drop(q.parameters.insert("seed".into(), 1.into())), "parameters"),
        (|q| q.messages.push(Message::user("more")), "the number of messages"),
        (|q| q.reply_schema = crate::structured_question().reply_schema, "reply_schema"),
    ];
    for (change, place) in changes {
        let mut asked = question("milk\nthe red mug\nthe pan");
        change(&mut asked);
        let error = replay.chat(&asked).unwrap_err().to_string();
        assert!(error.contains(&format!("{near}.json, which differs at {place}")), "{error}");
    }
}

#[test]
fn damaged_cassettes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted([Behaviour::Answer("a".into())]).unwrap();
    CassetteChat::new(client(&server), settings(CassetteMode::Record, folder.path()), None)
        .chat(&question("1"))
        .unwrap();
    let path = files(folder.path()).remove(0);
    let good = std::fs::read_to_string(&path).unwrap();
    let replay = CassetteChat::<HttpChat>::replay(settings(CassetteMode::Replay, folder.path()));
    for (text, part) in [
        (good.replace("\"1\"", "\"2\""), "the question was changed"),
        (good.replace("cassette/1", "cassette/7"), "expected schema"),
        (good[..good.len() / 2].to_owned(), "not JSON"),
        (good.replace("\"text\": \"a\"", "\"text\": 5"), "$.reply"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = replay.chat(&question("1")).unwrap_err();
        assert!(matches!(error, ChatError::Cassette { .. }) && error.to_string().contains(part), "{error}");
    }
    // The answer may be edited by hand.
    std::fs::write(&path, good.replace("\"text\": \"a\"", "\"text\": [\"b\", \"c\"]")).unwrap();
    assert_eq!(replay.chat(&question("1")).unwrap().text, "b\nc");
}

/// A request for a task and the answers that a scripted server gives to it, in order.
fn shipped_exchanges() -> Vec<(TaskRequest, Vec<String>)> {
    let answers = recorded_answers();
    let find = |number: &str| answers.iter().find(|(name, _)| name.starts_with(number)).unwrap();
    let request = |number: &str| {
        let (name, answer) = find(number);
        answer.request(name, &catalogue()).unwrap()
    };
    let said = |number: &str| find(number).1.response.clone();
    vec![
        (request("003"), vec![said("003")]),                          // taken as it is
        (request("009"), vec![said("009")]),                          // in a code fence
        (request("015"), vec![said("015")]),                          // two alternatives
        (request("030"), vec![said("030")]),                          // repaired here: flat goal
        (request("012"), vec!["I am not sure.".into(), said("012")]), // sent back once
    ]
}

fn scripted_settings(base_url: String) -> LlmSettings {
    let mut settings = impatient(base_url);
    settings.server.model = "scripted-server".into();
    settings
}

#[test]
fn the_shipped_cassettes_replay() {
    let mut settings = scripted_settings("http://127.0.0.1:9/v1".into());
    settings.cassettes = self::settings(CassetteMode::Replay, Path::new(SHIPPED));
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    let verdicts: Vec<Vec<Verdict>> = shipped_exchanges()
        .iter()
        .map(|(request, _)| {
            let outcome = designer.design(request);
            assert!(outcome.task().is_some(), "{:?}", outcome.refusal());
            assert_eq!(GenerationOutcome::from_json(&outcome.to_json()).unwrap(), without_attempts(outcome.clone()));
            outcome.rounds.iter().map(|round| round.verdict).collect()
        })
        .collect();
    use Verdict::{Rejected, Repaired, Valid};
    assert_eq!(verdicts, [vec![Valid], vec![Valid], vec![Valid], vec![Repaired], vec![Rejected, Valid]]);
    for path in files(Path::new(SHIPPED)) {
        assert_eq!(read_cassette(&path).unwrap().note, NOTE);
    }
}

fn without_attempts(mut outcome: GenerationOutcome) -> GenerationOutcome {
    outcome.rounds.iter_mut().for_each(|round| round.reply.attempts = 0);
    outcome
}

/// After a change of the prompts: `cargo test --release -p genmanip-llm -- --ignored record_the_shipped`.
#[test]
#[ignore = "writes into testdata"]
fn record_the_shipped_cassettes() {
    let _ = std::fs::remove_dir_all(SHIPPED);
    let exchanges = shipped_exchanges();
    let server =
        FakeServer::scripted(exchanges.iter().flat_map(|(_, answers)| answers.iter().cloned().map(Behaviour::Answer)))
            .unwrap();
    let mut settings = scripted_settings(server.base_url());
    settings.cassettes = self::settings(CassetteMode::Record, Path::new(SHIPPED));
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    for (request, answers) in &exchanges {
        let outcome = designer.design(request);
        assert_eq!(outcome.rounds.len(), answers.len(), "{:?}", outcome.refusal());
    }
    let cassettes: Vec<Cassette> = files(Path::new(SHIPPED)).iter().map(|path| read_cassette(path).unwrap()).collect();
    assert_eq!(cassettes.len(), 6);
}
