//! Recorded answers, replayed in the order of their asks if the question matches.
//!
//! A question matches if its kind, prompt, instruction and previously rejected answers are equal, and its marks and
//! images differ by at most [`Tolerance`]. Recorded questions that are no longer asked are passed over. Any other question
//! is reported as a mismatch and never answered.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::Document;
use genmanip_llm::Usage;
use serde::{Deserialize, Serialize};

use super::model::ModelReply;
use super::question::{Marks, Question};
use super::question_kind::{PromptStamp, QuestionKind};
use crate::image::RgbImage;
use crate::segmentation::Mask;

/// Columns and rows of a thumbnail: cells of 32 pixels in images of 512 x 288.
const THUMBNAIL: [usize; 2] = [16, 9];

/// The answers of one episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswers {
    /// Id of the scenario of the episode.
    pub scenario: String,
    /// Answers in the order of their ask index.
    pub answers: Vec<RecordedAnswer>,
}

impl Document for RecordedAnswers {
    const SCHEMA: &'static str = "genmanip.agent_answers/1";
}

/// Recorded answer with the question it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswer {
    /// Index of the ask in the episode, retries included, from 0.
    pub ask: usize,
    /// Kind of question.
    pub stage: QuestionKind,
    /// Identity of the prompt, with its version.
    pub prompt: PromptStamp,
    /// Text of the question, as it was sent.
    pub text: String,
    /// True if reasoning was requested.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub reasoning: bool,
    /// Previously rejected answers with the reasons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<[String; 2]>,
    /// Drawn marks (px): centre (column, row) and area of each mask, or column, row and 1 of each point.
    pub marks: Vec<[f64; 3]>,
    /// Thumbnails of the images that were sent.
    pub pictures: Vec<Thumbnail>,
    /// Text of the answer, as the model gave it.
    pub answer: String,
    /// Token usage, if the service reported it; `None` otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
    /// True if the model was stopped at its limit of tokens.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cut_off: bool,
}

/// Thumbnail of an image: mean colour of each of 16 x 9 cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thumbnail {
    /// Name of the image, e.g. `masks`.
    pub name: String,
    /// Width and height of the image (px).
    pub size: [u32; 2],
    /// Three bytes per cell, row by row, 8-bit sRGB, in base64.
    pub cells: String,
}

/// Tolerated differences between a question and its recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Maximum mean difference of thumbnail cell colours, on a scale of 0 to 255.
    pub mean: f64,
    /// Maximum difference of the colour of one cell, on a scale of 0 to 255.
    pub largest: f64,
    /// Maximum distance of a mark (px).
    pub mark_px: f64,
    /// Maximum relative difference of a mask's area.
    pub mark_size: f64,
}

impl Default for Tolerance {
    /// The renderer is deterministic across machines, but renderer versions differ slightly: the version that
    /// introduced colour bleeding onto the table changed images by 0.9 of 255 on average and by 12 in one cell. An
    /// object displaced by its own width changes a cell by about 40 of 255.
    fn default() -> Self {
        Self { mean: 1.5, largest: 20.0, mark_px: 2.0, mark_size: 0.05 }
    }
}

/// Mismatch between a recorded answer and a question.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// No answer was recorded for this ask.
    #[error("ask {ask} ({}) of {scenario} is not recorded", stage.name())]
    Missing {
        /// Id of the scenario of the episode.
        scenario: String,
        /// Index of the ask without an answer.
        ask: usize,
        /// Kind of the question.
        stage: QuestionKind,
    },
    /// The recording belongs to a different question.
    #[error("ask {ask} of {scenario} was recorded for another {what}: {recorded}, not {asked}")]
    Other {
        /// Id of the scenario of the episode.
        scenario: String,
        /// Index of the ask that differs.
        ask: usize,
        /// Differing property, e.g. `prompt`.
        what: &'static str,
        /// Value of the property in the recording.
        recorded: String,
        /// Value of the property in the question.
        asked: String,
    },
}

