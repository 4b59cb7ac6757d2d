//! Worlds matched to photographs of hidden worlds with known truth: errors of response, light and materials, and of
//! held-out views.

mod hidden;
mod materials;
mod views;

use std::path::Path;
use std::sync::Arc;

use genmanip_core::Seed;
use genmanip_visual_matching::{MatchRequest, Matched, ObjectScene, match_workspace};
use genmanip_workspace::{Progress, WorkspaceError};
use serde::Serialize;

use crate::clock::cpu_clock;
use crate::quantile::Spread;
use hidden::Hidden;
use views::{Difference, held_out, medians};

/// Errors of matched worlds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number of worlds.
    pub count: usize,
    /// Number of worlds whose photographs were path-traced, with a tone curve that matched responses cannot have.
    pub traced: usize,
    /// Relative error of the exposure: median and 95th percentile over the worlds with a colour chart.
    pub exposure_error_median: f64,
    /// 95th percentile of it.
    pub exposure_error_p95: f64,
    /// Largest relative error of the three white-balance factors: median over the worlds with a colour chart.
    pub white_balance_error_median: f64,
    /// 95th percentile of it.
    pub white_balance_error_p95: f64,
    /// Angle between found and true direction of the key light, degrees: median over the worlds where it was found.
    pub light_direction_deg_median: f64,
    /// 95th percentile of it.
    pub light_direction_deg_p95: f64,
    /// Number of worlds where the direction was found, and of those with shadows of known things.
    pub directions_found: [usize; 2],
    /// Median over held-out views of their mean ΔE2000 to the hidden truth, in the default world and in the matched one.
    pub delta_e_before: f64,
    /// The same median in the matched world.
    pub delta_e_after: f64,
    /// Median over held-out views of their mean FLIP, in the default world and in the matched one.
    pub flip_before: f64,
    /// The same median in the matched world.
    pub flip_after: f64,
    /// Median ΔE2000 before and after, of the photographed view with other objects and another posture of the arm.
    pub delta_e_same_view: [f64; 2],
    /// Median ΔE2000 before and after, without background, of a view from another place that was never photographed.
    pub delta_e_new_view: [f64; 2],
    /// Number of properties that the photographs of a world could not tell.
    pub unidentifiable_planted: usize,
    /// Number of those that were named.
    pub unidentifiable_named: usize,
    /// Number of properties that were named although the photographs could tell them.
    pub named_wrongly: usize,
    /// Materials of objects that the photographs show.
    pub materials: materials::MaterialReport,
    /// CPU time of matching alone, s.
    pub match_cpu_s: f64,
    /// CPU time of the whole measurement, s.
    pub cpu_s: f64,
}

