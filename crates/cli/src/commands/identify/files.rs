//! Files of motions and recordings.

use std::path::Path;

use genmanip_core::{Document, RobotModel};
use genmanip_identify::IdentifyError;
use genmanip_identify::recording::{RECORDING, Recording};
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
