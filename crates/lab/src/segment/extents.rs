//! Centres and sizes of objects from the depth of several cameras, compared with the posed geometry.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_agent::perception::{ObservedObject, SegmentedViews};
use genmanip_agent::segmentation::{Mask, Segmenter};
use genmanip_assets::Catalogue;
use genmanip_core::{Aabb, Seed, World};
use genmanip_workspace::{Progress, task_files, text_table};
use serde::Serialize;

use super::scenes::{Scenes, SegmentView, Stratum};
use super::{FOUND_IOU, MIN_PIXELS, SPARE, SegmentArguments};
use crate::LabError;
use crate::quantile::quantile;

/// Cameras whose depth the agent uses; the image of the first one is shown to the model.
const CAMERAS: [&str; 3] = ["overview", "left", "right"];

/// Position and size errors of a group of objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Number of objects with a mask in the first camera's image.
    pub objects: usize,
    /// Median horizontal distance of the bounding box's centre from the true one, mm.
    pub centre_mm_median: f64,
    /// 95th percentile of the same distance, mm.
    pub centre_mm_p95: f64,
    /// Maximum of the same distance, mm.
    pub centre_mm_max: f64,
    /// Median over objects of the largest error of width, depth and height of the bounding box, mm.
    pub size_mm_median: f64,
    /// 95th percentile of the same error, mm.
    pub size_mm_p95: f64,
}

/// Errors of located objects.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of scenes.
    pub scenes: usize,
    /// Number of objects with at least 200 visible pixels in the first camera's image.
    pub visible: usize,
    /// Errors of all objects with a mask.
    #[serde(flatten)]
    pub all: Errors,
    /// Errors by category of object.
    pub strata: BTreeMap<Stratum, Errors>,
    /// Number of visible objects with a handle.
    pub handles: usize,
    /// Number of visible objects with a handle that are not cut: no second mask covers more than 3 % of their pixels.
    pub handles_joined: usize,
    /// Largest centre errors, mm, each with scene, camera and object; for the text summary.
    #[serde(skip)]
    pub worst: Vec<(f64, String)>,
}

/// Share of an object's visible pixels covered by a second mask above which the object counts as cut into parts.
const CUT_SHARE: f64 = 0.03;
/// Number of largest errors in the text summary.
const WORST: usize = 8;

/// Error of one object: category, errors of centre and size (mm), name.
type Miss = (Stratum, [f64; 2], String);

/// Renders scenes with the agent's cameras, and locates every object that has a mask.
///
/// # Errors
/// If a scene cannot be rendered or the segmenter fails.
pub fn measure(
    arguments: &SegmentArguments,
    segmenter: &dyn Segmenter,
    world: &Arc<World>,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let tasks = task_files::designed_tasks(arguments.count * SPARE, seed.value(), Catalogue::builtin())?;
    let mut scenes = Scenes::new(world, seed, &CAMERAS)?;
    let (mut made, mut visible, mut images) = (0, 0, 0);
    let (mut handles, mut handles_joined) = (0, 0);
    let mut misses: Vec<Miss> = Vec::new();
    progress.begin("locating", arguments.count);
    for (index, task) in tasks.iter().enumerate() {
        if made == arguments.count {
            break;
        }
        let Some(mut views) = scenes.draw(index, task)? else { continue };
        made += 1;
        for view in &mut views {
            arguments.disturb(view, seed, images);
            images += 1;
        }
        let found = located(views, segmenter, &mut misses)?;
        visible += found.visible;
        handles += found.handles;
        handles_joined += found.handles_joined;
        progress.advance();
    }
    progress.end();
    let strata = [Stratum::Free, Stratum::Touching, Stratum::InOrOn, Stratum::Thin];
    let of = |stratum| errors(misses.iter().filter(|(other, ..)| *other == stratum));
    let mut worst: Vec<(f64, String)> = misses.iter().map(|(_, [centre, _], name)| (*centre, name.clone())).collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    worst.truncate(WORST);
    let all = errors(misses.iter());
    let strata = strata.into_iter().map(|it| (it, of(it))).collect();
    Ok(Measured { scenes: made, visible, all, strata, handles, handles_joined, worst })
}

/// Counts of the visible objects of a scene.
#[derive(Default)]
struct Found {
    visible: usize,
    handles: usize,
    handles_joined: usize,
}

