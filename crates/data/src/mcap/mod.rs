//! MCAP with Foxglove's schemas, one file per episode, for viewers such as Foxglove and Rerun.
//!
//! ```text
//! EPISODE.mcap
//!   /tf                        foxglove.FrameTransforms    in `world`: tool and objects at every control step, hand cameras per image, fixed ones once
//!   /joints, /commands         foxglove.JointStates        every control step; `gripper` is the opening, m
//!   /action                    genmanip.Action, JSON       rows of the data set, keyed by the action contract's names
//!   /camera/NAME/video         foxglove.CompressedVideo    H.264, as in the store
//!   /camera/NAME/depth         foxglove.CompressedImage    16-bit PNG, millimetres, 0 = no return
//!   /camera/NAME/calibration   foxglove.CameraCalibration
//!   /scene                     foxglove.SceneUpdate        bounding boxes of the objects
//!   /events                    foxglove.Log                instruction, steps, grasps and releases, outcome
//!   metadata `genmanip`, attachment `scenario.json`
//! export.json                  rate, action contract, episodes
//! ```
//!
//! Times are simulation time, from 0.

mod schemas;
mod wire;

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use genmanip_core::{CameraMount, Document, RobotModel};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions, Writer};
use serde_json::{Value, json};

use crate::export::features::Values;
use crate::export::steps::Steps;
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source, sampling};
use crate::{DataError, EpisodeStore};
use schemas::Cube;

/// Exports the selected episodes to a folder at `target`, which must not exist.
///
/// # Errors
/// If no episode is selected, images are missing, the target exists, or writing fails.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &ExportSettings,
    target: &Path,
) -> Result<ExportReport, DataError> {
    let (exporter, staging) = Exporter::begin(store, selection, robot, settings, target)?;
    let mut episodes = Vec::new();
    let contract = exporter.contract();
    let report = exporter.each(target, |source, rows| {
        let recorded = Recording::of(source, &rows, robot, settings)?;
        let metadata = episode_metadata(&rows, settings, &contract.to_value());
        let name = format!("{}.mcap", rows.metadata.result.id);
        let bytes = recorded
            .to_bytes(&metadata, &rows.metadata.scenario_json)
            .map_err(|error| DataError::NotWritable { what: name.clone(), why: error.to_string() })?;
        staging.write(&name, &bytes)?;
        episodes.push(
            json!({"file": name, "instruction": rows.metadata.instruction, "success": rows.metadata.result.success}),
        );
        Ok(())
    })?;
    let about = json!({
        "schema": "genmanip.mcap_export/1",
        "genmanip_version": env!("CARGO_PKG_VERSION"),
        "rate_hz": settings.fps,
        "action_contract": contract,
        "episodes": episodes,
    });
    staging.write("export.json", (format!("{about:#}\n")).as_bytes())?;
    staging.publish()?;
    Ok(report)
}

