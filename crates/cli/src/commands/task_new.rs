//! `genmanip task new`: tasks from the rule-based designer or a language model.

use genmanip_workspace::documents;
use genmanip_workspace::task_files;
use genmanip_workspace::worlds;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::limits;
use genmanip_core::{Document, ObjectCard, RobotModel, Seed, TaskKind};
use genmanip_llm::CassetteMode;
use genmanip_task_writer::{Designed, Designer, GenerationEvent, GenerationOutcome, LlmSettings, Refusal, Round};
use genmanip_tasks::designer::{DesignSettings, fitting, graspable_by};
use genmanip_workspace::Progress;
use genmanip_workspace::designed_tasks::{self, Design, NewTask, design_into};
use genmanip_workspace::{MAX_ROWS, text_table};

use crate::args::NewArguments;
use crate::commands::assets::catalogue;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Folder beside the tasks with the model's answers and the flaws found in them.
const ROUNDS: &str = "rounds";

pub fn run(arguments: &NewArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let kinds = match arguments.kind.as_str() {
        "all" => TaskKind::ALL.to_vec(),
        name => vec![task_files::task_kind(name)?],
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
    if !is_rules && arguments.include.is_some() {
        return Err(Failed::misused("--include is for rules").hint("offer a language model few objects: --objects"));
    }
    if !is_rules && arguments.fill {
        return Err(Failed::misused("--fill is for rules: a language model does not run out of tasks")
            .hint("leave it out, or add --designer rules"));
    }
    if !(0.0..=1.0).contains(&arguments.copies) || (!is_rules && arguments.copies > 0.0) {
        return Err(Failed::misused(format!("--copies {} is not possible", arguments.copies))
            .hint("expected a share of scenes, 0 to 1, with --designer rules"));
    }
    if !is_rules && arguments.robot.is_some() {
        return Err(Failed::misused("--robot is for rules").hint("offer a language model what it can hold: --objects"));
    }
    if arguments.text.is_some() && !is_rules {
        return Err(Failed::misused("--text is for rules").hint("leave out --designer llm"));
    }
    let rows = match (arguments.designer.as_str(), &arguments.text) {
        ("rules", Some(sentence)) => {
            let (cards, settings) = (cards(arguments)?, design_settings(arguments)?);
            let seed = Seed::new(arguments.seed);
            designed_tasks::compose_into(&arguments.out, sentence, arguments.count, &cards, seed, &settings, printer)?
        }
        ("rules", None) => by_rules(arguments, &kinds, printer)?,
        ("llm", _) => by_language_model(arguments, &kinds, printer)?,
        (other, _) => {
            return Err(Failed::misused(format!("unknown designer `{other}`")).hint("expected rules or llm"));
        }
    };
    printer.data(&rows, &describe(&rows, arguments.each));
    let missing = shortfall(&rows);
    for ((kind, _), (count, why)) in &missing {
        let are_missing = if *count == 1 { "task is missing" } else { "tasks are missing" };
        printer.say(format!("{count} {kind} {are_missing}: {why}"));
    }
    let missing: usize = missing.values().map(|(count, _)| count).sum();
    if missing > 0 {
        printer.say(format!("{missing} of {} tasks missing, {} written", rows.len(), rows.len() - missing));
        return Ok(ExitStatus::NotMet);
    }
    Ok(ExitStatus::Done)
}

/// Cards of the objects that tasks may contain: those selected by `--objects`, or the whole catalogue.
fn cards(arguments: &NewArguments) -> Result<Vec<ObjectCard>, Failed> {
    let catalogue = catalogue(&arguments.catalog);
    let cards = match &arguments.objects {
        Some(text) => task_files::select_objects(text, catalogue)?,
        None => catalogue.cards().to_vec(),
    };
    Ok(match robot(arguments)? {
        Some(robot) => graspable_by(&robot, &fitting(&robot, &cards)),
        None => cards,
    })
}

fn design_settings(arguments: &NewArguments) -> Result<DesignSettings, Failed> {
    let settings = DesignSettings { copies: arguments.copies, ..DesignSettings::default() };
    Ok(match robot(arguments)? {
        Some(robot) => settings.scaled_to(&robot),
        None => settings,
    })
}

/// Robot that the tasks are for, if one was named.
fn robot(arguments: &NewArguments) -> Result<Option<Arc<RobotModel>>, Failed> {
    let Some(name) = &arguments.robot else { return Ok(None) };
    Ok(Some(worlds::robot(&worlds::read_world_with(None, Some(name))?)?))
}

fn by_rules(arguments: &NewArguments, kinds: &[TaskKind], printer: &Printer) -> Result<Vec<NewTask>, Failed> {
    let design = Design {
        kinds,
        count: arguments.count,
        cards: &cards(arguments)?,
        seed: Seed::new(arguments.seed),
        settings: design_settings(arguments)?,
        fill: arguments.fill,
        include: arguments.include.as_ref(),
    };
    Ok(design_into(&arguments.out, &design, printer)?)
}

/// New tasks by a language model, the kinds in turn. Task `k` of a kind has its own random stream, so the tasks of a
/// kind do not depend on which other kinds are requested.
fn by_language_model(arguments: &NewArguments, kinds: &[TaskKind], printer: &Printer) -> Result<Vec<NewTask>, Failed> {
    let settings = settings(arguments)?;
    let seed = Seed::new(arguments.seed);
    let designer = Designer::open(&settings, seed)
        .map_err(|error| {
            Failed::because("the language model cannot be asked", &error)
                .hint("docs/guides/language-models.md says what settings, prompts and cassettes hold")
        })?
        .with_surfaces(worlds::read_world(arguments.world.as_deref())?.named_surfaces());
    let counts: Vec<(TaskKind, usize)> = kinds
        .iter()
        .enumerate()
        .map(|(index, &kind)| (kind, (arguments.count + kinds.len() - 1 - index) / kinds.len()))
        .collect();
    let cards = cards(arguments)?;
    // Every answer has been paid for, so it is written as soon as it arrives.
    let written = Mutex::new(BTreeMap::new());
    let rounds = settings.generation.max_rounds;
    let keep = |event: GenerationEvent<'_>| match event {
        GenerationEvent::Asked { id, round } => {
            printer.tell(&format!("{id}, round {round}"));
            printer.note(&format!("{id}: asking, round {round} of at most {rounds}"));
        }
        GenerationEvent::Rejected { id, round } => printer.note(&format!("{id}: {}", rejected(round))),
        GenerationEvent::Done(outcome) => {
            let row = write_outcome(outcome, &arguments.out);
            written.lock().unwrap_or_else(PoisonError::into_inner).insert(outcome.id.clone(), row);
            printer.advance();
        }
    };
    printer.begin("asking", arguments.count);
    let outcomes = designer.generate(&counts, seed, &cards, &keep);
    printer.end();
    let mut written = written.into_inner().unwrap_or_else(PoisonError::into_inner);
    outcomes.iter().filter_map(|outcome| written.remove(&outcome.id)).collect()
}

