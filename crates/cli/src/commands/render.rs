//! `genmanip render`: images of scenarios and episodes.

use genmanip_core::ImageChannels;
use genmanip_core::sensor::SensorPreset;
use genmanip_viz::render::{self, AppearanceOptions, RenderOptions};
use genmanip_workspace::workers;

use super::collect::vary;
use crate::args::RenderArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &RenderArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let holds = |channel: &str| arguments.channels.iter().any(|named| named == channel);
    let options = RenderOptions {
        robot: arguments.robot.clone(),
        cameras: arguments.cameras.clone(),
        size_px: arguments.size,
        channels: ImageChannels {
            rgb: holds("rgb"),
            depth: holds("depth"),
            ids: holds("ids"),
            normals: holds("normals"),
            points: false,
        },
        boxes: holds("boxes"),
        clouds: holds("clouds"),
        overlays: arguments.overlay.clone(),
        captions: arguments.captions,
        turntable: arguments.turntable,
        fps: arguments.rate,
        look: arguments.variation.map(|seed| AppearanceOptions { seed, vary: vary(&arguments.vary) }),
        sensor: arguments.sensor.as_deref().and_then(SensorPreset::named).map(|preset| preset.sensor),
        shutter_s: arguments.shutter,
        distortion: arguments.distortion,
        paths: (arguments.quality == "reference").then_some(arguments.paths),
        workers: workers::workers(arguments.workers),
    };
    let stop = genmanip_terminal::on_interrupt();
    let rendered = render::render(&arguments.source, &arguments.out, &options, printer, &stop)?;
    printer.data(&rendered, &render::table(&rendered));
    let is_whole = !stop.load(std::sync::atomic::Ordering::Relaxed);
    Ok(if is_whole { ExitStatus::Done } else { ExitStatus::NotMet })
}
