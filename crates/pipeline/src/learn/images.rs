//! Images of the rows of demonstrations, rendered once at the size of the network's inputs, with the same renderer and
//! camera requests as in evaluation, into a file in the run's folder.

use std::error::Error;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{Camera, Episode, ImageChannels, hexadecimal};
use genmanip_data::files::Writing;
use genmanip_policy::{ImageInput, RowImages};
use genmanip_rollout::collect::in_parallel_each;
use genmanip_rollout::images::{Exposure, StageRenderer};
use genmanip_rollout::{RolloutError, Stage};
use genmanip_viz::replay;
use genmanip_workspace::{Progress, WorkspaceError, documents};
use sha2::{Digest, Sha256};

use super::demonstrations::RunDemonstrations;
use crate::folder::RunFolder;
use crate::learned::inputs;

/// Folder of the image files in a run.
const FOLDER: &str = "training_images";
/// Version of the image files; to be increased when the images of the same run change.
const VERSION: u32 = 1;

/// Cause of an error.
type Cause = Box<dyn Error + Send + Sync>;

/// A file with the images of all rows.
struct ImageFile {
    file: File,
    row_bytes: usize,
    /// Index of the first row of each episode.
    first: Vec<usize>,
}

impl RowImages for ImageFile {
    fn read(&self, episode: usize, row: usize) -> io::Result<Vec<u8>> {
        let first = self.first.get(episode).ok_or(io::ErrorKind::NotFound)?;
        let mut bytes = vec![0; self.row_bytes];
        self.file.read_exact_at(&mut bytes, ((first + row) * self.row_bytes) as u64)?;
        Ok(bytes)
    }
}

/// Images of all rows, rendered unless an earlier call has done so; `None` if interrupted.
///
/// # Errors
/// When an episode cannot be rendered, or the file cannot be written.
pub(super) fn of_rows(
    read: &RunDemonstrations,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Box<dyn RowImages>>, WorkspaceError> {
    let images = &read.arrays.inputs.images;
    if images.is_empty() {
        return Ok(Some(Box::new(())));
    }
    let row_bytes = images.iter().map(ImageInput::bytes).sum();
    let counts = read.frames.iter().map(Vec::len);
    let first: Vec<usize> = counts.scan(0, |next, count| Some(std::mem::replace(next, *next + count))).collect();
    let folder = read.folder.join(FOLDER);
    let path = folder.join(format!("{}.rgb", name(read)));
    if !path.exists() {
        documents::sweep(&folder)?;
        if !render(read, &path, (workers, progress, stop))? {
            return Ok(None);
        }
    }
    let file = File::open(&path).map_err(|error| WorkspaceError::file("open", &path, error))?;
    let expected = read.frames.iter().map(Vec::len).sum::<usize>() * row_bytes;
    let got = file.metadata().map_err(|error| WorkspaceError::file("read", &path, error))?.len();
    if got != expected as u64 {
        return Err(WorkspaceError::input(format!("{} has {got} bytes, expected {expected}", path.display()))
            .with_hint("remove it; it is then rendered again"));
    }
    Ok(Some(Box::new(ImageFile { file, row_bytes, first })))
}

/// Name of the file: a hash of everything that the images depend on.
fn name(read: &RunDemonstrations) -> String {
    let mut hasher = Sha256::new();
    hasher.update(format!("{VERSION} {} {} {:?}\n", env!("CARGO_PKG_VERSION"), read.run, read.arrays.inputs.images));
    for (id, frames) in read.ids.iter().zip(&read.frames) {
        hasher.update(format!("{id} {frames:?}\n"));
    }
    hexadecimal(&hasher.finalize()[..8])
}

/// Renders all rows into a file; false if interrupted.
fn render(
    read: &RunDemonstrations,
    path: &Path,
    (workers, progress, stop): (usize, &dyn Progress, &AtomicBool),
) -> Result<bool, WorkspaceError> {
    let (folder, _) = RunFolder::open(&read.folder)?;
    let store = folder.store()?;
    let mut writing = Writing::begin(path).map_err(|error| documents::unwritable(path, error))?;
    let mut written = Ok(());
    progress.begin("rendering training images", read.ids.len());
    let episodes: Vec<(&String, &Vec<usize>)> = read.ids.iter().zip(&read.frames).collect();
    let work = |&(id, frames): &(&String, &Vec<usize>)| {
        let broken = |error: Cause| WorkspaceError::broken(format!("cannot render episode {id}"), error);
        let episode = store.read(id).map_err(|error| broken(error.into()))?;
        let stage = replay::stage(&episode)?;
        rows(&stage, &episode, frames, &read.arrays.inputs.images).map_err(|error| broken(error.into()))
    };
    in_parallel_each(&episodes, workers, stop, &work, &mut |rows| {
        if written.is_ok() {
            written = writing.write_all(&rows);
        }
        progress.advance();
    })?;
    progress.end();
    if stop.load(Ordering::Relaxed) {
        return Ok(false);
    }
    written.map_err(|error| WorkspaceError::file("write", path, error))?;
    writing.finish().map_err(|error| documents::unwritable(path, error))?;
    Ok(true)
}

/// Images of the rows of an episode, as the policy observes them in evaluation.
fn rows(stage: &Stage, episode: &Episode, frames: &[usize], images: &[ImageInput]) -> Result<Vec<u8>, RolloutError> {
    let requests = inputs::cameras(images);
    let cameras = requests.iter().map(|request| stage.camera(request)).collect::<Result<Vec<Camera>, _>>()?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, ImageChannels::RGB)).collect();
    let mut renderer = StageRenderer::new(stage)?;
    let mut rows = Vec::new();
    for (index, frame) in frames.iter().filter_map(|&index| Some((index, episode.frames.get(index)?))) {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let exposure = Exposure::of(episode, index);
        for image in renderer.render_state(&frame.joint_position, frame.gripper_width, objects, &views, exposure)? {
            rows.extend(image.rgb);
        }
    }
    Ok(rows)
}
