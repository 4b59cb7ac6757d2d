//! Hashes of images, one per line: `cargo xtask test bytes` compares those of a build for any processor with those of
//! the usual one, which takes the widest registers of the machine.
//!
//! ```text
//! cargo run --release -p genmanip-render --example same_bytes [--no-default-features]
//! ```
#![allow(clippy::print_stdout, reason = "an example talks to a program")]

use std::error::Error;
use std::sync::Arc;

use genmanip_assets::{Catalogue, panda, worlds::default_world};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Camera, ObjectModel, Pose, Seed};
use genmanip_render::{
    AppearanceFactor, AppearanceRandomisation, Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation,
    Renderer, ViewJob, sampling,
};

/// Seeds of further appearances: other tables, walls and lights.
const LOOKS: [u64; 2] = [11, 57];
const SIZES: [[u32; 2]; 2] = [[512, 288], [64, 64]];

fn main() -> Result<(), Box<dyn Error>> {
    let objects = objects()?;
    let world = default_world();
    let assets = RenderAssets::new(panda(), &objects, Some(&world))?;
    let usual = RenderVariation::default();
    let parts = vec![
        AppearanceFactor::Light,
        AppearanceFactor::Background,
        AppearanceFactor::Material,
        AppearanceFactor::Objects,
    ];
    let looks =
        LOOKS.map(|seed| sampling::varied(&usual, &AppearanceRandomisation::new(Seed::new(seed), parts.clone())));
    for (look, variation) in std::iter::once(&usual).chain(&looks).enumerate() {
        let mut renderer = Renderer::new(Arc::clone(&assets), variation.clone());
        // The second image of a camera continues the first.
        for moment in 0..2 {
            let frame = frame(&assets, &objects, moment)?;
            for name in ["static", "wrist"] {
                for [width, height] in SIZES {
                    let camera = world.camera(name).ok_or("the world has no such camera")?;
                    let intrinsics = camera.intrinsics.filling(width, height);
                    let camera = Camera { intrinsics, ..camera.clone() };
                    let mut out = [FrameBuffers::default()];
                    renderer.render(&[ViewJob::new(&frame, &camera, Channels::ALL)], &mut out)?;
                    let picture = format!("look {look}, moment {moment}, {name}, {width}x{height}");
                    let FrameBuffers { rgb, depth_m, instance, normal, .. } = &out[0];
                    println!("{picture}, colour {:016x}", hash(rgb.iter().copied()));
                    println!("{picture}, depth {:016x}", hash(depth_m.iter().flat_map(|it| it.to_le_bytes())));
                    println!("{picture}, ids {:016x}", hash(instance.iter().flat_map(|it| it.to_le_bytes())));
                    println!("{picture}, normals {:016x}", hash(normal.iter().flatten().map(|it| it.cast_unsigned())));
                }
            }
        }
    }
    Ok(())
}

/// Every fifth rigid object that fits, and some of glass.
fn objects() -> Result<Vec<Arc<ObjectModel>>, Box<dyn Error>> {
    let catalogue = Catalogue::builtin();
    let models = catalogue.cards().iter().filter(|card| !card.is_articulated).map(|card| catalogue.build(&card.uid));
    let models = models.collect::<Result<Vec<_>, _>>()?;
    let is_small = |model: &&Arc<ObjectModel>| model.card.size_m.x.max(model.card.size_m.y) < 0.2;
    let is_glass = |model: &Arc<ObjectModel>| {
        model.links.iter().flat_map(|link| &link.visual).any(|part| part.material.opacity < 1.0)
    };
    let (glass, other): (Vec<_>, Vec<_>) = models.iter().filter(is_small).cloned().partition(is_glass);
    if glass.is_empty() {
        return Err("the catalogue has nothing of glass".into());
    }
    Ok(glass.into_iter().take(3).chain(other.into_iter().step_by(5)).take(12).collect())
}

/// Objects on a grid in front of the arm; at the second moment some objects and the arm have moved.
fn frame(
    assets: &RenderAssets,
    objects: &[Arc<ObjectModel>],
    moment: usize,
) -> Result<FrameState, genmanip_render::RenderError> {
    let joints: Vec<Vec<f64>> = objects.iter().map(|model| vec![0.0; model.joint_count()]).collect();
    let placed = objects.iter().zip(&joints).enumerate().map(|(index, (model, joints))| {
        let moved = if index % 3 == 0 { 0.013 * moment as f64 } else { 0.0 };
        let (row, column) = ((index / 4) as f64, (index % 4) as f64);
        let position = DVec3::new(0.35 + 0.14 * row + moved, -0.24 + 0.16 * column, 0.5 * model.card.size_m.z);
        (Pose::new(position, DQuat::from_rotation_z(0.7 * index as f64)), joints.as_slice())
    });
    let turn = 0.05 * moment as f64;
    assets.frame_state(&[turn, -0.5, 0.0, -2.38 + turn, 0.0, 1.88, 0.785], 0.05, placed)
}

/// FNV-1a.
fn hash(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
