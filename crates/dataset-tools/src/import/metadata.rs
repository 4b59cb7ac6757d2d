//! Metadata of an imported episode.

use genmanip_core::hexadecimal;
use genmanip_core::names::is_file_name;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use genmanip_data::export::EpisodeRows;
use genmanip_data::export::features::Values;
use genmanip_data::export::metadata::LanguageLabels;
use genmanip_data::lerobot::episodes::EpisodeColumns;
use genmanip_data::lerobot::imported::SOURCE_HASH;
use genmanip_data::lerobot::v21::EpisodeFields;
use genmanip_data::table::Columns;

/// Metadata of an episode of another program; unknown fields are empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct ImportedMetadata {
    /// Name in the source if that is a valid file name, else `episode_` and the index.
    pub(super) store_id: String,
    pub(super) instruction: String,
    pub(super) steps: Vec<String>,
    pub(super) success: Option<bool>,
    pub(super) failure: String,
    /// Seed, if the source is a data set of this program; exported as -1 otherwise.
    pub(super) seed: Option<i64>,
    pub(super) scenario_id: String,
    /// Ids of the objects in the pose columns, in column order.
    pub(super) objects: Vec<String>,
    /// SHA-256 of the episode's rows and images, by which a merge of data sets recognises an episode that it already
    /// has.
    pub(super) source_sha256: String,
}

impl LanguageLabels for ImportedMetadata {
    fn name(&self) -> &str {
        &self.store_id
    }

    fn instruction(&self) -> &str {
        &self.instruction
    }

    fn steps(&self) -> &[String] {
        &self.steps
    }
}

impl EpisodeColumns for ImportedMetadata {
    fn add(columns: &mut Columns, all: &[&Self]) {
        columns.text("store_id", all.iter().map(|metadata| &metadata.store_id));
        columns.optional_bool("success", all.iter().map(|metadata| metadata.success));
        columns.text("failure", all.iter().map(|metadata| &metadata.failure));
        columns.text_lists("subtasks", &all.iter().map(|metadata| &metadata.steps).collect::<Vec<_>>());
        columns.text_lists("objects", &all.iter().map(|metadata| &metadata.objects).collect::<Vec<_>>());
        columns.i64("seed", all.iter().map(|metadata| metadata.seed.unwrap_or(-1)));
        columns.text("scenario_id", all.iter().map(|metadata| &metadata.scenario_id));
        columns.text(SOURCE_HASH, all.iter().map(|metadata| &metadata.source_sha256));
    }
}

impl EpisodeFields for ImportedMetadata {
    fn fields(&self) -> Value {
        let Self { store_id, scenario_id, seed, success, failure, steps, .. } = self;
        let failure = (!failure.is_empty()).then_some(failure);
        json!({
            "store_id": store_id,
            "scenario_id": scenario_id,
            "seed": seed,
            "success": success,
            "failure": failure,
            "subtasks": steps,
        })
    }
}

/// Name of an episode: the source's name if that is a valid file name, else one derived from the index.
pub(super) fn name(own: Option<&str>, index: usize) -> String {
    own.filter(|name| is_file_name(name)).map_or_else(|| format!("episode_{index:06}"), str::to_owned)
}

/// SHA-256 of an episode's numeric columns, video frames (encoded) and depth images (PNG), hexadecimal.
pub(super) fn hash<F>(rows: &EpisodeRows<F>) -> String {
    let mut hasher = Sha256::new();
    for feature in &rows.features {
        hasher.update(feature.key.as_bytes());
        match &feature.values {
            Values::F32(values) => values.iter().for_each(|value| hasher.update(value.to_le_bytes())),
            Values::F64(values) => values.iter().for_each(|value| hasher.update(value.to_le_bytes())),
            Values::I64(values) => values.iter().for_each(|value| hasher.update(value.to_le_bytes())),
            Values::Bool(values) => values.iter().for_each(|value| hasher.update([u8::from(*value)])),
        }
    }
    let images = rows.videos.iter().flat_map(|video| &video.video.frames);
    images.chain(rows.images.iter().flat_map(|image| &image.png)).for_each(|image| hasher.update(image));
    hexadecimal(&hasher.finalize())
}
