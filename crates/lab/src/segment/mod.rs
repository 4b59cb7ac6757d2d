//! Segmentation of RGB-D images, compared with the renderer's ids.

pub mod extents;
pub mod fit;
mod pictures;
mod scenes;
mod sensor;

use genmanip_workspace::task_files;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_agent::segmentation::{Mask, SegmentQuestion, Segmenter};
use genmanip_assets::Catalogue;
use genmanip_core::{Seed, World};
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use crate::quantile::quantile;
use genmanip_workspace::text_table;
pub use scenes::Stratum;
use scenes::{Scenes, SegmentView, TrueObject};
use sensor::D435;

/// Fixed cameras whose images are used for datasets and shown to models.
const DATA_CAMERAS: [&str; 2] = ["overview", "static"];
/// Minimum number of visible pixels for an object to count.
const MIN_PIXELS: usize = 200;
/// Minimum IoU of an object with a mask for the object to count as found.
const FOUND_IOU: f64 = 0.5;
/// Number of worst views that are saved as images.
const DRAWN: usize = 24;
/// Number of tasks designed per scene, since some have no layout with the requested number of objects.
const SPARE: usize = 2;

/// Number and noise of the scenes, and output folder.
#[derive(Clone, Debug)]
pub struct SegmentArguments {
    /// Number of scenes, each seen by two cameras.
    pub count: usize,
    /// True for the depth noise of a RealSense D435, false for exact depth.
    pub is_noisy: bool,
    /// Folder for images of the worst views; `None` for no images.
    pub out: Option<PathBuf>,
}

impl SegmentArguments {
    /// Replaces the depth of a view by a noisy one, if noise was requested.
    fn disturb(&self, view: &mut SegmentView, seed: Seed, number: usize) {
        if self.is_noisy {
            view.image = D435.measure(&view.image, seed.fork("sensor").fork_index(number as u64));
        }
    }
}

/// Accuracy on the objects of one category.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Found {
    /// Number of objects with at least 200 visible pixels.
    pub objects: usize,
    /// Mean intersection over union (IoU) of the objects with their masks; 0 for an object without a mask.
    pub mean_iou: f64,
    /// Share of the objects with an IoU of at least 0.5, 0 to 1.
    pub share_iou_50: f64,
}

/// Accuracy and cost of the segmentation.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of views segmented.
    pub views: usize,
    /// Accuracy on all objects.
    #[serde(flatten)]
    pub found: Found,
    /// Share of masks without an IoU of at least 0.5 with any object, 0 to 1.
    pub spurious_share: f64,
    /// Median CPU time per view, one thread, ms.
    pub cpu_ms_median: f64,
    /// 95th percentile of the CPU time per view, ms.
    pub cpu_ms_p95: f64,
    /// Accuracy by category of object.
    pub strata: BTreeMap<Stratum, Found>,
    /// By name of the object: number of missed objects and of all; for the text summary.
    #[serde(skip)]
    pub missed: BTreeMap<String, [usize; 2]>,
}

