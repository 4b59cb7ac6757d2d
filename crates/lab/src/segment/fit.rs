//! Fit of the weights of region merging (RGB-D segmentation) to the oversegmentation of rendered scenes.

use genmanip_workspace::task_files;
use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_agent::segmentation::rgbd::Oversegmentation;
use genmanip_agent::segmentation::rgbd::merge::{FEATURES, Features};
use genmanip_agent::segmentation::{RgbdSegmenter, SegmentQuestion};
use genmanip_assets::Catalogue;
use genmanip_core::{Seed, World};
use genmanip_workspace::Progress;
use serde::Serialize;

use super::scenes::{Scenes, SegmentView};
use super::{SPARE, SegmentArguments};
use crate::LabError;
use crate::fit::{Sample, chance, fit};

/// Number of rounds: regions are merged with the weights of the previous round, and the weights are refitted to all
/// region pairs met so far.
const ROUNDS: usize = 4;
/// Minimum share of a region's pixels that belong to one object; less pure regions are not used.
const PURE: f64 = 0.8;

/// Fitted weights, and their accuracy on the pairs that they were fitted to.
#[derive(Debug, Serialize)]
pub struct Fitted {
    /// Number of region pairs, weighted copies included.
    pub pairs: usize,
    /// Share of these pairs within one object, 0 to 1.
    pub same: f64,
    /// Share of these pairs classified correctly at probability 0.5.
    pub right: f64,
    /// Fitted weights by name of the feature.
    pub weights: BTreeMap<&'static str, f64>,
    /// Weights in the order of the features, to paste into the source.
    pub in_order: Vec<f64>,
}

/// Fits the weights to rendered scenes, with exact or noisy depth as the arguments say.
///
/// # Errors
/// If a scene cannot be rendered.
pub fn fit_weights(
    arguments: &SegmentArguments,
    segmenter: &RgbdSegmenter,
    world: &Arc<World>,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Fitted, LabError> {
    let tasks = task_files::designed_tasks(arguments.count * SPARE, seed.value(), Catalogue::builtin())?;
    let mut scenes = Scenes::new(world, seed, &super::DATA_CAMERAS)?;
    let mut views: Vec<(Oversegmentation, Vec<Option<usize>>)> = Vec::new();
    progress.begin("drawing", arguments.count);
    for (index, task) in tasks.iter().enumerate() {
        if views.len() >= 2 * arguments.count {
            break;
        }
        for mut view in scenes.draw(index, task)?.unwrap_or_default() {
            arguments.disturb(&mut view, seed, views.len());
            let cut =
                segmenter.oversegment(&SegmentQuestion { image: &view.image, ignore: &view.ignore, within: None });
            let owners = owners(&cut, &view);
            views.push((cut, owners));
        }
        progress.advance();
    }
    progress.end();
    let mut samples: Vec<Sample> = Vec::new();
    let mut weights = vec![0.0; FEATURES.len()];
    for _ in 0..ROUNDS {
        for (cut, owners) in &views {
            meet(cut, owners, &weights, &mut samples);
        }
        weights = fit(&samples);
    }
    let same = samples.iter().filter(|(_, same)| *same).count() as f64 / samples.len().max(1) as f64;
    let right = samples.iter().filter(|(features, same)| (chance(&weights, features) >= 0.5) == *same).count() as f64;
    let right = right / samples.len().max(1) as f64;
    let in_order: Vec<f64> = weights.iter().map(|weight| (weight * 100.0).round() / 100.0).collect();
    let weights = FEATURES.into_iter().zip(in_order.iter().copied()).collect();
    Ok(Fitted { pairs: samples.len(), same, right, weights, in_order })
}

/// Object that each region belongs to, numbered from 1; 0 for the background, `None` below the purity [`PURE`].
fn owners(cut: &Oversegmentation, view: &SegmentView) -> Vec<Option<usize>> {
    let mut counts = vec![BTreeMap::<usize, usize>::new(); cut.graph.count()];
    for (index, label) in cut.labels.iter().enumerate() {
        if let Some(counts) = counts.get_mut(*label as usize) {
            let owner = view.objects.iter().position(|object| object.mask.pixels[index]).map_or(0, |index| index + 1);
            *counts.entry(owner).or_default() += 1;
        }
    }
    let of_region = |counts: BTreeMap<usize, usize>| {
        let all: usize = counts.values().sum();
        let (owner, most) = counts.into_iter().max_by_key(|(_, count)| *count)?;
        (most as f64 >= PURE * all as f64).then_some(owner)
    };
    counts.into_iter().map(of_region).collect()
}

/// Adds the region pairs met while regions of one object are merged, most probable first, as samples.
fn meet(cut: &Oversegmentation, owners: &[Option<usize>], weights: &[f64], samples: &mut Vec<Sample>) {
    let mut graph = cut.graph.clone();
    let mut met: Vec<(u32, u32)> = graph.pairs();
    loop {
        for &(low, high) in &met {
            if let (Some(one), Some(other)) = (owners[low as usize], owners[high as usize]) {
                let features: Features = graph.features(low, high);
                // Weight by region size through copies: wrong merges of large regions spoil more of a mask. Chosen by
                // hand.
                let smaller = graph.pixels(low).min(graph.pixels(high));
                let copies = if smaller >= 200.0 {
                    4
                } else if smaller >= 50.0 {
                    2
                } else {
                    1
                };
                samples.extend((0..copies).map(|_| (features.to_vec(), one == other)));
            }
        }
        let same = graph
            .pairs()
            .into_iter()
            .filter(|(low, high)| owners[*low as usize].is_some() && owners[*low as usize] == owners[*high as usize]);
        let rated = same.map(|(low, high)| (chance(weights, &graph.features(low, high)), low, high));
        let Some((_, low, high)) = rated.max_by(|one, other| one.0.total_cmp(&other.0)) else { break };
        graph.join(low, high);
        met = graph.pairs_of(low);
    }
}

/// Text summary.
pub fn describe(fitted: &Fitted) -> String {
    let mut text = format!(
        "{} pairs, {:.1} % of one object, {:.2} % judged rightly\n",
        fitted.pairs,
        100.0 * fitted.same,
        100.0 * fitted.right
    );
    for (name, weight) in FEATURES.iter().zip(&fitted.in_order) {
        text += &format!("  {name:<16} {weight:7.2}\n");
    }
    text
}
