//! HDF5 in robomimic's layout: one file per episode, each with one demonstration.
//!
//! ```text
//! EPISODE.hdf5
//!   data                           attributes: total (rows), env_args (JSON: rate, action contract, versions)
//!   data/demo_0                    attributes: num_samples, instruction, seed, success, store_id
//!   data/demo_0/actions            the `action` column
//!   data/demo_0/rewards, dones     1 in the last row of a success; 1 in the last row
//!   data/demo_0/obs/KEY            robot0_joint_pos, robot0_joint_vel, robot0_eef_pos, robot0_eef_quat (x, y, z, w),
//!                                  robot0_gripper_qpos (opening of each finger), CAMERA_image (uint8 [N, H, W, 3])
//!   data/demo_0/columns/KEY        every other column by its name in the LeRobot data set
//!   data/demo_0/subtask            index of the step in the text list `subtasks`
//!   data/demo_0/{subtasks,paraphrases,scenario_json}
//! ```
//!
//! Images are decoded from the store's video, one chunk per image, compressed with zlib. Depth is omitted.

use std::path::Path;

use genmanip_core::glam::DQuat;
use genmanip_core::{Document, RobotModel};
use hdf5_writer::{
    AttributeBuilder, DatasetBuilder, FILTER_DEFLATE, FilterDescription, H5WriteElement, Hdf5Builder, WriteOptions,
};
use serde_json::json;

use crate::export::features::{Feature, Values};
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source, sampling};
use crate::{CameraTrack, DataError, EpisodeStore, video};

const DEMO: &str = "data/demo_0";
/// zlib level; higher levels take several times as long for a few percent.
const LEVEL: u32 = 1;
/// Maximum size of the decoded images of a camera and episode, bytes; they are held in memory all at once.
const MAX_IMAGE_BYTES: usize = 600 << 20;

/// Exports the selected episodes to a folder at `target`, which must not exist.
///
/// # Errors
/// If no episode is selected, images are missing or exceed the memory limit, the target exists, or writing fails.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &ExportSettings,
    target: &Path,
) -> Result<ExportReport, DataError> {
    let (exporter, staging) = Exporter::begin(store, selection, robot, settings, target)?;
    let about = json!({
        "env_name": "genmanip",
        "env_kwargs": {},
        "genmanip_version": env!("CARGO_PKG_VERSION"),
        "rate_hz": settings.fps,
        "action_contract": exporter.contract(),
    });
    let report = exporter.each(target, |source, rows| {
        let name = format!("{}.hdf5", rows.metadata.result.id);
        let file = File { name: &name, builder: Hdf5Builder::new() };
        staging.write(&name, &file.episode(source, &rows, settings, &about.to_string())?)
    })?;
    staging.publish()?;
    Ok(report)
}

/// HDF5 file of an episode under construction.
struct File<'a> {
    name: &'a str,
    builder: Hdf5Builder,
}

