//! Files of motions, recordings and identified worlds.

use std::path::Path;

use genmanip_assets::worlds::DEFAULT_TEXT;
use genmanip_core::{Document, RobotModel, World, limits};
use genmanip_identify::recording::{RECORDING, Recording};
use genmanip_identify::{IdentifyError, world_text};
use genmanip_terminal::Failed;
use genmanip_workspace::{WorkspaceError, documents};

/// Recording in a file, checked against the robot.
pub fn read(path: &Path, robot: &RobotModel) -> Result<Recording, Failed> {
    let recording: Recording = documents::read_document(path, RECORDING)?;
    recording.check_robot(robot).map_err(|error: IdentifyError| {
        WorkspaceError::input(format!("{} cannot be used", path.display()))
            .because(error)
            .with_hint("docs/formats/recording.md describes a recording; --robot names another robot")
    })?;
    Ok(recording)
}

/// Writes a motion or recording.
pub fn write(path: &Path, recording: &Recording) -> Result<(), WorkspaceError> {
    documents::write_file(path, recording.to_json().as_bytes())
}

/// Writes the identified world: as TOML with the comments of its source, or as JSON if that is one or the name ends so.
pub fn write_world(source: Option<&Path>, before: &World, world: &World, out: &Path) -> Result<(), WorkspaceError> {
    let text = match source {
        Some(path) => documents::read_text(path, limits::WORLD)?,
        None => DEFAULT_TEXT.to_owned(),
    };
    let is_json = out.extension().is_some_and(|extension| extension == "json") || text.trim_start().starts_with('{');
    let written = match is_json {
        true => world.to_json(),
        false => world_text::edited(&text, before, world)
            .map_err(|error| WorkspaceError::input("the world's file cannot be edited").because(error))?,
    };
    documents::write_file(out, written.as_bytes())
}
