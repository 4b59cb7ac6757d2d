//! Top sections of the report: the run, its results, and the index of tasks.

use std::collections::BTreeSet;
use std::fmt::Write;

use genmanip_core::TaskKind;

use super::tables::{causes_text, mean_text, rate_bar, seconds_text, table};
use super::{
    ImagePlan, ReportInput, ReportSettings, TaskSection, agent_failures, chip, distributions, episodes, image, shows,
    words,
};
use crate::rows::EpisodeRow;
use crate::rows::totals::GroupTotal;
use crate::statistics::{MIN_SCENARIOS, PairedComparison, Rate, StatisticsSettings, SuiteSummary};
use genmanip_viz::markup::escape;

pub(super) fn overview(input: &ReportInput, settings: &ReportSettings, plan: ImagePlan) -> String {
    let statistics = &settings.statistics;
    let mut html = String::from("<header>\n");
    let _ = writeln!(html, "<p class=\"kicker\">GenManip report</p>\n<h1>{}</h1>", escape(&input.title));
    let _ = writeln!(html, "<p class=\"lead\">{}</p>", escape(&lead(input, statistics).replace(" %", "\u{a0}%")));
    html += &tiles(input, statistics);
    html += &warnings(input);
    html += "</header>\n<section id=\"results\">\n<h2>Results</h2>\n";
    html += &policies(input);
    html += &comparisons(&input.comparisons);
    html += &agent_failures::agent_failures(input);
    html += &kinds(input, statistics);
    html += &distributions::distributions(input, statistics);
    html += "</section>\n";
    html += &index(input, plan);
    html += &episodes::episodes(input, ROWS_BYTES);
    html += "<section id=\"made\" class=\"two\">\n";
    html += &provenance(input, plan);
    html + "</section>\n"
}

fn lead(input: &ReportInput, statistics: &StatisticsSettings) -> String {
    let rate = total_yield(input, statistics);
    let solved = solved(input).into_iter().filter(|&solved| solved).count();
    let (tasks, episodes) = (input.tasks.len(), input.summaries.iter().map(|s| s.success.trials).sum::<usize>());
    let collected = (rate.trials > 0).then(|| {
        format!(
            "{}: {} gave {}, {rate}; {solved} of {tasks} tasks have at least one.",
            plural(tasks, "task"),
            plural(rate.trials, "attempt"),
            plural(rate.successes, "verified demonstration"),
        )
    });
    let policies = match input.summaries.len() {
        1 => "1 policy was".into(),
        count => format!("{count} policies were"),
    };
    let evaluated =
        (!input.summaries.is_empty()).then(|| format!("{policies} evaluated in {}.", plural(episodes, "episode")));
    match (collected, evaluated) {
        (None, None) if input.episodes.is_empty() => {
            format!("{}: nothing was collected or evaluated yet.", plural(tasks, "task"))
        }
        (None, None) => format!("{}: {}.", plural(tasks, "task"), plural(input.episodes.len(), "episode")),
        (None, Some(evaluated)) => format!("{}: {evaluated}", plural(tasks, "task")),
        (collected, evaluated) => [collected, evaluated].into_iter().flatten().collect::<Vec<_>>().join(" "),
    }
}

fn tiles(input: &ReportInput, statistics: &StatisticsSettings) -> String {
    let rate = total_yield(input, statistics);
    let mut tiles = Vec::new();
    if rate.trials > 0 {
        let figure = format!("{} of {}", rate.successes, rate.trials);
        tiles.push(tile("Verified demonstrations", &figure, "attempts, all counted"));
    }
    for summary in input.summaries.iter().take(4) {
        let baseline = input.baseline.as_deref() == Some(&summary.policy);
        let remark = match (baseline, summary.oracle) {
            (true, _) => "baseline, must be 0",
            (false, true) => "success at the end · oracle",
            (false, false) => "success at the end",
        };
        let figure = match is_mistaken(input, &summary.policy) {
            true => "–".to_owned(),
            false => format!("{:.0} %", 100.0 * summary.success.value),
        };
        tiles.push(tile(&words(&summary.policy), &figure, remark));
    }
    if tiles.is_empty() { String::new() } else { format!("<ul class=\"tiles\">\n{}</ul>\n", tiles.concat()) }
}

fn tile(label: &str, figure: &str, remark: &str) -> String {
    let (label, figure, remark) = (escape(label), escape(figure), escape(remark));
    format!(
        "<li><span class=\"label\">{label}</span><strong>{figure}</strong><span class=\"muted\">{remark}</span></li>\n"
    )
}

/// Maximum size of the table of all episodes, bytes: about 25,000 rows, which leaves space for images within the page's
/// 15 MB.
const ROWS_BYTES: usize = 6_000_000;

