//! Settings of an exported data set, and the files that hold them.

use genmanip_core::{Document, Upgrade};
use serde::{Deserialize, Serialize};

use crate::export::ExportSettings;

/// File with the export settings of a data set.
pub const SETTINGS: &str = "meta/lerobot_settings.json";

/// File with the action contract.
pub const CONTRACT: &str = "meta/action_contract.json";

/// Table of the steps' instructions, by `subtask_index`.
pub const SUBTASKS: &str = "meta/subtasks.parquet";

/// Settings of an exported data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LerobotSettings {
    /// Contents of the rows; depth images go into the sibling data set `<name>-depth`.
    pub export: ExportSettings,
    /// Include the native record of each episode in `extras/record`, an episode store from which the episodes can be
    /// replayed. Default true.
    pub record: bool,
    /// Episodes per data and video file, so that file boundaries depend on the episode index alone. Default 100, which
    /// keeps video files of typical episodes under 200 MB.
    pub episodes_per_file: usize,
    /// Episodes per file of the depth data set, whose images are larger. Default 10.
    pub episodes_per_depth_file: usize,
    /// Id of the collection run that owns the data set and may replace it. Default none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
}

impl Default for LerobotSettings {
    fn default() -> Self {
        Self {
            export: ExportSettings::default(),
            record: true,
            episodes_per_file: 100,
            episodes_per_depth_file: 10,
            run: None,
        }
    }
}

impl Document for LerobotSettings {
    const SCHEMA: &'static str = "genmanip.lerobot_settings/3";
    const PREVIOUS: Option<Upgrade> = Some(Upgrade {
        schema: "genmanip.lerobot_settings/2",
        upgrade: |settings| {
            let moved = ["fps", "cameras", "depth", "is_varied"];
            let export: serde_json::Map<_, _> =
                moved.iter().filter_map(|key| settings.remove(*key).map(|value| ((*key).to_owned(), value))).collect();
            settings.insert("export".into(), export.into());
            Ok(())
        },
    });
}
