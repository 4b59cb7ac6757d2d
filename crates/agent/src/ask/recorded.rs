//! Answers that were recorded, by the number of their ask: what a question must be like for one to be its answer.
//!
//! A question is the recorded one when stage, prompt, instruction and the answers that were refused before are the same,
//! and its marks and pictures differ by no more than [`Tolerance`] says. Any other is reported, never answered.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::Document;
use genmanip_llm::Usage;
use serde::{Deserialize, Serialize};

use super::model::Answered;
use super::question::{Marks, Question};
use super::stage::{PromptStamp, Stage};
use crate::picture::Picture;
use crate::segmentation::Mask;

/// Columns and rows of a thumbnail: cells of 32 pixels in pictures of 512 x 288.
const THUMBNAIL: [usize; 2] = [16, 9];

/// The answers of one episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswers {
    /// Id of the scenario.
    pub scenario: String,
    /// By the number of their ask.
    pub answers: Vec<RecordedAnswer>,
}

impl Document for RecordedAnswers {
    const SCHEMA: &'static str = "genmanip.agent_answers/1";
}

/// One answer with what it was given to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedAnswer {
    /// Number of the ask in the episode, repeated ones included, from 0.
    pub ask: usize,
    /// What it was about.
    pub stage: Stage,
    /// The prompt, with its version.
    pub prompt: PromptStamp,
    /// The words of the question.
    pub text: String,
    /// Whether reasons were asked for.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub reasoning: bool,
    /// Answers that had been refused before, with why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<[String; 2]>,
    /// What was drawn: middle (column and row) and size of each mask, or the points, in pixels.
    pub marks: Vec<[f64; 3]>,
    /// The pictures.
    pub pictures: Vec<Thumbnail>,
    /// What was answered.
    pub answer: String,
    /// Tokens, where the service said so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
}

/// A picture, small: the mean colour of each of 16 x 9 cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thumbnail {
    /// What it shows, e.g. `masks`.
    pub name: String,
    /// Pixels per row and rows of the picture.
    pub size: [u32; 2],
    /// Three bytes per cell, row by row, 8-bit sRGB, in base64.
    pub cells: String,
}

/// How much a question may differ from the recorded one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Mean difference of the colours of a thumbnail's cells, of 255.
    pub mean: f64,
    /// Largest difference of one cell's colours, of 255.
    pub largest: f64,
    /// Distance of a mark, pixels.
    pub mark_px: f64,
    /// Difference of a mask's size, as a share of it.
    pub mark_size: f64,
}

impl Default for Tolerance {
    /// The renderer gives the same pictures everywhere; its later versions light the same scene a little differently, by
    /// 0.9 of 255 on the mean and 12 in a cell when things began to colour the table around them.
    /// A can that is moved by its own width changes a cell by some 40 of 255.
    fn default() -> Self {
        Self { mean: 1.5, largest: 20.0, mark_px: 2.0, mark_size: 0.05 }
    }
}

/// Why a recorded answer is not the answer to a question.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mismatch {
    /// Nothing was recorded for this ask.
    #[error("ask {ask} ({}) of {scenario} is not recorded", stage.name())]
    Missing {
        /// The scenario.
        scenario: String,
        /// The ask.
        ask: usize,
        /// Its stage.
        stage: Stage,
    },
    /// Something else was asked then.
    #[error("ask {ask} of {scenario} was recorded for another {what}: {recorded}, not {asked}")]
    Other {
        /// The scenario.
        scenario: String,
        /// The ask.
        ask: usize,
        /// What differs, e.g. `prompt`.
        what: &'static str,
        /// What was recorded.
        recorded: String,
        /// What is asked now.
        asked: String,
    },
}

impl RecordedAnswer {
    /// An answer to a question.
    pub fn new(question: &Question, answered: &Answered) -> Self {
        let refused = |refused: &super::Refused| [refused.answer.clone(), refused.complaint.to_string()];
        Self {
            ask: question.ask,
            stage: question.stage,
            prompt: question.prompt.clone(),
            text: question.text.clone(),
            reasoning: question.reasoning,
            refused: question.refused.iter().map(refused).collect(),
            marks: marks(question),
            pictures: question.pictures.iter().map(|shown| Thumbnail::of(shown.name, &shown.picture)).collect(),
            answer: answered.text.clone(),
            usage: answered.usage,
        }
    }

