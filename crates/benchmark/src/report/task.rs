//! Report section on one task: instruction, scene, episode and verdict.

use std::fmt::Write;

use genmanip_core::{
    Atom, AtomVerdict, AttemptOutcome, Correction, EpisodeResult, Failure, GoalVerdict, Measurement, ReferenceId, Task,
};

use super::agent_failures::failure_markup;
use super::overview::{why_chips, yield_chip};
use super::tables::{causes_text, margin_text, quantity_text, seconds_text, table, threshold_text};
use super::{ImagePlan, TaskSection, chip, image, words};
use crate::statistics::failure_counts;
use genmanip_viz::drawing::letter;
use genmanip_viz::markup::escape;

pub(super) fn section(index: usize, section: &TaskSection, baseline: Option<&str>, plan: ImagePlan) -> String {
    let task = &section.task;
    let mut html = format!(
        concat!(
            "<article id=\"task-{number}\">\n<p class=\"kicker\"><a href=\"#task-{number}\">{id}</a></p>\n",
            "<h2 class=\"instruction\">{instruction}</h2>\n<p class=\"chips\">{kind}{yielded}</p>\n",
            "<p class=\"description\">{description}</p>\n"
        ),
        number = index + 1,
        id = escape(&task.id),
        instruction = escape(&task.instruction),
        kind = why_chips(section).unwrap_or_default() + &chip("plain", &words(task.kind.name())),
        yielded = yield_chip(section),
        description = escape(&task.scene_graph.description),
    );
    html += "<div class=\"drawings\">\n";
    let _ = writeln!(
        html,
        "<figure><div class=\"paper\">{}</div><figcaption>Scene graph: initial scene and goal.</figcaption></figure>",
        section.graph
    );
    if let Some(layout) = &section.layout {
        let caption = match &section.scenario {
            Some(scenario) => format!("Layout {} from above, seed {}.", scenario.id, scenario.seed),
            None => "Layout from above.".into(),
        };
        let _ = writeln!(
            html,
            "<figure><div class=\"paper\">{layout}</div><figcaption>{}</figcaption></figure>",
            escape(&caption)
        );
    }
    html += "</div>\n";
    html += &pictures(section, plan);
    if let Some(shown) = section.shown.as_ref().filter(|shown| !shown.verdict.alternatives.is_empty()) {
        html += &verdict(task, shown);
    }
    html += "<div class=\"two\">\n";
    html += &attempts(section);
    html += &results(&section.results, baseline);
    html + "</div>\n</article>\n"
}

fn pictures(section: &TaskSection, plan: ImagePlan) -> String {
    let episode = section.shown.as_ref();
    let stills: String = [("start", &section.first_image), ("end", &section.last_image)]
        .into_iter()
        .filter_map(|(name, jpeg)| Some((name, jpeg.as_ref()?)))
        .map(|(name, jpeg)| {
            let time = match (name, episode) {
                ("end", Some(episode)) => format!("End, {:.1} s", episode.duration_s),
                ("end", None) => "End".into(),
                _ => "Start, 0.0 s".into(),
            };
            format!(
                "<figure class=\"{name}\">{}<figcaption>{}</figcaption></figure>\n",
                image(jpeg, &format!("Scene at the {name}")),
                escape(&time)
            )
        })
        .collect();
    let frames: String = plan
        .film(section)
        .map(|frame| {
            let time = format!("{:.1} s", frame.time_s);
            format!("<li>{}<span>{}</span></li>\n", image(&frame.jpeg, &format!("Scene at {time}")), escape(&time))
        })
        .collect();
    let mut html = String::new();
    if !stills.is_empty() {
        let _ = write!(html, "<div class=\"stills\">\n{stills}</div>\n");
    }
    if !frames.is_empty() {
        let _ = write!(html, "<ol class=\"film\">\n{frames}</ol>\n");
    }
    html
}

fn verdict(task: &Task, shown: &EpisodeResult) -> String {
    let GoalVerdict { score, success, alternatives } = &shown.verdict;
    let mut html = format!(
        "<h3>Verdict of {} {}<span class=\"muted\"> score {score:.2}, policy {}{}</span></h3>\n",
        escape(&shown.id),
        if *success { chip("good", "goal holds") } else { chip("bad", "goal does not hold") },
        escape(&words(&shown.policy)),
        if shown.oracle { ", oracle" } else { "" },
    );
    html += &shown.correction.as_ref().map_or_else(String::new, |correction| taken_over(correction, shown));
    if let Some(failure) = &shown.agent_failure {
        let _ = writeln!(html, "<p class=\"note\">Agent: {}</p>", failure_markup(failure));
    }
    let several = alternatives.len() > 1;
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (index, atoms) in alternatives.iter().enumerate() {
        for atom in atoms {
            let name =
                if several { format!("<span class=\"letter\">{}</span> ", letter(index)) } else { String::new() };
            rows.push(atom_row(task, &name, atom));
        }
    }
    html += &table("verdict", &["Condition", "Holds", "Measured", "Value", "Threshold", "Margin"], &rows);
    if several {
        html += "<p class=\"note\">One alternative is enough; the letters are those of the drawing.</p>\n";
    }
    html
}

/// Description of a take-over: policy that acted first, time of the take-over, and reason.
fn taken_over(correction: &Correction, episode: &EpisodeResult) -> String {
    let after_s = correction.from_step as f64 / episode.control_rate_hz;
    let why = match correction.failures.first() {
        Some(Failure { cause, evidence }) => format!(", which had failed: {}, {evidence}", words(cause.name())),
        None => String::new(),
    };
    let text = format!("Taken over after {after_s:.1} s from {}{why}.", words(&correction.policy));
    format!("<p class=\"note\">{}</p>\n", escape(&text))
}

