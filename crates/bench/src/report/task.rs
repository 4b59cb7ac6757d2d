//! One task: what was asked, what the scene was, what happened, and how it was judged.

use std::fmt::Write;

use genmanip_core::{Atom, AtomVerdict, AttemptOutcome, EpisodeResult, GoalVerdict, Task};

use super::overview::yield_chip;
use super::tables::{quantity_text, seconds_text, table, threshold_text};
use super::{ImagePlan, TaskSection, chip, image, words};
use crate::drawing::letter;
use crate::markup::escape;

pub(super) fn section(index: usize, section: &TaskSection, plan: ImagePlan) -> String {
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
        kind = chip("plain", &words(task.kind.name())),
        yielded = yield_chip(section),
        description = escape(&task.scene_graph.description),
    );
    html += "<div class=\"drawings\">\n";
    let _ = writeln!(
        html,
        "<figure><div class=\"paper\">{}</div><figcaption>Scene graph: the start, and what the goal asks for.</figcaption></figure>",
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
    if let Some(shown) = &section.shown {
        html += &verdict(task, shown);
    }
    html += "<div class=\"two\">\n";
    html += &attempts(section);
    html += &results(&section.results);
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
    let several = alternatives.len() > 1;
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (index, atoms) in alternatives.iter().enumerate() {
        for atom in atoms {
            let name =
                if several { format!("<span class=\"letter\">{}</span> ", letter(index)) } else { String::new() };
            rows.extend(atom_rows(task, name, atom));
        }
    }
    html += &table("verdict", &["Condition", "Holds", "Measured", "Value", "Threshold", "Margin"], &rows);
    if several {
        html += "<p class=\"note\">One alternative is enough; the letters are those of the drawing.</p>\n";
    }
    html
}

/// One row per measured quantity, the condition itself only in the first.
fn atom_rows(task: &Task, prefix: String, verdict: &AtomVerdict) -> Vec<Vec<String>> {
    let holds = if verdict.holds { chip("good", "holds") } else { chip("bad", "does not hold") };
    let condition = format!(
        "{prefix}{}<span class=\"why\">{}</span>",
        atom_markup(task, &verdict.atom),
        escape(&verdict.explanation)
    );
    if verdict.measurements.is_empty() {
        let dash = || "<span class=\"muted\">none</span>".to_owned();
        return vec![vec![condition, holds, dash(), dash(), dash(), format!("{:+.4}", verdict.margin)]];
    }
    let mut lead = Some((condition, holds));
    verdict
        .measurements
        .iter()
        .map(|measurement| {
            let (condition, holds) = lead.take().unwrap_or_default();
            let margin = quantity_text(measurement.margin, &measurement.unit);
            let sign = if measurement.margin >= 0.0 { "+" } else { "" };
            vec![
                condition,
                holds,
                escape(&measurement.quantity),
                escape(&quantity_text(measurement.value, &measurement.unit)),
                escape(&threshold_text(measurement)),
                format!(
                    "<span class=\"{}\">{}</span>",
                    if measurement.met { "met" } else { "missed" },
                    escape(&format!("{sign}{margin}"))
                ),
            ]
        })
        .collect()
}

/// A condition with names instead of uids.
fn atom_markup(task: &Task, atom: &Atom) -> String {
    let name = |uid: &str| format!("<b>{}</b>", escape(task.card(uid).map_or(uid, |card| card.name.as_str())));
    match atom {
        Atom::State { object, state } => format!("{} is <em>{}</em>", name(object), escape(state)),
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_ref().map_or(String::new(), |second| format!(" and {}", name(second)));
            format!("{} <em>{}</em> {}{second}", name(subject), relation.name(), name(reference))
        }
    }
}

fn attempts(section: &TaskSection) -> String {
    let rows: Vec<Vec<String>> = section
        .attempts
        .iter()
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
    format!("<div>\n<h3>Attempts</h3>\n{}</div>\n", table("list", &["Attempt", "Outcome", "Wall time"], &rows))
}

fn results(results: &[EpisodeResult]) -> String {
    let rows: Vec<Vec<String>> = results
        .iter()
        .map(|result| {
            let outcome = match (result.success, result.success_once) {
                (true, _) => chip("good", "success"),
                (false, true) => chip("fair", "once, not at the end"),
                (false, false) => chip("bad", "no success"),
            };
            let reason = result.failure.as_ref().map_or(String::new(), |failure| {
                format!("<span class=\"why\">{}: {}</span>", words(failure.cause.name()), escape(&failure.evidence))
            });
            let oracle = if result.oracle { chip("warn", "oracle") } else { String::new() };
            vec![
                format!(
                    "{}{oracle}<span class=\"why\">{}</span>",
                    escape(&words(&result.policy)),
                    escape(&result.scenario_id)
                ),
                outcome + &reason,
                format!("{:.2}", result.verdict.score),
                format!("{:.1} s", result.duration_s),
                format!("{:.2} m", result.tcp_path_m),
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let headings = ["Policy", "Outcome", "Score", "Duration", "Path"];
    format!("<div>\n<h3>Evaluation</h3>\n{}</div>\n", table("list", &headings, &rows))
}
