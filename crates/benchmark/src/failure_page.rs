//! HTML page on the failures of a policy that asks questions: causes by kind of task, and one case per cause with its
//! images and its intended and actual outcome.

use std::collections::BTreeMap;
use std::fmt::Write;

use genmanip_viz::markup::{base64, escape};

/// Contents of the page.
#[derive(Clone, Debug, Default)]
pub struct FailurePage {
    /// Names of the policy and its services.
    pub title: String,
    /// True if the policy or a service read simulator truth.
    pub oracle: bool,
    /// Failures by kind of task.
    pub kinds: Vec<KindFailures>,
    /// Counts of placements by intended and actual relation.
    pub relations: BTreeMap<(String, String), usize>,
    /// Confusion matrix of the completion check: rows are goal unmet and goal met, columns *not finished* and
    /// *finished*.
    pub checks: [[usize; 2]; 2],
    /// One failed episode per cause.
    pub cases: Vec<FailureCase>,
}

/// Failures of one kind of task.
#[derive(Clone, Debug, Default)]
pub struct KindFailures {
    /// Name of the kind.
    pub kind: String,
    /// Number of episodes, successes included.
    pub episodes: usize,
    /// Number of failed episodes by cause; all kinds have the same causes in the same order.
    pub causes: Vec<(String, usize)>,
}

/// A failed episode.
#[derive(Clone, Debug, Default)]
pub struct FailureCase {
    /// Cause of failure.
    pub cause: String,
    /// Id of the episode.
    pub id: String,
    /// Instruction.
    pub instruction: String,
    /// Evidence for the cause, as text.
    pub evidence: String,
    /// Questions and actions in chronological order.
    pub moments: Vec<CaseMoment>,
}

/// One question or action.
#[derive(Clone, Debug, Default)]
pub struct CaseMoment {
    /// Short title.
    pub title: String,
    /// The model's answer, or the action taken.
    pub text: String,
    /// True if the failure analysis blames this answer or action.
    pub is_blamed: bool,
    /// Images shown with the question, as PNG files.
    pub pictures: Vec<Vec<u8>>,
}

/// Colours of the causes, in the order of the causes: grasps in blues, plans in oranges, the rest in greens and greys.
const COLORS: [&str; 11] = [
    "#7c5ba6", "#1d4f91", "#3b82c4", "#8ec1e8", "#b45309", "#e08a2e", "#f4c27a", "#3f7d4f", "#8a9099", "#c3c8cf",
    "#55595f",
];

/// The page as a self-contained HTML file that is complete without scripts.
pub fn failure_page(page: &FailurePage) -> String {
    let oracle = if page.oracle { " · oracle" } else { "" };
    let episodes: usize = page.kinds.iter().map(|kind| kind.episodes).sum();
    let failed: usize = page.kinds.iter().map(KindFailures::failed).sum();
    let mut html = format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n",
            "<meta name=\"color-scheme\" content=\"light dark\" />\n",
            "<title>Failures of {title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<header>\n",
            "<p class=\"kicker\">GenManip failures{oracle}</p>\n<h1>{title}</h1>\n",
            "<p class=\"lead\">{failed} of {episodes} episodes failed.</p>\n</header>\n<main>\n"
        ),
        title = escape(&page.title),
        style = include_str!("report/style.css"),
        oracle = oracle,
        failed = failed,
        episodes = episodes,
    );
    html += "<section>\n<h2>Causes by kind of task</h2>\n";
    html += "<p>Each bar is the share of episodes that failed, by the one cause that is blamed.</p>\n";
    html += &chart(&page.kinds);
    html += "</section>\n";
    html += &relations(&page.relations);
    html += &checks(&page.checks);
    html.extend(page.cases.iter().map(case));
    html + "</main>\n</body>\n</html>\n"
}

impl KindFailures {
    fn failed(&self) -> usize {
        self.causes.iter().map(|(_, count)| count).sum()
    }
}

/// Width, height and vertical spacing of the bars, and width of the labels, px.
const BAR: [usize; 4] = [560, 26, 40, 150];