/// Matches `count` hidden worlds; images of held-out views (truth, before, after) are written to `out`, if given.
///
/// # Errors
/// When a hidden world cannot be rendered, its photographs cannot be matched, or an image cannot be written.
pub fn measure(
    count: usize,
    seed: Seed,
    out: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Report, WorkspaceError> {
    let mut clock = cpu_clock();
    let (mut exposure, mut balance, mut angles) = (Vec::new(), Vec::new(), Vec::new());
    let mut views: [Vec<[Difference; 2]>; 2] = [Vec::new(), Vec::new()];
    let mut report = Report {
        count,
        traced: 0,
        exposure_error_median: 0.0,
        exposure_error_p95: 0.0,
        white_balance_error_median: 0.0,
        white_balance_error_p95: 0.0,
        light_direction_deg_median: 0.0,
        light_direction_deg_p95: 0.0,
        directions_found: [0, 0],
        delta_e_before: 0.0,
        delta_e_after: 0.0,
        flip_before: 0.0,
        flip_after: 0.0,
        delta_e_same_view: [0.0; 2],
        delta_e_new_view: [0.0; 2],
        unidentifiable_planted: 0,
        unidentifiable_named: 0,
        named_wrongly: 0,
        materials: materials::MaterialReport::default(),
        match_cpu_s: 0.0,
        cpu_s: 0.0,
    };
    let mut errors = materials::Errors::default();
    progress.begin("matching", count);
    for index in 0..count {
        let hidden = Hidden::new(index, seed)?;
        let request = request(&hidden)?;
        let before = clock();
        let matched = match_workspace(&request)
            .map_err(|error| WorkspaceError::broken(format!("hidden world {index} cannot be matched"), error))?;
        report.match_cpu_s += clock() - before;
        report.traced += usize::from(hidden.kind.traced);
        count_names(&hidden, &matched, &mut report);
        if hidden.kind.chart {
            let (found, truth) = (&matched.cameras[0].response, &hidden.response);
            exposure.push((found.exposure / truth.exposure - 1.0).abs());
            let shares = found.white_balance.iter().zip(truth.white_balance).map(|(a, b)| (a / b - 1.0).abs());
            balance.push(shares.fold(0.0, f64::max));
        }
        if let Some(found) = matched.light.as_ref().filter(|found| found.has_direction()) {
            angles.push(found.light.direction.angle_between(hidden.direction).to_degrees());
        }
        for (kind, view) in views.iter_mut().enumerate() {
            view.push(held_out(&hidden, &matched, kind, index, out)?);
        }
        errors.add(&hidden, &matched)?;
        progress.advance();
    }
    progress.end();
    let (exposure, balance, angles) = (Spread::of(exposure), Spread::of(balance), Spread::of(angles));
    (report.exposure_error_median, report.exposure_error_p95) = (exposure.median, exposure.p95);
    (report.white_balance_error_median, report.white_balance_error_p95) = (balance.median, balance.p95);
    (report.light_direction_deg_median, report.light_direction_deg_p95) = (angles.median, angles.p95);
    let all: Vec<[Difference; 2]> = views.iter().flatten().copied().collect();
    [report.delta_e_before, report.delta_e_after] = medians(&all, |it| it.delta_e);
    [report.flip_before, report.flip_after] = medians(&all, |it| it.flip);
    [report.delta_e_same_view, report.delta_e_new_view] = views.each_ref().map(|views| medians(views, |it| it.delta_e));
    report.materials = errors.report();
    report.cpu_s = clock();
    Ok(report)
}

/// Photographs of a hidden world.
fn request(hidden: &Hidden) -> Result<MatchRequest, WorkspaceError> {
    let kind = hidden.kind;
    let home = hidden.robot.home.clone();
    let arm = kind.arm.then_some(home.as_slice());
    let charts = match kind.chart {
        true => vec![hidden.chart(arm)?],
        false => Vec::new(),
    };
    let scene = |placed: &hidden::Placed, label: &str| {
        Ok::<_, WorkspaceError>(ObjectScene {
            models: placed.iter().map(|(model, _)| Arc::clone(model)).collect(),
            poses: placed.iter().map(|(model, pose)| (*pose, vec![0.0; model.joint_count()])).collect(),
            photos: vec![hidden.photo(0, arm, placed, label)?],
        })
    };
    let [second, third, _] = &hidden.layouts;
    let scenes = [(&hidden.objects[0], "objects"), (second, "objects 2"), (third, "objects 3")];
    let objects = scenes.into_iter().filter(|_| kind.objects).map(|(placed, label)| scene(placed, label));
    Ok(MatchRequest {
        world: hidden.world.clone(),
        robot: Arc::clone(&hidden.robot),
        empty: vec![hidden.photo(0, arm, &[], "empty")?],
        arm: kind.arm.then(|| (home.clone(), hidden.robot.gripper.max_width)),
        charts,
        objects: objects.collect::<Result<_, _>>()?,
        table_color: None,
    })
}

/// Counts the properties that the photographs do not tell, and those that were named.
fn count_names(hidden: &Hidden, matched: &Matched, report: &mut Report) {
    use genmanip_visual_matching::names::{DIRECTION, EXPOSURE};
    let casts = hidden.kind.arm || hidden.kind.objects;
    let is_named = |name: &str| matched.unidentified.iter().any(|it| it.what == name);
    for (name, is_planted) in [(DIRECTION, !casts), (EXPOSURE, !hidden.kind.chart)] {
        report.unidentifiable_planted += usize::from(is_planted);
        report.unidentifiable_named += usize::from(is_planted && is_named(name));
        report.named_wrongly += usize::from(!is_planted && is_named(name));
    }
    report.directions_found[0] += usize::from(casts && !is_named(DIRECTION));
    report.directions_found[1] += usize::from(casts);
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let Report { count, traced, .. } = *report;
    let percent = |value: f64| 100.0 * value;
    format!(
        "{count} hidden worlds, {traced} of them path-traced\n\
         exposure            {:.1} / {:.1} % (median / 95th percentile)\n\
         white balance       {:.1} / {:.1} %\n\
         light direction     {:.1} / {:.1} degrees, found in {} of {} worlds\n\
         held-out views      ΔE2000 {:.2} before, {:.2} after; FLIP {:.3} before, {:.3} after\n\
         photographed view   ΔE2000 {:.2} before, {:.2} after\n\
         new view            ΔE2000 {:.2} before, {:.2} after\n\
         not identifiable    {} planted, {} named, {} named wrongly\n\
         {}\
         {:.1} s of CPU time, {:.1} s per match\n",
        percent(report.exposure_error_median),
        percent(report.exposure_error_p95),
        percent(report.white_balance_error_median),
        percent(report.white_balance_error_p95),
        report.light_direction_deg_median,
        report.light_direction_deg_p95,
        report.directions_found[0],
        report.directions_found[1],
        report.delta_e_before,
        report.delta_e_after,
        report.flip_before,
        report.flip_after,
        report.delta_e_same_view[0],
        report.delta_e_same_view[1],
        report.delta_e_new_view[0],
        report.delta_e_new_view[1],
        report.unidentifiable_planted,
        report.unidentifiable_named,
        report.named_wrongly,
        materials::describe(&report.materials),
        report.cpu_s,
        report.match_cpu_s / count.max(1) as f64,
    )
}
