//! Texts: answers of language models, versioned documents, worlds.

use std::collections::BTreeMap;
use std::path::Path;

use genmanip_assets::{Catalogue, GraspFile};
use genmanip_benchmark::EvaluationReport;
use genmanip_core::{Document, DocumentError, EpisodeResult, Scenario, Seed, Task, World};
use genmanip_import::packs::PackList;
use genmanip_llm::Cassette;
use genmanip_pipeline::folder::RunRecord;
use genmanip_skills::Skill;
use genmanip_tasks::answer::hostile::inconsistency;
use genmanip_tasks::answer::{RecordedAnswer, TaskRequest, check_answer};
use genmanip_tasks::designer::{DesignSettings, task_from_sentence};
use genmanip_workspace::worlds;

use super::{Opened, message};
use crate::Failure;
use crate::input::Input;

/// Recorded answers, each checked against its own request.
pub fn answers(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let (mut corpus, mut requests) = (Vec::new(), BTreeMap::<String, TaskRequest>::new());
    for (name, bytes) in Input::of_folder(&repository.join("examples/tasks"))?.files {
        let answer = RecordedAnswer::from_json(&String::from_utf8(bytes)?)?;
        requests.insert(name.clone(), answer.request("fuzz", Catalogue::builtin().cards())?);
        corpus.push(Input::file(&name, answer.response));
    }
    let read = move |input: &Input| {
        let (name, bytes) = &input.files[0];
        let (text, request) = (String::from_utf8_lossy(bytes), &requests[name]);
        let report = check_answer(&text, request);
        assert_eq!(inconsistency(&text, request, &report), None, "the report contradicts itself");
        report.task.map(drop).ok_or_else(|| report.verdict.name().into())
    };
    corpus.retain(|input| read(input).is_ok());
    Ok(Opened { corpus, read: Box::new(read) })
}

/// Files of every schema; each is read as the document that its schema names.
pub fn documents(_: &str, repository: &Path) -> Result<Opened, Failure> {
    fn read<T: Document>(bytes: &[u8]) -> Option<Result<(), String>> {
        match T::from_bytes(bytes) {
            Ok(document) => Some(T::from_json(&document.to_json()).map(drop).map_err(message)),
            Err(DocumentError::WrongSchema { .. }) => None,
            Err(error) => Some(Err(message(error))),
        }
    }
    /// `None` if the bytes are a document of another kind.
    type ReadKind = fn(&[u8]) -> Option<Result<(), String>>;
    const KINDS: [ReadKind; 10] = [
        read::<Task>,
        read::<Scenario>,
        read::<World>,
        read::<EpisodeResult>,
        read::<RunRecord>,
        read::<EvaluationReport>,
        read::<GraspFile>,
        read::<PackList>,
        read::<Cassette>,
        read::<Skill>,
    ];
    let folders = [
        "crates/core/testdata",
        "crates/cli/testdata/version_1",
        "crates/task-writer/testdata/cassettes",
        "crates/skills/testdata",
    ];
    let mut corpus = Vec::new();
    for folder in folders {
        corpus.extend(Input::each_of_folder(&repository.join(folder))?);
    }
    let read = |input: &Input| {
        let bytes = &input.files[0].1;
        KINDS.iter().find_map(|read| read(bytes)).unwrap_or_else(|| Err("unknown schema".into()))
    };
    // Records and hashes of the store are the target `episodes`.
    corpus.retain(|input| read(input).is_ok());
    Ok(Opened { corpus, read: Box::new(read) })
}

/// Sentences of people that become tasks.
pub fn sentences(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let table = std::fs::read_to_string(repository.join("crates/tasks/testdata/sentences.txt"))?;
    let sentences = table.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_once(" => "));
    let clear = sentences.filter(|(_, expected)| !expected.starts_with('?'));
    let mut corpus: Vec<Input> = clear.map(|(sentence, _)| Input::file("sentence.txt", sentence)).collect();
    // A few draws find most scenes; more would only search longer.
    let settings = DesignSettings { max_draws: 4, ..DesignSettings::default() };
    let cards = Catalogue::builtin().cards();
    let read = move |input: &Input| {
        let sentence = String::from_utf8_lossy(&input.files[0].1);
        task_from_sentence(&sentence, cards, Seed::new(1), "fuzz", &settings).map(drop).map_err(message)
    };
    corpus.retain(|input| read(input).is_ok());
    Ok(Opened { corpus, read: Box::new(read) })
}

/// The default world and the examples, compiled for the simulator.
pub fn worlds(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let mut corpus = vec![Input::file("world.toml", genmanip_assets::worlds::DEFAULT_TEXT)];
    corpus.extend(Input::each_of_folder(&repository.join("examples/worlds"))?);
    corpus.retain(|input| input.files[0].0.ends_with(".toml") && !input.files[0].0.contains('/'));
    let folder = tempfile::tempdir()?;
    let read = move |input: &Input| {
        input.write(folder.path()).map_err(message)?;
        let faults = worlds::check(&folder.path().join(&input.files[0].0)).map_err(message)?;
        faults.first().map_or(Ok(()), |fault| Err(message(fault)))
    };
    Ok(Opened { corpus, read: Box::new(read) })
}
