//! `genmanip world` and `genmanip camera`: worlds with their cameras.

use std::path::Path;

use genmanip_assets::worlds::text_for;
use genmanip_core::glam::DVec3;
use genmanip_core::sensor::SENSORS;
use genmanip_core::{Camera, CameraMount, CameraSensor, Document};
use genmanip_viz::views;
use genmanip_workspace::documents;
use genmanip_workspace::text_table;
use genmanip_workspace::worlds::{self, CameraChange, CameraEdit, CameraFile};
use serde_json::json;

use crate::args::{CameraCommand, CameraEditArguments, WorldCommand};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(command: &WorldCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        WorldCommand::Init(arguments) => init(arguments.out.as_deref(), arguments.robot.as_deref(), printer),
        WorldCommand::Check(arguments) => check(&arguments.file, printer),
        WorldCommand::Show(arguments) => show(&arguments.file, arguments.picture.as_deref(), printer),
    }
}

pub fn run_camera(command: &CameraCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        CameraCommand::List(arguments) => {
            let Some(file) = &arguments.file else {
                presets(printer);
                return Ok(ExitStatus::Done);
            };
            let setting = CameraFile::read(file)?;
            printer.data(&setting.world().cameras, &cameras_table(&setting.world().cameras));
        }
        CameraCommand::Add(arguments) => {
            edit(&arguments.file, &CameraEdit::Add(arguments.name.clone(), change(arguments)), printer)?;
        }
        CameraCommand::Set(arguments) => {
            edit(&arguments.file, &CameraEdit::Set(arguments.name.clone(), change(arguments)), printer)?;
        }
        CameraCommand::Remove(arguments) => {
            edit(&arguments.file, &CameraEdit::Remove(arguments.name.clone()), printer)?;
        }
        CameraCommand::Preview(arguments) => {
            let written = views::preview(&arguments.file, &arguments.names, arguments.size, &arguments.out)?;
            let lines = written.iter().map(|one| format!("{}: {}\n", one.file.display(), one.cameras.join(", ")));
            printer.data(&written, &lines.collect::<String>());
        }
    }
    Ok(ExitStatus::Done)
}

fn init(out: Option<&Path>, robot: Option<&str>, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world_with(None, robot)?;
    let text = text_for(&*worlds::robot(&world)?);
    match out {
        Some(path) if path.exists() => {
            return Err(Failed::new(format!("{} exists", path.display())).hint("choose another --out file"));
        }
        Some(path) if path.extension().is_some_and(|extension| extension == "json") => {
            documents::write_file(path, world.to_json().as_bytes())?;
            printer.say(format!("wrote {}", path.display()));
        }
        Some(path) => {
            documents::write_file(path, text.as_bytes())?;
            printer.say(format!("wrote {}", path.display()));
        }
        None => printer.data(&world.to_value(), &text),
    }
    Ok(ExitStatus::Done)
}

