//! Reader of an exported data set: contract and recorded actions.

use std::path::{Path, PathBuf};

use arrow_array::types::Float32Type;
use arrow_array::{Array, BooleanArray, Int64Array, StringArray};
use genmanip_core::limits;
use genmanip_core::{ActionContract, Document};

use super::CONTRACT;
use crate::table::{self, Table};
use crate::{DataError, files};

/// An exported data set, open for reading.
#[derive(Clone, Debug)]
pub struct LerobotDataset {
    root: PathBuf,
    contract: ActionContract,
    episodes: Vec<EpisodeRow>,
}

/// One row of the episodes table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EpisodeRow {
    /// Index of the episode in the data set.
    pub index: i64,
    /// Id of the episode in its store.
    pub store_id: String,
    /// Id of the initial scenario.
    pub scenario_id: String,
    /// True for a verified demonstration.
    pub success: bool,
    /// Data-set indices of its frames.
    pub rows: std::ops::Range<i64>,
    /// Chunk and file index of the data file with these rows.
    file: [i64; 2],
}

impl LerobotDataset {
    /// Opens a data set and reads its contract and its episodes table.
    ///
    /// # Errors
    /// If it is not a data set, has no contract, or a file cannot be read.
    pub fn open(root: &Path) -> Result<Self, DataError> {
        let path = root.join(CONTRACT);
        let contract = ActionContract::from_bytes(&files::read(&path, limits::SETTINGS)?)
            .map_err(|source| DataError::Document { path, source })?;
        let mut episodes = Vec::new();
        for path in table::files_below(&root.join("meta/episodes"))? {
            episodes.extend(episodes_in(&path)?);
        }
        episodes.sort_by_key(|episode| episode.index);
        Ok(Self { root: root.into(), contract, episodes })
    }

    /// The contract of the `action` column.
    pub fn contract(&self) -> &ActionContract {
        &self.contract
    }

    /// All episodes, in the order of their indices.
    pub fn episodes(&self) -> &[EpisodeRow] {
        &self.episodes
    }

    /// The `action` column of an episode, row by row.
    ///
    /// # Errors
    /// If the table cannot be read, or its number of rows differs from the episodes table.
    pub fn actions(&self, episode: &EpisodeRow) -> Result<Vec<Vec<f32>>, DataError> {
        let [chunk, file] = episode.file;
        let path = self.root.join(format!("data/chunk-{chunk:03}/file-{file:03}.parquet"));
        let length = self.contract.names.len();
        let mut actions = Vec::new();
        for batch in Table::open(&path)?.columns(&["index", "action"])? {
            let batch = batch?;
            let indices: &Int64Array = table::column(&path, &batch, "index")?;
            let vectors = table::vector_column::<Float32Type>(&path, &batch, "action", length)?;
            let rows = indices.values().iter().zip(vectors.chunks_exact(length.max(1)));
            actions.extend(rows.filter(|(index, _)| episode.rows.contains(index)).map(|(_, action)| action.to_vec()));
        }
        let expected = episode.rows.end - episode.rows.start;
        if i64::try_from(actions.len()).ok() == Some(expected) {
            return Ok(actions);
        }
        let what = format!("rows of episode {} in {}", episode.index, path.display());
        Err(DataError::mismatch(what, expected, actions.len()))
    }
}

fn episodes_in(path: &Path) -> Result<Vec<EpisodeRow>, DataError> {
    const INTEGERS: [&str; 5] =
        ["episode_index", "dataset_from_index", "dataset_to_index", "data/chunk_index", "data/file_index"];
    const TEXTS: [&str; 2] = ["store_id", "scenario_id"];
    let mut episodes = Vec::new();
    for batch in Table::open(path)?.columns(&[&INTEGERS[..], &TEXTS[..], &["success"]].concat())? {
        let batch = batch?;
        let integers = INTEGERS.map(|name| table::column::<Int64Array>(path, &batch, name));
        let [index, from, to, chunk, file] = integers;
        let (index, from, to, chunk, file) = (index?, from?, to?, chunk?, file?);
        let [store_id, scenario_id] = TEXTS.map(|name| table::column::<StringArray>(path, &batch, name));
        let (store_id, scenario_id) = (store_id?, scenario_id?);
        let success: &BooleanArray = table::column(path, &batch, "success")?;
        episodes.extend((0..batch.num_rows()).map(|row| EpisodeRow {
            index: index.value(row),
            store_id: store_id.value(row).into(),
            scenario_id: scenario_id.value(row).into(),
            success: success.is_valid(row) && success.value(row),
            rows: from.value(row)..to.value(row),
            file: [chunk.value(row), file.value(row)],
        }));
    }
    Ok(episodes)
}
