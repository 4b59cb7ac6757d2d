//! Views of a calibration board whose corners are detected in images.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use genmanip_core::{Document, limits};
use genmanip_dataset_tools::import::decode_image;
use genmanip_real::boards::{GreyImage, Layout, detect};
use genmanip_real::calibrate::{BoardViews, CameraModel};
use genmanip_terminal::Printer;
use genmanip_workspace::{WorkspaceError, documents};

/// File that describes the views in a folder of images.
const VIEWS: &str = "views.json";

/// Views with their corners, and by id of a view the reason why no board was detected. If the file has no detections,
/// the images lie beside it, named after the views.
pub fn read(path: &Path, printer: &Printer) -> Result<(BoardViews, BTreeMap<String, String>), WorkspaceError> {
    let path = if path.is_dir() { path.join(VIEWS) } else { path.to_owned() };
    let mut file: BoardViews = documents::read_document(&path, limits::VIEWS)?;
    let mut reasons = BTreeMap::new();
    if !file.detections.is_empty() {
        return Ok((file, reasons));
    }
    let Some(Ok(layout)) = file.board.layout() else {
        return Err(WorkspaceError::input(format!("{} has no detections", path.display()))
            .with_hint("expected `detections`, or images beside the file and a `charuco` or `tags` board"));
    };
    let images = images(path.parent().unwrap_or(Path::new(".")))?;
    file.detections = images.keys().map(|id| (id.clone(), Vec::new())).collect();
    file.check().map_err(|error| WorkspaceError::input(format!("{} cannot be used", path.display())).because(error))?;
    for (id, image) in images.iter().filter(|(id, _)| file.robot.contains_key(*id)) {
        match corners(image, &file.camera, &layout)? {
            Ok(corners) => {
                printer.say(format!("{id}: {} of {} corners", corners.len(), layout.corners.len()));
                file.detections.insert(id.clone(), corners);
            }
            Err(reason) => {
                printer.say(format!("{id}: {reason}"));
                reasons.insert(id.clone(), reason);
            }
        }
    }
    Ok((file, reasons))
}

/// Image files of a folder by their names without extension.
fn images(folder: &Path) -> Result<BTreeMap<String, PathBuf>, WorkspaceError> {
    let unreadable = |error: std::io::Error| WorkspaceError::file("read", folder, error);
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut found: BTreeMap<String, PathBuf> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        if !ending.is_some_and(|ending| ["png", "jpg", "jpeg"].contains(&ending.as_str())) {
            continue;
        }
        if let Some(other) = found.insert(documents::stem(&path), path.clone()) {
            let (a, b) = (other.display(), path.display());
            return Err(WorkspaceError::input(format!("{a} and {b} are both images of one view"))
                .with_hint("remove one of them"));
        }
    }
    Ok(found)
}

type Corners = Vec<(u32, f64, f64)>;

/// Corners of the board in an image, or the reason why none was detected.
fn corners(path: &Path, camera: &CameraModel, layout: &Layout) -> Result<Result<Corners, String>, WorkspaceError> {
    let bytes = documents::read_bytes(path, limits::IMPORTED_PICTURE)?;
    let broken = || WorkspaceError::input(format!("{} is no image of the camera", path.display()));
    let (width, height, rgb) = decode_image(&bytes).map_err(|error| broken().because(error))?;
    let expected = [camera.intrinsics.width, camera.intrinsics.height];
    let image = GreyImage::from_rgb(width as usize, height as usize, &rgb).filter(|_| [width, height] == expected);
    let Some(image) = image else {
        let [wide, high] = expected;
        return Err(
            broken().with_hint(format!("expected {wide} x {high} pixels as in `intrinsics`, got {width} x {height}"))
        );
    };
    let found = detect(&image, layout).map_err(|reason| reason.to_string());
    Ok(found.map(|corners| corners.into_iter().map(|(id, pixel)| (id, pixel.x, pixel.y)).collect()))
}
