//! MCAP files, read by the mcap crate and by a protocol-buffer decoder that knows only the descriptors in the file,
//! hold what the store and the LeRobot data set hold.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int64Type};
use genmanip_core::{Episode, RobotModel};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{DataError, EpisodeStore, Selection, mcap as writer};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

use crate::filled_store;
use crate::synthetic::robot;

/// Value of a field.
#[derive(Clone, Debug, PartialEq)]
enum Field {
    Number(f64),
    Bytes(Vec<u8>),
    Message(Fields),
    Numbers(Vec<f64>),
}

/// Values by field name, repeated fields included.
type Fields = BTreeMap<String, Vec<Field>>;

/// Message descriptors: field number to name, type and type name.
#[derive(Debug, Default)]
struct Schemas(BTreeMap<String, BTreeMap<u64, (String, u64, String)>>);

/// Number, wire type and bytes of every field; varints and fixed-size numbers as eight bytes.
fn raw(mut bytes: &[u8]) -> Vec<(u64, u64, Vec<u8>)> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = bytes[0];
            *bytes = &bytes[1..];
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                return value;
            }
        }
    }
    let mut fields = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes);
        let length = match key & 7 {
            0 => {
                fields.push((key >> 3, 0, varint(&mut bytes).to_le_bytes().to_vec()));
                continue;
            }
            1 => 8,
            2 => varint(&mut bytes) as usize,
            5 => 4,
            kind => panic!("kind {kind}"),
        };
        fields.push((key >> 3, key & 7, bytes[..length].to_vec()));
        bytes = &bytes[length..];
    }
    fields
}

impl Schemas {
    fn learn(&mut self, descriptors: &[u8]) {
        let text = |fields: &[(u64, u64, Vec<u8>)], number: u64| {
            let found = fields.iter().find(|(field, ..)| *field == number);
            found.map_or(String::new(), |(_, _, bytes)| String::from_utf8(bytes.clone()).unwrap())
        };
        let whole = |fields: &[(u64, u64, Vec<u8>)], number: u64| {
            let found = fields.iter().find(|(field, ..)| *field == number);
            found.map_or(0, |(_, _, bytes)| u64::from_le_bytes(bytes.clone().try_into().unwrap()))
        };
        let mut files = Vec::new();
        for (_, _, file) in raw(descriptors) {
            let file = raw(&file);
            assert_eq!(text(&file, 12), "proto3");
            let imports = file.iter().filter(|(field, ..)| *field == 3);
            for (_, _, name) in imports {
                assert!(files.contains(&String::from_utf8(name.clone()).unwrap()), "imported before it is defined");
            }
            files.push(text(&file, 1));
            for (_, _, message) in file.iter().filter(|(field, ..)| *field == 4) {
                let message = raw(message);
                let fields = message.iter().filter(|(field, ..)| *field == 2).map(|(_, _, field)| {
                    let field = raw(field);
                    (whole(&field, 3), (text(&field, 1), whole(&field, 5), text(&field, 6)))
                });
                self.0.insert(format!(".{}.{}", text(&file, 2), text(&message, 1)), fields.collect());
            }
        }
    }

    fn decode(&self, message: &str, bytes: &[u8]) -> Fields {
        let known = self.0.get(message).unwrap_or_else(|| panic!("{message} is not described"));
        let mut fields = Fields::new();
        for (number, kind, bytes) in raw(bytes) {
            let (name, code, type_name) = known.get(&number).unwrap_or_else(|| panic!("field {number} of {message}"));
            let doubles = || bytes.chunks(8).map(|number| f64::from_le_bytes(number.try_into().unwrap()));
            let value = match (code, kind) {
                (1, 1) => Field::Number(doubles().next().unwrap()),
                (1, 2) => Field::Numbers(doubles().collect()),
                (3 | 5 | 8 | 14, 0) => Field::Number(u64::from_le_bytes(bytes.try_into().unwrap()) as f64),
                (7, 5) => Field::Number(f64::from(u32::from_le_bytes(bytes.try_into().unwrap()))),
                (9 | 12, 2) => Field::Bytes(bytes),
                (11, 2) => Field::Message(self.decode(type_name, &bytes)),
                other => panic!("{name} of {message}: {other:?}"),
            };
            fields.entry(name.clone()).or_default().push(value);
        }
        fields
    }
}

fn number(fields: &Fields, name: &str) -> f64 {
    match fields.get(name).map(Vec::as_slice) {
        Some([Field::Number(number)]) => *number,
        // Zero values may be omitted.
        None => 0.0,
        other => panic!("{name}: {other:?}"),
    }
}

