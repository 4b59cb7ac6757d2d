//! Hand-eye calibration of random setups with known truth: errors, refusals, and coverage of the stated uncertainty.

use std::collections::BTreeMap;
use std::path::Path;

use genmanip_core::Seed;
use genmanip_real::calibrate::{Calibration, CalibrationError, CalibrationSettings, Mounting, Noise, View, calibrate};
use genmanip_real::synthetic::{Degeneracy, Scene};
use genmanip_workspace::{WorkspaceError, text_table};
use serde::Serialize;

use crate::board_images::{self, RenderedReport};
use crate::board_sets;
use crate::clock::cpu_clock;
use crate::quantile::Spread;

/// Minimum and maximum number of views of a set.
const VIEWS: [usize; 2] = [15, 20];
/// Noise of images and robot: sharp images and an exact robot; or a D435's images and an arm with errors of 0.1 mm and
/// 0.05 degrees.
const NOISES: [(&str, Noise); 2] = [
    ("clean", Noise { corner_px: 0.1, hand_m: 0.0, hand_rad: 0.0 }),
    ("noisy", Noise { corner_px: 0.3, hand_m: 1e-4, hand_rad: 0.05 * std::f64::consts::PI / 180.0 }),
];
/// Quantile of the normal distribution for a two-sided 95 % interval.
const Z: f64 = 1.959_963_984_540_054;

/// Accuracy of the calibration and detection of degenerate sets.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Results on sound sets, by mounting and noise.
    pub setups: Vec<SetupReport>,
    /// Degenerate sets by kind: number refused, and number of all.
    pub degenerate: BTreeMap<Degeneracy, [usize; 2]>,
    /// Results on sets from rendered images; `None` unless requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rendered: Option<RenderedReport>,
    /// CPU time of the measurement, s.
    pub cpu_s: f64,
}

/// Results of one mounting and noise.
#[derive(Clone, Debug, Serialize)]
pub struct SetupReport {
    /// Mounting of the camera, by name: on the hand or fixed in the world.
    pub mounting: &'static str,
    /// Noise of images and robot, by name.
    pub noise: &'static str,
    /// Number of sets, refused ones included.
    pub sets: usize,
    /// Reasons of refused calibrations, one per refused set.
    pub refused: Vec<String>,
    /// Position error of points on the table located with the calibrated camera, m.
    pub table_m: Spread,
    /// Error of the camera's position on its mount, m.
    pub position_m: Spread,
    /// Error of the camera's orientation on its mount, degrees.
    pub rotation_deg: Spread,
    /// Reprojection error in held-out views, px.
    pub held_out_px: Spread,
    /// Share of position coordinates whose stated 95 % interval contains the truth, 0 to 1; 0.95 is ideal.
    pub coverage: f64,
}

/// Calibrates `count` random sets of each mounting and noise, `count` degenerate sets distributed over all kinds, and
/// `rendered` sets of each mounting and noise from rendered images. Sound sets are also written to `folder`, if given.
///
/// # Errors
/// When an image cannot be rendered or written.
pub fn measure(count: usize, rendered: usize, folder: Option<&Path>, seed: Seed) -> Result<Report, WorkspaceError> {
    let mut clock = cpu_clock();
    let began = clock();
    let mut setups = Vec::new();
    for mounting in [Mounting::EyeInHand, Mounting::EyeToHand] {
        for (name, noise) in &NOISES {
            let own = seed.fork(mounting.name()).fork(name);
            setups.push(setup(mounting, name, noise, count, folder, own)?);
        }
    }
    let mut degenerate: BTreeMap<Degeneracy, [usize; 2]> = BTreeMap::new();
    let (_, noise) = &NOISES[1];
    for index in 0..count {
        let how = Degeneracy::ALL[index % Degeneracy::ALL.len()];
        let mounting =
            if (index / Degeneracy::ALL.len()).is_multiple_of(2) { Mounting::EyeInHand } else { Mounting::EyeToHand };
        let own = seed.fork("degenerate").fork_index(index as u64);
        let (stated, views) = scene(mounting, index, own).degenerate(how, noise, own);
        let counts = degenerate.entry(how).or_default();
        counts[0] += usize::from(calibrated(&stated, &views).is_err());
        counts[1] += 1;
    }
    let settings = board_images::Settings { count: rendered, views: VIEWS, noises: &NOISES, folder };
    let rendered = (rendered > 0).then(|| board_images::measure(&settings, seed.fork("rendered"))).transpose()?;
    Ok(Report { setups, degenerate, rendered, cpu_s: clock() - began })
}

fn scene(mounting: Mounting, index: usize, seed: Seed) -> Scene {
    Scene::random(mounting, VIEWS[0] + index % (VIEWS[1] - VIEWS[0] + 1), seed.fork("scene"))
}

fn calibrated(scene: &Scene, views: &[View]) -> Result<Calibration, CalibrationError> {
    calibrate(&scene.camera, scene.mounting, views, Vec::new(), &CalibrationSettings::default())
}

fn setup(
    mounting: Mounting,
    name: &'static str,
    noise: &Noise,
    count: usize,
    folder: Option<&Path>,
    seed: Seed,
) -> Result<SetupReport, WorkspaceError> {
    let (mut table, mut position, mut rotation, mut held_out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut refused, mut within) = (Vec::new(), 0);
    for index in 0..count {
        let own = seed.fork_index(index as u64);
        let scene = scene(mounting, index, own);
        let views = scene.views(noise, own);
        if let Some(folder) = folder {
            let folder = folder.join(format!("{}_{name}_{index:03}", mounting.name()));
            board_sets::write(&folder, &scene, &scene.board, &views)?;
        }
        match calibrated(&scene, &views) {
            Ok(found) => {
                let pose = found.camera.mount_from_camera;
                table.extend(scene.table_errors_m(&pose));
                let off = pose.inverse() * scene.mount_from_camera;
                position.push(off.position.length());
                rotation.push(pose.angle_to(&scene.mount_from_camera).to_degrees());
                held_out.extend(found.held_out_rms_px);
                let off = off.position.to_array();
                within += (0..3).filter(|&axis| off[axis].abs() <= Z * found.position_sd_m[axis]).count();
            }
            Err(error) => refused.push(error.to_string()),
        }
    }
    let coverage = within as f64 / (3 * position.len()).max(1) as f64;
    Ok(SetupReport {
        mounting: mounting.name(),
        noise: name,
        sets: count,
        refused,
        table_m: Spread::of(table),
        position_m: Spread::of(position),
        rotation_deg: Spread::of(rotation),
        held_out_px: Spread::of(held_out),
        coverage,
    })
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let head =
        ["camera", "noise", "sets", "refused", "table, mm", "position, mm", "rotation, deg", "held out, px", "95 %"];
    let mut rows = vec![head.map(String::from).to_vec()];
    rows.extend(report.setups.iter().map(|it| {
        vec![
            it.mounting.into(),
            it.noise.into(),
            it.sets.to_string(),
            it.refused.len().to_string(),
            it.table_m.text(1e3),
            it.position_m.text(1e3),
            it.rotation_deg.text(1.0),
            it.held_out_px.text(1.0),
            format!("{:.1} %", 100.0 * it.coverage),
        ]
    }));
    let mut text = text_table(&rows) + "median / 95th percentile; 95 %: coverage of the stated intervals\n";
    for (how, [refused, all]) in &report.degenerate {
        text += &format!("{how:?}: {refused} of {all} refused\n");
    }
    text + &report.rendered.as_ref().map_or_else(String::new, board_images::describe)
}