fn check(file: &Path, printer: &Printer) -> Result<ExitStatus, Failed> {
    let faults = worlds::check(file)?;
    let mut rows = vec![["place", "expected", "got", "hint"].map(String::from).to_vec()];
    for fault in &faults {
        rows.push([&fault.place, &fault.expected, &fault.got, &fault.hint].map(String::clone).to_vec());
    }
    let text = if faults.is_empty() { "a sound world\n".to_owned() } else { text_table(&rows) };
    printer.data(&json!({"valid": faults.is_empty(), "faults": faults}), &text);
    Ok(if faults.is_empty() { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn show(file: &Path, picture: Option<&Path>, printer: &Printer) -> Result<ExitStatus, Failed> {
    let setting = CameraFile::read(file)?;
    let (world, hashes) = (setting.world(), setting.world().hashes());
    let mut rows = vec![["surface", "name", "top, m", "size, m", "friction"].map(String::from).to_vec()];
    let numbers = |values: DVec3| values.to_array().map(|value| format!("{value:.3}")).join(", ");
    for surface in &world.surfaces {
        rows.push(vec![
            surface.id.to_string(),
            surface.name.clone(),
            numbers(surface.top_center_m),
            numbers(surface.size_m),
            surface.friction.to_string(),
        ]);
    }
    let text = format!(
        "{}\nworkspace  x {:?}, y {:?} m\nrobot      {} ({})\nphysics    {} Hz control, {} Hz steps, gravity {} m/s²\n\
         hashes     physics {}, judging {}, looks {}\n\n{}",
        text_table(&rows),
        world.workspace.x,
        world.workspace.y,
        world.robot.name,
        world.robot.physics_hash,
        world.physics.control_rate_hz,
        world.physics.physics_rate_hz,
        world.physics.gravity_m_s2,
        hashes.physics,
        hashes.judging,
        hashes.looks,
        cameras_table(&world.cameras),
    );
    if let Some(path) = picture {
        documents::write_file(path, &views::picture(&setting, &setting.from_above())?)?;
        printer.say(format!("wrote {}", path.display()));
    }
    printer.data(&json!({"world": world, "hashes": hashes}), &text);
    Ok(ExitStatus::Done)
}

fn presets(printer: &Printer) {
    let all = genmanip_core::camera::PRESETS;
    let mut rows =
        vec![["preset", "what", "pixels", "horizontal field of view, degrees", "source"].map(String::from).to_vec()];
    let mut data = Vec::new();
    for preset in &all {
        let [width, height] = preset.size_px;
        rows.push(vec![
            preset.name.into(),
            preset.what.into(),
            format!("{width}x{height}"),
            preset.horizontal_fov_deg.to_string(),
            preset.source.into(),
        ]);
        data.push(json!({
            "preset": preset.name,
            "what": preset.what,
            "size_px": preset.size_px,
            "horizontal_fov_deg": preset.horizontal_fov_deg,
            "source": preset.source,
        }));
    }
    printer.data(&data, &text_table(&rows));
}

fn cameras_table(cameras: &[Camera]) -> String {
    let mut rows = vec![
        ["camera", "mount", "position in its frame, m", "pixels", "field of view, degrees", "sensor"]
            .map(String::from)
            .to_vec(),
    ];
    for camera in cameras {
        let k = &camera.intrinsics;
        let at = camera.mount_from_camera.position.to_array().map(|value| format!("{value:.3}")).join(", ");
        rows.push(vec![
            camera.name.clone(),
            if camera.mount == CameraMount::Hand { "hand" } else { "world" }.into(),
            at,
            format!("{}x{}", k.width, k.height),
            format!("{:.1} x {:.1}", k.horizontal_fov().to_degrees(), k.vertical_fov().to_degrees()),
            sensor_text(camera),
        ]);
    }
    text_table(&rows)
}

/// Sensor preset, exposure time and lens of a camera: `d435, shutter 0.02 s, distorted`.
fn sensor_text(camera: &Camera) -> String {
    let mut parts = Vec::new();
    if let Some(still) = CameraSensor::with_shutter(camera.sensor, 0.0) {
        let preset = SENSORS.iter().find(|preset| preset.sensor == still);
        parts.push(preset.map_or("own values", |preset| preset.name).to_owned());
    }
    let color = camera.sensor.and_then(|sensor| sensor.color);
    if let Some(color) = color.filter(|color| color.shutter_s > 0.0) {
        parts.push(format!("shutter {} s", color.shutter_s));
    }
    if camera.distortion.is_some() {
        parts.push("distorted".into());
    }
    if parts.is_empty() { "ideal".into() } else { parts.join(", ") }
}

fn change(arguments: &CameraEditArguments) -> CameraChange {
    CameraChange {
        preset: arguments.preset.clone(),
        size_px: arguments.size,
        vertical_fov_rad: arguments.fov_deg.map(f64::to_radians),
        view: arguments.eye.zip(arguments.target).map(|(eye, target)| [eye, target].map(DVec3::from_array)),
        on_hand: arguments.hand,
        sensor: arguments.sensor.clone(),
        shutter_s: arguments.shutter,
        distortion: arguments.distortion,
    }
}

fn edit(file: &Path, edit: &CameraEdit, printer: &Printer) -> Result<(), Failed> {
    let setting = worlds::edit(file, edit)?;
    printer.say(format!("wrote {}", file.display()));
    printer.data(&setting.world().cameras, &cameras_table(&setting.world().cameras));
    Ok(())
}
