use std::path::{Path, PathBuf};

use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{
    CassetteChat, CassetteMode, CassetteSettings, ChatError, ChatModel, ChatReply, ChatRequest, HttpChat, Message,
};

use crate::{client, question};

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
        (good.replace("\"1\"", "\"2\""), "the request was edited"),
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
