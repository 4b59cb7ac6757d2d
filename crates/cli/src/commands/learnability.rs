//! `genmanip data show --learnability`: metrics of how well a dataset can be learned from.

use std::path::Path;

use genmanip_data::lerobot::RECORD;
use genmanip_data::{DataError, EpisodeStore};
use genmanip_dataset_tools::learnability::{Learnability, Residuals, learnability};
use genmanip_pipeline::folder::RunFolder;
use genmanip_workspace::text_table;
use serde_json::json;

use genmanip_terminal::{ExitStatus, Failed, Printer};

pub fn show(path: &Path, progress: &mut dyn FnMut(usize), printer: &Printer) -> Result<ExitStatus, Failed> {
    let store = store_of(path)?;
    let measured = learnability(&store, progress).map_err(|error| {
        Failed::because("cannot measure learnability", &error)
            .or_hint("collect demonstrations first; `genmanip data check` says what is wrong with a dataset")
    })?;
    printer.data(&json!({"path": path.display().to_string(), "learnability": measured}), &describe(path, &measured));
    Ok(ExitStatus::Done)
}

/// Episode store of a run, or the episodes that this program recorded within an exported dataset; an error for other
/// folders.
fn store_of(path: &Path) -> Result<EpisodeStore, Failed> {
    if path.join("run.json").is_file() {
        return Ok(RunFolder::open(path)?.0.store()?);
    }
    let record = path.join(RECORD);
    if !record.is_dir() {
        let what = format!("{} is no run, and a dataset without {RECORD}", path.display());
        return Err(Failed::new(what).hint(
            "object poses and tool poses come from the recorded episodes: name a run, or a dataset that `genmanip collect` \
             or `genmanip export` wrote",
        ));
    }
    EpisodeStore::open(record).map_err(|error: DataError| Failed::because("cannot read the episodes", &error))
}

fn describe(path: &Path, measured: &Learnability) -> String {
    let Learnability { episodes, without_grasp, small_tasks, min_episodes, grasp, neighbours } = measured;
    let mut text = format!("{}: {episodes} demonstrations", path.display());
    if *without_grasp > 0 {
        text += &format!(", {without_grasp} without a grasp");
    }
    if *small_tasks > 0 {
        text += &format!(", {small_tasks} tasks with fewer than {min_episodes} grasps left out of the fits");
    }
    text += "\n\n";
    if let Some(grasp) = grasp {
        let heading = match grasp.heading_std_deg.is_finite() {
            true => format!("{:.0}°", grasp.heading_std_deg),
            false => "uniform".to_owned(),
        };
        text += &format!(
            "first grasp ({} of them): heading of the closing direction {heading} circular standard deviation, \
             orientation {:.0}° rms from its mean\n\n",
            grasp.grasps, grasp.orientation_rms_deg
        );
        let list = |values: &[f64], scale: f64, digits: usize| {
            values.iter().map(|value| format!("{:.digits$}", value * scale)).collect::<Vec<_>>().join(" ")
        };
        let row = |name: &str, residuals: &Residuals| {
            let Residuals { position_m, direction, joints_rad } = residuals;
            vec![name.into(), list(position_m, 1e3, 1), list(direction, 1.0, 2), list(joints_rad, 1.0, 2)]
        };
        let head = ["residual of a fit from", "tool position, mm", "direction, 6d", "joints, rad"];
        text += &text_table(&[
            head.map(String::from).to_vec(),
            row("object position", &grasp.from_position),
            row("position and heading", &grasp.from_pose),
        ]);
        text += "\n";
    }
    if let Some(neighbours) = neighbours {
        let head = ["motion of the next second, normalised L1", "joints", "tool pose"];
        let row =
            |name: &str, joints: f64, tool: f64| vec![name.to_owned(), format!("{joints:.3}"), format!("{tool:.3}")];
        text += &text_table(&[
            head.map(String::from).to_vec(),
            row("5 nearest states of other episodes", neighbours.joints_l1, neighbours.tool_l1),
            row("mean", neighbours.joints_mean_l1, neighbours.tool_mean_l1),
        ]);
    }
    text
}
