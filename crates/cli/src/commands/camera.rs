//! `genmanip camera`: cameras of world and scenario files.

use genmanip_core::CameraMount;
use genmanip_run::cameras::{CameraEdit, CameraFile, list, preview};

use crate::args::{CameraArguments, CameraCommand};
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(command: &CameraCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    let file = match command {
        CameraCommand::List(arguments) => {
            let cameras = list(arguments.file.as_deref())?;
            printer.data(&cameras, &cameras.text());
            return Ok(ExitStatus::Done);
        }
        CameraCommand::Preview(arguments) => {
            let written = preview(&arguments.file, &arguments.names, arguments.size, &arguments.out)?;
            let lines = written.iter().map(|one| format!("{}: {}\n", one.file.display(), one.cameras.join(", ")));
            printer.data(&written, &lines.collect::<String>());
            return Ok(ExitStatus::Done);
        }
        CameraCommand::Add(arguments) => {
            CameraFile::open(&arguments.file)?.add(&arguments.name, &edit(&arguments.camera))?;
            &arguments.file
        }
        CameraCommand::Set(arguments) => {
            CameraFile::open(&arguments.file)?.set(&arguments.name, &edit(&arguments.camera))?;
            &arguments.file
        }
        CameraCommand::Remove(arguments) => {
            CameraFile::open(&arguments.file)?.remove(&arguments.name)?;
            &arguments.file
        }
    };
    let cameras = list(Some(file))?;
    printer.say(format!("wrote {}", file.display()));
    printer.data(&cameras, &cameras.text());
    Ok(ExitStatus::Done)
}

fn edit(arguments: &CameraArguments) -> CameraEdit {
    CameraEdit {
        preset: arguments.preset.clone(),
        vertical_fov_deg: arguments.fov_deg,
        size_px: arguments.size,
        eye_m: arguments.eye.clone(),
        target_m: arguments.target.clone(),
        mount: arguments.mount.as_ref().map(|mount| match mount.as_str() {
            "hand" => CameraMount::Hand,
            _ => CameraMount::World,
        }),
    }
}
