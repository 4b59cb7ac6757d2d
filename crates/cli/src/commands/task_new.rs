//! `genmanip task new`: by rules, or by a language model.

use std::path::Path;

use genmanip_assets::search::Filter;
use genmanip_bench::text_table;
use genmanip_chat::CassetteMode;
use genmanip_core::limits;
use genmanip_core::{Document, ObjectCard, Seed, Task, TaskKind};
use genmanip_llm::{Designer, GenerationOutcome, LlmSettings};
use genmanip_run::{Progress, inputs};
use genmanip_scene::designer::{DesignSettings, design_each};
use serde::Serialize;

use crate::args::NewArguments;
use crate::commands::assets::catalogue;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

/// Folder beside the tasks with what the model answered and what was wrong with it.
const ROUNDS: &str = "rounds";

#[derive(Serialize)]
struct Row {
    task: String,
    kind: &'static str,
    instruction: Option<String>,
    file: Option<String>,
    /// Why there is no task.
    refused: Option<String>,
}

pub fn run(arguments: &NewArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let kinds = match arguments.kind.as_str() {
        "all" => TaskKind::ALL.to_vec(),
        name => vec![inputs::task_kind(name)?],
    };
    let is_rules = arguments.designer == "rules";
    if is_rules && (arguments.settings.is_some() || arguments.cassettes.is_some() || arguments.folder.is_some()) {
        return Err(Failed::misused("--settings, --cassettes and --folder are for language models")
            .hint("add --designer llm, or leave them out"));
    }
    if is_rules && arguments.world.is_some() {
        return Err(Failed::new("--world is for language models: the rules name no surface but the table")
            .hint("leave it out; `layout` and `collect` lay tasks out in a world with --world"));
    }
    if !(0.0..=1.0).contains(&arguments.copies) || (!is_rules && arguments.copies > 0.0) {
        return Err(Failed::misused(format!("--copies {} is not possible", arguments.copies))
            .hint("expected a share of scenes, 0 to 1, with --designer rules"));
    }
    let rows = match arguments.designer.as_str() {
        "rules" => by_rules(arguments, &kinds, printer)?,
        "llm" => by_language_model(arguments, &kinds, printer)?,
        other => {
            return Err(Failed::misused(format!("unknown designer `{other}`")).hint("expected rules or llm"));
        }
    };
    printer.data(&rows, &in_words(&rows));
    let refused = rows.iter().filter(|row| row.refused.is_some()).count();
    if refused > 0 {
        printer.say(format!("{refused} of {} refused", rows.len()));
        return Ok(ExitStatus::NotMet);
    }
    Ok(ExitStatus::Done)
}

/// The cards that tasks may be about.
fn cards(arguments: &NewArguments) -> Result<Vec<ObjectCard>, Failed> {
    let catalogue = catalogue(&arguments.catalog);
    let Some(query) = &arguments.objects else { return Ok(catalogue.cards().to_vec()) };
    let index = catalogue.index();
    let found = index.search(query, &Filter::default(), usize::MAX);
    if found.is_empty() {
        return Err(Failed::new(format!("no object fits \"{query}\"")).hint("try it with `genmanip assets search`"));
    }
    Ok(found.iter().map(|one| one.card.clone()).collect())
}

fn by_rules(arguments: &NewArguments, kinds: &[TaskKind], printer: &Printer) -> Result<Vec<Row>, Failed> {
    let cards = &*cards(arguments)?;
    printer.begin("designing", arguments.count);
    let settings = DesignSettings { copies: arguments.copies, ..DesignSettings::default() };
    let seed = Seed::new(arguments.seed);
    let batch = design_each(kinds, arguments.count, cards, seed, &settings, &mut |_| printer.advance());
    printer.end();
    let batch = batch.map_err(|error| Failed::because("the designer gave up", &error))?;
    batch.tasks.iter().map(|task| write_task(task, &arguments.out)).collect()
}

/// The kinds in turn, as with rules; task `k` of a kind has its own stream, so more kinds change nothing.
fn by_language_model(arguments: &NewArguments, kinds: &[TaskKind], printer: &Printer) -> Result<Vec<Row>, Failed> {
    let settings = settings(arguments)?;
    let seed = Seed::new(arguments.seed);
    let designer = Designer::open(&settings, seed)
        .map_err(|error| {
            Failed::because("the language model cannot be asked", &error)
                .hint("docs/guides/language-models.md says what settings, prompts and cassettes hold")
        })?
        .with_surfaces(inputs::read_world(arguments.world.as_deref())?.named_surfaces());
    printer.begin("asking", arguments.count);
    let mut outcomes: Vec<GenerationOutcome> = Vec::new();
    let cards = cards(arguments)?;
    for (index, &kind) in kinds.iter().enumerate() {
        let count = (arguments.count + kinds.len() - 1 - index) / kinds.len();
        outcomes.extend(designer.generate(kind, count, seed, &cards, &|_| printer.advance()));
    }
    printer.end();
    outcomes.iter().map(|outcome| write_outcome(outcome, &arguments.out)).collect()
}

fn settings(arguments: &NewArguments) -> Result<LlmSettings, Failed> {
    let mut settings = match (arguments.settings.as_deref(), &arguments.folder) {
        (Some(path), _) => {
            let text = inputs::read_text(path, limits::SETTINGS)?;
            LlmSettings::from_toml(&text).map_err(|error| {
                Failed::because(format!("cannot use the settings in {}", path.display()), &error)
                    .hint("expected TOML as in docs/guides/language-models.md")
            })?
        }
        (None, Some(_)) => LlmSettings::default(),
        (None, None) => {
            return Err(Failed::new("a language model needs --settings FILE, or --folder DIR to be it yourself")
                .hint("see docs/guides/language-models.md"));
        }
    };
    if let Some(folder) = &arguments.folder {
        settings.folder.get_or_insert_default().folder.clone_from(folder);
    }
    if let Some(mode) = &arguments.cassettes {
        settings.cassettes.mode = match mode.as_str() {
            "live" => CassetteMode::Live,
            "record" => CassetteMode::Record,
            "replay" => CassetteMode::Replay,
            other => {
                let what = format!("cassettes cannot be used in the mode `{other}`");
                return Err(Failed::misused(what).hint("expected live, record or replay"));
            }
        };
    }
    Ok(settings)
}

fn write_task(task: &Task, folder: &Path) -> Result<Row, Failed> {
    let path = folder.join(format!("{}.json", task.id));
    inputs::write_file(&path, task.to_json().as_bytes())?;
    Ok(Row {
        task: task.id.clone(),
        kind: task.kind.name(),
        instruction: Some(task.instruction.clone()),
        file: Some(path.display().to_string()),
        refused: None,
    })
}

fn write_outcome(outcome: &GenerationOutcome, folder: &Path) -> Result<Row, Failed> {
    let rounds = folder.join(ROUNDS).join(format!("{}.json", outcome.id));
    inputs::write_file(&rounds, outcome.to_json().as_bytes())?;
    match outcome.task() {
        Some(task) => write_task(task, folder),
        None => Ok(Row {
            task: outcome.id.clone(),
            kind: outcome.kind.name(),
            instruction: None,
            file: None,
            refused: outcome.refusal(),
        }),
    }
}

fn in_words(rows: &[Row]) -> String {
    let mut lines = vec![["task", "instruction"].map(String::from).to_vec()];
    for row in rows {
        let said = row.instruction.clone().or_else(|| row.refused.as_ref().map(|why| format!("refused: {why}")));
        lines.push(vec![row.task.clone(), said.unwrap_or_default()]);
    }
    text_table(&lines)
}