/// Adds the errors of a scene's objects to `misses`; returns the counts of its visible objects.
fn located(views: Vec<SegmentView>, segmenter: &dyn Segmenter, misses: &mut Vec<Miss>) -> Result<Found, LabError> {
    let ignore: Vec<Vec<bool>> = views.iter().map(|view| view.ignore.clone()).collect();
    let images = views.iter().map(|view| (view.name.clone(), Arc::new(view.image.clone()))).collect();
    let seen = SegmentedViews::new(images, &ignore, segmenter)
        .map_err(|error| LabError::broken("a scene cannot be segmented", error))?;
    let (Some(shown), Some(truth)) = (seen.shown(), views.first()) else { return Ok(Found::default()) };
    let mut found = Found::default();
    for object in truth.objects.iter().filter(|object| object.mask.area() >= MIN_PIXELS) {
        found.visible += 1;
        let overlaps = shown.masks.iter().map(|mask| mask.iou(&object.mask)).enumerate();
        let best = overlaps.max_by(|a, b| a.1.total_cmp(&b.1));
        if object.has_handle {
            found.handles += 1;
            found.handles_joined += usize::from(best.is_some_and(|(own, _)| !is_cut(&object.mask, own, &shown.masks)));
        }
        let Some((mask, iou)) = best else { continue };
        if iou < FOUND_IOU {
            continue;
        }
        let around: Vec<_> =
            (0..shown.masks.len()).filter(|other| *other != mask).flat_map(|it| seen.points(it)).collect();
        let Some(observed) = ObservedObject::new(seen.points(mask), &around, 0.0) else { continue };
        misses.push((object.stratum, miss_mm(&observed, &object.bounds), format!("{}: {}", truth.name, object.name)));
    }
    Ok(found)
}

/// True if a mask other than the object's own covers more than [`CUT_SHARE`] of it.
fn is_cut(object: &Mask, own: usize, masks: &[Mask]) -> bool {
    let covered = |mask: &Mask| object.indices().filter(|index| mask.pixels[*index]).count();
    let others = masks.iter().enumerate().filter(|(index, _)| *index != own);
    others.map(|(_, mask)| covered(mask)).max().is_some_and(|most| most as f64 > CUT_SHARE * object.area() as f64)
}

/// Horizontal error of the centre, and largest error of the three sizes, mm.
fn miss_mm(observed: &ObservedObject, bounds: &Aabb) -> [f64; 2] {
    let centre = (observed.pose.position - bounds.center()).truncate().length();
    let size = (2.0 * observed.half).extend(observed.height_m) - bounds.size();
    [centre * 1e3, size.abs().max_element() * 1e3]
}

fn errors<'a>(misses: impl Iterator<Item = &'a Miss>) -> Errors {
    let (mut centres, mut sizes): (Vec<f64>, Vec<f64>) = misses.map(|(_, [centre, size], _)| (*centre, *size)).unzip();
    centres.sort_by(f64::total_cmp);
    sizes.sort_by(f64::total_cmp);
    Errors {
        objects: centres.len(),
        centre_mm_median: quantile(&centres, 0.5),
        centre_mm_p95: quantile(&centres, 0.95),
        centre_mm_max: quantile(&centres, 1.0),
        size_mm_median: quantile(&sizes, 0.5),
        size_mm_p95: quantile(&sizes, 0.95),
    }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let head = ["", "objects", "centre median", "p95", "max", "size median", "p95 (mm)"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let mut row = |name: String, errors: &Errors| {
        let numbers = [
            errors.centre_mm_median,
            errors.centre_mm_p95,
            errors.centre_mm_max,
            errors.size_mm_median,
            errors.size_mm_p95,
        ];
        let numbers = numbers.map(|number| format!("{number:.1}"));
        rows.push([name, errors.objects.to_string()].into_iter().chain(numbers).collect());
    };
    for (stratum, errors) in &measured.strata {
        row(super::name_of(*stratum), errors);
    }
    row("all".into(), &measured.all);
    let mut text = format!(
        "{}\n{} scenes; {} of {} visible objects have a mask; {} of {} with a handle are not cut\n",
        text_table(&rows),
        measured.scenes,
        measured.all.objects,
        measured.visible,
        measured.handles_joined,
        measured.handles
    );
    for (error, name) in &measured.worst {
        text += &format!("  {error:.1} mm  {name}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_errors() {
        let miss = |centre: f64| (Stratum::Free, [centre, 2.0 * centre], String::new());
        let misses: Vec<Miss> = (0..=20).map(|index| miss(f64::from(20 - index))).collect();
        let found = errors(misses.iter());
        assert_eq!(
            (found.objects, found.centre_mm_median, found.centre_mm_p95, found.centre_mm_max),
            (21, 10.0, 19.0, 20.0)
        );
        assert_eq!((found.size_mm_median, found.size_mm_p95), (20.0, 38.0));
        assert_eq!(errors([].iter()), Errors::default());
    }
}