/// Maximum number of tasks named in the warning about tasks without a demonstration.
const NAMED_TASKS: usize = 12;

/// True if a mistake of the policy prevented episodes, so that the finished ones are no random sample.
fn is_mistaken(input: &ReportInput, policy: &str) -> bool {
    input.not_run.get(policy).is_some_and(|left| left.iter().any(|left| left.mistake))
}

/// Warnings about the results, as HTML.
fn warnings(input: &ReportInput) -> String {
    let mut warnings = Vec::new();
    let baseline = input.summaries.iter().find(|summary| input.baseline.as_deref() == Some(&summary.policy));
    if let Some(summary) = baseline.filter(|summary| summary.success.successes > 0) {
        warnings.push(format!(
            "The baseline policy {} succeeded in {}: a goal holds without any action.",
            summary.policy,
            plural(summary.success.successes, "episode")
        ));
    }
    for (policy, left) in &input.not_run {
        let Some((first, others)) = left.split_first() else { continue };
        let more = if others.is_empty() { String::new() } else { format!(" (and {} more)", others.len()) };
        warnings.push(format!("{}: {} was not run{more}: {}", words(policy), first.id, first.reason));
    }
    let mut tried = vec![false; input.tasks.len()];
    for row in attempts(input) {
        tried[row.task] = true;
    }
    let flags = tried.into_iter().zip(solved(input)).zip(&input.tasks);
    let unsolved: Vec<&str> =
        flags.filter(|((tried, solved), _)| *tried && !solved).map(|(_, task)| task.id.as_str()).collect();
    if !unsolved.is_empty() {
        let more = unsolved.len().saturating_sub(NAMED_TASKS);
        let more = if more > 0 { format!(" and {more} more, see the table of all episodes") } else { String::new() };
        let named = &unsolved[..unsolved.len().min(NAMED_TASKS)];
        warnings.push(format!("Without a verified demonstration: {}{more}.", named.join(", ")));
    }
    warnings.iter().map(|warning| format!("<p class=\"warning\">{}</p>\n", escape(warning))).collect()
}

fn policies(input: &ReportInput) -> String {
    let (summaries, baseline) = (&input.summaries, input.baseline.as_deref());
    if summaries.is_empty() {
        let has_evaluated = input.episodes.iter().any(|row| !row.is_attempt());
        return if has_evaluated { "" } else { "<p class=\"muted\">No policy was evaluated.</p>\n" }.into();
    }
    let with_spl = summaries.iter().any(|summary| summary.spl.is_some());
    let rows: Vec<Vec<String>> = summaries
        .iter()
        .map(|summary| {
            // Destructured without `..`, so that a new statistic must be shown here or omitted on purpose.
            let SuiteSummary {
                policy,
                oracle,
                success,
                success_once,
                score,
                spl,
                tcp_path_m,
                duration_s,
                collisions,
                cloud_success: _,
                cloud_disagreements: _,
                kinds: _,
                traits: _,
                failures: _,
                agent_failures: _,
            } = summary;
            let mut name = escape(&words(policy));
            if *oracle {
                name += &chip("warn", "oracle");
            }
            if baseline == Some(policy) {
                name += &chip("plain", "baseline");
            }
            let is_mistaken = is_mistaken(input, policy);
            let rate = |cell: String| if is_mistaken { "–".to_owned() } else { cell };
            let mut cells = vec![
                name,
                success.trials.to_string(),
                rate(rate_bar(success)),
                rate(format!("{:.1} %", 100.0 * success_once.value)),
                rate(mean_text(score, 2, "")),
            ];
            if with_spl {
                let none = || "<span class=\"muted\">none</span>".into();
                cells.push(spl.as_ref().map_or_else(none, |spl| mean_text(spl, 2, "")));
            }
            cells.extend([
                mean_text(tcp_path_m, 2, " m"),
                mean_text(duration_s, 1, " s"),
                format!("{} of {}", collisions.successes, collisions.trials),
            ]);
            cells
        })
        .collect();
    let mut headings = vec!["Policy", "Episodes", "Success at end", "Once", "Score"];
    if with_spl {
        headings.push("SPL");
    }
    headings.extend(["Path", "Duration", "Collisions"]);
    let mut html = String::from("<h3>Policies</h3>\n") + &table("figures", &headings, &rows);
    let failures: Vec<String> = summaries
        .iter()
        .filter(|summary| !summary.failures.is_empty())
        .map(|summary| format!("{}: {}.", escape(&words(&summary.policy)), causes_text(&summary.failures)))
        .collect();
    if !failures.is_empty() {
        let _ = writeln!(html, "<p class=\"note\">Causes of failure. {}</p>", failures.join(" "));
    }
    html += "<p class=\"note\">Success at end is the headline: judged after settling, nothing held or moving. \
             Once: held at some moment. Bars carry 95 % Wilson intervals, means 95 % bootstrap intervals.</p>\n";
    let kinds: Vec<TaskKind> = TaskKind::ALL
        .into_iter()
        .filter(|kind| summaries.iter().any(|s| s.kinds.iter().any(|k| k.kind == *kind)))
        .collect();
    let rows: Vec<Vec<String>> = kinds
        .iter()
        .map(|kind| {
            let of_kind = |summary: &SuiteSummary| {
                let found = summary.kinds.iter().find(|entry| entry.kind == *kind);
                found.map_or("<span class=\"muted\">none</span>".into(), |entry| rate_bar(&entry.success))
            };
            std::iter::once(escape(&words(kind.name()))).chain(summaries.iter().map(of_kind)).collect()
        })
        .collect();
    let names: Vec<String> = summaries.iter().map(|summary| words(&summary.policy)).collect();
    let headings: Vec<&str> = std::iter::once("Kind").chain(names.iter().map(String::as_str)).collect();
    html += "<h3>Success at end by kind of task</h3>\n";
    html += &table("figures", &headings, &rows);
    html + &traits(summaries, &headings)
}

