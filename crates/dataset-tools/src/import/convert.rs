//! Conversion of LeRobot data sets to v2.1.

use std::path::Path;

use super::lerobot::Lerobot;
use super::{ImportReport, ImportSettings, Imported, Importer};
use genmanip_data::DataError;
use genmanip_data::export::{ExportReport, ExtraColumns};
use genmanip_data::lerobot::LerobotSettings;
use genmanip_data::lerobot::begin;
use genmanip_data::lerobot::origin::Origin;
use genmanip_data::lerobot::v21::Writer;

/// Converts a LeRobot data set of any program, v3.0, v2.1 or v2.0, to v2.1 at `out`; depth images are left out.
/// `on_episode` is called after each episode with the total number of episodes.
///
/// # Errors
/// As [`super::import`].
pub fn to_v21(
    dataset: &Path,
    settings: &ImportSettings,
    out: &Path,
    on_episode: &mut dyn FnMut(usize),
) -> Result<ImportReport, DataError> {
    let mut importer = Lerobot::open(dataset, settings)?;
    let info = importer.info();
    let mut writer = Writer::new(begin(out, None)?, info.fps);
    importer.each(&mut |from, mut episode| {
        episode.images.clear();
        if let Some(record) = &info.record {
            genmanip_data::lerobot::record::copy(&writer.staging, record, &episode.metadata.store_id)?;
        }
        writer.push(episode).map_err(|error| error.with_path(from))?;
        on_episode(info.episodes);
        Ok(())
    })?;
    let (episodes, frames) = (writer.metadata.episodes, writer.metadata.frames);
    let imported = Imported {
        format: info.format.into(),
        fps: info.fps,
        depth: false,
        record: info.record.is_some(),
        episodes_per_file: 1,
        episodes_per_depth_file: 1,
        notes: importer.notes(),
    };
    let origin = match Origin::read(dataset) {
        Ok(Origin::Exported(mut settings)) => {
            settings.export.depth = false;
            // Masks are stored with the depth images, which v2.1 lacks.
            settings.export.columns.retain(|column| *column != ExtraColumns::Masks);
            Origin::Exported(LerobotSettings { run: None, record: info.record.is_some(), ..settings })
        }
        _ => Origin::Imported(imported.clone()),
    };
    writer.finish(out, &info.robot, &origin, info.contract.as_ref())?;
    let written = ExportReport { dataset: out.into(), depth_dataset: None, episodes, frames, left_out: Vec::new() };
    Ok(ImportReport { written, imported })
}
