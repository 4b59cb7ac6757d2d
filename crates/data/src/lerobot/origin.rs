//! Origin of a data set: exported from this program's episodes, or imported from another data set.

use std::path::Path;

use genmanip_core::{Document, limits};
use serde_json::{Value, json};

use super::imported::{IMPORTED, Imported};
use super::{LerobotSettings, SETTINGS, card, info};
use crate::atomic_write::{AtomicFolder, write_json};
use crate::{DataError, files};

/// Origin of a data set.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// Exported by this program, with these settings.
    Exported(LerobotSettings),
    /// Imported from another format.
    Imported(Imported),
}

impl Origin {
    /// Reads the origin from the metadata of a data set.
    pub fn read(root: &Path) -> Result<Self, DataError> {
        let document = |name: &str, source| DataError::Document { path: root.join(name), source };
        match files::read(&root.join(SETTINGS), limits::SETTINGS) {
            Err(error) if error.is_missing() => {}
            bytes => {
                let settings = LerobotSettings::from_bytes(&bytes?).map_err(|error| document(SETTINGS, error))?;
                return Ok(Self::Exported(settings));
            }
        }
        match files::read(&root.join(IMPORTED), limits::SETTINGS) {
            Err(error) if error.is_missing() => {
                let expected = "a LeRobotDataset v3.0 written by `data export` or `data import`";
                let got = match root.is_dir() {
                    true => format!("neither {SETTINGS} nor {IMPORTED} in it"),
                    false => "no folder".into(),
                };
                Err(DataError::mismatch(root.display().to_string(), expected, got))
            }
            bytes => Ok(Self::Imported(Imported::from_bytes(&bytes?).map_err(|error| document(IMPORTED, error))?)),
        }
    }

    /// Writes the files of the origin. `statistics` describes how the statistics were computed; `None` if from rows and
    /// images.
    pub fn write(&self, dataset: &AtomicFolder, statistics: Option<&str>) -> Result<(), DataError> {
        match self {
            Self::Exported(settings) => {
                let mut meaning = info::meaning(settings);
                if let Some(statistics) = statistics {
                    meaning["statistics"] = json!(statistics);
                }
                write_json(dataset, "meta/genmanip.json", &meaning)?;
                dataset.write(SETTINGS, settings.to_json().as_bytes())
            }
            Self::Imported(imported) => dataset.write(IMPORTED, imported.to_json().as_bytes()),
        }
    }

    /// Contents of `README.md` (the data set card) for a version of the format.
    pub fn card(&self, name: &str, version: &str) -> String {
        match self {
            Self::Exported(settings) => card::color(name, settings, version),
            Self::Imported(imported) => card::imported(name, imported),
        }
    }

    /// Rate of the rows, Hz.
    pub fn fps(&self) -> u32 {
        match self {
            Self::Exported(settings) => settings.export.fps,
            Self::Imported(imported) => imported.fps,
        }
    }

    /// True if the data set has a depth sibling.
    pub fn has_depth(&self) -> bool {
        match self {
            Self::Exported(settings) => settings.export.has_sibling(),
            Self::Imported(imported) => imported.depth,
        }
    }

    /// True if the data set has a native record.
    pub fn has_record(&self) -> bool {
        match self {
            Self::Exported(settings) => settings.record,
            Self::Imported(imported) => imported.record,
        }
    }

    /// Number of episodes per file.
    pub fn episodes_per_file(&self) -> usize {
        match self {
            Self::Exported(settings) => settings.episodes_per_file,
            Self::Imported(imported) => imported.episodes_per_file,
        }
    }

    /// Number of episodes per file of the depth sibling.
    pub fn episodes_per_depth_file(&self) -> usize {
        match self {
            Self::Exported(settings) => settings.episodes_per_depth_file,
            Self::Imported(imported) => imported.episodes_per_depth_file,
        }
    }

    /// Origin without its collection run, for a new independent data set.
    pub fn without_run(self) -> Self {
        match self {
            Self::Exported(settings) => Self::Exported(LerobotSettings { run: None, ..settings }),
            imported @ Self::Imported(_) => imported,
        }
    }

    /// Settings that must be equal for data sets to be merged.
    pub fn comparable(&self) -> Value {
        match self.clone().without_run() {
            Self::Exported(settings) => {
                LerobotSettings { episodes_per_file: 1, episodes_per_depth_file: 1, ..settings }.to_value()
            }
            Self::Imported(imported) => {
                Imported { episodes_per_file: 1, episodes_per_depth_file: 1, notes: Vec::new(), ..imported }.to_value()
            }
        }
    }
}
