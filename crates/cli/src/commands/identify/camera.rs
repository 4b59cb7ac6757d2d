//! `genmanip identify camera`: noise of a camera from repeated images of a still scene.

use std::path::{Path, PathBuf};

use genmanip_core::sensor::SensorPreset;
use genmanip_core::{ColorSensor, limits};
use genmanip_data::depth::decode_depth_png;
use genmanip_dataset_tools::import::decode_image;
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_visual_matching::noise::{CameraNoise, FEWEST_IMAGES};
use genmanip_workspace::{WorkspaceError, documents, text_table, worlds};

use super::files;
use crate::args::IdentifyCameraArguments;

/// Step of depth files, m: they hold whole millimetres.
const STEP_M: f64 = 1e-3;

pub fn run(arguments: &IdentifyCameraArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world(arguments.world.as_deref())?;
    let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let Some(index) = known.iter().position(|name| *name == arguments.camera) else {
        return Err(WorkspaceError::unknown("camera", "cameras", &arguments.camera, &known).into());
    };
    let preset = arguments.sensor.as_deref().and_then(SensorPreset::named).map(|preset| preset.sensor);
    let before = preset.or(world.cameras[index].sensor).unwrap_or_default();
    let (mut found, mut sensor) = (CameraNoise::default(), before);
    if !arguments.color.is_empty() {
        let (width, images) = alike(&arguments.color, |path| {
            let bytes = documents::read_bytes(path, limits::IMPORTED_PICTURE)?;
            let (width, _, rgb) = decode_image(&bytes).map_err(|error| WorkspaceError::file("read", path, error))?;
            Ok((width, rgb))
        })?;
        found.add_color(width, &images);
        sensor.color = Some(found.color(before.color.unwrap_or(ColorSensor::perfect(0.0))));
    }
    if !arguments.depth.is_empty() {
        let Some(own) = before.depth else {
            return Err(Failed::misused(format!("camera {} of the world has no depth sensor", arguments.camera))
                .hint("--sensor d435, d415 or structured-light; its focal length and baseline are needed"));
        };
        let (width, images) = alike(&arguments.depth, |path| {
            let bytes = documents::read_bytes(path, limits::IMPORTED_PICTURE)?;
            let (width, _, depth_mm) =
                decode_depth_png(&bytes).map_err(|error| WorkspaceError::file("read", path, error))?;
            Ok((width, depth_mm.into_iter().map(|depth| f32::from(depth) / 1000.0).collect()))
        })?;
        found.add_depth(width, &images, &own, STEP_M);
        sensor.depth = Some(found.depth(own));
    }
    if let Some(out) = &arguments.out {
        let mut measured = world.clone();
        measured.cameras[index].sensor = Some(sensor);
        files::write_world(arguments.world.as_deref(), &world, &measured, out)?;
        printer.say(format!("wrote {}", out.display()));
    }
    printer.data(&found, &describe(&found));
    Ok(ExitStatus::Done)
}

/// Width and pixels of images of one size.
fn alike<T>(
    paths: &[PathBuf],
    read: impl Fn(&Path) -> Result<(u32, Vec<T>), WorkspaceError>,
) -> Result<(usize, Vec<Vec<T>>), Failed> {
    if paths.len() < FEWEST_IMAGES {
        return Err(Failed::misused(format!("{} images", paths.len()))
            .hint(format!("at least {FEWEST_IMAGES} of one still scene, better 20")));
    }
    let mut images = Vec::new();
    let mut size = None;
    for path in paths {
        let (width, pixels) = read(path)?;
        let own = (width, pixels.len());
        if *size.get_or_insert(own) != own {
            return Err(WorkspaceError::input(format!("{} has another size than the first image", path.display()))
                .with_hint("all images come from one camera at one resolution")
                .into());
        }
        images.push(pixels);
    }
    Ok((size.map_or(1, |(width, _)| width as usize), images))
}

fn describe(found: &CameraNoise) -> String {
    let mut rows = vec![["sensor", "identified", "95 % interval", "unit"].map(String::from).to_vec()];
    rows.extend(found.estimates.iter().map(|it| {
        let [low, high] = it.interval;
        vec![it.name.into(), format!("{:.4}", it.value), format!("{low:.4} to {high:.4}"), it.unit.into()]
    }));
    let text = if found.estimates.is_empty() { String::new() } else { text_table(&rows) };
    found.unidentified.iter().fold(text, |text, it| text + &format!("not identified: {}: {}\n", it.name, it.reason))
}
