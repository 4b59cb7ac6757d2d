//! What is told of an imported episode as a whole.

use genmanip_core::names::is_file_name;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::export::EpisodeRows;
use crate::export::facts::Told;
use crate::export::features::Values;
use crate::lerobot::episodes::Entries;
use crate::lerobot::imported::SOURCE_HASH;
use crate::lerobot::v21::Line;
use crate::table::Columns;

/// What a source tells of an episode; what it does not tell stays unknown.
#[derive(Clone, Debug, Default)]
pub(crate) struct ImportedFacts {
    /// Its name in the source, or one made of its index there.
    pub(super) store_id: String,
    pub(super) instruction: String,
    pub(super) steps: Vec<String>,
    pub(super) success: Option<bool>,
    pub(super) failure: String,
    /// The seed of a data set of this program; -1 where there is none.
    pub(super) seed: Option<i64>,
    pub(super) scenario_id: String,
    /// Ids of the objects whose poses the rows hold, in their order there.
    pub(super) objects: Vec<String>,
    /// Of its rows and pictures: tells it from every other.
    pub(super) source_sha256: String,
}

impl Told for ImportedFacts {
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

impl Entries for ImportedFacts {
    fn add(columns: &mut Columns, all: &[&Self]) {
        columns.text("store_id", all.iter().map(|facts| &facts.store_id));
        columns.optional_bool("success", all.iter().map(|facts| facts.success));
        columns.text("failure", all.iter().map(|facts| &facts.failure));
        columns.text_lists("subtasks", &all.iter().map(|facts| facts.steps.clone()).collect::<Vec<_>>());
        columns.text_lists("objects", &all.iter().map(|facts| facts.objects.clone()).collect::<Vec<_>>());
        columns.i64("seed", all.iter().map(|facts| facts.seed.unwrap_or(-1)));
        columns.text("scenario_id", all.iter().map(|facts| &facts.scenario_id));
        columns.text(SOURCE_HASH, all.iter().map(|facts| &facts.source_sha256));
    }
}

impl Line for ImportedFacts {
    fn line(&self) -> Value {
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

/// A name for an episode: that of the source where it can be a file's, or one made of its index.
pub(super) fn name(own: Option<&str>, index: usize) -> String {
    own.filter(|name| is_file_name(name)).map_or_else(|| format!("episode_{index:06}"), str::to_owned)
}

/// The hash of an episode's columns and pictures.
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
    let pictures = rows.videos.iter().flat_map(|video| &video.video.frames);
    pictures.chain(rows.images.iter().flat_map(|image| &image.png)).for_each(|picture| hasher.update(picture));
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
