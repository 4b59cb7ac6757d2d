//! Renders a crowded table from the five default cameras and prints the cost of each image.
//!
//! ```text
//! cargo run --release -p genmanip-render --example default_views -- folder [width height]
//! ```
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use genmanip_assets::{Catalogue, panda, worlds::default_world};
use genmanip_core::glam::DVec3;
use genmanip_core::{ObjectModel, Pose};
use genmanip_render::{Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob, encode};

/// Repetitions of each view for the timing.
const REPEATS: usize = 30;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;
    let (assets, frame) = crowded_table()?;
    println!("{} triangles", assets.triangle_count());
    let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
    let color = Channels { normal: false, ..Channels::ALL };
    let size = std::env::args().skip(2).map(|text| text.parse()).collect::<Result<Vec<u32>, _>>()?;
    for mut camera in default_world().cameras.clone() {
        if let [width, height] = size[..] {
            camera.intrinsics = camera.intrinsics.resized(width, height);
        }
        let camera = &camera;
        let (out, full_ms) = timed(&mut renderer, ViewJob::new(&frame, camera, color))?;
        let (_, geometry_ms) = timed(&mut renderer, ViewJob::new(&frame, camera, Channels::GEOMETRY))?;
        println!("{:>9}: colour + depth + ids {full_ms:.1} ms, depth + ids {geometry_ms:.2} ms", camera.name);
        let (width, height) = (out.width, out.height);
        std::fs::write(folder.join(format!("{}.png", camera.name)), encode::png_rgb(width, height, &out.rgb)?)?;
        let depth = encode::png_depth_mm(width, height, &out.depth_m)?;
        std::fs::write(folder.join(format!("{}_depth.png", camera.name)), depth)?;
    }
    Ok(())
}

/// The buffers and the shortest wall time [ms]: other programs only add to it.
///
/// Views of one frame share its shadow map, so the time excludes it.
fn timed(renderer: &mut Renderer, job: ViewJob<'_>) -> Result<(FrameBuffers, f64), Box<dyn Error>> {
    let mut out = [FrameBuffers::default()];
    renderer.render(&[job], &mut out)?;
    let mut fastest_ms = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        renderer.render(&[job], &mut out)?;
        fastest_ms = fastest_ms.min(start.elapsed().as_secs_f64() * 1e3);
    }
    let [out] = out;
    Ok((out, fastest_ms))
}

/// The robot at home and every third object of the catalogue on a grid.
fn crowded_table() -> Result<(Arc<RenderAssets>, FrameState), Box<dyn Error>> {
    let catalogue = Catalogue::builtin();
    let objects: Vec<Arc<ObjectModel>> = catalogue
        .cards()
        .iter()
        .filter(|card| !card.is_articulated && card.size_m.x.max(card.size_m.y) < 0.16)
        .step_by(3)
        .take(12)
        .map(|card| catalogue.build(&card.uid))
        .collect::<Result<_, _>>()?;
    let robot = panda();
    let (home, width) = (robot.home.clone(), robot.gripper.max_width);
    let assets = RenderAssets::new(robot, &objects, Some(&default_world()))?;
    let poses = (0..objects.len()).map(|index| {
        let (row, column) = ((index / 4) as f64, (index % 4) as f64);
        let at = DVec3::new(0.35 + 0.18 * row, -0.32 + 0.21 * column, 0.0);
        (Pose::from_position_yaw(at, 0.7 * index as f64), [].as_slice())
    });
    let frame = assets.frame_state(&home, width, poses)?;
    Ok((assets, frame))
}
