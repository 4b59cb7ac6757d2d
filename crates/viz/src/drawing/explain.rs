//! Diagram of a task and its layout: the scene graph beside the top view, and the reasons if no layout was found.

use genmanip_core::{Atom, Task};

use super::colors::{CONFLICT, INK, MUTED};
use super::floor_plan::{TopView, plan_drawing};
use super::graph::graph_drawing;
use super::svg::{Anchor, Canvas, Svg, wrap};

const MARGIN: f64 = 16.0;
const TITLE_SIZE: f64 = 17.0;
const TEXT_SIZE: f64 = 13.0;
const LINE: f64 = 20.0;

/// Reasons why a task has no layout, for display.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refusal {
    /// Summary of the reasons in one line.
    pub headline: String,
    /// Reasons with the number of attempts that failed for each, most frequent first.
    pub reasons: Vec<(String, usize)>,
    /// Conflicting relations, most frequent first; drawn in red.
    pub conflicts: Vec<Atom>,
    /// Conflicting relations in words, with the number of attempts in which each conflicted.
    pub conflict_labels: Vec<(String, usize)>,
}

/// Draws the scene graph with its goals beside the layout. For a rejected task, the layout is the attempt that placed
/// most, and the reasons are listed below.
pub fn explain_svg(task: &Task, picture: &TopView, refusal: Option<&Refusal>) -> Svg {
    let conflicts = refusal.map_or(&[][..], |refusal| &refusal.conflicts);
    let (graph, [graph_width, graph_height]) = graph_drawing(task, conflicts);
    let (plan, [plan_width, plan_height]) = plan_drawing(picture);
    let width = graph_width + plan_width + MARGIN;
    let mut canvas = Canvas::default();
    let title = wrap(&format!("“{}”", task.instruction), TITLE_SIZE, width - 2.0 * MARGIN, 3);
    let mut y = 2.0 * MARGIN;
    for line in &title {
        canvas.text([MARGIN, y], TITLE_SIZE, Anchor::Start, &format!(r#"fill="{INK}" font-weight="600""#), line);
        y += TITLE_SIZE * 1.35;
    }
    let subtitle = format!("{} · {}", task.id, task.kind.name().replace('_', " "));
    canvas.text([MARGIN, y], TEXT_SIZE - 1.0, Anchor::Start, &format!(r#"fill="{MUTED}""#), &subtitle);
    y += MARGIN;
    let mut below = graph_height;
    if let Some(refusal) = refusal {
        // The reasons are placed below the graph, where there is space beside the top view.
        below = draw_reasons(&mut canvas, refusal, [MARGIN, y + graph_height + LINE], graph_width - MARGIN) - y;
    }
    canvas.group([0.0, y], graph);
    canvas.group([graph_width + MARGIN, y], plan);
    canvas.finish(width, y + plan_height.max(below) + MARGIN, &format!("Layout of: {}", task.instruction))
}

/// Draws the reasons as a text block, and returns the page height at which it ends (px).
fn draw_reasons(canvas: &mut Canvas, refusal: &Refusal, at: [f64; 2], width: f64) -> f64 {
    let mut y = at[1];
    for line in wrap(&refusal.headline, TEXT_SIZE + 1.0, width, 4) {
        let style = format!(r#"fill="{CONFLICT}" font-weight="700""#);
        canvas.text([at[0], y], TEXT_SIZE + 1.0, Anchor::Start, &style, &line);
        y += LINE;
    }
    let reasons = refusal.reasons.iter().take(6).map(|reason| (reason, INK));
    let conflicts = refusal.conflict_labels.iter().take(8).map(|edge| (edge, CONFLICT));
    for ((what, count), color) in reasons.chain(conflicts) {
        canvas.text([at[0], y], TEXT_SIZE, Anchor::Start, &format!(r#"fill="{MUTED}""#), &format!("{count}×"));
        for line in wrap(what, TEXT_SIZE, width - 72.0, 2) {
            canvas.text([at[0] + 72.0, y], TEXT_SIZE, Anchor::Start, &format!(r#"fill="{color}""#), &line);
            y += LINE;
        }
    }
    y
}
