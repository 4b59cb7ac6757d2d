//! Leaderboard: policies on the same suites, as Markdown and HTML tables.

use std::fmt::Write;

use genmanip_core::TaskKind;
use serde::Serialize;

use crate::evaluation::EvaluationReport;
use crate::report::tables::{rate_bar, table};
use crate::statistics::{KindSummary, Mean, Rate};
use genmanip_viz::markup::escape;

/// Leaderboard of one suite.
#[derive(Clone, Debug, Serialize)]
pub struct Leaderboard {
    /// Name of the suite.
    pub suite: String,
    /// [`crate::suite_hash`] of the suite's scenarios.
    pub suite_hash: String,
    /// Evaluations of policies that observe only what a real robot could, highest success first.
    pub fair: Vec<Entry>,
    /// Evaluations of policies that read simulator truth, highest success first.
    pub oracle: Vec<Entry>,
}

/// Row of one evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Entry {
    /// Label of the evaluation.
    pub label: String,
    /// Source of the masks; `None` for policies that do not segment.
    pub masks: Option<String>,
    /// Success rate at the end of the episodes.
    pub success: Rate,
    /// Success by kind of task.
    pub kinds: Vec<KindSummary>,
    /// Success weighted by path length (SPL); `None` without reference paths.
    pub spl: Option<Mean>,
    /// Simulated duration of the episodes, s.
    pub duration_s: Mean,
    /// Share of episodes with a collision.
    pub collisions: Rate,
    /// Number of episodes that could not be run.
    pub not_run: usize,
}

/// Groups evaluations into one board per suite; boards, and entries of equal success, keep the order of the reports.
pub fn boards(reports: &[EvaluationReport]) -> Vec<Leaderboard> {
    let mut boards: Vec<Leaderboard> = Vec::new();
    for report in reports {
        let at = boards.iter().position(|board| board.suite_hash == report.suite_hash).unwrap_or_else(|| {
            let (suite, suite_hash) = (report.suite.clone(), report.suite_hash.clone());
            boards.push(Leaderboard { suite, suite_hash, fair: Vec::new(), oracle: Vec::new() });
            boards.len() - 1
        });
        let side = if report.oracle { &mut boards[at].oracle } else { &mut boards[at].fair };
        side.push(entry(report));
    }
    for board in &mut boards {
        for side in [&mut board.fair, &mut board.oracle] {
            side.sort_by(|a, b| b.success.value.total_cmp(&a.success.value));
        }
    }
    boards
}

fn entry(report: &EvaluationReport) -> Entry {
    let masks = report.policy.split_whitespace().find_map(|part| part.strip_prefix("masks="));
    Entry {
        label: report.label.clone(),
        masks: masks.map(str::to_owned),
        success: report.summary.success,
        kinds: report.summary.kinds.clone(),
        spl: report.summary.spl,
        duration_s: report.summary.duration_s,
        collisions: report.summary.collisions,
        not_run: report.not_run.len(),
    }
}

/// Functions that render text and rates in a cell, as Markdown or as HTML.
struct Style {
    text: fn(&str) -> String,
    rate: fn(&Rate) -> String,
}

/// Header and rows of a table; a cell without a value is empty.
fn cells(entries: &[Entry], style: &Style) -> (Vec<String>, Vec<Vec<String>>) {
    let is_there = |kind: &TaskKind| entries.iter().any(|entry| entry.kinds.iter().any(|own| own.kind == *kind));
    let kinds: Vec<TaskKind> = TaskKind::ALL.into_iter().filter(is_there).collect();
    let has_masks = entries.iter().any(|entry| entry.masks.is_some());
    let has_left = entries.iter().any(|entry| entry.not_run > 0);
    let mut head = vec!["policy".to_owned()];
    head.extend(has_masks.then(|| "masks".to_owned()));
    head.extend(["episodes", "success"].map(String::from));
    head.extend(kinds.iter().map(|kind| kind.name().replace('_', " ")));
    head.extend(["SPL", "time, s", "collisions"].map(String::from));
    head.extend(has_left.then(|| "not run".to_owned()));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let rows = entries.iter().map(|entry| {
        let mut row = vec![(style.text)(&entry.label)];
        row.extend(has_masks.then(|| (style.text)(entry.masks.as_deref().unwrap_or_default())));
        row.extend([entry.success.trials.to_string(), (style.rate)(&entry.success)]);
        row.extend(kinds.iter().map(|kind| {
            let own = entry.kinds.iter().find(|own| own.kind == *kind);
            own.map_or_else(String::new, |own| percent(own.success.value))
        }));
        row.extend([
            entry.spl.map_or_else(String::new, |spl| format!("{:.3}", spl.value)),
            format!("{:.1}", entry.duration_s.value),
            percent(entry.collisions.value),
        ]);
        row.extend(has_left.then(|| entry.not_run.to_string()));
        row
    });
    (head, rows.collect())
}

/// The two tables of a board with their titles; empty ones are omitted.
fn tables(board: &Leaderboard) -> impl Iterator<Item = (&'static str, &[Entry])> {
    [("Policies", board.fair.as_slice()), ("With simulator truth (oracle)", board.oracle.as_slice())]
        .into_iter()
        .filter(|(_, entries)| !entries.is_empty())
}

/// The boards as Markdown.
pub fn leaderboard_markdown(boards: &[Leaderboard]) -> String {
    let safe: fn(&str) -> String = |text| text.replace('|', "\\|").replace(['\n', '\r'], " ");
    let style = Style {
        text: safe,
        rate: |rate| {
            let [value, low, high] = [rate.value, rate.low, rate.high].map(|share| format!("{:.1}", 100.0 * share));
            format!("{value} % ({low}–{high})")
        },
    };
    let mut text = String::from("# Leaderboard\n");
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    for board in boards {
        let _ = writeln!(text, "\n## {} ({})", safe(&board.suite), board.suite_hash);
        for (title, entries) in tables(board) {
            let (head, rows) = cells(entries, &style);
            let rule = vec!["---".to_owned(); head.len()];
            let _ = write!(text, "\n### {title}\n\n{}{}", line(&head), line(&rule));
            text.extend(rows.iter().map(|row| line(row)));
        }
    }
    text
}

/// The boards as a self-contained HTML file that is complete without scripts.
pub fn leaderboard_html(boards: &[Leaderboard]) -> String {
    let style = Style { text: escape, rate: rate_bar };
    let mut html = format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n",
            "<meta name=\"color-scheme\" content=\"light dark\" />\n<title>GenManip leaderboard</title>\n",
            "<style>\n{}</style>\n</head>\n<body>\n<header>\n<p class=\"kicker\">GenManip</p>\n<h1>Leaderboard</h1>\n",
            "<p class=\"lead\">Success means that the goal holds at the end, after settling; intervals ",
            "are 95&#160;%. <code>genmanip compare</code> tests two policies on the same suite: it pairs their ",
            "episodes.</p>\n</header>\n<main>\n"
        ),
        include_str!("report/style.css")
    );
    for board in boards {
        let (suite, hash) = (escape(&board.suite), escape(&board.suite_hash));
        let _ = writeln!(html, "<section>\n<h2>{suite}</h2>\n<p>Scenarios <code>{hash}</code></p>");
        for (title, entries) in tables(board) {
            let (head, rows) = cells(entries, &style);
            let head: Vec<&str> = head.iter().map(String::as_str).collect();
            let _ = write!(html, "<h3>{title}</h3>\n{}", table("figures", &head, &rows));
        }
        html += "</section>\n";
    }
    html + "</main>\n</body>\n</html>\n"
}
