//! LeRobot data sets as those of another version.

use std::path::Path;

use super::lerobot::Lerobot;
use super::{ImportReport, ImportSettings, Imported, Incoming};
use crate::DataError;
use crate::export::{ExportReport, ExtraColumns};
use crate::lerobot::LerobotSettings;
use crate::lerobot::begin;
use crate::lerobot::made::Made;
use crate::lerobot::v21::Writer;

/// Writes a LeRobot data set of any program, v3.0 or v2.1, as one of v2.1 at `out`, for readers of that version; depth has
/// no place in it.
///
/// # Errors
/// As [`super::import`].
pub fn to_v21(
    dataset: &Path,
    settings: &ImportSettings,
    out: &Path,
    heard: &mut dyn FnMut(usize),
) -> Result<ImportReport, DataError> {
    let mut incoming = Lerobot::open(dataset, settings)?;
    let about = incoming.about();
    let mut writer = Writer::new(begin(out, None)?, about.fps);
    incoming.each(&mut |from, mut episode| {
        episode.images.clear();
        if let Some(record) = &about.record {
            crate::lerobot::record::copy(&writer.aside, record, &episode.facts.store_id)?;
        }
        writer.push(episode).map_err(|error| error.placed(from))?;
        heard(about.episodes);
        Ok(())
    })?;
    let (episodes, frames) = (writer.ledger.episodes, writer.ledger.frames);
    let imported = Imported {
        format: about.format.into(),
        fps: about.fps,
        depth: false,
        record: about.record.is_some(),
        episodes_per_file: 1,
        episodes_per_depth_file: 1,
        notes: incoming.notes(),
    };
    let made = match Made::read(dataset) {
        Ok(Made::Exported(mut settings)) => {
            settings.export.depth = false;
            // Ids of pixels lie beside the depth.
            settings.export.columns.retain(|column| *column != ExtraColumns::Masks);
            Made::Exported(LerobotSettings { run: None, record: about.record.is_some(), ..settings })
        }
        _ => Made::Imported(imported.clone()),
    };
    writer.finish(out, &about.robot, &made, about.contract.as_ref())?;
    let written = ExportReport { dataset: out.into(), depth_dataset: None, episodes, frames, left_out: Vec::new() };
    Ok(ImportReport { written, imported })
}
