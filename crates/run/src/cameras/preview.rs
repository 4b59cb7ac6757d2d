//! What the cameras of a file see before anything moves.

use std::path::{Path, PathBuf};

use genmanip_core::{Camera, Pose};
use genmanip_render::{Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob, encode};
use serde::Serialize;

use super::{CameraFile, Format};
use crate::error::RunError;
use crate::inputs;

/// Most pixels along one side of a preview.
const MOST_PIXELS: u32 = 8192;
/// White between the pictures of a sheet, pixels.
const GAP_PX: usize = 4;

/// A picture that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Previewed {
    /// Cameras in the picture, row by row.
    pub cameras: Vec<String>,
    /// Where it is.
    pub file: PathBuf,
    /// Width and height of each camera's picture.
    pub size_px: [u32; 2],
}

/// Draws what cameras of a file see: the robot at its start over the table, with the objects of a scenario.
///
/// `out` with the ending .png, .jpg or .jpeg is one picture, a sheet where there are several cameras; anything else is
/// a folder that gets NAME.png for each. Without names, all cameras are drawn; without a size, each at its own.
///
/// # Errors
/// When there is no such camera, the scenario's objects or robot are not those of this program, or a picture cannot
/// be drawn or written.
pub fn preview(
    path: &Path,
    names: &[String],
    size_px: Option<[u32; 2]>,
    out: &Path,
) -> Result<Vec<Previewed>, RunError> {
    let file = CameraFile::open(path)?;
    if let Some([width, height]) = size_px.filter(|size| !size.iter().all(|side| (1..=MOST_PIXELS).contains(side))) {
        return Err(RunError::input(format!("--size {width}x{height} is no picture"))
            .with_hint(format!("expected 1 to {MOST_PIXELS} pixels along each side")));
    }
    let chosen: Vec<usize> = match names {
        [] => (0..file.cameras().len()).collect(),
        names => names.iter().map(|name| file.index_of(name)).collect::<Result<_, _>>()?,
    };
    if chosen.is_empty() {
        return Err(file.without_cameras());
    }
    let sized = |index: usize| {
        let camera = file.cameras()[index].clone();
        let [width, height] = size_px.unwrap_or([camera.intrinsics.width, camera.intrinsics.height]);
        Camera { intrinsics: camera.intrinsics.filling(width, height), ..camera }
    };
    let cameras: Vec<Camera> = chosen.into_iter().map(sized).collect();
    let (renderer, frame) = file.stage()?;
    let pictures = draw(renderer, &frame, &cameras)?;
    match out.extension().and_then(|ending| ending.to_str()) {
        Some(ending @ ("png" | "jpg" | "jpeg")) => {
            let sheet = sheet(&pictures);
            let encoded = match ending {
                "png" => encode::png_rgb(sheet.width, sheet.height, &sheet.rgb),
                _ => encode::jpeg_rgb(sheet.width, sheet.height, &sheet.rgb, 88),
            };
            inputs::write_file(out, &encoded.map_err(|error| RunError::broken("cannot encode the picture", error))?)?;
            let size_px = [pictures[0].width, pictures[0].height];
            let cameras = cameras.into_iter().map(|camera| camera.name).collect();
            Ok(vec![Previewed { cameras, file: out.into(), size_px }])
        }
        Some(ending) if !out.is_dir() => Err(RunError::input(format!("cannot write a .{ending} file"))
            .with_hint("--out is a folder, or a picture that ends in .png or .jpg")),
        _ => cameras
            .into_iter()
            .zip(&pictures)
            .map(|(camera, picture)| {
                let file = out.join(format!("{}.png", camera.name));
                let encoded = encode::png_rgb(picture.width, picture.height, &picture.rgb)
                    .map_err(|error| RunError::broken("cannot encode the picture", error))?;
                inputs::write_file(&file, &encoded)?;
                Ok(Previewed { cameras: vec![camera.name], file, size_px: [picture.width, picture.height] })
            })
            .collect(),
    }
}

impl CameraFile {
    /// What draws the file's world, and its state before anything moves.
    fn stage(&self) -> Result<(Renderer, FrameState), RunError> {
        let failed = |error| RunError::broken(format!("cannot draw {}", self.path.display()), error);
        let mut objects: Vec<(Pose, Vec<f64>)> = Vec::new();
        let (assets, robot) = if self.format == Format::Scenario {
            let stage = inputs::read_stage(&self.path)?;
            objects.extend(stage.scenario.objects.iter().map(|placed| (placed.pose, placed.joint_positions.clone())));
            let assets = stage
                .render_assets()
                .map_err(|error| RunError::broken(format!("cannot draw {}", self.path.display()), error))?;
            (assets, inputs::robot(&self.world)?)
        } else {
            let robot = inputs::robot(&self.world)?;
            (RenderAssets::new(robot.clone(), &[], Some(&self.world)).map_err(failed)?, robot)
        };
        let placed = objects.iter().map(|(pose, joints)| (*pose, joints.as_slice()));
        let frame = assets.frame_state(&self.world.robot.home, robot.gripper.max_width, placed).map_err(failed)?;
        Ok((Renderer::new(assets, RenderVariation::default()), frame))
    }

    fn without_cameras(&self) -> RunError {
        RunError::input(format!("{} has no camera", self.path.display()))
            .with_hint("add one with `genmanip camera add`")
    }
}

fn draw(mut renderer: Renderer, frame: &FrameState, cameras: &[Camera]) -> Result<Vec<FrameBuffers>, RunError> {
    let jobs: Vec<ViewJob> = cameras.iter().map(|camera| ViewJob::new(frame, camera, Channels::RGB)).collect();
    let mut pictures = vec![FrameBuffers::default(); jobs.len()];
    renderer.render(&jobs, &mut pictures).map_err(|error| RunError::broken("cannot draw a camera's view", error))?;
    Ok(pictures)
}

/// Pictures row by row in one, as square as their number allows; each in a cell of the largest one's size.
fn sheet(pictures: &[FrameBuffers]) -> FrameBuffers {
    let columns = (1..=pictures.len()).find(|columns| columns * columns >= pictures.len()).unwrap_or(1);
    let rows = pictures.len().div_ceil(columns);
    let largest = |side: fn(&FrameBuffers) -> u32| pictures.iter().map(side).max().unwrap_or(0) as usize;
    let (cell_width, cell_height) = (largest(|p| p.width) + GAP_PX, largest(|p| p.height) + GAP_PX);
    let (width, height) = (columns * cell_width - GAP_PX, rows * cell_height - GAP_PX);
    let mut rgb = vec![255; width * height * 3];
    for (index, picture) in pictures.iter().enumerate() {
        let (left, top) = (index % columns * cell_width, index / columns * cell_height);
        for (row, pixels) in picture.rgb.chunks_exact(picture.width as usize * 3).enumerate() {
            let start = ((top + row) * width + left) * 3;
            rgb[start..start + pixels.len()].copy_from_slice(pixels);
        }
    }
    FrameBuffers { width: width as u32, height: height as u32, rgb, ..FrameBuffers::default() }
}
