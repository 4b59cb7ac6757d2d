//! Requests tasks from a model, validates every answer and requests repairs, up to a maximum number of rounds.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use genmanip_core::{NamedSurface, ObjectCard, Seed, TaskKind};
use genmanip_llm::{CassetteChat, CassetteMode, ChatModel, ChatRequest, FolderChat, Message, SettingsError};
use genmanip_tasks::answer::{AnswerReport, FlawKind, TaskRequest, check_answer};
use serde_json::{Map, Value};

use crate::outcome::{Designed, GenerationOutcome, Refusal, Round};
use crate::prompt::{PromptError, PromptSet};
use crate::sampling::sample_objects;
use crate::settings::{GenerationSettings, LlmSettings};

/// Maximum instruction length (words).
const MAX_WORDS: usize = 30;
/// Maximum number of consecutive tasks with server failures; the remaining tasks are then skipped.
const MAX_UNANSWERED: u32 = 3;
/// Maximum length of the violation list (bytes).
const MAX_VIOLATION_BYTES: usize = 16 << 10;
/// Minimum share of common words at which a repaired answer counts as hardly changed. Chosen by hand: small models that
/// repair nothing keep more, and a repair of one condition in an answer of usual length keeps more only if other flaws
/// remain.
const UNCHANGED_SHARE: f64 = 0.9;

/// Generates `count` tasks of one kind with objects from `cards`; one outcome per task, in order.
///
/// Each task has its own random stream and conversation, so results do not depend on the number of workers.
///
/// # Errors
/// Fails if the settings are invalid, the key is missing or a prompt file is invalid; failures of single tasks are in
/// their outcomes.
pub fn generate(
    settings: &LlmSettings,
    kind: TaskKind,
    count: usize,
    seed: Seed,
    cards: &[ObjectCard],
) -> Result<Vec<GenerationOutcome>, DesignerError> {
    Ok(Designer::open(settings, seed)?.generate(&[(kind, count)], seed, cards, &|_| {}))
}

/// Progress event of a running generation.
#[derive(Clone, Copy, Debug)]
pub enum GenerationEvent<'a> {
    /// A request was sent to the model.
    Asked {
        /// Id of the task.
        id: &'a str,
        /// Number of the round, from 1.
        round: u32,
    },
    /// An answer was rejected.
    Rejected {
        /// Id of the task.
        id: &'a str,
        /// The rejected answer with its flaws.
        round: &'a Round,
    },
    /// A task succeeded, or failed for good.
    Done(&'a GenerationOutcome),
}

/// Reason why a task writer cannot be set up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DesignerError {
    /// The settings are invalid; the wrapped error names the line or field.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A prompt file cannot be read or is invalid.
    #[error(transparent)]
    Prompt(#[from] PromptError),
}

/// A task writer: model, prompts and settings.
pub struct Designer {
    model: Box<dyn ChatModel>,
    prompts: PromptSet,
    settings: GenerationSettings,
    model_name: String,
    parameters: Map<String, Value>,
    surfaces: Vec<NamedSurface>,
}

impl Designer {
    /// Creates a task writer from settings. Replay needs neither a key nor a server.
    ///
    /// # Errors
    /// As [`generate`].
    pub fn open(settings: &LlmSettings, seed: Seed) -> Result<Self, DesignerError> {
        settings.check()?;
        if let Some(folder) = settings.folder.as_ref().filter(|_| settings.cassettes.mode != CassetteMode::Replay) {
            let model = FolderChat::new(folder.clone())?;
            return Self::with_model(CassetteChat::new(model, settings.cassettes.clone(), None), settings);
        }
        let model = CassetteChat::open(&settings.server, &settings.cassettes, seed.fork("retries"))?;
        Self::with_model(model, settings)
    }

    /// Creates a task writer with any model, for example a [script](genmanip_llm::fake::ScriptedChat).
    ///
    /// # Errors
    /// Fails if the settings or a prompt file are invalid.
    pub fn with_model(model: impl ChatModel + 'static, settings: &LlmSettings) -> Result<Self, DesignerError> {
        settings.check()?;
        Ok(Self {
            model: Box::new(model),
            prompts: PromptSet::load(settings.generation.prompts.as_deref())?,
            settings: settings.generation.clone(),
            model_name: settings.server.model.clone(),
            parameters: settings.server.parameters.clone(),
            surfaces: Vec::new(),
        })
    }