impl RecordedAnswer {
    /// Records the answer to a question.
    pub fn new(question: &Question, answered: &ModelReply) -> Self {
        let refused = |refused: &super::RejectedAnswer| [refused.answer.clone(), refused.rejection.to_string()];
        Self {
            ask: question.ask,
            stage: question.stage,
            prompt: question.prompt.clone(),
            text: question.text.clone(),
            reasoning: question.reasoning,
            refused: question.refused.iter().map(refused).collect(),
            marks: marks(question),
            pictures: question.pictures.iter().map(|shown| Thumbnail::size_of(shown.name, &shown.picture)).collect(),
            answer: answered.text.clone(),
            usage: answered.usage,
            cut_off: answered.cut_off,
        }
    }

    /// First difference from a question as name, recorded value and current value; `None` if all are within tolerance.
    fn difference(&self, current: &Self, tolerance: &Tolerance) -> Option<(&'static str, String, String)> {
        let differs = |what, recorded: String, asked: String| (recorded != asked).then_some((what, recorded, asked));
        let prompt = |stamp: &PromptStamp| format!("{} version {} ({})", stamp.id, stamp.version, stamp.sha256);
        let excerpt = |text: &str| text.chars().take(120).collect::<String>();
        differs("stage", self.stage.name().into(), current.stage.name().into())
            .or_else(|| differs("prompt", prompt(&self.prompt), prompt(&current.prompt)))
            .or_else(|| differs("reasoning", self.reasoning.to_string(), current.reasoning.to_string()))
            .or_else(|| (self.text != current.text).then(|| ("text", excerpt(&self.text), excerpt(&current.text))))
            .or_else(|| {
                let count = |refused: &[[String; 2]]| format!("{} refused answers", refused.len());
                (self.refused != current.refused)
                    .then(|| ("conversation", count(&self.refused), count(&current.refused)))
            })
            .or_else(|| differs("number of marks", self.marks.len().to_string(), current.marks.len().to_string()))
            .or_else(|| {
                let is_displaced = |(recorded_mark, current_mark): &(&[f64; 3], &[f64; 3])| {
                    (recorded_mark[0] - current_mark[0]).hypot(recorded_mark[1] - current_mark[1]) > tolerance.mark_px
                        || (recorded_mark[2] - current_mark[2]).abs() > tolerance.mark_size * recorded_mark[2].max(1.0)
                };
                let displaced = self.marks.iter().zip(&current.marks).find(is_displaced)?;
                Some(("mark", format!("{:.1?}", displaced.0), format!("{:.1?}", displaced.1)))
            })
            .or_else(|| {
                differs("number of pictures", self.pictures.len().to_string(), current.pictures.len().to_string())
            })
            .or_else(|| {
                let pairs = self.pictures.iter().zip(&current.pictures);
                pairs
                    .into_iter()
                    .find_map(|(recorded_mark, current_mark)| recorded_mark.difference(current_mark, tolerance))
            })
    }
}

impl RecordedAnswers {
    /// Returns the recorded answer to a question: of the matching ones from its ask index on, the first. The agent may
    /// ask fewer questions than when the answers were recorded.
    ///
    /// # Errors
    /// Reports a missing recording, or the first difference from the one of the same ask index.
    pub fn answer(&self, question: &Question, tolerance: &Tolerance) -> Result<ModelReply, Mismatch> {
        let (scenario, ask) = (self.scenario.clone(), question.ask);
        let current = RecordedAnswer::new(question, &ModelReply { text: String::new(), usage: None, cut_off: false });
        let mut later: Vec<&RecordedAnswer> = self.answers.iter().filter(|answer| answer.ask >= ask).collect();
        later.sort_by_key(|answer| answer.ask);
        if let Some(found) = later.iter().find(|answer| answer.difference(&current, tolerance).is_none()) {
            return Ok(ModelReply { text: found.answer.clone(), usage: found.usage, cut_off: found.cut_off });
        }
        let recorded = later.first().filter(|answer| answer.ask == ask);
        match recorded.and_then(|recorded| recorded.difference(&current, tolerance)) {
            None => Err(Mismatch::Missing { scenario, ask, stage: question.stage }),
            Some((what, recorded, asked)) => Err(Mismatch::Other { scenario, ask, what, recorded, asked }),
        }
    }
}

