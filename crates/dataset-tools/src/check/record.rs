//! Check of the export settings and the native record against the rows.

use std::collections::BTreeSet;

use arrow_array::Array;
use genmanip_core::{ActionSpec, Document, RobotModel, limits};

use super::findings::Findings;
use super::metadata::{EpisodeEntry, Metadata};
use genmanip_data::columns::Column;
use genmanip_data::export::sampling;
use genmanip_data::lerobot::{RECORD, SETTINGS};
use genmanip_data::table::Table;
use genmanip_data::{DataError, EpisodeStore, LerobotSettings, files};

/// Number of episodes, evenly spaced, whose rows are compared with the native record; the hashes of all records are
/// checked.
const SAMPLED: usize = 20;

/// Export settings of the data set; `None` if it was not exported by this program.
pub(super) fn settings(metadata: &Metadata) -> Option<LerobotSettings> {
    let bytes = files::read(&metadata.root.join(SETTINGS), limits::SETTINGS).ok()?;
    LerobotSettings::from_bytes(&bytes).ok()
}

pub(super) fn check(metadata: &Metadata, robot: Option<&RobotModel>, findings: &mut Findings) {
    let settings = settings(metadata);
    if metadata.is_own && settings.is_none() && metadata.root.join(SETTINGS).exists() {
        findings.add("info", SETTINGS, "", "valid export settings", "something else");
    }
    if let Some(settings) = &settings {
        if (f64::from(settings.export.fps) - metadata.info.fps).abs() > 1e-9 {
            findings.add("info", SETTINGS, "export.fps", metadata.info.fps, settings.export.fps);
        }
        if let Some(contract) = &metadata.contract
            && contract.action != settings.export.action
        {
            findings.add(
                "contract",
                SETTINGS,
                "export.action",
                format!("{:?}", contract.action),
                format!("{:?}", settings.export.action),
            );
        }
    }
    let has_actions = metadata.info.features.iter().any(|feature| feature.key == "action");
    let root = metadata.root.join(RECORD);
    match EpisodeStore::open(&root) {
        Err(error) => {
            if settings.is_some_and(|settings| settings.record) && has_actions {
                findings.add("record", RECORD, "", "the native record named in the settings", error);
            }
        }
        Ok(store) => records(metadata, robot, &store, findings),
    }
}

fn records(metadata: &Metadata, robot: Option<&RobotModel>, store: &EpisodeStore, findings: &mut Findings) {
    let held: BTreeSet<String> = match store.ids() {
        Ok(ids) => ids.into_iter().collect(),
        Err(error) => return findings.add("record", RECORD, "", "a list of episodes", error),
    };
    let named: BTreeSet<String> = metadata.episodes.iter().filter_map(|episode| episode.store_id.clone()).collect();
    for id in held.difference(&named) {
        findings.add("record", &format!("{RECORD}/{id}"), "", "no record, as no episode has this store_id", "a record");
    }
    let stride = metadata.episodes.len().div_ceil(SAMPLED).max(1);
    for (number, episode) in metadata.episodes.iter().enumerate() {
        let Some(id) = episode.store_id.as_ref() else { continue };
        let file = format!("{RECORD}/{id}");
        if !held.contains(id) {
            findings.add("record", &file, episode.place(), "its record", "nothing");
            continue;
        }
        let compared = store.verify(id).and_then(|()| {
            outcome(episode, store, id, &file, findings)?;
            match robot.filter(|_| number.is_multiple_of(stride)) {
                Some(robot) => states(metadata, robot, episode, store, id, findings),
                None => Ok(()),
            }
        });
        if let Err(error) = compared {
            findings.add("record", &file, episode.place(), "an undamaged record", error);
        }
    }
}

fn outcome(
    episode: &EpisodeEntry,
    store: &EpisodeStore,
    id: &str,
    file: &str,
    findings: &mut Findings,
) -> Result<(), DataError> {
    let result = store.read_result(id)?;
    let place = |what: &str| format!("{}, {what}", episode.place());
    if let Some(success) = episode.success {
        findings.require("record", file, &place("success"), &result.success, &success);
    }
    if let Some(seed) = episode.seed {
        findings.require(
            "record",
            file,
            &place("seed"),
            &i64::try_from(result.seed.value()).unwrap_or(i64::MAX),
            &seed,
        );
    }
    if let Some(scenario) = &episode.scenario_id {
        findings.require("record", file, &place("scenario_id"), &result.scenario_id, scenario);
    }
    Ok(())
}

/// Compares `observation.state` with the recorded joint positions and gripper opening.
fn states(
    metadata: &Metadata,
    robot: &RobotModel,
    episode: &EpisodeEntry,
    store: &EpisodeStore,
    id: &str,
    findings: &mut Findings,
) -> Result<(), DataError> {
    let spec = metadata.contract.as_ref().map_or_else(ActionSpec::native, |contract| contract.action);
    let recorded = store.read(id)?;
    let (rows, stride) = sampling(recorded.frames.len(), recorded.result.control_rate_hz, metadata.info.fps as u32)?;
    if i64::try_from(rows).ok() != Some(episode.length) {
        findings.add(
            "record",
            &episode.data,
            format!("{}, length", episode.place()),
            format!("{rows} rows, according to the record"),
            episode.length,
        );
        return Ok(());
    }
    let mut frames = recorded.frames.iter().step_by(stride).enumerate();
    for batch in Table::open(&metadata.root.join(&episode.data))?.columns(&["index", "observation.state"])? {
        let batch = batch?;
        let columns =
            ["index", "observation.state"].map(|name| batch.column_by_name(name).and_then(|column| Column::of(column)));
        let [Some(index), Some(state)] = columns else { return Ok(()) };
        for row in 0..batch.column(0).len() {
            if !(episode.from as f64..episode.to as f64).contains(&index.values[row]) {
                continue;
            }
            let Some((number, frame)) = frames.next() else { return Ok(()) };
            let expected = spec.encode_state(&frame.joint_position, frame.gripper_width, robot);
            let expected: Vec<f64> = expected.into_iter().map(f64::from).collect();
            if state.row(row) != expected {
                let place = format!("{}, row {number}, observation.state", episode.place());
                findings.add(
                    "record",
                    &episode.data,
                    place,
                    format!("{expected:.5?}, according to the record"),
                    format!("{:.5?}", state.row(row)),
                );
                return Ok(());
            }
        }
    }
    Ok(())
}
