use std::path::{Path, PathBuf};

use genmanip_core::{Document, Seed};
use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{Cassette, CassetteMode, CassetteSettings, read_cassette};
use genmanip_task_writer::{Designer, GenerationOutcome, LlmSettings};
use genmanip_tasks::answer::{TaskRequest, Verdict};

use crate::{catalogue, impatient, recorded_answers};

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

/// A task request and the scripted server's answers, in order.
fn shipped_exchanges() -> Vec<(TaskRequest, Vec<String>)> {
    let answers = recorded_answers();
    let find = |number: &str| answers.iter().find(|(name, _)| name.starts_with(number)).unwrap();
    let request = |number: &str| {
        let (name, answer) = find(number);
        answer.request(name, &catalogue()).unwrap()
    };
    let said = |number: &str| find(number).1.response.clone();
    vec![
        (request("003"), vec![said("003")]),                          // accepted as is
        (request("009"), vec![said("009")]),                          // in a code fence
        (request("015"), vec![said("015")]),                          // two alternatives
        (request("030"), vec![said("030")]),                          // repaired here: flat goal
        (request("012"), vec!["I am not sure.".into(), said("012")]), // repaired once by the model
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

/// After a change of the prompts, run `cargo test --release -p genmanip-task-writer -- --ignored record_the_shipped`.
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
