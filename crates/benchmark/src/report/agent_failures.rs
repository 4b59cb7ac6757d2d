//! Report section on failures of the agent: class by kind of task, and class by stage.

use std::collections::BTreeSet;

use genmanip_core::{AgentFailure, AgentStage, FailureClass, TaskKind};

use super::tables::table;
use super::{ReportInput, words};
use crate::failure_page::{KindFailures, chart};
use crate::rows::EpisodeRow;
use crate::statistics::{SuiteSummary, agent_failure_counts};
use genmanip_viz::markup::escape;

/// Label of failures without a class.
const UNCLASSIFIED: &str = "not analysed";

/// One part per evaluation of an agent with failures.
pub(super) fn agent_failures(input: &ReportInput) -> String {
    let failed = input.summaries.iter().filter(|summary| !summary.agent_failures.is_empty());
    failed.map(|summary| of_policy(input, summary)).collect()
}

fn of_policy(input: &ReportInput, summary: &SuiteSummary) -> String {
    let own: Vec<&EpisodeRow> =
        input.episodes.iter().filter(|row| row.evaluation.as_deref() == Some(&summary.policy)).collect();
    let kinds: Vec<KindFailures> = TaskKind::ALL.into_iter().filter_map(|kind| of_kind(input, &own, kind)).collect();
    let counts = &summary.agent_failures;
    let classes: Vec<Option<FailureClass>> =
        all_classes().filter(|class| counts.iter().any(|entry| entry.class == *class)).collect();
    let stages: BTreeSet<AgentStage> = counts.iter().map(|entry| entry.stage).collect();
    let sum = |class: Option<FailureClass>, stage: Option<AgentStage>| -> usize {
        let is_meant = |stage_of| stage.is_none_or(|stage| stage == stage_of);
        counts.iter().filter(|entry| entry.class == class && is_meant(entry.stage)).map(|entry| entry.count).sum()
    };
    let cell = |count: usize| if count == 0 { "·".to_owned() } else { count.to_string() };
    let rows: Vec<Vec<String>> = classes
        .into_iter()
        .map(|class| {
            let cells = stages.iter().map(|stage| cell(sum(class, Some(*stage))));
            let name = escape(&class_name(class));
            std::iter::once(name).chain(cells).chain([cell(sum(class, None))]).collect()
        })
        .collect();
    let stages: Vec<String> = stages.into_iter().map(|stage| words(stage.name())).collect();
    let headings: Vec<&str> =
        std::iter::once("Class").chain(stages.iter().map(String::as_str)).chain(["All stages"]).collect();
    format!(
        "<h3>Failures of the agent: {}</h3>\n{}{}<p class=\"note\">Class: of the first wrong step that was not taken \
         back. Stage: where that step was taken, or where the agent stopped.{}</p>\n",
        escape(&words(&summary.policy)),
        chart(&kinds),
        table("figures", &headings, &rows),
        if counts.iter().any(|entry| entry.class.is_none()) {
            " Classes need the simulator's truth: evaluate with <code>agent:…,analysis=yes</code>."
        } else {
            ""
        },
    )
}

/// Failures of one kind of task by class; `None` without episodes.
fn of_kind(input: &ReportInput, own: &[&EpisodeRow], kind: TaskKind) -> Option<KindFailures> {
    let is_of = |row: &&&EpisodeRow| input.tasks.get(row.task).is_some_and(|task| task.kind == kind);
    let rows: Vec<&&EpisodeRow> = own.iter().filter(is_of).collect();
    let counts = agent_failure_counts(rows.iter().filter_map(|row| row.outcome.agent_failure.as_ref()));
    let count = |class: Option<FailureClass>| -> usize {
        counts.iter().filter(|entry| entry.class == class).map(|entry| entry.count).sum()
    };
    (!rows.is_empty()).then(|| KindFailures {
        kind: kind.name().into(),
        episodes: rows.len(),
        causes: all_classes().map(|class| (class_name(class), count(class))).collect(),
    })
}

/// All failure classes, then `None` for failures without one.
fn all_classes() -> impl Iterator<Item = Option<FailureClass>> {
    FailureClass::ALL.into_iter().map(Some).chain([None])
}

fn class_name(class: Option<FailureClass>) -> String {
    class.map_or_else(|| UNCLASSIFIED.into(), |class| words(class.name()))
}

/// Class, stage and evidence as markup, with a link to the transcript.
pub(super) fn failure_markup(failure: &AgentFailure) -> String {
    let stage = words(failure.stage.name());
    let class = match failure.class {
        Some(class) => format!("{} at {stage}", words(class.name())),
        None => format!("stopped at {stage}"),
    };
    let evidence = if failure.evidence.is_empty() { String::new() } else { format!(": {}", failure.evidence) };
    let transcript = failure
        .transcript
        .as_ref()
        .map_or_else(String::new, |path| format!(" <a href=\"{}\">transcript</a>", escape(path)));
    format!("{}{transcript}", escape(&(class + &evidence)))
}