/// Table row of a condition: the condition, then cells with one line per measurement.
fn atom_row(task: &Task, prefix: &str, verdict: &AtomVerdict) -> Vec<String> {
    let holds = if verdict.holds { chip("good", "holds") } else { chip("bad", "does not hold") };
    let why = escape(&verdict.explanation);
    let condition = format!("{prefix}{}<span class=\"why\">{why}</span>", atom_markup(task, &verdict.atom));
    let lines = |text: &dyn Fn(&Measurement) -> String| -> String {
        let line = |measurement| format!("<span class=\"line\">{}</span>", text(measurement));
        let other = |measurement| format!("<span class=\"line muted\">{}</span>", text(measurement));
        verdict.measurements.iter().map(line).chain(verdict.other_readings.iter().map(other)).collect()
    };
    let margin = |measurement: &Measurement| {
        let class = if measurement.met { "met" } else { "missed" };
        format!("<span class=\"{class}\">{}</span>", escape(&margin_text(measurement)))
    };
    vec![
        condition,
        holds,
        lines(&|measurement| escape(&measurement.quantity)),
        lines(&|measurement| escape(&quantity_text(measurement.value, measurement.unit))),
        lines(&|measurement| escape(&threshold_text(measurement))),
        lines(&margin),
    ]
}

/// HTML of a condition with names of objects instead of ids.
fn atom_markup(task: &Task, atom: &Atom) -> String {
    let name = |id: &ReferenceId| format!("<b>{}</b>", escape(&task.name_of(id)));
    match atom {
        Atom::State { object, state } => format!("{} is <em>{}</em>", name(object), escape(state)),
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_ref().map_or(String::new(), |second| format!(" and {}", name(second)));
            format!("{} <em>{}</em> {}{second}", name(subject), relation.name(), name(reference))
        }
    }
}

/// Maximum number of attempts listed in a section; the table of episodes has all.
const SHOWN_ATTEMPTS: usize = 24;

fn attempts(section: &TaskSection) -> String {
    let mut rows: Vec<Vec<String>> = section
        .attempts
        .iter()
        .take(SHOWN_ATTEMPTS)
        .map(|attempt| {
            let (outcome, reason) = match &attempt.outcome {
                AttemptOutcome::Verified => (chip("good", "verified"), String::new()),
                AttemptOutcome::Failed(failure) => (
                    chip("bad", &words(failure.cause.name())),
                    format!("<span class=\"why\">{}</span>", escape(&failure.evidence)),
                ),
            };
            vec![escape(&attempt.id), outcome + &reason, escape(&seconds_text(attempt.seconds))]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    if section.attempts.len() > SHOWN_ATTEMPTS {
        let more = section.attempts.len() - SHOWN_ATTEMPTS;
        rows.push(vec![format!("and {more} more"), "in the table of all episodes".into(), String::new()]);
    }
    format!("<div>\n<h3>Attempts</h3>\n{}</div>\n", table("list", &["Attempt", "Outcome", "Wall time"], &rows))
}

/// Maximum number of failed episodes quoted in a policy's row; the evaluation's file has all.
const SHOWN_REASONS: usize = 2;

/// Table of the results by policy, with failure causes; a row per policy.
fn results(results: &[EpisodeResult], baseline: Option<&str>) -> String {
    let mut policies: Vec<&str> = Vec::new();
    for result in results {
        if !policies.contains(&result.policy.as_str()) {
            policies.push(&result.policy);
        }
    }
    let rows: Vec<Vec<String>> = policies
        .into_iter()
        .map(|policy| {
            let own: Vec<&EpisodeResult> = results.iter().filter(|result| result.policy == policy).collect();
            let successes = own.iter().filter(|result| result.success).count();
            let class = match (baseline == Some(policy), successes) {
                (true, 0) => "plain",
                (true, _) | (false, 0) => "bad",
                (false, all) if all == own.len() => "good",
                _ => "fair",
            };
            let failed: Vec<_> = own.iter().filter_map(|result| Some((result, result.failure()?))).collect();
            let mut reasons = String::new();
            if !failed.is_empty() {
                let counts = causes_text(&failure_counts(failed.iter().map(|(_, failure)| failure.cause)));
                let _ = write!(reasons, "<span class=\"why\">{counts}</span>");
            }
            for (result, failure) in failed.iter().take(SHOWN_REASONS) {
                let text = escape(&format!("{}: {}", result.id, failure.evidence));
                let agent = result.agent_failure.as_ref().map(failure_markup);
                let agent = agent.map_or_else(String::new, |agent| format!(" Agent: {agent}"));
                let _ = write!(reasons, "<span class=\"why\">{text}{agent}</span>");
            }
            if failed.len() > SHOWN_REASONS {
                let _ = write!(reasons, "<span class=\"why\">and {} more</span>", failed.len() - SHOWN_REASONS);
            }
            let mean = |value: &dyn Fn(&EpisodeResult) -> f64| {
                own.iter().map(|result| value(result)).sum::<f64>() / own.len().max(1) as f64
            };
            let oracle = if own.iter().any(|result| result.oracle) { chip("warn", "oracle") } else { String::new() };
            vec![
                escape(&words(policy)) + &oracle,
                chip(class, &format!("{successes} of {} succeeded", own.len())) + &reasons,
                format!("{:.2}", mean(&|result| result.verdict.score)),
                format!("{:.1} s", mean(&|result| result.duration_s)),
                format!("{:.2} m", mean(&|result| result.tcp_path_m)),
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let headings = ["Policy", "Outcome", "Mean score", "Duration", "Path"];
    format!("<div>\n<h3>Evaluation</h3>\n{}</div>\n", table("list", &headings, &rows))
}
