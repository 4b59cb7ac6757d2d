//! Datasets of other programs' versions, as their tools leave them: checked, imported, or refused with the place.

use std::path::{Path, PathBuf};

use genmanip_data::columns::Column;
use genmanip_data::table::Table;
use genmanip_dataset_tools::import::{self, ImportSettings};

use crate::checking::{checked, listed};

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/strangers").join(name)
}

/// All values of a column of a data file.
fn column(file: &Path, key: &str) -> Vec<f64> {
    let batch = Table::open(file).unwrap().whole(|column| column == key).unwrap();
    Column::of(batch.column_by_name(key).unwrap()).unwrap().values
}

/// v2.1 without statistics of the whole, v2.0, and images within the tables.
#[test]
fn versions_of_other_tools_are_checked_and_imported() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["data_v21_plain", "data_v20", "data_v21_image"] {
        let report = checked(&source(name));
        assert_eq!(listed(&report), "", "{name}");
        assert_eq!((report.episodes, report.frames), (2, 21), "{name}");
        let out = folder.path().join(name);
        let made = import::import(&source(name), &ImportSettings::default(), &out, &mut |_| {}).unwrap();
        assert_eq!((made.written.episodes, listed(&checked(&out)).as_str()), (2, ""), "{name}");
        let imported = out.join("data/chunk-000/file-000.parquet");
        for key in ["action", "observation.state"] {
            let files = ["episode_000000.parquet", "episode_000001.parquet"];
            let original = files.map(|file| column(&source(name).join("data/chunk-000").join(file), key)).concat();
            assert_eq!(column(&imported, key), original, "{name}, {key}");
        }
        let video = out.join("videos/observation.images.front/chunk-000/file-000.mp4");
        assert!(video.is_file(), "{name}: {}", video.display());
    }
}

/// A value that is not finite is named by its row, once an episode; its statistics are no further findings.
#[test]
fn values_that_are_not_finite_are_named_by_row() {
    let found = listed(&checked(&source("data_m_nan")));
    assert!(found.contains("episode 0, row 3, action[") && found.contains("a finite number"), "{found}");
    assert!(found.contains("episode 1, row 3, action["), "{found}");
    assert_eq!(found.trim().lines().count(), 2, "one per episode: {found}");
    let out = tempfile::tempdir().unwrap().path().join("out");
    let error = import::import(&source("data_m_nan"), &ImportSettings::default(), &out, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("of row 3, episode 0") && error.to_string().contains("finite"), "{error}");
    assert!(!out.exists());
}