impl Thumbnail {
    fn size_of(name: &str, picture: &RgbImage) -> Self {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let [columns, rows] = THUMBNAIL;
        let mut cells = Vec::with_capacity(columns * rows * 3);
        for row in 0..rows {
            for column in 0..columns {
                let (left, right) = (column * width / columns, ((column + 1) * width / columns).max(1));
                let (top, bottom) = (row * height / rows, ((row + 1) * height / rows).max(1));
                let mut sum = [0_u64; 3];
                let mut count = 0;
                for y in top..bottom.min(height) {
                    for pixel in picture.rgb[3 * (y * width + left)..3 * (y * width + right.min(width))].chunks_exact(3)
                    {
                        (0..3).for_each(|channel| sum[channel] += u64::from(pixel[channel]));
                        count += 1;
                    }
                }
                cells.extend(sum.map(|sum| (sum / count.max(1)) as u8));
            }
        }
        Self { name: name.into(), size: [picture.width, picture.height], cells: STANDARD.encode(cells) }
    }

    fn difference(&self, current: &Self, tolerance: &Tolerance) -> Option<(&'static str, String, String)> {
        let size_of = |thumbnail: &Self| format!("{} of {} x {}", thumbnail.name, thumbnail.size[0], thumbnail.size[1]);
        if size_of(self) != size_of(current) {
            return Some(("picture", size_of(self), size_of(current)));
        }
        let cells = |thumbnail: &Self| STANDARD.decode(&thumbnail.cells).unwrap_or_default();
        let (recorded_mark, current_mark) = (cells(self), cells(current));
        if recorded_mark.len() != current_mark.len() {
            return Some((
                "picture",
                format!("{} bytes", recorded_mark.len()),
                format!("{} bytes", current_mark.len()),
            ));
        }
        let apart: Vec<f64> = recorded_mark
            .iter()
            .zip(&current_mark)
            .map(|(recorded_mark, current_mark)| f64::from(recorded_mark.abs_diff(*current_mark)))
            .collect();
        let mean = apart.iter().sum::<f64>() / apart.len().max(1) as f64;
        let largest = apart.iter().copied().fold(0.0, f64::max);
        (mean > tolerance.mean || largest > tolerance.largest).then(|| {
            let limits = format!("at most {} and {} are tolerated", tolerance.mean, tolerance.largest);
            (
                "picture",
                self.name.clone(),
                format!("one that differs by {mean:.2} of 255, {largest} at most ({limits})"),
            )
        })
    }
}

/// Marks of a question for [`RecordedAnswer::marks`]; for a grid, the mask of the moved object.
fn marks(question: &Question) -> Vec<[f64; 3]> {
    let middle = |mask: &Mask| {
        let (mut x, mut y, mut count) = (0.0, 0.0, 0.0);
        for index in mask.indices() {
            x += (index % mask.width as usize) as f64;
            y += (index / mask.width as usize) as f64;
            count += 1.0;
        }
        [x / f64::max(count, 1.0), y / f64::max(count, 1.0), count].map(|number: f64| (number * 100.0).round() / 100.0)
    };
    match &question.marks {
        Marks::None => Vec::new(),
        Marks::Masks(masks) => masks.iter().map(middle).collect(),
        Marks::Points(points) => {
            let width = question.view.width() as usize;
            points.iter().map(|index| [(index % width) as f64, (index / width) as f64, 1.0]).collect()
        }
        Marks::Grid { moved, .. } => vec![middle(moved)],
    }
}
