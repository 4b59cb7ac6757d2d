//! The HTML report: one self-contained page, complete without scripts.

mod agent_failures;
mod distributions;
mod episodes;
mod overview;
mod page;
pub(crate) mod tables;
mod task;

use std::collections::BTreeMap;

use genmanip_core::{AttemptOutcome, EpisodeResult, NotRun, Scenario, Seed, Task};

pub use page::{EpisodePage, episode_page};

use crate::rows::cases::{ExampleOf, ExampleRole};
use crate::rows::{EpisodeRow, TaskRow};
use crate::statistics::{PairedComparison, StatisticsSettings, SuiteSummary};
use genmanip_viz::drawing::Svg;
use genmanip_viz::markup::{base64, base64_length, escape};

/// Contents of the page. Totals and the table of episodes are computed from `tasks` and `episodes`.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportInput {
    /// Heading of the page.
    pub title: String,
    /// Name and version of the program.
    pub generated_by: String,
    /// Seed of the run.
    pub seed: Seed,
    /// Command lines that reproduce the run.
    pub commands: Vec<String>,
    /// Versions and settings, e.g. (`physics`, `mujoco 3.17.0`).
    pub versions: Vec<(String, String)>,
    /// Summaries of evaluations, one per policy.
    pub summaries: Vec<SuiteSummary>,
    /// Episodes that were not run, by label of the policy as in `summaries`.
    pub not_run: BTreeMap<String, Vec<NotRun>>,
    /// Name of the baseline policy, which must never succeed, if one was run.
    pub baseline: Option<String>,
    /// Paired comparisons of policies on common episodes.
    pub comparisons: Vec<PairedComparison>,
    /// Wall-clock times of the phases of the run; may be empty.
    pub timings: Vec<Timing>,
    /// Notes for the reader, e.g. that the expert reads simulator truth.
    pub notes: Vec<String>,
    /// All tasks of the run.
    pub tasks: Vec<TaskRow>,
    /// All episodes: attempts to collect demonstrations, and evaluated ones.
    pub episodes: Vec<EpisodeRow>,
    /// Tasks shown with images, in page order.
    pub cases: Vec<TaskSection>,
    /// Rule by which these tasks were selected; `None` if all are shown.
    pub rule: Option<String>,
    /// True if this is the overview of a folder with one page per episode, see [`EpisodeRow::page`].
    pub has_pages: bool,
}

/// Duration of one phase of the run.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Name of the phase, e.g. `collect`.
    pub phase: String,
    /// Wall-clock time of the phase, s.
    pub seconds: f64,
}

/// One task with its attempts and results.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskSection {
    /// Task of the section.
    pub task: Task,
    /// Role of the case as an example; `None` if all tasks are shown.
    pub why: Option<ExampleRole>,
    /// Index of the shown episode in [`ReportInput::episodes`]; `None` if no episode is shown.
    pub episode: Option<usize>,
    /// Scenario of the shown episode; `None` without one.
    pub scenario: Option<Scenario>,
    /// Initial scene graph, from [`genmanip_viz::graph_svg`].
    pub graph: Svg,
    /// Top view of the layout, from [`genmanip_viz::layout_svg`]; `None` without a layout.
    pub layout: Option<Svg>,
    /// First image of the shown episode, JPEG; `None` if there are no images.
    pub first_image: Option<Vec<u8>>,
    /// Last image of the shown episode, JPEG; `None` if there are no images.
    pub last_image: Option<Vec<u8>>,
    /// Images between the first and the last one, in order of time.
    pub film: Vec<EpisodeImage>,
    /// Result of the shown episode, usually of the expert.
    pub shown: Option<EpisodeResult>,
    /// Every attempt to collect a demonstration, including failed ones.
    pub attempts: Vec<AttemptRow>,
    /// Results of all policies on this task.
    pub results: Vec<EpisodeResult>,
}

/// An image of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeImage {
    /// Simulated time since the start of the episode, s.
    pub time_s: f64,
    /// The image as a JPEG file.
    pub jpeg: Vec<u8>,
}

/// One attempt to collect a demonstration.
#[derive(Clone, Debug, PartialEq)]
pub struct AttemptRow {
    /// Id of the scenario or episode.
    pub id: String,
    /// Verified, or the cause of the failure.
    pub outcome: AttemptOutcome,
    /// Wall-clock time of the attempt, s.
    pub seconds: f64,
}

/// Settings of the page: size limit and statistics.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportSettings {
    /// Maximum size of the HTML file, bytes; film strips are thinned until it fits.
    pub max_bytes: usize,
    /// Settings of the confidence intervals.
    pub statistics: StatisticsSettings,
}

impl Default for ReportSettings {
    fn default() -> Self {
        // 15 MB opens without delay from a mail or a CI artefact.
        Self { max_bytes: 15_000_000, statistics: StatisticsSettings::default() }
    }
}