    /// Offers the support surfaces of a world other than the table as references, too.
    #[must_use]
    pub fn with_surfaces(self, surfaces: Vec<NamedSurface>) -> Self {
        Self { surfaces, ..self }
    }

    /// Generates this many tasks of each kind, one outcome per task in the order of the kinds; calls `on_event` on the
    /// worker threads. All workers serve all kinds; otherwise like the function [`generate`].
    pub fn generate(
        &self,
        kinds: &[(TaskKind, usize)],
        seed: Seed,
        cards: &[ObjectCard],
        on_event: &(dyn Fn(GenerationEvent<'_>) + Sync),
    ) -> Vec<GenerationOutcome> {
        let tasks: Vec<(TaskKind, usize)> =
            kinds.iter().flat_map(|&(kind, count)| (0..count).map(move |index| (kind, index))).collect();
        let next = AtomicUsize::new(0);
        let unanswered = AtomicU32::new(0);
        let outcomes = Mutex::new(Vec::with_capacity(tasks.len()));
        let work = || {
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let Some(&(kind, index)) = tasks.get(number) else { return };
                let ask = unanswered.load(Ordering::Relaxed) < MAX_UNANSWERED;
                let outcome = self.one_of_many((kind, index), seed, cards, ask, on_event);
                match &outcome.result {
                    Designed::Refused(Refusal::NotAsked) => {}
                    Designed::Refused(Refusal::Unanswered { error }) if error.is_service_trouble() => {
                        unanswered.fetch_add(1, Ordering::Relaxed);
                    }
                    _ => unanswered.store(0, Ordering::Relaxed),
                }
                on_event(GenerationEvent::Done(&outcome));
                if let Ok(mut outcomes) = outcomes.lock() {
                    outcomes.push((number, outcome));
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.settings.workers.min(tasks.len()) {
                scope.spawn(work);
            }
            work();
        });
        let mut outcomes = outcomes.into_inner().unwrap_or_default();
        outcomes.sort_by_key(|(number, _)| *number);
        outcomes.into_iter().map(|(_, outcome)| outcome).collect()
    }

    fn one_of_many(
        &self,
        (kind, index): (TaskKind, usize),
        seed: Seed,
        cards: &[ObjectCard],
        ask: bool,
        on_event: &dyn Fn(GenerationEvent<'_>),
    ) -> GenerationOutcome {
        let stream = seed.fork("llm task").fork(kind.name()).fork_index(index as u64);
        let offered = sample_objects(cards, kind, &self.settings.sampling, stream.fork("objects"));
        let request = TaskRequest {
            id: format!("llm_{}_{seed}_{index:04}", kind.name()),
            kind,
            offered: offered.clone().unwrap_or_default(),
            surfaces: self.surfaces.clone(),
            min_objects: self.settings.min_objects,
            between: false,
            source: format!("language model {}", self.model_name),
        };
        match offered {
            Err(error) => self.outcome(&request, Vec::new(), Designed::Refused(Refusal::NoObjects { error })),
            Ok(_) if !ask => self.outcome(&request, Vec::new(), Designed::Refused(Refusal::NotAsked)),
            Ok(_) => self.converse(&request, on_event),
        }
    }

    /// Generates one task with the objects of the request, including repair rounds.
    pub fn design(&self, request: &TaskRequest) -> GenerationOutcome {
        self.converse(request, &|_| {})
    }

    fn converse(&self, request: &TaskRequest, on_event: &dyn Fn(GenerationEvent<'_>)) -> GenerationOutcome {
        let mut rounds: Vec<Round> = Vec::new();
        let mut conversation = self.asked(request, "");
        for number in 1..=self.settings.max_rounds {
            on_event(GenerationEvent::Asked { id: &request.id, round: number });
            let key = conversation.key();
            let reply = match self.model.chat(&conversation) {
                Ok(reply) => reply,
                Err(error) => {
                    return self.outcome(request, rounds, Designed::Refused(Refusal::Unanswered { error }));
                }
            };
            let report = check_answer(&reply.text, request);
            let found = violations(&report);
            let AnswerReport { verdict, flaws, repairs, task, .. } = report;
            let is_cut_off = reply.is_cut_off();
            let round = Round { key, reply, verdict, flaws, repairs };
            if rounds.last().is_some_and(|before| has_hardly_changed(before, &round)) {
                // A model tends to repeat its own words in the conversation, so the new conversation omits them.
                conversation = self.asked(request, &format!("\n\n{}", self.prompts.restart_text(&found)));
            } else {
                conversation.messages.push(Message::assistant(self.quoted(&round.reply.text)));
                conversation.messages.push(Message::user(self.prompts.repair_text(&found)));
            }
            if task.is_none() {
                on_event(GenerationEvent::Rejected { id: &request.id, round: &round });
            }
            rounds.push(round);
            if let Some(task) = task {
                return self.outcome(request, rounds, Designed::Task(Box::new(task)));
            }
            if is_cut_off {
                return self.outcome(request, rounds, Designed::Refused(Refusal::CutOff));
            }
        }
        self.outcome(request, rounds, Designed::Refused(Refusal::Invalid))
    }

    /// Conversation that begins with the request, followed by the text `more`.
    fn asked(&self, request: &TaskRequest, more: &str) -> ChatRequest {
        let prompts = &self.prompts;
        ChatRequest {
            model: self.model_name.clone(),
            messages: vec![
                Message::system(prompts.system_text(MAX_WORDS)),
                Message::user(format!("{}{more}", prompts.request_text(request))),
            ],
            reply_schema: Some(prompts.reply_schema(request)),
            parameters: self.parameters.clone(),
        }
    }

    fn quoted(&self, answer: &str) -> String {
        truncated(answer, self.settings.max_quoted_bytes, "\n… (the rest is left out here)")
    }

    fn outcome(&self, request: &TaskRequest, rounds: Vec<Round>, result: Designed) -> GenerationOutcome {
        GenerationOutcome {
            id: request.id.clone(),
            kind: request.kind,
            model: self.model_name.clone(),
            prompts: self.prompts.stamps(request.kind),
            offered: request.ids(),
            min_objects: request.min_objects,
            rounds,
            result,
        }
    }
}

/// True if a repaired answer keeps most words of the rejected one, and some of its flaws.
fn has_hardly_changed(before: &Round, after: &Round) -> bool {
    let kinds = |round: &Round| -> BTreeSet<FlawKind> {
        round.flaws.iter().filter(|flaw| !flaw.repaired).map(|flaw| flaw.kind).collect()
    };
    common_share(&before.reply.text, &after.reply.text) >= UNCHANGED_SHARE && !kinds(before).is_disjoint(&kinds(after))
}

/// Share of words that two texts have in common, each as often as it occurs (Sørensen–Dice coefficient).
fn common_share(one: &str, other: &str) -> f64 {
    let words = |text: &str| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for word in text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()) {
            *counts.entry(word.to_lowercase()).or_default() += 1;
        }
        counts
    };
    let (one, other) = (words(one), words(other));
    let common: usize = one.iter().map(|(word, count)| other.get(word).map_or(0, |also| *also.min(count))).sum();
    let all = one.values().sum::<usize>() + other.values().sum::<usize>();
    2.0 * common as f64 / all.max(1) as f64
}

/// Unrepaired violations, one line each.
fn violations(report: &AnswerReport) -> String {
    let mut text = String::new();
    for flaw in report.flaws.iter().filter(|flaw| !flaw.repaired) {
        let hint = if flaw.hint.is_empty() { String::new() } else { format!(" ({})", flaw.hint) };
        text += &format!("- {} at {}: {}{hint}\n", flaw.kind.name(), flaw.path, flaw.message);
    }
    if report.flaws_left_out > 0 {
        text += &format!("- and {} more\n", report.flaws_left_out);
    }
    truncated(text.trim_end(), MAX_VIOLATION_BYTES, "\n- and more")
}

fn truncated(text: &str, max_bytes: usize, remark: &str) -> String {
    if text.len() <= max_bytes {
        return text.to_owned();
    }
    let end = (0..=max_bytes).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    format!("{}{remark}", &text[..end])
}
