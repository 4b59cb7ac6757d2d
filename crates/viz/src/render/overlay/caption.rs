//! Caption over the lower edge of an image: instruction, current step, time, and result.

use genmanip_agent::image::{BLACK, Color, RgbImage, WHITE};
use genmanip_core::Episode;
use genmanip_core::glam::DVec2;
use genmanip_data::export::steps::Steps;
use genmanip_rollout::Stage;

use super::super::moment::Moment;
use super::palette::{PALETTE, VERMILION};
use super::pen::{width, write};

/// Largest share of the image's height that captions cover.
const SHARE: f64 = 0.15;
/// Cap heights that are tried, largest first, as shares of the image's height. Chosen by hand: 11 down to 7 pixels of
/// 288.
const HEIGHTS: [f64; 5] = [0.040, 0.036, 0.032, 0.028, 0.025];
/// Distance of baselines, in cap heights.
const LEADING: f64 = 1.7;
/// Opacity of the caption's background, 0-1.
const GROUND: f64 = 0.62;
/// Time before the end of an episode from which the result is shown, s.
const END_S: f64 = 1.0;

/// Caption of an episode or a scenario.
pub(super) struct Caption {
    instruction: String,
    /// Steps, duration and result of an episode; `None` for a scenario.
    told: Option<Told>,
}

struct Told {
    steps: Steps,
    duration_s: f64,
    success: bool,
}

impl Caption {
    pub(super) fn new(stage: &Stage, episode: Option<&Episode>) -> Self {
        let told = |episode: &Episode| Told {
            steps: Steps::of(episode),
            duration_s: episode.frames.last().map_or(0.0, |frame| frame.time_s),
            success: episode.result.success,
        };
        Self { instruction: stage.scenario.task.instruction.clone(), told: episode.map(told) }
    }

    /// Draws the caption over the lower edge of an image.
    pub(super) fn draw(&self, picture: &mut RgbImage, moment: &Moment) {
        let (columns, rows) = (f64::from(picture.width), f64::from(picture.height));
        let margin = 0.02 * columns;
        let (below, color) = self.below(moment);
        let below: Vec<String> = (!below.is_empty()).then_some(below).into_iter().collect();
        let fits = |share: &f64| {
            let lines = wrapped(&self.instruction, share * rows, columns - 2.0 * margin);
            let is_low = band(lines.len() + below.len(), share * rows) <= SHARE * rows;
            is_low && below.iter().all(|text| width(text, share * rows) <= columns - 2.0 * margin)
        };
        let height = HEIGHTS.iter().find(|share| fits(share)).unwrap_or(&HEIGHTS[HEIGHTS.len() - 1]) * rows;
        let most = ((SHARE * rows / height - 0.8) / LEADING) as usize;
        let mut lines = wrapped(&self.instruction, height, columns - 2.0 * margin);
        lines.truncate(most.saturating_sub(below.len()).max(1));
        let top = rows - band(lines.len() + below.len(), height).min(SHARE * rows).floor();
        picture.rectangle([0.0, top], [columns, rows], BLACK, GROUND);
        let white = lines.len();
        for (index, text) in lines.iter().chain(&below).enumerate() {
            let base = top + height * (1.3 + LEADING * index as f64);
            let color = if index < white { WHITE } else { color };
            write(picture, text, DVec2::new(margin, base), height, color);
        }
    }

    /// Last line and its colour: time and current step, or the result near the end; empty for a scenario.
    fn below(&self, moment: &Moment) -> (String, Color) {
        let Some((told, frame)) = self.told.as_ref().zip(moment.frame) else { return (String::new(), WHITE) };
        let time = format!("{:.1} s", frame.time_s);
        if frame.time_s >= told.duration_s - END_S {
            return match told.success {
                true => (format!("{time}   Success"), PALETTE[3]),
                false => (format!("{time}   Failed"), VERMILION),
            };
        }
        let number = told.steps.at(moment.control_step);
        let text = told.steps.texts.get(number).map_or("", String::as_str);
        match told.steps.texts.len() {
            // A single step only repeats the instruction in other words.
            0 | 1 => (time, PALETTE[1]),
            count => (format!("{time}   {}/{count} {text}", number + 1), PALETTE[1]),
        }
    }
}

/// Height of the background of this many lines, pixels; `height` is the cap height.
fn band(lines: usize, height: f64) -> f64 {
    height * (0.8 + LEADING * lines as f64)
}

/// Text broken into lines of at most `widest` pixels; a wider word gets a line of its own.
fn wrapped(text: &str, height: f64, widest: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), height) <= widest => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the text and the size, nothing above the lowest 15 % of the image changes, and something below does.
    #[test]
    fn captions_stay_in_the_lowest_part_of_the_picture() {
        let long = "Put the small red mug that stands left of the blue bowl on the plate. ".repeat(6);
        for (columns, rows) in [(512, 288), (1280, 720), (96, 54), (256, 256)] {
            for text in ["Lift it.", "Put the red mug on the plate and the fork into the bowl.", &long] {
                let mut picture = RgbImage::plain(columns, rows, [200, 180, 160]);
                let caption = Caption { instruction: text.into(), told: None };
                let moment = Moment {
                    picture: 0,
                    control_step: 0,
                    frame: None,
                    arm: Vec::new(),
                    width: 0.0,
                    objects: Vec::new(),
                };
                caption.draw(&mut picture, &moment);
                let changed = |row: u32| {
                    let bytes = columns as usize * 3;
                    picture.rgb[row as usize * bytes..][..bytes].chunks(3).any(|pixel| pixel != [200, 180, 160])
                };
                let first = (0..rows).find(|row| changed(*row)).unwrap();
                assert!(f64::from(rows - first) <= 0.15 * f64::from(rows), "{columns}x{rows}: {text}: row {first}");
            }
        }
    }
}
