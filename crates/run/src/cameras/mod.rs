//! Cameras of worlds and scenarios: listed, added, changed, removed and looked through.

mod edit;
mod preview;
mod toml_text;

use std::path::{Path, PathBuf};

use genmanip_assets::worlds;
use genmanip_core::camera::{CameraPreset, PRESETS};
use genmanip_core::{Camera, CameraMount, Document, Scenario, World, json};
use serde::Serialize;
use serde_json::Value;

use crate::error::RunError;
use crate::inputs;

pub use edit::CameraEdit;
pub use preview::{Previewed, preview};

/// A world file (TOML or JSON) or a scenario file whose cameras are of interest.
#[derive(Clone, Debug)]
pub struct CameraFile {
    path: PathBuf,
    format: Format,
    text: String,
    /// The file as it is written, shorthands unresolved.
    body: Value,
    world: World,
}

/// What a file is, which decides where its cameras are and how they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    WorldToml,
    WorldJson,
    Scenario,
}

impl CameraFile {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read, or is neither a valid world nor a valid scenario.
    pub fn open(path: &Path) -> Result<Self, RunError> {
        let text = inputs::read_document_text(path)?;
        if !text.trim_start().starts_with('{') {
            let world = inputs::parse_world(path, &text)?;
            let body = toml_text::value(path, &text)?;
            return Ok(Self { path: path.into(), format: Format::WorldToml, text, body, world });
        }
        let body = json::parse(&text).map_err(|error| {
            RunError::input(format!("{} is neither a world nor a scenario", path.display())).because(error)
        })?;
        let is_world = body.get("schema").and_then(Value::as_str) == Some(World::SCHEMA);
        let (format, world) = if is_world {
            (Format::WorldJson, inputs::parse_world(path, &text)?)
        } else {
            (Format::Scenario, inputs::parse_document::<Scenario>(path, &text)?.world)
        };
        Ok(Self { path: path.into(), format, text, body, world })
    }

    /// Its cameras.
    pub fn cameras(&self) -> &[Camera] {
        &self.world.cameras
    }

    /// The place of a camera in the list.
    fn index_of(&self, name: &str) -> Result<usize, RunError> {
        let known: Vec<&str> = self.cameras().iter().map(|camera| camera.name.as_str()).collect();
        let found = known.iter().position(|&other| other == name);
        found.ok_or_else(|| RunError::unknown("camera", "cameras", name, &known))
    }
}

/// What `camera list` shows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraList {
    /// Cameras of the file, or of the built-in world.
    pub cameras: Vec<CameraLine>,
    /// Presets there are; only where no file was named.
    #[serde(skip_serializing_if = "<[CameraPreset]>::is_empty")]
    pub presets: &'static [CameraPreset],
}

/// One camera of a [`CameraList`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraLine {
    /// Name.
    pub name: String,
    /// What it is fixed to.
    pub mount: CameraMount,
    /// Width and height.
    pub size_px: [u32; 2],
    /// Vertical field of view, degrees.
    pub vertical_fov_deg: f64,
    /// Horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
    /// Where it is, in the frame of its mount.
    pub position_m: [f64; 3],
    /// Unit vector along its optical axis, in the frame of its mount.
    pub looks_along: [f64; 3],
}

/// The cameras of a file; those of the built-in world and all presets where no file is named.
///
/// # Errors
/// As [`CameraFile::open`].
pub fn list(path: Option<&Path>) -> Result<CameraList, RunError> {
    Ok(match path {
        Some(path) => CameraList { cameras: lines(CameraFile::open(path)?.cameras()), presets: &[] },
        None => CameraList { cameras: lines(&worlds::default_world().cameras), presets: &PRESETS },
    })
}

fn lines(cameras: &[Camera]) -> Vec<CameraLine> {
    let line = |camera: &Camera| CameraLine {
        name: camera.name.clone(),
        mount: camera.mount,
        size_px: [camera.intrinsics.width, camera.intrinsics.height],
        vertical_fov_deg: camera.intrinsics.vertical_fov().to_degrees(),
        horizontal_fov_deg: camera.intrinsics.horizontal_fov().to_degrees(),
        position_m: camera.mount_from_camera.position.to_array(),
        looks_along: (camera.mount_from_camera.orientation * genmanip_core::glam::DVec3::Z).to_array(),
    };
    cameras.iter().map(line).collect()
}

impl CameraList {
    /// As a table for people.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{:16} {:6} {:>10} {:>9}  {:24} looks along\n",
            "camera", "mount", "size", "fov (deg)", "position (m)"
        );
        let vector = |[x, y, z]: [f64; 3]| format!("{x:.3}, {y:.3}, {z:.3}");
        for camera in &self.cameras {
            let mount = if camera.mount == CameraMount::Hand { "hand" } else { "world" };
            let size = format!("{}x{}", camera.size_px[0], camera.size_px[1]);
            text += &format!(
                "{:16} {mount:6} {size:>10} {:9.1}  {:24} {}\n",
                camera.name,
                camera.vertical_fov_deg,
                vector(camera.position_m),
                vector(camera.looks_along)
            );
        }
        if !self.presets.is_empty() {
            text += &format!("\n{:16} {:>10} {:>9}  what it is\n", "preset", "size", "fov (deg)");
        }
        for preset in self.presets {
            let size = format!("{}x{}", preset.size_px[0], preset.size_px[1]);
            let vertical_deg = preset.intrinsics().vertical_fov().to_degrees();
            text += &format!("{:16} {size:>10} {vertical_deg:9.1}  {}\n", preset.name, preset.what);
        }
        text
    }
}