fn bytes<'a>(fields: &'a Fields, name: &str) -> &'a [u8] {
    match &fields[name][..] {
        [Field::Bytes(bytes)] => bytes,
        other => panic!("{name}: {other:?}"),
    }
}

fn text(fields: &Fields, name: &str) -> String {
    String::from_utf8(bytes(fields, name).to_vec()).unwrap()
}

fn messages<'a>(fields: &'a Fields, name: &str) -> Vec<&'a Fields> {
    let message = |field: &'a Field| match field {
        Field::Message(fields) => fields,
        other => panic!("{name}: {other:?}"),
    };
    fields.get(name).into_iter().flatten().map(message).collect()
}

fn vector(fields: &Fields, name: &str, entries: &[&str]) -> Vec<f64> {
    entries.iter().map(|entry| number(messages(fields, name)[0], entry)).collect()
}

/// Messages of a file by topic: time and contents.
struct Read {
    topics: BTreeMap<String, Vec<(u64, Fields)>>,
    actions: Vec<(u64, Value)>,
    facts: BTreeMap<String, String>,
}

fn read(path: &Path) -> Read {
    let file = fs::read(path).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let metadata = mcap::read::metadata(&file, &summary.metadata_indexes[0]).unwrap();
    let attached = mcap::read::attachment(&file, &summary.attachment_indexes[0]).unwrap();
    let scenario: Value = serde_json::from_slice(&attached.data).unwrap();
    assert_eq!(scenario["id"], metadata.metadata["scenario"]);
    let mut read = Read { topics: BTreeMap::new(), actions: Vec::new(), facts: metadata.metadata };
    let mut schemas: BTreeMap<String, Schemas> = BTreeMap::new();
    let mut before = 0;
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= before && message.publish_time == message.log_time);
        before = message.log_time;
        let schema = message.channel.schema.as_ref().unwrap();
        if message.channel.message_encoding == "json" {
            assert_eq!((schema.name.as_str(), schema.encoding.as_str()), ("genmanip.Action", "jsonschema"));
            read.actions.push((message.log_time, serde_json::from_slice(&message.data).unwrap()));
            continue;
        }
        assert_eq!((message.channel.message_encoding.as_str(), schema.encoding.as_str()), ("protobuf", "protobuf"));
        let known = schemas.entry(schema.name.clone()).or_insert_with(|| {
            let mut known = Schemas::default();
            known.learn(&schema.data);
            known
        });
        let fields = known.decode(&format!(".{}", schema.name), &message.data);
        for stamp in messages(&fields, "timestamp") {
            let time = number(stamp, "seconds") * 1e9 + number(stamp, "nanos");
            assert_eq!(time as u64, message.log_time, "{}", message.channel.topic);
        }
        read.topics.entry(message.channel.topic.clone()).or_default().push((message.log_time, fields));
    }
    read
}

#[test]
fn messages_agree_with_the_store_and_the_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let settings = LerobotSettings::default();
    let [v30, target] = ["v30", "mcap"].map(|name| folder.path().join(name));
    lerobot::export(&store, &Selection::Verified, &robot(), &settings, &v30).unwrap();
    let report = writer::export(&store, &Selection::Verified, &robot(), &settings.export, &target).unwrap();
    assert_eq!((report.episodes, report.frames), (3, 12 + 15 + 10));
    let again = writer::export(&store, &Selection::Verified, &robot(), &settings.export, &target).unwrap_err();
    assert!(matches!(again, DataError::Exists { .. }), "{again}");
    let about: Value = serde_json::from_slice(&fs::read(target.join("export.json")).unwrap()).unwrap();
    let table = v30.join("data/chunk-000/file-000.parquet");
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(table).unwrap()).unwrap();
    let rows = builder.with_batch_size(1000).build().unwrap().next().unwrap().unwrap();
    let column = |name: &str| rows.column_by_name(name).unwrap().clone();
    let (episodes, [states, actions]) = (
        column("episode_index").as_primitive::<Int64Type>().values().to_vec(),
        ["observation.state", "action"]
            .map(|name| column(name).as_fixed_size_list().values().as_primitive::<Float32Type>().values().to_vec()),
    );
    let names: Vec<&str> =
        about["action_contract"]["names"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect();
    for number in 0..3 {
        let entry = &about["episodes"][number];
        let read = read(&target.join(entry["file"].as_str().unwrap()));
        let episode = store.read(&read.facts["episode"]).unwrap();
        assert_eq!(read.facts["instruction"], episode.scenario.task.instruction);
        assert_eq!((read.facts["success"].as_str(), &read.facts["seed"]), ("true", &episode.result.seed.to_string()));
        assert_states(&read, &episode, &robot());
        assert_images(&read, &store, &episode);
        // Rows of the data set at the times of the messages.
        let own: Vec<usize> = (0..episodes.len()).filter(|row| episodes[*row] == number as i64).collect();
        assert_eq!(read.actions.len(), own.len());
        let joints: BTreeMap<u64, &Fields> =
            read.topics["/joints"].iter().map(|(time, fields)| (*time, fields)).collect();
        for ((time, action), row) in read.actions.iter().zip(own) {
            let sent: Vec<f32> = names.iter().map(|name| action[*name].as_f64().unwrap() as f32).collect();
            assert_eq!(sent, actions[row * 8..row * 8 + 8]);
            let state: Vec<f32> =
                messages(joints[time], "joints").iter().map(|joint| self::number(joint, "position") as f32).collect();
            assert_eq!(state, states[row * 8..row * 8 + 8]);
        }
    }
}