/// Renders scenes with both data cameras, segments every view, and compares the masks with the ids.
///
/// # Errors
/// If a scene cannot be rendered, the segmenter fails, or an image cannot be written.
pub fn measure(
    arguments: &SegmentArguments,
    segmenter: &dyn Segmenter,
    world: &Arc<World>,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let tasks = task_files::designed_tasks(arguments.count * SPARE, seed.value(), Catalogue::builtin())?;
    let mut scenes = Scenes::new(world, seed, &DATA_CAMERAS)?;
    let mut clock = cpu_clock();
    let (mut ious, mut masks_made, mut spurious, mut cpu_ms) = (Vec::new(), 0, 0, Vec::new());
    let mut worst = pictures::Worst::new(if arguments.out.is_some() { DRAWN } else { 0 });
    let mut made = 0;
    progress.begin("segmenting", arguments.count);
    for (index, task) in tasks.iter().enumerate() {
        if made == arguments.count {
            break;
        }
        let Some(views) = scenes.draw(index, task)? else { continue };
        made += 1;
        for mut view in views {
            arguments.disturb(&mut view, seed, cpu_ms.len());
            let question = SegmentQuestion { image: &view.image, ignore: &view.ignore, within: None };
            let start = clock();
            let masks = segmenter
                .segment(&question)
                .map_err(|error| LabError::broken(format!("{} cannot be segmented", view.name), error))?;
            cpu_ms.push((clock() - start) * 1e3);
            let pairs = matched(&view.objects, &masks);
            let counted = |object: &TrueObject| object.mask.area() >= MIN_PIXELS;
            let of_view: Vec<(usize, f64)> =
                pairs.iter().copied().enumerate().filter(|(index, _)| counted(&view.objects[*index])).collect();
            masks_made += masks.len();
            spurious += masks.iter().filter(|mask| is_spurious(mask, &view)).count();
            ious.extend(of_view.iter().map(|(index, iou)| {
                let object = &view.objects[*index];
                (object.stratum, object.name.clone(), *iou)
            }));
            let mean = of_view.iter().map(|(_, iou)| iou).sum::<f64>() / of_view.len().max(1) as f64;
            worst.keep(mean, view, masks);
        }
        progress.advance();
    }
    progress.end();
    if let Some(folder) = &arguments.out {
        worst.write(folder)?;
    }
    cpu_ms.sort_by(f64::total_cmp);
    let of = |stratum: Stratum| found(ious.iter().filter(|(other, ..)| *other == stratum).map(|(.., iou)| *iou));
    let strata = [Stratum::Free, Stratum::Touching, Stratum::InOrOn, Stratum::Thin];
    let mut missed: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for (_, name, iou) in &ious {
        let [lost, all] = missed.entry(name.clone()).or_default();
        *all += 1;
        *lost += usize::from(*iou < FOUND_IOU);
    }
    Ok(Measured {
        views: cpu_ms.len(),
        found: found(ious.iter().map(|(.., iou)| *iou)),
        spurious_share: spurious as f64 / (masks_made as f64).max(1.0),
        cpu_ms_median: quantile(&cpu_ms, 0.5),
        cpu_ms_p95: quantile(&cpu_ms, 0.95),
        strata: strata.into_iter().map(|stratum| (stratum, of(stratum))).collect(),
        missed,
    })
}

fn found(ious: impl Iterator<Item = f64>) -> Found {
    let ious: Vec<f64> = ious.collect();
    let objects = ious.len();
    let share = |sum: f64| sum / objects.max(1) as f64;
    let hits = ious.iter().filter(|iou| **iou >= FOUND_IOU).count();
    Found { objects, mean_iou: share(ious.iter().sum()), share_iou_50: share(hits as f64) }
}

/// IoU of each object with its mask; objects and masks are matched greedily by IoU, one to one.
fn matched(objects: &[TrueObject], masks: &[Mask]) -> Vec<f64> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (index, object) in objects.iter().enumerate() {
        pairs.extend(masks.iter().enumerate().map(|(mask, pixels)| (object.mask.iou(pixels), index, mask)));
    }
    pairs.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)).then(one.2.cmp(&other.2)));
    let (mut ious, mut is_used) = (vec![None; objects.len()], vec![false; masks.len()]);
    for (iou, object, mask) in pairs {
        if ious[object].is_none() && !is_used[mask] {
            ious[object] = Some(iou);
            is_used[mask] = true;
        }
    }
    ious.into_iter().map(Option::unwrap_or_default).collect()
}

fn is_spurious(mask: &Mask, view: &SegmentView) -> bool {
    view.objects.iter().all(|object| object.mask.iou(mask) < FOUND_IOU)
}

/// Name of a category as in JSON.
fn name_of(stratum: Stratum) -> String {
    serde_json::to_value(stratum).ok().and_then(|name| name.as_str().map(String::from)).unwrap_or_default()
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut rows = vec![["", "objects", "mean IoU", "IoU ≥ 0.5"].map(String::from).to_vec()];
    let mut row = |name: String, found: &Found| {
        rows.push(vec![
            name,
            found.objects.to_string(),
            format!("{:.3}", found.mean_iou),
            format!("{:.1} %", 100.0 * found.share_iou_50),
        ]);
    };
    for (stratum, found) in &measured.strata {
        row(name_of(*stratum), found);
    }
    row("all".into(), &measured.found);
    let mut text = format!(
        "{}\n{} views, {:.1} % of the masks spurious; {:.1} ms of CPU time per view, 95 of 100 within {:.1} ms\n",
        text_table(&rows),
        measured.views,
        100.0 * measured.spurious_share,
        measured.cpu_ms_median,
        measured.cpu_ms_p95,
    );
    let mut missed: Vec<_> = measured.missed.iter().filter(|(_, [lost, _])| *lost > 0).collect();
    missed.sort_by_key(|(_, [lost, _])| std::cmp::Reverse(*lost));
    for (name, [lost, all]) in missed {
        text += &format!("  {name}: {lost} of {all} missed\n");
    }
    text
}