impl File<'_> {
    fn episode(
        mut self,
        source: &Source,
        rows: &EpisodeRows,
        settings: &ExportSettings,
        about: &str,
    ) -> Result<Vec<u8>, DataError> {
        let (metadata, count) = (&rows.metadata, rows.frames as u64);
        let result = &metadata.result;
        self.attribute("data", self.number("total", count)?);
        self.attribute("data", AttributeBuilder::fixed_string("env_args", about));
        self.attribute(DEMO, self.number("num_samples", count)?);
        self.attribute(DEMO, self.number("seed", result.seed.value())?);
        self.attribute(DEMO, self.number("success", u64::from(result.success))?);
        self.attribute(DEMO, AttributeBuilder::fixed_string("instruction", &metadata.instruction));
        self.attribute(DEMO, AttributeBuilder::fixed_string("store_id", &result.id));
        let last = |row: usize| row + 1 == rows.frames;
        let rewards = (0..rows.frames).map(|row| f64::from(u8::from(last(row) && result.success))).collect::<Vec<_>>();
        self.array("rewards", &[], &rewards)?;
        self.array("dones", &[], &(0..rows.frames).map(|row| i64::from(last(row))).collect::<Vec<_>>())?;
        self.array("subtask", &[], &rows.steps.iter().map(|step| *step as i64).collect::<Vec<_>>())?;
        for feature in &rows.features {
            let name = if feature.key == "action" { "actions".into() } else { format!("columns/{}", feature.key) };
            self.feature(&name, feature)?;
        }
        self.observations(source, settings)?;
        for track in &source.tracks {
            self.images(track)?;
        }
        self.texts("subtasks", &metadata.steps.texts)?;
        self.texts("paraphrases", &metadata.paraphrases)?;
        self.texts("scenario_json", &[source.episode.scenario.to_value().to_string()])?;
        let plan = self.builder.into_plan().map_err(|error| refused(self.name, &error))?;
        plan.encode(WriteOptions::default()).map_err(|error| refused(self.name, &error))
    }

    /// Writes the robot's state to `obs`, under robomimic's names.
    fn observations(&mut self, source: &Source, settings: &ExportSettings) -> Result<(), DataError> {
        let episode = &source.episode;
        let (_, stride) = sampling(episode.frames.len(), episode.result.control_rate_hz, settings.fps)?;
        let nows: Vec<_> = episode.frames.iter().step_by(stride).collect();
        let dof = nows.first().map_or(0, |now| now.joint_position.len());
        // Choose the sign of each quaternion nearest to its predecessor; the first has w >= 0.
        let mut quaternions: Vec<f64> = Vec::with_capacity(4 * nows.len());
        let mut before = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.0);
        for now in &nows {
            let rotation = now.tcp.rotation;
            before = if rotation.dot(before) < 0.0 { -rotation } else { rotation };
            quaternions.extend(before.to_array());
        }
        let positions: Vec<f64> = nows.iter().flat_map(|now| now.joint_position.clone()).collect();
        let velocities: Vec<f64> = nows.iter().flat_map(|now| now.joint_velocity.clone()).collect();
        let tool: Vec<f64> = nows.iter().flat_map(|now| now.tcp.position.to_array()).collect();
        let fingers: Vec<f64> = nows.iter().flat_map(|now| [0.5 * now.gripper_width; 2]).collect();
        self.array("obs/robot0_joint_pos", &[dof], &positions)?;
        self.array("obs/robot0_joint_vel", &[dof], &velocities)?;
        self.array("obs/robot0_eef_pos", &[3], &tool)?;
        self.array("obs/robot0_eef_quat", &[4], &quaternions)?;
        self.array("obs/robot0_gripper_qpos", &[2], &fingers)
    }

    fn images(&mut self, track: &CameraTrack) -> Result<(), DataError> {
        let (width, height) = (track.video.width as usize, track.video.height as usize);
        let bytes = track.video.frames.len().saturating_mul(width * height * 3);
        if bytes > MAX_IMAGE_BYTES {
            let what = format!("images of camera {} in {}", track.camera.name, self.name);
            let expected = format!("at most {} MiB decoded; choose a lower rate", MAX_IMAGE_BYTES >> 20);
            return Err(DataError::mismatch(what, expected, format!("{} MiB", bytes >> 20)));
        }
        let mut pixels = Vec::with_capacity(bytes);
        video::decode(&track.video, &mut |rgb| {
            pixels.extend_from_slice(rgb);
            Ok(())
        })?;
        let shape = [track.video.frames.len(), height, width, 3].map(|size| size as u64);
        let name = format!("{DEMO}/obs/{}_image", track.camera.name);
        let deflate = FilterDescription { id: FILTER_DEFLATE, name: None, client_data: vec![LEVEL] };
        let dataset = DatasetBuilder::typed::<u8>(name, shape).raw_data(pixels);
        self.add(dataset.chunked([1, shape[1], shape[2], 3]).filter(deflate));
        Ok(())
    }

    fn feature(&mut self, name: &str, feature: &Feature) -> Result<(), DataError> {
        let inner = if feature.names.is_empty() { vec![] } else { vec![feature.names.len()] };
        match &feature.values {
            Values::F32(values) => self.array(name, &inner, values),
            Values::F64(values) => self.array(name, &inner, values),
            Values::I64(values) => self.array(name, &inner, values),
            Values::Bool(values) => self.array(name, &inner, &values.iter().copied().map(u8::from).collect::<Vec<_>>()),
        }
    }

    /// Writes an array whose first axis is the row and whose other axes are `inner`.
    fn array<T: H5WriteElement>(&mut self, name: &str, inner: &[usize], values: &[T]) -> Result<(), DataError> {
        let row: usize = inner.iter().product();
        let shape: Vec<u64> = [values.len() / row.max(1)].iter().chain(inner).map(|size| *size as u64).collect();
        let dataset = DatasetBuilder::typed_data(format!("{DEMO}/{name}"), shape, values);
        self.add(dataset.map_err(|error| refused(self.name, &error))?);
        Ok(())
    }

    fn texts(&mut self, name: &str, texts: &[String]) -> Result<(), DataError> {
        let dataset = DatasetBuilder::vlen_string_data(format!("{DEMO}/{name}"), [texts.len() as u64], texts);
        self.add(dataset.map_err(|error| refused(self.name, &error))?);
        Ok(())
    }

    fn number(&self, name: &str, value: u64) -> Result<AttributeBuilder, DataError> {
        AttributeBuilder::scalar(name, value).map_err(|error| refused(self.name, &error))
    }

    fn add(&mut self, dataset: DatasetBuilder) {
        self.builder = std::mem::take(&mut self.builder).dataset(dataset);
    }

    fn attribute(&mut self, group: &str, attribute: AttributeBuilder) {
        self.builder = std::mem::take(&mut self.builder).group_attribute(group, attribute);
    }
}

fn refused(file: &str, error: &hdf5_writer::Error) -> DataError {
    DataError::mismatch(file, "numbers and texts that fit HDF5", error)
}
