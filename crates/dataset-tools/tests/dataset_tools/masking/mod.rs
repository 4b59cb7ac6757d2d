//! Columns of bounding boxes and masks agree with the masks in the store, also in copies of the data set.

use std::fs::{self, File};
use std::path::Path;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int64Type};
use genmanip_data::export::ExtraColumns;
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::masks::{self, FIRST_OBJECT, MaskTrack};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_dataset_tools::edit;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

use crate::checking::{checked, listed, settings, store};
use crate::synthetic::{HEIGHT, WIDTH, robot};

/// An object of 10 × 5 pixels that moves to the right, and one that is visible in odd frames only.
fn ids(row: usize) -> Vec<u16> {
    let mut ids = vec![1; (WIDTH * HEIGHT) as usize];
    for y in 20..25 {
        for x in row..row + 10 {
            ids[y * WIDTH as usize + x] = FIRST_OBJECT;
        }
    }
    if row % 2 == 1 {
        ids[0] = FIRST_OBJECT + 1;
    }
    ids
}

fn attach_masks(store: &EpisodeStore) {
    for id in store.ids().unwrap() {
        let rows = store.read(&id).unwrap().frames.len().div_ceil(4);
        let png: Vec<_> = (0..rows).map(|row| masks::encode(&ids(row), WIDTH, HEIGHT).unwrap()).collect();
        let track = |camera: &str| MaskTrack { camera: camera.into(), fps: 15, png: png.clone() };
        store.attach_masks(&id, &[track("static"), track("wrist")]).unwrap();
    }
}

fn first(dataset: &Path) -> RecordBatch {
    let file = File::open(dataset.join("data/chunk-000/file-000.parquet")).unwrap();
    ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap().next().unwrap().unwrap()
}

#[test]
fn boxes_and_masks_are_exported_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(&folder.path().join("store"));
    let usual = settings(genmanip_data::export::default_action());
    let columns = vec![ExtraColumns::Boxes, ExtraColumns::Masks];
    let asked = |depth| LerobotSettings {
        export: ExportSettings { columns: columns.clone(), depth, ..usual.export.clone() },
        ..usual.clone()
    };
    let export = |name: &str, settings: &LerobotSettings| {
        let dataset = folder.path().join(name);
        lerobot::export(&store, &Selection::Verified, &robot(), settings, &dataset).map(|_| dataset)
    };
    let error = export("early", &asked(true)).unwrap_err().to_string();
    assert!(error.contains("masks_15hz"), "masks that were not rendered cannot be exported: {error}");
    attach_masks(&store);
    for (name, depth) in [("with-depth", true), ("without", false)] {
        let dataset = export(name, &asked(depth)).unwrap();
        assert_eq!(listed(&checked(&dataset)), "");
        let rows = first(&dataset);
        let boxes = rows.column_by_name("sim.box.wrist").unwrap().as_fixed_size_list().values().clone();
        let boxes = boxes.as_primitive::<Float32Type>().values().to_vec();
        let pixels = rows.column_by_name("sim.visible_pixels.wrist").unwrap().as_fixed_size_list().values().clone();
        let pixels = pixels.as_primitive::<Int64Type>().values().to_vec();
        for row in 0..3 {
            let left = row as f32;
            assert_eq!(boxes[row * 64..row * 64 + 4], [left, 20.0, left + 10.0, 25.0]);
            let second = if row % 2 == 1 { [0.0, 0.0, 1.0, 1.0] } else { [0.0; 4] };
            assert_eq!(boxes[row * 64 + 4..row * 64 + 8], second);
            assert_eq!(pixels[row * 16..row * 16 + 3], [50, (row % 2) as i64, 0]);
        }
        let sibling = lerobot::depth_path(&dataset);
        let pictures = first(&sibling);
        let files = pictures.column_by_name("observation.images.wrist_mask").unwrap().as_struct();
        let file = files.column_by_name("bytes").unwrap().as_binary::<i32>().value(2).to_vec();
        assert_eq!(genmanip_data::depth::decode_depth_png(&file).unwrap(), (WIDTH, HEIGHT, ids(2)));
        assert_eq!(pictures.column_by_name("observation.images.wrist_depth").is_some(), depth);
        let info: Value = serde_json::from_slice(&fs::read(sibling.join("meta/info.json")).unwrap()).unwrap();
        assert_eq!(info["features"]["observation.images.wrist_mask"]["info"]["is_depth_map"], false);
        let card = fs::read_to_string(dataset.join("README.md")).unwrap();
        assert!(card.contains("has masks") && card.contains("`sim.box.*`"), "{card}");

        let copy = folder.path().join(format!("{name}-copy"));
        edit::delete(&dataset, &[0].into(), &copy, &mut |_| {}).unwrap();
        assert_eq!(listed(&checked(&copy)), "");
        assert!(first(&lerobot::depth_path(&copy)).column_by_name("observation.images.static_mask").is_some());
    }
}
