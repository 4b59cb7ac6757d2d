//! Labels of the objects in images: bounding boxes in `labels.jsonl`, point clouds in PLY files.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use genmanip_core::names::{MAX_NAME_LENGTH, fits_file_name};
use genmanip_core::perception::{self, ImageLabels, VisibleRegion};
use genmanip_core::{Camera, Document, RgbdImage};
use genmanip_data::files::Writing;
use genmanip_data::ply;
use genmanip_rollout::Stage;
use genmanip_rollout::images::StageRenderer;

use super::moment::{Boxes, Moment};
use crate::scene_images::not_drawn;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Name of the file with bounding boxes: one JSON line per image and camera.
const FILE: &str = "labels.jsonl";

/// Writer of the labels of a scenario's or an episode's images; it writes them as images are rendered, and keeps no
/// image.
pub(super) struct Labels<'a> {
    stage: &'a Stage,
    folder: PathBuf,
    /// File of bounding boxes; `None` if they are not requested.
    lines: Option<BufWriter<Writing>>,
    boxes: Boxes<'a>,
    has_clouds: bool,
    is_film: bool,
}

impl<'a> Labels<'a> {
    pub(super) fn new(
        stage: &'a Stage,
        folder: &Path,
        has_boxes: bool,
        has_clouds: bool,
        is_film: bool,
    ) -> Result<Self, WorkspaceError> {
        let file = folder.join(FILE);
        let lines = has_boxes.then(|| Writing::begin(&file)).transpose();
        let lines = lines.map_err(|error| WorkspaceError::of_file("write", &file, error))?.map(BufWriter::new);
        Ok(Self { stage, folder: folder.to_owned(), lines, boxes: Boxes::new(stage), has_clouds, is_film })
    }

    /// Writes the labels of all cameras' images at a moment.
    pub(super) fn push(
        &mut self,
        painter: &mut StageRenderer,
        moment: &Moment,
        cameras: &[Camera],
        images: &[RgbdImage],
    ) -> Result<(), WorkspaceError> {
        if self.lines.is_some() {
            let whole = painter.unoccluded(&moment.arm, moment.width, moment.placed(), cameras);
            let whole = whole.map_err(|error| not_drawn(&self.stage.scenario.id, error))?;
            for ((camera, image), whole) in cameras.iter().zip(images).zip(&whole) {
                self.write_line(moment, camera, image, whole)?;
            }
        }
        if self.has_clouds {
            for (camera, image) in cameras.iter().zip(images) {
                self.write_clouds(moment.picture, camera, image)?;
            }
        }
        Ok(())
    }

    fn write_line(
        &mut self,
        moment: &Moment,
        camera: &Camera,
        image: &RgbdImage,
        whole: &[VisibleRegion],
    ) -> Result<(), WorkspaceError> {
        let objects = &self.stage.scenario.objects;
        let visible = perception::visible_regions(&image.ids, image.width(), objects.len());
        let whole = whole.iter().copied().chain(std::iter::repeat(VisibleRegion::default()));
        let told = objects.iter().zip(visible).zip(whole).zip(self.boxes.at(moment));
        let told = told.map(|(((placed, visible), whole), around)| (&placed.id, visible, whole, around));
        let line = ImageLabels {
            picture: moment.picture,
            control_step: moment.control_step,
            time_s: moment.frame.map_or(0.0, |frame| frame.time_s),
            camera: camera.name.clone(),
            projection: image.projection(),
            objects: perception::labels(&image.projection(), told),
        };
        let Some(lines) = &mut self.lines else { return Ok(()) };
        let written = writeln!(lines, "{}", line.to_value());
        written.map_err(|error| WorkspaceError::file("write", &self.folder.join(FILE), error))
    }

    fn write_clouds(&self, picture: usize, camera: &Camera, image: &RgbdImage) -> Result<(), WorkspaceError> {
        let place = self.folder.join(format!("{}_clouds", camera.name));
        let place = if self.is_film { place.join(format!("{picture:06}")) } else { place };
        let objects = &self.stage.scenario.objects;
        for (placed, cloud) in objects.iter().zip(perception::clouds(image, objects.len())) {
            if !cloud.points_m.is_empty() {
                documents::write_file(
                    &place.join(format!("{}.ply", file_name(placed.id.as_str()))),
                    &ply::encode(&cloud),
                )?;
            }
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<(), WorkspaceError> {
        let Some(lines) = self.lines else { return Ok(()) };
        let file = self.folder.join(FILE);
        let lines = lines.into_inner().map_err(|error| WorkspaceError::file("write", &file, error.into_error()))?;
        lines.finish().map_err(|error| WorkspaceError::of_file("write", &file, error))
    }
}

/// File name for an object id.
fn file_name(id: &str) -> String {
    let fit = |c: char| if fits_file_name(c) { c } else { '_' };
    let name: String = id.chars().map(fit).take(MAX_NAME_LENGTH - 4).collect();
    if name.starts_with('.') { format!("_{name}") } else { name }
}
