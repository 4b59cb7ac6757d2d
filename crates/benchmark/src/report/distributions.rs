//! Report section on distributions over a run: causes of failure, relations, objects, lengths and times.

use std::collections::BTreeMap;

use genmanip_core::FailureCause;

use super::tables::{causes_text, rate_bar, table};
use super::{ReportInput, words};
use crate::rows::EpisodeRow;
use crate::rows::cases::ExampleOf;
use crate::rows::totals::{GroupTotal, Histogram, by_group};
use crate::statistics::{StatisticsSettings, failure_counts};
use genmanip_viz::markup::escape;

/// Minimum number of episodes for a histogram.
const MIN_EPISODES: usize = 20;

/// Maximum number of objects listed, most failures first.
const OBJECTS: usize = 12;

/// Number of bins of a histogram.
const RANGES: usize = 12;

/// Section about the attempts at demonstrations, or, if there are none, about the evaluated episodes except the
/// baseline's.
pub(super) fn distributions(input: &ReportInput, statistics: &StatisticsSettings) -> String {
    let has_attempts = input.episodes.iter().any(EpisodeRow::is_attempt);
    let is_meant = |row: &&EpisodeRow| match has_attempts {
        true => row.is_attempt(),
        false => row.evaluation.as_deref() != input.baseline.as_deref(),
    };
    let rows: Vec<&EpisodeRow> = input.episodes.iter().filter(is_meant).collect();
    if rows.len() < MIN_EPISODES {
        return String::new();
    }
    let relations = by_group(&input.tasks, &rows, |task| task.goal.to_vec(), statistics);
    let objects = by_group(&input.tasks, &rows, |task| task.objects.iter().map(String::as_str).collect(), statistics);
    let failing: Vec<GroupTotal> =
        objects.into_iter().filter(|total| !total.failures.is_empty()).take(OBJECTS).collect();
    let successes =
        rows.iter().map(|row| &row.outcome).filter(|outcome| outcome.success).map(|outcome| outcome.duration_s);
    let mut html = causes(input, &rows);
    html += "<div class=\"two\">\n";
    html += &groups("Success by relation in the goal", "Goal", &relations);
    html += &groups("Objects of the goal that fail most", "Object", &failing);
    html += &histogram("Simulated length of successes", "s", Histogram::of(successes, RANGES));
    html += &histogram("Wall time per attempt", "s", Histogram::of(rows.iter().filter_map(|row| row.wall_s), RANGES));
    html + "</div>\n"
}

/// Table of failure causes with their shares and links to the cases.
fn causes(input: &ReportInput, rows: &[&EpisodeRow]) -> String {
    let mut cases: BTreeMap<FailureCause, Vec<String>> = BTreeMap::new();
    for (index, section) in input.cases.iter().enumerate() {
        if let Some(ExampleOf::Failure(cause)) = section.why.as_ref().map(|why| why.shows) {
            let number = index + 1;
            let known = cases.entry(cause).or_default();
            known.push(format!("<a href=\"#task-{number}\">{}</a>", known.len() + 1));
        }
    }
    let counts = failure_counts(rows.iter().filter_map(|row| row.outcome.cause));
    let most = counts.iter().map(|entry| entry.count).max().unwrap_or(0);
    let line = |entry: &crate::statistics::FailureCount| {
        let share = format!("{:.1} % of episodes", 100.0 * entry.count as f64 / rows.len().max(1) as f64);
        // The page's script filters the rows by this outcome when the link is followed.
        let cause = escape(&words(entry.cause.name()));
        let rows = format!("<a href=\"#episodes\" data-outcome=\"{cause}\">{cause}</a>");
        let mut line = vec![rows, count_bar(entry.count, most), share];
        if !cases.is_empty() {
            line.push(cases.get(&entry.cause).map_or_else(String::new, |links| links.join(" ")));
        }
        line
    };
    let lines: Vec<Vec<String>> = counts.iter().map(line).collect();
    if lines.is_empty() {
        return String::new();
    }
    let headings: &[&str] = &["Cause", "Episodes", "Share", "Cases"];
    let headings = if cases.is_empty() { &headings[..3] } else { headings };
    String::from("<h3>Why episodes fail</h3>\n") + &table("figures", headings, &lines)
}

fn groups(title: &str, heading: &str, totals: &[GroupTotal]) -> String {
    if totals.is_empty() {
        return String::new();
    }
    let line = |total: &GroupTotal| {
        let rate = &total.rate;
        let counted = format!("{} of {}", rate.successes, rate.trials);
        vec![escape(&words(&total.name)), rate_bar(rate), counted, causes_text(&total.failures)]
    };
    let lines: Vec<Vec<String>> = totals.iter().map(line).collect();
    let headings = [heading, "Success", "Episodes", "Causes of failure"];
    format!("<div>\n<h3>{}</h3>\n{}</div>\n", escape(title), table("figures", &headings, &lines))
}

fn histogram(title: &str, unit: &str, spread: Option<Histogram>) -> String {
    let Some(spread) = spread else { return String::new() };
    let most = spread.counts.iter().copied().max().unwrap_or(0);
    let decimals = if spread.width < 1.0 { (-spread.width.log10()).ceil() as usize } else { 0 };
    let line = |(index, &count): (usize, &usize)| {
        let low = spread.low + spread.width * index as f64;
        vec![format!("{low:.decimals$}–{:.decimals$} {unit}", low + spread.width), count_bar(count, most)]
    };
    let lines: Vec<Vec<String>> = spread.counts.iter().enumerate().map(line).collect();
    format!(
        "<div>\n<h3>{}<span class=\"muted\">median {:.1} {unit}, 95 % below {:.1} {unit}</span></h3>\n{}</div>\n",
        escape(title),
        spread.median,
        spread.p95,
        table("figures narrow", &["Range", "Episodes"], &lines)
    )
}

/// A count as a bar and as a number.
fn count_bar(count: usize, most: usize) -> String {
    let width = 100.0 * count as f64 / most.max(1) as f64;
    format!(
        "<span class=\"rate\"><span class=\"bar\"><span class=\"fill\" style=\"width:{width:.1}%\"></span></span><span class=\"figure\">{count}</span></span>"
    )
}
