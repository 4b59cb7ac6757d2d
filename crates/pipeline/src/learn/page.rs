//! HTML page of a training run: its curves, and predicted and recorded actions at some points of its demonstrations.

use genmanip_benchmark::{FilmStrip, Line, LineChart, PredictedMoment, training_page};
use genmanip_policy::{Network, Prediction, RowImages, Seen};
use genmanip_render::encode::jpeg_rgb;
use genmanip_workspace::WorkspaceError;

use super::demonstrations::RunDemonstrations;
use super::options::Trained;

/// Number of points with predictions, each in another demonstration.
const MOMENTS: usize = 4;
/// JPEG quality of the images at these points, 1-100.
const JPEG_QUALITY: u8 = 90;
/// Number of position entries at the start of an action, drawn in one chart (m); the gripper is the last entry.
const POSITION: usize = 3;

/// Page of a finished training run, from the lines of its metrics file.
///
/// # Errors
/// When the images of the demonstrations cannot be read.
pub(super) fn html(
    trained: &Trained,
    metrics: &[String],
    read: &RunDemonstrations,
    images: &dyn RowImages,
    network: &Network,
) -> Result<String, WorkspaceError> {
    let count = MOMENTS.min(read.ids.len());
    let episodes = (0..count).map(|number| number * read.ids.len() / count.max(1));
    let moments = episodes.enumerate().map(|(number, episode)| {
        let rows = read.arrays.episodes[episode].actions.len() / read.arrays.action;
        moment(read, images, network, (episode, rows * (number + 1) / (MOMENTS + 1)))
    });
    let moments = moments.collect::<Result<Vec<_>, _>>()?;
    let Trained { policy, demonstrations, rows, samples, steps, parameters, final_l1, seconds, .. } = trained;
    let note = format!(
        "preset {}, {parameters} parameters\n{demonstrations} demonstrations of {rows} rows\n{steps} steps, {samples} \
         samples in {seconds:.0} s of this call\nL1 error of normalised actions at the end {final_l1:.4}",
        trained.preset.name()
    );
    Ok(training_page(&policy.display().to_string(), &note, &curves(metrics, trained.labels), &moments))
}

/// Charts of the metrics over optimiser steps.
fn curves(metrics: &[String], has_labels: bool) -> Vec<LineChart> {
    let columns = [
        (2, "L1 error of normalised actions", true, true),
        (3, "Cross-entropy of the end of the episode", true, true),
        (4, "L1 error of labelled points, in 0.1 m and normalised pixels", true, has_labels),
        (5, "Norm of all gradients before clipping", true, true),
        (6, "Learning rate", false, true),
    ];
    let rows: Vec<Vec<f64>> =
        metrics.iter().map(|line| line.split(',').filter_map(|number| number.parse().ok()).collect()).collect();
    let shown = columns.into_iter().filter(|(.., is_shown)| *is_shown);
    shown
        .map(|(column, caption, is_logarithmic, _)| {
            let points = rows.iter().filter_map(|row| Some([*row.first()?, *row.get(column)?])).collect();
            LineChart { is_logarithmic, ..LineChart::of(caption, "steps", points) }
        })
        .collect()
}

fn moment(
    read: &RunDemonstrations,
    images: &dyn RowImages,
    network: &Network,
    (episode, row): (usize, usize),
) -> Result<PredictedMoment, WorkspaceError> {
    let id = &read.ids[episode];
    let name = format!("{id}, row {row}");
    let unreadable = |error: std::io::Error| WorkspaceError::broken(format!("no prediction of {name}"), error);
    let (demonstration, description) = (&read.arrays.episodes[episode], network.description());
    let width = description.inputs.width();
    let numbers = demonstration.inputs[row * width..(row + 1) * width].to_vec();
    let rgb = images.read(episode, row).map_err(unreadable)?;
    let mut rest = rgb.as_slice();
    let mut strip = FilmStrip { caption: String::new(), pictures: Vec::new() };
    for image in &description.inputs.images {
        let (bytes, others) = rest.split_at(image.bytes().min(rest.len()));
        rest = others;
        let jpeg = jpeg_rgb(image.width as u32, image.height as u32, bytes, JPEG_QUALITY);
        strip.pictures.push(jpeg.map_err(|error| WorkspaceError::broken(format!("no image of {name}"), error))?);
        let comma = if strip.caption.is_empty() { "" } else { ", " };
        strip.caption += &format!("{comma}{} ({} × {} pixels)", image.camera, image.width, image.height);
    }
    let seen = Seen { numbers, words: demonstration.words.clone(), rgb, row };
    let Prediction { actions, .. } = network.predict(&seen).map_err(unreadable)?;
    let scale = &description.normalisation.action;
    let predicted: Vec<Vec<f32>> = actions.iter().map(|action| scale.restore(action).collect()).collect();
    let entries = read.arrays.action;
    let recorded: Vec<Vec<f32>> = demonstration.actions[row * entries..]
        .chunks_exact(entries)
        .take(predicted.len())
        .map(<[f32]>::to_vec)
        .collect();
    let chart = |caption: &str, places: std::ops::Range<usize>| {
        let line = |name: &str, place: usize, rows: &[Vec<f32>], is_dashed| {
            let points = rows.iter().enumerate().map(|(at, action)| [at as f64, f64::from(action[place])]).collect();
            Line { name: format!("{name} {}", description.contract.names[place]), points, is_dashed }
        };
        let pair = |place| [line("predicted", place, &predicted, false), line("recorded", place, &recorded, true)];
        LineChart {
            lines: places.flat_map(pair).collect(),
            ..LineChart::of(caption, "actions of the chunk", Vec::new())
        }
    };
    let charts = vec![
        chart("Position or first joints, as the action contract says", 0..POSITION.min(entries)),
        chart("Gripper", entries - 1..entries),
    ];
    Ok(PredictedMoment { name, images: strip, charts })
}
