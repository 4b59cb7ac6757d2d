//! Renders what a camera of a scenario sees:
//! `cargo run --release -p genmanip --example render -- scenario.json overview image.png`

use std::error::Error;
use std::path::PathBuf;

use genmanip::viz::views;
use genmanip::workspace::{documents, worlds::CameraFile};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scenario, camera, out] = arguments.as_slice() else {
        return Err("usage: render SCENARIO.json CAMERA IMAGE.png".into());
    };
    let setting = CameraFile::read(&PathBuf::from(scenario))?;
    let png = views::picture(&setting, setting.camera(camera)?)?;
    documents::write_file(&PathBuf::from(out), &png)?;
    Ok(())
}
