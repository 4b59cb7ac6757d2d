//! Camera previews of a world or scenario in its initial state.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Camera, Seed};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, encode, sensor};
use serde::Serialize;

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::worlds;
use genmanip_workspace::worlds::CameraFile;

/// Width of the white gaps between the images of a sheet, pixels. Chosen by hand.
const GAP_PX: usize = 4;
/// Quality of JPEG sheets, 1-100. Chosen by hand: artefacts are hardly visible.
const JPEG_QUALITY: u8 = 88;

/// Preview image that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Preview {
    /// Names of the cameras in the image, row by row.
    pub cameras: Vec<String>,
    /// Path of the image file.
    pub file: PathBuf,
}

/// Renders camera previews of a world or scenario: the robot at home with open fingers above the table, and the objects
/// of a scenario at their initial poses.
///
/// If `out` ends in .png, .jpg or .jpeg, one image is written, with several cameras as a sheet; otherwise `out` is a
/// folder that gets NAME.png for each camera. Empty `names` select all cameras; without `size_px` each camera has its
/// own size.
///
/// # Errors
/// When the file is neither a world nor a scenario, a camera is unknown, the program has another version of an object
/// or the robot, or an image cannot be rendered or written.
pub fn preview(
    file: &Path,
    names: &[String],
    size_px: Option<[u32; 2]>,
    out: &Path,
) -> Result<Vec<Preview>, WorkspaceError> {
    let setting = &CameraFile::read(file)?;
    let chosen: Vec<&Camera> = match names {
        [] => setting.world().cameras.iter().collect(),
        names => names.iter().map(|name| setting.camera(name)).collect::<Result<_, _>>()?,
    };
    if chosen.is_empty() {
        let what = format!("{} has no camera to look through", file.display());
        return Err(WorkspaceError::input(what).with_hint("expected one or more; see `genmanip camera add --help`"));
    }
    let sized = |camera: &Camera| {
        let [width, height] = size_px.unwrap_or([camera.intrinsics.width, camera.intrinsics.height]);
        Camera { intrinsics: camera.intrinsics.filling(width, height), ..camera.clone() }
    };
    let cameras: Vec<Camera> = chosen.into_iter().map(sized).collect();
    let name = |camera: &Camera| camera.name.clone();
    match out.extension().and_then(|ending| ending.to_str()) {
        Some(ending @ ("png" | "jpg" | "jpeg")) => {
            let sheet = sheet(&draw(setting, &cameras, Catalogue::builtin())?);
            let encoded = match ending {
                "png" => encode::png_rgb(sheet.width, sheet.height, &sheet.rgb),
                _ => encode::jpeg_rgb(sheet.width, sheet.height, &sheet.rgb, JPEG_QUALITY),
            };
            documents::write_file(
                out,
                &encoded.map_err(|error| WorkspaceError::broken("cannot encode the sheet", error))?,
            )?;
            Ok(vec![Preview { cameras: cameras.iter().map(name).collect(), file: out.into() }])
        }
        Some(ending) if !out.is_dir() => Err(WorkspaceError::input(format!("cannot write pictures as .{ending}"))
            .with_hint("--out is a folder, or a picture that ends in .png or .jpg")),
        _ => {
            let write = |(camera, picture): (&Camera, FrameBuffers)| {
                let file = out.join(format!("{}.png", camera.name));
                documents::write_file(&file, &png(camera, &picture)?)?;
                Ok(Preview { cameras: vec![camera.name.clone()], file })
            };
            cameras.iter().zip(draw(setting, &cameras, Catalogue::builtin())?).map(write).collect()
        }
    }
}

/// Preview through one camera, as the bytes of a PNG file.
///
/// # Errors
/// As [`preview`].
pub fn picture(setting: &CameraFile, camera: &Camera) -> Result<Vec<u8>, WorkspaceError> {
    let picture = draw(setting, std::slice::from_ref(camera), Catalogue::builtin())?.swap_remove(0);
    png(camera, &picture)
}

fn png(camera: &Camera, picture: &FrameBuffers) -> Result<Vec<u8>, WorkspaceError> {
    encode::png_rgb(picture.width, picture.height, &picture.rgb)
        .map_err(|error| WorkspaceError::broken(format!("cannot encode the picture of camera {}", camera.name), error))
}

/// Renders one image per camera; `source` provides the objects.
pub fn draw(
    setting: &CameraFile,
    cameras: &[Camera],
    source: &dyn AssetSource,
) -> Result<Vec<FrameBuffers>, WorkspaceError> {
    let robot = worlds::robot(setting.world())?;
    let (id, objects) = match setting {
        CameraFile::World(_) => ("", &[][..]),
        CameraFile::Scenario(scenario) => (scenario.id.as_str(), &scenario.objects[..]),
    };
    let models = objects.iter().map(|placed| {
        source.instance(placed).map_err(|error| {
            WorkspaceError::broken(format!("cannot draw object {} of scenario {id}", placed.id), error)
                .with_hint("a scenario belongs to the objects it was made with; lay its task out again")
        })
    });
    let models = models.collect::<Result<Vec<_>, WorkspaceError>>()?;
    let not_drawn = |error| WorkspaceError::broken("the cameras give no picture", error);
    let assets = RenderAssets::new(Arc::clone(&robot), &models, Some(setting.world())).map_err(not_drawn)?;
    let poses = objects.iter().map(|placed| (placed.pose, placed.joint_positions.as_slice()));
    let state = assets.frame_state(&robot.home, robot.gripper.max_width, poses).map_err(not_drawn)?;
    let pinholes = cameras.iter().map(sensor::pinhole).collect::<Result<Vec<_>, _>>().map_err(not_drawn)?;
    let jobs: Vec<ViewJob> = pinholes.iter().map(|camera| ViewJob::new(&state, camera, Channels::RGB)).collect();
    let mut pictures = vec![FrameBuffers::default(); jobs.len()];
    let variation = RenderVariation::of_world(setting.world()).map_err(not_drawn)?;
    let mut renderer = Renderer::new(assets, variation);
    renderer.render(&jobs, &mut pictures).map_err(not_drawn)?;
    let developed = |(camera, picture)| sensor::developed(&renderer, camera, Channels::RGB, picture, Seed::new(0));
    cameras.iter().zip(pictures).map(developed).collect::<Result<_, _>>().map_err(not_drawn)
}

/// Images in a nearly square grid, row by row; each cell has the size of the largest image.
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
