//! User CPU time per image of a continued episode, static and wrist camera, 512x288.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]
use genmanip_assets::{Catalogue, panda, worlds::default_world};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{ObjectModel, Pose};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};
use std::error::Error;
use std::sync::Arc;
fn cpu() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    stat.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-6
}
fn main() -> Result<(), Box<dyn Error>> {
    let [w, h] = std::env::args().nth(1).map_or([512, 288], |s| {
        let (a, b) = s.split_once('x').unwrap();
        [a.parse().unwrap(), b.parse().unwrap()]
    });
    #[cfg(feature = "off")]
    if let Some(off) = std::env::args().nth(2) {
        genmanip_render::OFF.store(off.parse()?, std::sync::atomic::Ordering::Relaxed);
    }
    let catalogue = Catalogue::builtin();
    let objects: Vec<Arc<ObjectModel>> = catalogue
        .cards()
        .iter()
        .filter(|card| !card.is_articulated && card.size_m.x.max(card.size_m.y) < 0.16)
        .step_by(3)
        .take(8)
        .map(|card| catalogue.build(&card.uid))
        .collect::<Result<_, _>>()?;
    let robot = panda();
    let world = default_world();
    let assets = RenderAssets::new(robot, &objects, Some(&world))?;
    let frames: Vec<_> = (0..24)
        .map(|step| {
            let t = f64::from(step) * 0.02;
            let poses = (0..objects.len()).map(|index| {
                let (row, column) = ((index / 4) as f64, (index % 4) as f64);
                let lift = if index == 5 { 0.3 * t } else { 0.0 };
                let at = DVec3::new(0.35 + 0.18 * row, -0.32 + 0.21 * column, lift);
                (Pose::new(at, DQuat::from_rotation_z(0.7 * index as f64)), [].as_slice())
            });
            assets.frame_state(&[t, -0.3 - 0.5 * t, 0.1 * t, -2.2 + t, 0.0, 1.9 + t, 0.785], 0.05, poses)
        })
        .collect::<Result<_, _>>()?;
    let channels = Channels { normal: false, ..Channels::ALL };
    for name in ["static", "wrist"] {
        let mut camera = world.camera(name).ok_or("no such camera")?.clone();
        camera.intrinsics = camera.intrinsics.filling(w, h);
        let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        let mut out = [FrameBuffers::default()];
        let mut best = vec![f64::INFINITY; frames.len()];
        for round in 0..9 {
            for (frame, best) in frames.iter().zip(&mut best) {
                let start = cpu();
                renderer.render(&[ViewJob::new(frame, &camera, channels)], &mut out)?;
                let took = cpu() - start;
                if round > 0 {
                    *best = best.min(took);
                }
            }
        }
        println!("{name} {:.3}", best[1..].iter().sum::<f64>() / (best.len() - 1) as f64);
    }
    Ok(())
}