fn assert_states(read: &Read, episode: &Episode, robot: &RobotModel) {
    let joints = &read.topics["/joints"];
    let commands = &read.topics["/commands"];
    let tools = || {
        read.topics["/tf"].iter().filter_map(|(time, fields)| {
            let tool = messages(fields, "transforms")
                .into_iter()
                .find(|transform| text(transform, "child_frame_id") == "tool");
            tool.map(|tool| (*time, tool, messages(fields, "transforms").len()))
        })
    };
    assert_eq!(
        (joints.len(), commands.len(), tools().count()),
        (episode.frames.len(), episode.frames.len(), episode.frames.len())
    );
    for (index, (time, tool, count)) in tools().enumerate() {
        let frame = &episode.frames[index];
        assert_eq!(time, (frame.time_s * 1e9).round() as u64);
        assert_eq!(vector(tool, "translation", &["x", "y", "z"]), frame.tcp.position.to_array());
        assert_eq!(vector(tool, "rotation", &["x", "y", "z", "w"]), frame.tcp.rotation.to_array());
        assert_eq!(count, 1 + frame.objects.len(), "all objects have a frame");
        let moved = messages(&joints[index].1, "joints");
        let command = messages(&commands[index].1, "joints");
        for (joint, model) in robot.arm_joints().enumerate() {
            assert_eq!(text(moved[joint], "name"), model.name);
            let found = ["position", "velocity", "effort"].map(|name| number(moved[joint], name));
            assert_eq!(found, [frame.joint_position[joint], frame.joint_velocity[joint], frame.joint_torque[joint]]);
            assert_eq!(number(command[joint], "position") as f32, frame.command[joint]);
        }
        assert_eq!(number(moved[7], "position"), frame.gripper_width);
    }
    let events: Vec<String> = read.topics["/events"].iter().map(|(_, event)| text(event, "message")).collect();
    assert_eq!(
        (events.first(), events.last()),
        (Some(&episode.scenario.task.instruction), Some(&"success".to_owned()))
    );
    assert!(
        events.iter().any(|event| event == "grasped uid-0") && events.iter().any(|event| event == "released uid-0")
    );
}

fn assert_images(read: &Read, store: &EpisodeStore, episode: &Episode) {
    for camera in ["static", "wrist"] {
        let track = store.read_track(&episode.result.id, 15, camera).unwrap();
        let frames: Vec<&[u8]> =
            read.topics[&format!("/camera/{camera}/video")].iter().map(|(_, frame)| bytes(frame, "data")).collect();
        assert!(frames == track.video.frames, "{camera}");
        let depth: Vec<&[u8]> =
            read.topics[&format!("/camera/{camera}/depth")].iter().map(|(_, frame)| bytes(frame, "data")).collect();
        assert!(depth == track.depth_png, "{camera}");
        let calibration = &read.topics[&format!("/camera/{camera}/calibration")][0].1;
        let k = &track.camera.intrinsics;
        assert_eq!(calibration["K"], [Field::Numbers(vec![k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0])]);
        assert_eq!(
            (number(calibration, "width"), number(calibration, "height")),
            (f64::from(k.width), f64::from(k.height))
        );
        let frame = text(calibration, "frame_id");
        let poses: Vec<Vec<f64>> = read.topics["/tf"]
            .iter()
            .flat_map(|(_, fields)| messages(fields, "transforms"))
            .filter(|transform| text(transform, "child_frame_id") == frame)
            .map(|transform| vector(transform, "translation", &["x", "y", "z"]))
            .collect();
        let expected: Vec<Vec<f64>> = (0..if camera == "wrist" { frames.len() } else { 1 })
            .map(|row| track.pose_at(row).unwrap().position.to_array().to_vec())
            .collect();
        assert_eq!(poses, expected);
    }
}