/// Bar chart: one bar per kind, as long as the kind's share of failed episodes and divided by cause.
pub(crate) fn chart(kinds: &[KindFailures]) -> String {
    let [width, height, step, left] = BAR;
    let mut svg = String::new();
    for (row, kind) in kinds.iter().enumerate() {
        let y = 12 + row * step;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n\
             <rect x=\"{left}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"currentColor\" opacity=\"0.08\" />",
            left - 10,
            y + height * 2 / 3,
            escape(&kind.kind.replace('_', " ")),
        );
        let mut x = left as f64;
        for ((cause, count), color) in kind.causes.iter().zip(COLORS).filter(|((_, count), _)| *count > 0) {
            let length = (width * count) as f64 / kind.episodes.max(1) as f64;
            let words = escape(&format!("{}: {count} of {}", cause.replace('_', " "), kind.episodes));
            let _ = writeln!(
                svg,
                "<rect x=\"{x:.1}\" y=\"{y}\" width=\"{length:.1}\" height=\"{height}\" fill=\"{color}\"><title>{words}</title></rect>"
            );
            if length > 14.0 {
                let _ = writeln!(
                    svg,
                    "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#fff\" stroke=\"#0008\" stroke-width=\"2\" paint-order=\"stroke\">{count}</text>",
                    x + length / 2.0,
                    y + height * 2 / 3,
                );
            }
            x += length;
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\">{} of {}</text>",
            left + width + 10,
            y + height * 2 / 3,
            kind.failed(),
            kind.episodes
        );
    }
    let bottom = 12 + kinds.len() * step;
    for share in [0, 25, 50, 75, 100] {
        let x = left + width * share / 100;
        let _ = writeln!(
            svg,
            "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" opacity=\"0.7\">{share} %</text>",
            bottom + 12
        );
    }
    let names: Vec<&String> =
        kinds.first().map_or_else(Vec::new, |kind| kind.causes.iter().map(|(name, _)| name).collect());
    let total = |cause: &String| -> usize {
        kinds.iter().flat_map(|kind| &kind.causes).filter(|(name, _)| name == cause).map(|(_, count)| count).sum()
    };
    let mut legend = String::new();
    for (name, color) in names.into_iter().zip(COLORS).filter(|(name, _)| total(name) > 0) {
        let _ = writeln!(
            legend,
            "<span style=\"white-space:nowrap;margin-right:1.2em\"><span style=\"display:inline-block;width:.8em;height:.8em;background:{color};margin-right:.4em\"></span>{} {}</span>",
            escape(&name.replace('_', " ")),
            total(name),
        );
    }
    format!(
        "<svg viewBox=\"0 0 {} {}\" style=\"max-width:{}px;width:100%;font:13px sans-serif\" fill=\"currentColor\" role=\"img\" aria-label=\"Failed episodes by kind and cause\">\n{svg}</svg>\n<p>{legend}</p>\n",
        left + width + 110,
        bottom + 20,
        left + width + 110,
    )
}

/// Confusion matrix: rows intended, columns actual; mirrored relations are distinguished.
fn relations(counts: &BTreeMap<(String, String), usize>) -> String {
    if counts.is_empty() {
        return String::new();
    }
    let mut columns: Vec<&String> = counts.keys().map(|(_, resulting)| resulting).collect();
    columns.sort();
    columns.dedup();
    let mut rows: Vec<&String> = counts.keys().map(|(intended, _)| intended).collect();
    rows.dedup();
    let mut table = String::from("<table>\n<tr><th>meant</th>");
    columns.iter().for_each(|column| {
        let _ = write!(table, "<th class=\"number\">{}</th>", escape(column));
    });
    table += "</tr>\n";
    for row in rows {
        let _ = write!(table, "<tr><td>{}</td>", escape(row));
        for &column in &columns {
            let count = counts.get(&(row.clone(), column.clone())).copied().unwrap_or(0);
            let text = if count == 0 { "·".to_owned() } else { count.to_string() };
            let weight = if row == column { " style=\"font-weight:bold\"" } else { "" };
            let _ = write!(table, "<td class=\"number\"{weight}>{text}</td>");
        }
        table += "</tr>\n";
    }
    let mirrored = |pairs: [(&str, &str); 2]| -> usize {
        pairs.iter().filter_map(|(one, other)| counts.get(&((*one).to_owned(), (*other).to_owned()))).sum()
    };
    let (sides, depths) =
        (mirrored([("left", "right"), ("right", "left")]), mirrored([("front", "back"), ("back", "front")]));
    format!(
        "<section>\n<h2>What was meant, and what the chosen place comes to</h2>\n{table}</table>\n\
         <p>Left and right mirrored: {sides}. Front and back mirrored: {depths}.</p>\n</section>\n"
    )
}