/// Metadata of an episode as text, by name.
fn episode_metadata(rows: &EpisodeRows, settings: &ExportSettings, contract: &Value) -> BTreeMap<String, String> {
    let result = &rows.metadata.result;
    let mut metadata = vec![
        ("episode", result.id.clone()),
        ("scenario", result.scenario_id.clone()),
        ("task", result.task_id.clone()),
        ("kind", rows.metadata.kind.into()),
        ("instruction", rows.metadata.instruction.clone()),
        ("success", result.success.to_string()),
        ("score", result.verdict.score.to_string()),
        ("failure", result.failure().map_or_else(String::new, |failure| failure.to_string())),
        ("seed", result.seed.to_string()),
        ("policy", result.policy.clone()),
        ("engine", result.engine.clone()),
        ("genmanip_version", result.genmanip_version.clone()),
        ("control_rate_hz", result.control_rate_hz.to_string()),
        ("rate_hz", settings.fps.to_string()),
        ("action_contract", contract.to_string()),
    ];
    if let Some(correction) = &result.correction {
        metadata.push(("corrected_policy", correction.policy.clone()));
        metadata.push(("corrected_from_step", correction.from_step.to_string()));
    }
    metadata.extend(rows.metadata.variation_seed.map(|seed| ("variation_seed", seed.to_string())));
    metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Messages of one episode, with their topics.
#[derive(Default)]
struct Recording {
    topics: Vec<(String, &'static str)>,
    /// Time in ns, topic index, payload.
    messages: Vec<(u64, usize, Vec<u8>)>,
}

/// Schema of the messages on `/action`.
const ACTION: &str = "genmanip.Action";

impl Recording {
    fn of(
        source: &Source,
        rows: &EpisodeRows,
        robot: &RobotModel,
        settings: &ExportSettings,
    ) -> Result<Self, DataError> {
        let mut recording = Self::default();
        recording.states(source, robot);
        let (episode, result) = (&source.episode, &source.episode.result);
        let (_, stride) = sampling(episode.frames.len(), result.control_rate_hz, settings.fps)?;
        let times: Vec<u64> = episode.frames.iter().step_by(stride).map(|frame| nanoseconds(frame.time_s)).collect();
        recording.actions(rows, &times);
        for track in &source.tracks {
            let name = &track.camera.name;
            let frame = format!("camera_{name}");
            let calibration = recording.topic(&format!("/camera/{name}/calibration"), "foxglove.CameraCalibration");
            recording.add(0, calibration, schemas::calibration(0, &frame, &track.camera));
            let transforms = recording.topic("/tf", "foxglove.FrameTransforms");
            let video = recording.topic(&format!("/camera/{name}/video"), "foxglove.CompressedVideo");
            for (row, (time, data)) in times.iter().zip(&track.video.frames).enumerate() {
                if (row == 0 || track.camera.mount == CameraMount::Hand)
                    && let Some(pose) = track.pose_at(row)
                {
                    recording.add(*time, transforms, schemas::transforms(*time, &[(&frame, *pose)]));
                }
                recording.add(*time, video, schemas::video(*time, &frame, data));
            }
            if settings.depth {
                let depth = recording.topic(&format!("/camera/{name}/depth"), "foxglove.CompressedImage");
                for (time, data) in times.iter().zip(&track.depth_png) {
                    recording.add(*time, depth, schemas::png(*time, &frame, data));
                }
            }
        }
        recording.scene(source);
        recording.events(source);
        // Messages with equal times are ordered by topic.
        recording.messages.sort_by_key(|(time, topic, _)| (*time, *topic));
        Ok(recording)
    }

    fn topic(&mut self, name: &str, schema: &'static str) -> usize {
        self.topics.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.topics.push((name.into(), schema));
            self.topics.len() - 1
        })
    }

    fn add(&mut self, time_ns: u64, topic: usize, bytes: Vec<u8>) {
        self.messages.push((time_ns, topic, bytes));
    }

    fn states(&mut self, source: &Source, robot: &RobotModel) {
        let transforms = self.topic("/tf", "foxglove.FrameTransforms");
        let [joints, commands] = ["/joints", "/commands"].map(|name| self.topic(name, "foxglove.JointStates"));
        let names: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
        let objects = &source.episode.scenario.objects;
        for frame in &source.episode.frames {
            let time = nanoseconds(frame.time_s);
            let placed = objects.iter().zip(&frame.objects).map(|(object, state)| (object.id.as_str(), state.pose));
            let poses: Vec<_> = [("tool", frame.tcp)].into_iter().chain(placed).collect();
            self.add(time, transforms, schemas::transforms(time, &poses));
            let moved = frame.joint_position.iter().zip(frame.joint_velocity.iter().zip(&frame.joint_torque));
            let arm = names
                .iter()
                .zip(moved)
                .map(|(name, (position, (speed, effort)))| (*name, *position, Some([*speed, *effort])));
            let gripper = ("gripper", frame.gripper_width, None);
            self.add(time, joints, schemas::joints(time, arm.chain([gripper])));
            let named = names.iter().chain([&"gripper"]).zip(&frame.command);
            let commanded = named.map(|(name, target)| (*name, f64::from(*target), None));
            self.add(time, commands, schemas::joints(time, commanded));
        }
    }

    fn actions(&mut self, rows: &EpisodeRows, times: &[u64]) {
        let topic = self.topic("/action", ACTION);
        let Some(action) = rows.features.iter().find(|feature| feature.key == "action") else { return };
        let Values::F32(values) = &action.values else { return };
        for (time, row) in times.iter().zip(values.chunks(action.length())) {
            let named: serde_json::Map<String, Value> =
                action.names.iter().zip(row).map(|(name, value)| (name.clone(), json!(value))).collect();
            self.add(*time, topic, Value::Object(named).to_string().into_bytes());
        }
    }

    /// Adds boxes of the size of the objects' bounding boxes; an object's origin is at the centre of its bottom face.
    fn scene(&mut self, source: &Source) {
        let scenario = &source.episode.scenario;
        let cube = |object: &'_ genmanip_core::PlacedObject| {
            let card = scenario.task.objects.iter().find(|card| card.asset == object.asset)?;
            let size = card.size_m.to_array();
            Some((object.id.clone(), card.name.clone(), size))
        };
        let known: Vec<_> = scenario.objects.iter().filter_map(cube).collect();
        let cubes: Vec<Cube> = known
            .iter()
            .map(|(frame, name, size)| Cube {
                frame: frame.as_str(),
                name,
                center: [0.0, 0.0, 0.5 * size[2]],
                size: *size,
            })
            .collect();
        if !cubes.is_empty() {
            let topic = self.topic("/scene", "foxglove.SceneUpdate");
            self.add(0, topic, schemas::scene(0, &cubes));
        }
    }

    fn events(&mut self, source: &Source) {
        let topic = self.topic("/events", "foxglove.Log");
        let (scenario, result) = (&source.episode.scenario, &source.episode.result);
        self.add(0, topic, schemas::event(0, false, &scenario.task.instruction));
        for (begin, text) in Steps::of(&source.episode).begins() {
            let time = source.episode.frames.get(begin).map_or(0, |frame| nanoseconds(frame.time_s));
            self.add(time, topic, schemas::event(time, false, &format!("step: {text}")));
        }
        let name = |index: usize| scenario.objects.get(index).map_or("something", |object| object.id.as_str());
        let mut held = None;
        for frame in &source.episode.frames {
            if frame.grasped != held {
                let time = nanoseconds(frame.time_s);
                let message = match (held, frame.grasped) {
                    (_, Some(object)) => format!("grasped {}", name(object)),
                    (Some(object), None) => format!("released {}", name(object)),
                    (None, None) => continue,
                };
                self.add(time, topic, schemas::event(time, false, &message));
                held = frame.grasped;
            }
        }
        let end = source.episode.frames.last().map_or(0, |frame| nanoseconds(frame.time_s));
        let outcome = result.failure().map_or_else(|| "success".into(), |failure| failure.to_string());
        self.add(end, topic, schemas::event(end, !result.success, &outcome));
    }

    /// Bytes of the MCAP file.
    fn to_bytes(&self, metadata: &BTreeMap<String, String>, scenario: &str) -> mcap::McapResult<Vec<u8>> {
        let mut bytes = Cursor::new(Vec::new());
        let options = WriteOptions::new().library(format!("genmanip {}", env!("CARGO_PKG_VERSION"))).compression(None);
        let mut writer = Writer::with_options(&mut bytes, options)?;
        writer.write_metadata(&Metadata { name: "genmanip".into(), metadata: metadata.clone() })?;
        let attached = scenario.as_bytes().into();
        let (name, media_type) = ("scenario.json".to_owned(), "application/json".to_owned());
        writer.attach(&Attachment { log_time: 0, create_time: 0, name, media_type, data: attached })?;
        let mut channels = Vec::new();
        for (topic, name) in &self.topics {
            let (kind, encoding, text) = match *name {
                ACTION => ("jsonschema", "json", json!({"type": "object"}).to_string().into_bytes()),
                name => ("protobuf", "protobuf", schemas::schema(name)),
            };
            let schema = writer.add_schema(name, kind, &text)?;
            channels.push((writer.add_channel(schema, topic, encoding, &BTreeMap::new())?, 0));
        }
        for (time, topic, message) in &self.messages {
            let (channel_id, sequence) = &mut channels[*topic];
            let header =
                MessageHeader { channel_id: *channel_id, sequence: *sequence, log_time: *time, publish_time: *time };
            *sequence += 1;
            writer.write_to_known_channel(&header, message)?;
        }
        writer.finish()?;
        drop(writer);
        Ok(bytes.into_inner())
    }
}

fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}