    /// What differs from a question, with both; `None` where it is the same within the tolerance.
    fn difference(&self, question: &Question, tolerance: &Tolerance) -> Option<(&'static str, String, String)> {
        let now = Self::new(question, &Answered { text: String::new(), usage: None });
        let differs = |what, recorded: String, asked: String| (recorded != asked).then_some((what, recorded, asked));
        let prompt = |stamp: &PromptStamp| format!("{} version {} ({})", stamp.id, stamp.version, stamp.sha256);
        let words = |text: &str| text.chars().take(120).collect::<String>();
        differs("stage", self.stage.name().into(), now.stage.name().into())
            .or_else(|| differs("prompt", prompt(&self.prompt), prompt(&now.prompt)))
            .or_else(|| differs("reasoning", self.reasoning.to_string(), now.reasoning.to_string()))
            .or_else(|| (self.text != now.text).then(|| ("text", words(&self.text), words(&now.text))))
            .or_else(|| {
                let count = |refused: &[[String; 2]]| format!("{} refused answers", refused.len());
                (self.refused != now.refused).then(|| ("conversation", count(&self.refused), count(&now.refused)))
            })
            .or_else(|| differs("number of marks", self.marks.len().to_string(), now.marks.len().to_string()))
            .or_else(|| {
                let is_off = |(was, is): &(&[f64; 3], &[f64; 3])| {
                    (was[0] - is[0]).hypot(was[1] - is[1]) > tolerance.mark_px
                        || (was[2] - is[2]).abs() > tolerance.mark_size * was[2].max(1.0)
                };
                let off = self.marks.iter().zip(&now.marks).find(is_off)?;
                Some(("mark", format!("{:.1?}", off.0), format!("{:.1?}", off.1)))
            })
            .or_else(|| differs("number of pictures", self.pictures.len().to_string(), now.pictures.len().to_string()))
            .or_else(|| {
                let pairs = self.pictures.iter().zip(&now.pictures);
                pairs.into_iter().find_map(|(was, is)| was.difference(is, tolerance))
            })
    }
}

impl RecordedAnswers {
    /// The recorded answer to a question.
    ///
    /// # Errors
    /// Says what is missing or what differs.
    pub fn answer(&self, question: &Question, tolerance: &Tolerance) -> Result<Answered, Mismatch> {
        let (scenario, ask) = (self.scenario.clone(), question.ask);
        let recorded = self.answers.iter().find(|answer| answer.ask == ask);
        let Some(recorded) = recorded else {
            return Err(Mismatch::Missing { scenario, ask, stage: question.stage });
        };
        match recorded.difference(question, tolerance) {
            None => Ok(Answered { text: recorded.answer.clone(), usage: recorded.usage }),
            Some((what, recorded, asked)) => Err(Mismatch::Other { scenario, ask, what, recorded, asked }),
        }
    }
}

impl Thumbnail {
    fn of(name: &str, picture: &Picture) -> Self {
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

    fn difference(&self, now: &Self, tolerance: &Tolerance) -> Option<(&'static str, String, String)> {
        let of = |thumbnail: &Self| format!("{} of {} x {}", thumbnail.name, thumbnail.size[0], thumbnail.size[1]);
        if of(self) != of(now) {
            return Some(("picture", of(self), of(now)));
        }
        let cells = |thumbnail: &Self| STANDARD.decode(&thumbnail.cells).unwrap_or_default();
        let (was, is) = (cells(self), cells(now));
        if was.len() != is.len() {
            return Some(("picture", format!("{} bytes", was.len()), format!("{} bytes", is.len())));
        }
        let apart: Vec<f64> = was.iter().zip(&is).map(|(was, is)| f64::from(was.abs_diff(*is))).collect();
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

/// What is drawn: middle and size of each mask, the points, or what is moved over the grid.
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