/// Table of success by scenario trait; values with fewer than [`MIN_SCENARIOS`] scenarios are omitted.
fn traits(summaries: &[SuiteSummary], headings: &[&str]) -> String {
    let said = || summaries.iter().flat_map(|summary| &summary.traits).filter(|it| it.scenarios >= MIN_SCENARIOS);
    let groups: BTreeSet<(&str, &str)> = said().map(|it| (it.name.as_str(), it.value.as_str())).collect();
    if groups.is_empty() {
        return String::new();
    }
    let rows = groups.into_iter().map(|(name, value)| {
        let of = |summary: &SuiteSummary| {
            let found = summary.traits.iter().find(|it| (it.name.as_str(), it.value.as_str()) == (name, value));
            found.map_or("<span class=\"muted\">none</span>".into(), |it| rate_bar(&it.success))
        };
        let cell = escape(&format!("{} {}", words(name), words(value)));
        std::iter::once(cell).chain(summaries.iter().map(of)).collect::<Vec<String>>()
    });
    let headings: Vec<&str> = std::iter::once("Scenarios with").chain(headings.iter().skip(1).copied()).collect();
    String::from("<h3>Success at end by scenario trait</h3>\n")
        + &table("figures", &headings, &rows.collect::<Vec<_>>())
}

fn comparisons(comparisons: &[PairedComparison]) -> String {
    let rows: Vec<Vec<String>> = comparisons
        .iter()
        .map(|pair| {
            let points = |share: f64| format!("{:+.1}", 100.0 * share);
            vec![
                escape(&format!("{} against {}", words(&pair.first), words(&pair.second))),
                pair.pairs.to_string(),
                format!(
                    "{} points <span class=\"ci\">{} to {}</span>",
                    points(pair.difference.value),
                    points(pair.difference.low),
                    points(pair.difference.high)
                ),
                format!("{} / {}", pair.only_first, pair.only_second),
                if pair.p_value < 1e-4 { "&lt; 0.0001".into() } else { format!("{:.4}", pair.p_value) },
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let headings = ["On the same episodes", "Pairs", "Difference in success", "Only first / only second", "p (exact)"];
    String::from("<h3>Policies in pairs</h3>\n") + &table("figures", &headings, &rows)
}

fn kinds(input: &ReportInput, statistics: &StatisticsSettings) -> String {
    if attempts(input).next().is_none() {
        return String::new();
    }
    let row = |name: String, is_meant: &dyn Fn(TaskKind) -> bool| {
        let is_of = |row: &&EpisodeRow| input.tasks.get(row.task).is_some_and(|task| is_meant(task.kind));
        let total = GroupTotal::of(&name, attempts(input).filter(is_of), statistics);
        vec![
            escape(&total.name),
            rate_bar(&total.rate),
            format!("{} of {}", total.rate.successes, total.rate.trials),
            input.tasks.iter().filter(|task| is_meant(task.kind)).count().to_string(),
            causes_text(&total.failures),
        ]
    };
    let present = TaskKind::ALL.into_iter().filter(|kind| input.tasks.iter().any(|task| task.kind == *kind));
    let mut rows: Vec<Vec<String>> = present.map(|kind| row(words(kind.name()), &|other| other == kind)).collect();
    rows.push(row("all kinds".into(), &|_| true));
    let headings = ["Kind", "Yield", "Verified attempts", "Tasks", "Causes of failure"];
    String::from("<h3>Yield of demonstrations</h3>\n") + &table("figures total", &headings, &rows)
}

fn index(input: &ReportInput, plan: ImagePlan) -> String {
    let (title, rule) = match &input.rule {
        _ if input.cases.is_empty() => return String::new(),
        None => ("Tasks", String::new()),
        Some(rule) => (
            "Cases",
            format!(
                "<p class=\"note\">{} of {} episodes are shown with images: {}. All others are in the table below.</p>\n",
                input.cases.len(),
                input.episodes.len(),
                escape(rule)
            ),
        ),
    };
    let cards: String = input
        .cases
        .iter()
        .enumerate()
        .map(|(index, section)| {
            let picture = match section.thumbnail() {
                Some(jpeg) if plan.thumbnails => image(jpeg, &format!("End of {}", section.task.id)),
                _ => "<span class=\"blank\">no picture</span>".into(),
            };
            let chips = why_chips(section).unwrap_or_else(|| {
                chip("plain", &words(section.task.kind.name())) + &yield_chip(section)
            });
            format!(
                "<li><a href=\"#task-{}\">{picture}<span class=\"say\">{}</span></a><span class=\"chips\">{chips}</span></li>\n",
                index + 1,
                escape(&section.task.instruction),
            )
        })
        .collect();
    format!("<section id=\"tasks\">\n<h2>{title}</h2>\n{rule}<ol class=\"index\">\n{cards}</ol>\n</section>\n")
}

/// Labels of a case: the property that it shows, and its rank among the episodes with that property; `None` if all
/// tasks
/// are shown.
pub(super) fn why_chips(section: &TaskSection) -> Option<String> {
    let why = section.why.as_ref()?;
    let class = if matches!(why.shows, crate::rows::cases::ExampleOf::Failure(_)) { "bad" } else { "good" };
    Some(chip(class, &shows(why.shows)) + &chip("plain", &format!("{} of {}", why.place, why.of)))
}

/// Label with the number of verified attempts, coloured by whether all, some or none are; without attempts, with the
/// number of successful results.
pub(super) fn yield_chip(section: &TaskSection) -> String {
    let (verified, attempts) = (section.verified(), section.attempts.len());
    if attempts == 0 && !section.results.is_empty() {
        let (succeeded, all) = (section.results.iter().filter(|result| result.success).count(), section.results.len());
        return chip("plain", &format!("{succeeded} of {all} succeeded"));
    }
    let class = match verified {
        0 if attempts > 0 => "bad",
        0 => "plain",
        verified if verified == attempts => "good",
        _ => "fair",
    };
    chip(class, &format!("{verified} of {attempts} verified"))
}

fn provenance(input: &ReportInput, plan: ImagePlan) -> String {
    let mut facts = vec![("made by".to_owned(), input.generated_by.clone()), ("seed".into(), input.seed.to_string())];
    facts.extend(input.versions.iter().cloned());
    let facts: String =
        facts.iter().map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escape(name), escape(value))).collect();
    let mut html = format!("<div>\n<h2>How it was made</h2>\n<dl>\n{facts}</dl>\n");
    if !input.commands.is_empty() {
        let _ = writeln!(html, "<pre><code>{}</code></pre>", escape(&input.commands.join("\n")));
    }
    if !input.timings.is_empty() {
        let rows: Vec<Vec<String>> = input
            .timings
            .iter()
            .map(|timing| vec![escape(&timing.phase), escape(&seconds_text(timing.seconds))])
            .collect();
        html += &table("figures small", &["Phase", "Wall time"], &rows);
    }
    let mut notes = input.notes.clone();
    match plan.film_step {
        Some(1) => {}
        Some(step) => notes.push(format!("Film strips show every {step}th image to keep this page small.")),
        None => notes.push("Film strips are omitted to keep this page small.".into()),
    }
    let notes: String = notes.iter().map(|note| format!("<li>{}</li>\n", escape(note))).collect();
    html += "</div>\n<div>\n<h2>Notes</h2>\n";
    html + &format!("<ul class=\"notes\">\n{notes}</ul>\n</div>\n")
}

/// Rows of attempts to collect a demonstration.
fn attempts(input: &ReportInput) -> impl Iterator<Item = &EpisodeRow> {
    input.episodes.iter().filter(|row| row.is_attempt())
}

/// For each task, true if it has a verified demonstration.
fn solved(input: &ReportInput) -> Vec<bool> {
    let mut solved = vec![false; input.tasks.len()];
    for row in attempts(input).filter(|row| row.outcome.success) {
        solved[row.task] = true;
    }
    solved
}

fn total_yield(input: &ReportInput, statistics: &StatisticsSettings) -> Rate {
    Rate::of(attempts(input).map(|row| row.outcome.success), statistics)
}

fn plural(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
