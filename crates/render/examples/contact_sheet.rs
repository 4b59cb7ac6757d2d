//! Renders every object of the catalogue into one image.
//!
//! ```text
//! cargo run --release -p genmanip-render --example contact_sheet -- sheet.png
//! ```
//! Objects appear row by row in the order of the catalogue; the list of their uids goes to stdout.
#![allow(clippy::print_stdout, reason = "an example talks to a person")]

use std::error::Error;
use std::sync::Arc;

use genmanip_assets::{Catalogue, worlds::default_world};
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Intrinsics, ObjectModel, Pose};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, encode};

/// Pixels per side of one object's image.
const CELL: u32 = 200;
/// Images per row.
const COLUMNS: usize = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "contact_sheet.png".into());
    let catalogue = Catalogue::builtin();
    let rows = catalogue.cards().len().div_ceil(COLUMNS);
    let (width, height) = (COLUMNS as u32 * CELL, rows as u32 * CELL);
    let mut sheet = vec![255; (width * height * 3) as usize];
    for (index, card) in catalogue.cards().iter().enumerate() {
        let object = match catalogue.build(&card.uid) {
            Ok(object) => object,
            Err(error) => {
                println!("        {} {}: {error}", card.uid, card.name);
                continue;
            }
        };
        let picture = portrait(&object)?;
        let (left, top) = (index % COLUMNS * CELL as usize, index / COLUMNS * CELL as usize);
        for (row, pixels) in picture.chunks_exact(CELL as usize * 3).enumerate() {
            let start = ((top + row) * width as usize + left) * 3;
            sheet[start..start + pixels.len()].copy_from_slice(pixels);
        }
        println!("{:>2}, {:>2}  {} {}", index / COLUMNS + 1, index % COLUMNS + 1, card.uid, card.name);
    }
    std::fs::write(path, encode::png_rgb(width, height, &sheet)?)?;
    Ok(())
}

/// The object on the table, filling the image at any size.
fn portrait(object: &Arc<ObjectModel>) -> Result<Vec<u8>, Box<dyn Error>> {
    let pose = Pose::from_position(DVec3::new(0.5, 0.0, 0.0));
    let joints = vec![0.0; object.joint_count()];
    let bounds = object.world_bounds(&pose, &joints);
    let radius = bounds.size().length() / 2.0;
    // Rendered at twice the size, for smoother edges.
    let intrinsics = Intrinsics::from_vertical_fov(2 * CELL, 2 * CELL, 0.42);
    let direction = DVec3::new(0.8, 0.35, 0.6).normalize();
    let eye = bounds.center() + direction * (radius / 0.20);
    let camera = Camera::looking_at("portrait", eye, bounds.center(), intrinsics);
    let assets = RenderAssets::without_robot(&[Arc::clone(object)], Some(&default_world()))?;
    let frame = assets.frame_state(&[], 0.0, [(pose, joints.as_slice())])?;
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(&frame, &camera, Channels::RGB);
    Renderer::new(assets, RenderVariation::default()).render(&[job], &mut out)?;
    let [out] = out;
    Ok(encode::resize_rgb([2 * CELL; 2], &out.rgb, [CELL; 2])?)
}
