//! Robot files of the user, registered by name for the whole process.

use std::fs;
use std::path::{Path, PathBuf};

use genmanip_assets::AssetError;
use genmanip_assets::robots::{self, PartKind};
use genmanip_core::limits;
use serde_json::Value;

use crate::documents;
use crate::error::WorkspaceError;

/// Registers the robots of a folder by name and returns the names. A robot file is a `*.json` of the folder with schema
/// `genmanip.robot/N`; its arm and gripper are `arms/NAME.json` and `grippers/NAME.json` of the folder, or built in.
/// Ignores other JSON files.
///
/// # Errors
/// When a file cannot be read, is no valid robot, or has the name of another robot.
pub fn open(folder: &Path) -> Result<Vec<String>, WorkspaceError> {
    let find = |kind: PartKind, name: &str| {
        let parts = if kind == PartKind::Arm { "arms" } else { "grippers" };
        let path = folder.join(parts).join(format!("{name}.json"));
        if !path.is_file() {
            return robots::find(kind, name);
        }
        documents::read_text(&path, limits::ROBOT)
            .map_err(|error| AssetError::Data { file: path.display().to_string(), message: error.to_string() })
    };
    let mut names = Vec::new();
    for path in json_files(folder)? {
        let text = documents::read_text(&path, limits::ROBOT)?;
        if !is_robot_file(&text) {
            continue;
        }
        let file = path.display().to_string();
        let robot = robots::compose(&file, &text, &find).and_then(|robot| robots::register(&file, robot));
        let robot = robot.map_err(|error| {
            WorkspaceError::input(format!("{file} is not a valid robot file"))
                .because(error)
                .with_hint("docs/guides/your-own-robot.md explains every key")
        })?;
        names.push(robot.name.clone());
    }
    Ok(names)
}

/// Names of the built-in and registered robots.
pub fn names() -> Vec<String> {
    robots::names()
}

fn json_files(folder: &Path) -> Result<Vec<PathBuf>, WorkspaceError> {
    let unreadable =
        |error: std::io::Error| WorkspaceError::file("list", folder, error).with_hint("expected a folder of robots");
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|extension| extension == "json") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// True if a JSON text has a schema `genmanip.robot/N`.
fn is_robot_file(text: &str) -> bool {
    let value = serde_json::from_str::<Value>(text).ok();
    let schema = value.as_ref().and_then(|value| value.get("schema")).and_then(Value::as_str);
    schema.is_some_and(|schema| schema.starts_with("genmanip.robot/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROBOT: &str = r#"{"schema": "genmanip.robot/1", "name": "ur5e_with_a_gripper_of_mine", "on": "ur5e",
        "gripper": "mine", "mount": {"position": [0, 0, 0.01], "rpy_deg": [0, 0, 0]}}"#;

    #[test]
    fn robots_of_a_folder_are_known_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("grippers")).unwrap();
        fs::write(path("mine.json"), ROBOT).unwrap();
        fs::write(path("notes.json"), r#"{"schema": "of another program"}"#).unwrap();
        let gripper = robots::find(PartKind::Gripper, "panda_hand").unwrap().replace("panda_hand", "mine");

        let error = open(folder.path()).unwrap_err();
        let text = format!("{error} {:?}", std::error::Error::source(&error).map(ToString::to_string));
        assert!(
            text.contains("mine.json is not a valid robot file") && text.contains("no gripper is called"),
            "{text}"
        );

        fs::write(path("grippers/mine.json"), gripper.replace("\"max_width\": 0.08", "\"max_width\": 80")).unwrap();
        let error = open(folder.path()).unwrap_err();
        let text = format!("{error} {:?}", std::error::Error::source(&error).map(ToString::to_string));
        assert!(text.contains("gripper mine: max_width: expected metres in 0-0.5, got 80"), "{text}");

        fs::write(path("grippers/mine.json"), gripper).unwrap();
        let names = ["ur5e_with_a_gripper_of_mine"];
        assert_eq!(open(folder.path()).unwrap(), names);
        assert_eq!(open(folder.path()).unwrap(), names, "twice is no clash");
        assert_eq!(robots::named(names[0]).unwrap().gripper.max_width, 0.08);
    }
}
