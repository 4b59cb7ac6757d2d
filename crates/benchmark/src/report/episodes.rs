//! Report section with the table of all episodes: static without scripts; the page's script filters and sorts it.

use std::collections::BTreeMap;
use std::fmt::Write;

use genmanip_core::AgentFailure;

use super::agent_failures::failure_markup;
use super::{ReportInput, words};
use crate::rows::{EpisodeRow, TaskRow};
use genmanip_viz::markup::escape;

/// Maximum length of the evidence quoted in a row, characters: about two lines. The episode's file has the full text.
const EVIDENCE: usize = 160;
/// Note on how recorded episodes are looked at from all sides.
const PLAYBACK: &str = "<p class=\"note\"><code>genmanip studio RUN --episode ID</code> plays a recorded episode back in \
                        3-D; for an episode of a policy, <code>--episode POLICY/ID</code>.</p>\n";

/// Section with the table, in the order of the input, with at most `max_bytes` of rows. If there are more, successes
/// are omitted before failures, and the section states how many.
pub(super) fn episodes(input: &ReportInput, max_bytes: usize) -> String {
    if input.episodes.is_empty() {
        return String::new();
    }
    let drawn: BTreeMap<usize, usize> =
        input.cases.iter().enumerate().rev().filter_map(|(index, case)| Some((case.episode?, index + 1))).collect();
    let (mut body, mut left_out) = (String::new(), [0_usize; 2]);
    let mut order: Vec<usize> = (0..input.episodes.len()).collect();
    order.sort_by_key(|&index| input.episodes[index].outcome.success);
    let mut rows: Vec<(usize, String)> = Vec::with_capacity(order.len());
    let mut bytes = 0;
    for index in order {
        let episode = &input.episodes[index];
        let link = match drawn.get(&index) {
            Some(number) => Some(format!("#task-{number}")),
            None => input.has_pages.then(|| episode.page()).flatten(),
        };
        let row = row(episode, input.tasks.get(episode.task), link);
        if bytes + row.len() > max_bytes {
            left_out[usize::from(episode.outcome.success)] += 1;
        } else {
            bytes += row.len();
            rows.push((index, row));
        }
    }
    rows.sort_unstable_by_key(|(index, _)| *index);
    rows.iter().for_each(|(_, row)| body += row);
    let mut html = format!("<section id=\"episodes\">\n<h2>All {} episodes</h2>\n", input.episodes.len());
    if input.episodes.iter().any(|episode| episode.recorded) {
        html += PLAYBACK;
    }
    if left_out != [0, 0] {
        let _ = writeln!(
            html,
            "<p class=\"note\">To keep this page small, {} successes and {} failures counted above have no row here.</p>",
            left_out[1], left_out[0]
        );
    }
    let heads: String = HEADINGS.iter().map(|heading| format!("<th scope=\"col\">{heading}</th>")).collect();
    let _ = write!(
        html,
        "<div class=\"scroll tall\"><table class=\"all\">\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n</section>\n"
    );
    html
}

const HEADINGS: [&str; 8] = ["Episode", "Kind", "Made by", "Outcome", "Evidence", "Score", "Length, s", "Wall time, s"];

fn row(episode: &EpisodeRow, task: Option<&TaskRow>, link: Option<String>) -> String {
    let id = escape(&episode.id);
    let name = link.map_or(id.clone(), |link| format!("<a href=\"{}\">{id}</a>", escape(&link)));
    let (class, outcome) = match (episode.outcome.success, episode.outcome.cause) {
        (true, _) if episode.is_attempt() => ("met", "verified".into()),
        (true, _) => ("met", "success".into()),
        (false, Some(cause)) => ("missed", words(cause.name())),
        (false, None) => ("missed", "no success".into()),
    };
    let mut evidence = escape(&shortened(&episode.outcome.evidence));
    if let Some(failure) = &episode.outcome.agent_failure {
        let failure = AgentFailure { evidence: String::new(), ..failure.clone() };
        evidence = format!("<b>{}</b> {evidence}", failure_markup(&failure));
    }
    let wall = episode.wall_s.map_or(String::new(), |seconds| format!("{seconds:.1}"));
    format!(
        "<tr><th>{name}</th><td>{kind}</td><td>{by}</td><td class=\"{class}\">{outcome}</td><td>{evidence}</td><td>{score:.2}</td><td>{length:.1}</td><td>{wall}</td></tr>\n",
        kind = escape(&task.map_or(String::new(), |task| words(task.kind.name()))),
        by = escape(&words(episode.evaluation.as_deref().unwrap_or("collect"))),
        score = episode.outcome.score,
        length = episode.outcome.duration_s,
    )
}

fn shortened(text: &str) -> String {
    if text.chars().count() <= EVIDENCE {
        return text.to_owned();
    }
    text.chars().take(EVIDENCE - 1).chain(['…']).collect()
}