/// Reasons why there is no page.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// The page is too large even without film strips and thumbnails.
    #[error(
        "the report needs {got} bytes without film strips, more than the {limit} allowed; allow more, or show less with `--only`"
    )]
    TooLarge {
        /// Size limit, bytes.
        limit: usize,
        /// Size of the smallest version of the page, bytes.
        got: usize,
    },
}

/// Selection of images, so that the page stays within its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ImagePlan {
    /// Stride of the images in a film strip; `None` for no strip.
    film_step: Option<usize>,
    /// True if the table of tasks shows thumbnails.
    thumbnails: bool,
}

const PLANS: [ImagePlan; 9] = [
    ImagePlan { film_step: Some(1), thumbnails: true },
    ImagePlan { film_step: Some(2), thumbnails: true },
    ImagePlan { film_step: Some(3), thumbnails: true },
    ImagePlan { film_step: Some(4), thumbnails: true },
    ImagePlan { film_step: Some(6), thumbnails: true },
    ImagePlan { film_step: Some(8), thumbnails: true },
    ImagePlan { film_step: Some(12), thumbnails: true },
    ImagePlan { film_step: None, thumbnails: true },
    ImagePlan { film_step: None, thumbnails: false },
];

/// The page as the text of an HTML file (also well-formed XML): no external resource, complete without scripts,
/// the same bytes for the same input.
///
/// # Errors
/// [`ReportError::TooLarge`] when even the page without film strips exceeds the limit.
pub fn report_html(input: &ReportInput, settings: &ReportSettings) -> Result<String, ReportError> {
    let mut smallest = None;
    for plan in PLANS {
        // Do not build pages that cannot fit, except the last plan, whose size the error reports.
        if image_bytes(input, plan) > settings.max_bytes && plan != PLANS[PLANS.len() - 1] {
            continue;
        }
        let page = page(input, settings, plan);
        if page.len() <= settings.max_bytes {
            return Ok(page);
        }
        smallest = Some(page.len());
    }
    Err(ReportError::TooLarge { limit: settings.max_bytes, got: smallest.unwrap_or(0) })
}

fn page(input: &ReportInput, settings: &ReportSettings, plan: ImagePlan) -> String {
    let sections: String = input
        .cases
        .iter()
        .enumerate()
        .map(|(index, section)| task::section(index, section, input.baseline.as_deref(), plan))
        .collect();
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n",
            "<meta name=\"color-scheme\" content=\"light dark\" />\n",
            "<title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n",
            "{overview}<main>\n{sections}</main>\n<footer>{footer}</footer>\n<script>\n{script}</script>\n</body>\n</html>\n"
        ),
        title = escape(&input.title),
        style = include_str!("style.css"),
        overview = overview::overview(input, settings, plan),
        sections = sections,
        footer = escape(&format!("Made by {}, seed {}.", input.generated_by, input.seed)),
        script = include_str!("script.js"),
    )
}

fn image_bytes(input: &ReportInput, plan: ImagePlan) -> usize {
    let length = |image: &Option<Vec<u8>>| image.as_ref().map_or(0, |jpeg| base64_length(jpeg.len()));
    let of_section = |section: &TaskSection| {
        let film: usize = plan.film(section).map(|frame| base64_length(frame.jpeg.len())).sum();
        let thumbnail = if plan.thumbnails { length(section.thumbnail()) } else { 0 };
        film + thumbnail + length(&section.first_image) + length(&section.last_image)
    };
    input.cases.iter().map(of_section).sum()
}

impl ImagePlan {
    fn film<'a>(&self, section: &'a TaskSection) -> impl Iterator<Item = &'a EpisodeImage> {
        let shown = if self.film_step.is_some() { usize::MAX } else { 0 };
        section.film.iter().step_by(self.film_step.unwrap_or(1)).take(shown)
    }
}

impl TaskSection {
    fn thumbnail(&self) -> &Option<Vec<u8>> {
        if self.last_image.is_some() { &self.last_image } else { &self.first_image }
    }

    fn verified(&self) -> usize {
        self.attempts.iter().filter(|attempt| attempt.outcome == AttemptOutcome::Verified).count()
    }
}

/// HTML element with an embedded image.
fn image(jpeg: &[u8], alternative: &str) -> String {
    let (data, alternative) = (base64(jpeg), escape(alternative));
    format!("<img src=\"data:image/jpeg;base64,{data}\" alt=\"{alternative}\" />")
}

/// Short coloured label; `class` is one of `good`, `bad`, `plain`, `warn`.
fn chip(class: &str, text: &str) -> String {
    format!(" <span class=\"chip {class}\">{}</span>", escape(text))
}

/// A name such as `pick_and_place` with spaces for underscores.
fn words(name: &str) -> String {
    name.replace('_', " ")
}

/// Caption of a case: the failure cause or task kind that it shows.
fn shows(shows: ExampleOf) -> String {
    match shows {
        ExampleOf::Failure(cause) => format!("failure: {}", words(cause.name())),
        ExampleOf::Success(kind) => format!("success: {}", words(kind.name())),
    }
}