/// Kinds of flaws of a rejected answer and its number of tokens, as one line.
fn rejected(round: &Round) -> String {
    let mut kinds: Vec<String> =
        round.flaws.iter().filter(|flaw| !flaw.repaired).map(|flaw| flaw.kind.name()).collect();
    kinds.dedup();
    let tokens = round.reply.usage.map_or_else(String::new, |usage| format!(", {} tokens", usage.completion_tokens));
    format!("rejected{tokens}: {}", kinds.join(", "))
}

fn settings(arguments: &NewArguments) -> Result<LlmSettings, Failed> {
    let mut settings = match (arguments.settings.as_deref(), &arguments.folder) {
        (Some(path), _) => {
            let text = documents::read_text(path, limits::SETTINGS)?;
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

fn write_outcome(outcome: &GenerationOutcome, folder: &Path) -> Result<NewTask, Failed> {
    let rounds = folder.join(ROUNDS).join(format!("{}.json", outcome.id));
    documents::write_file(&rounds, outcome.to_json().as_bytes())?;
    match outcome.task() {
        Some(task) => Ok(designed_tasks::write(task, folder)?),
        None => Ok(NewTask {
            task: outcome.id.clone(),
            kind: outcome.kind.name(),
            instruction: None,
            file: None,
            refused: outcome.refusal().map(|why| match &outcome.result {
                Designed::Refused(Refusal::Unanswered { .. }) => format!("{why}\nhint: {}", outcome.hint()),
                _ => why,
            }),
        }),
    }
}

/// Missing tasks by kind and category of reason (the text before its first colon): their number, and the full reason of
/// the last one.
fn shortfall(rows: &[NewTask]) -> BTreeMap<(&'static str, &str), (usize, &str)> {
    let mut missing = BTreeMap::new();
    for (kind, why) in rows.iter().filter_map(|row| Some((row.kind, row.refused.as_deref()?))) {
        let sort = why.split(':').next().unwrap_or_default();
        let (count, last) = missing.entry((kind, sort)).or_insert((0, why));
        (*count, *last) = (*count + 1, why);
    }
    missing
}

/// Table of every task with its instruction. Above [`MAX_ROWS`], one row per kind unless `each` is true.
fn describe(rows: &[NewTask], each: bool) -> String {
    if rows.len() > MAX_ROWS && !each {
        return by_kind(rows);
    }
    let mut lines = vec![["task", "instruction"].map(String::from).to_vec()];
    for row in rows {
        let said = row.instruction.clone().or_else(|| row.refused.as_ref().map(|why| format!("missing: {why}")));
        lines.push(vec![row.task.clone(), said.unwrap_or_default()]);
    }
    text_table(&lines)
}

fn by_kind(rows: &[NewTask]) -> String {
    let mut lines = vec![["kind", "tasks", "missing"].map(String::from).to_vec()];
    let mut line = |name: &str, is_meant: &dyn Fn(&&NewTask) -> bool| {
        let own: Vec<&NewTask> = rows.iter().filter(is_meant).collect();
        let missing = own.iter().filter(|row| row.refused.is_some()).count();
        if !own.is_empty() {
            lines.push(vec![name.to_owned(), (own.len() - missing).to_string(), missing.to_string()]);
        }
    };
    for kind in TaskKind::ALL {
        line(kind.name(), &|row| row.kind == kind.name());
    }
    line("all", &|_| true);
    format!("{}each with --each\n", text_table(&lines))
}