fn checks(counts: &[[usize; 2]; 2]) -> String {
    let [[open_open, open_finished], [done_open, done_finished]] = counts;
    if counts.iter().flatten().sum::<usize>() == 0 {
        return String::new();
    }
    format!(
        "<section>\n<h2>The check after each placement</h2>\n<table>\n\
         <tr><th>the goal</th><th class=\"number\">said not finished</th><th class=\"number\">said finished</th></tr>\n\
         <tr><td>does not hold</td><td class=\"number\">{open_open}</td><td class=\"number\">{open_finished} false</td></tr>\n\
         <tr><td>holds</td><td class=\"number\">{done_open} missed</td><td class=\"number\">{done_finished}</td></tr>\n\
         </table>\n</section>\n"
    )
}

/// Width of the images of a case, px.
const PICTURE_WIDTH: usize = 440;

fn case(case: &FailureCase) -> String {
    let mut html = format!(
        "<section>\n<h2>{}</h2>\n<p><b>{}</b> <code>{}</code></p>\n<p>{}</p>\n<ul style=\"list-style:none;padding:0\">\n",
        escape(&case.cause.replace('_', " ")),
        escape(&case.instruction),
        escape(&case.id),
        escape(&case.evidence),
    );
    for moment in &case.moments {
        let blamed = if moment.is_blamed { " <span class=\"chip bad\">blamed</span>" } else { "" };
        let _ = writeln!(html, "<li><b>{}</b>{blamed} <code>{}</code>", escape(&moment.title), escape(&moment.text));
        if !moment.pictures.is_empty() {
            html += "<div style=\"display:flex;flex-wrap:wrap;gap:8px;margin:6px 0 14px\">";
            for picture in &moment.pictures {
                let _ = write!(
                    html,
                    "<img style=\"width:{PICTURE_WIDTH}px;max-width:100%\" src=\"data:image/png;base64,{}\" alt=\"{}\" />",
                    base64(picture),
                    escape(&moment.title)
                );
            }
            html += "</div>";
        }
        html += "</li>\n";
    }
    html + "</ul>\n</section>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_pictures_and_mirrored_relations_are_on_the_page() {
        let relation = |intended: &str, resulting: &str| (intended.to_owned(), resulting.to_owned());
        let page = FailurePage {
            title: "agent <vlm>".into(),
            oracle: true,
            kinds: vec![KindFailures {
                kind: "long_horizon".into(),
                episodes: 8,
                causes: vec![("decomposition".into(), 0), ("plan_location".into(), 2)],
            }],
            relations: [(relation("left", "right"), 3), (relation("left", "left"), 5), (relation("back", "front"), 1)]
                .into(),
            checks: [[4, 1], [2, 9]],
            cases: vec![FailureCase {
                cause: "plan_location".into(),
                id: "e-1".into(),
                instruction: "Put it & go".into(),
                evidence: "in C4".into(),
                moments: vec![CaseMoment {
                    title: "point to point".into(),
                    text: "C4".into(),
                    is_blamed: true,
                    pictures: vec![vec![1, 2, 3]],
                }],
            }],
        };
        let html = failure_page(&page);
        for expected in [
            "agent &lt;vlm&gt;",
            "GenManip failures · oracle",
            "2 of 8 episodes failed.",
            "plan location: 2 of 8",
            "Left and right mirrored: 3. Front and back mirrored: 1.",
            "1 false",
            "2 missed",
            "data:image/png;base64,AQID",
            "Put it &amp; go",
            "blamed",
        ] {
            assert!(html.contains(expected), "{expected}");
        }
        // Causes that never occurred have no legend entry and no bar.
        assert!(!html.contains("decomposition"));
    }
}
