//! Programs killed at any moment.

use std::fs;

use genmanip_assets::Catalogue;
use genmanip_studio::edit::{EditLog, EditedScenario};
use serde_json::json;

use crate::{CANS, command, copy, stamp};

/// A kill while the third line is appended leaves any prefix of it, with the scenario of the second line; one after
/// that leaves the scenario of the second or the third.
#[test]
fn no_acknowledged_line_is_lost_at_any_byte() {
    let (_folder, path) = copy(CANS);
    let log = EditLog::path_of(&path);
    let say = |text: &str| json!({"op": "instruction", "args": {"text": text}});
    let mut document = EditedScenario::open(&path, Catalogue::all()).unwrap();
    let mut states = vec![(fs::read(&path).unwrap(), Vec::new())];
    for number in 1..=3 {
        document.apply(&command("ada", number, number - 1, say(&format!("Move {number} ü.")))).unwrap();
        states.push((fs::read(&path).unwrap(), fs::read(&log).unwrap()));
    }
    drop(document);
    for acknowledged in 1..3 {
        let (old, new) = (states[acknowledged].1.len(), states[acknowledged + 1].1.len());
        for length in old..=new {
            fs::write(&path, &states[acknowledged].0).unwrap();
            fs::write(&log, &states[acknowledged + 1].1[..length]).unwrap();
            let mut document = EditedScenario::open(&path, Catalogue::all()).unwrap();
            let revision = document.revision();
            let is_whole = length == new;
            assert_eq!(revision, acknowledged as u64 + u64::from(is_whole), "after {length} bytes");
            // Reading wrote nothing; the next change restores both files.
            assert_eq!(fs::read(&log).unwrap().len(), length);
            if length % 16 == 0 || is_whole || length + 1 == new {
                document.undo(&stamp("ada", "undo")).unwrap();
                drop(document);
                let document = EditedScenario::open(&path, Catalogue::all()).unwrap();
                assert_eq!(document.revision(), revision + 1);
                assert_eq!(fs::read(&path).unwrap(), states[usize::try_from(revision).unwrap() - 1].0);
            }
        }
    }
}
