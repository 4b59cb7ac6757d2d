//! Messages of Foxglove's schemas that the MCAP export writes, with the field numbers of the published .proto files.

use genmanip_core::{Camera, Distortion, Pose};

use super::wire::{Kind, Message, Wire, descriptor};

const TIME: Kind = Kind::Message("google.protobuf.Timestamp");
const VECTOR: Kind = Kind::Message("foxglove.Vector3");

/// Field `timestamp`, the first in most messages.
const TIMESTAMP: (&str, u32, Kind, bool) = ("timestamp", 1, TIME, false);

macro_rules! message {
    ($package:literal, $name:literal, $fields:expr) => {
        Message { package: $package, name: $name, fields: $fields, values: None }
    };
}

const MESSAGES: &[Message] = &[
    message!("google.protobuf", "Timestamp", &[("seconds", 1, Kind::Int64, false), ("nanos", 2, Kind::Int32, false)]),
    message!(
        "foxglove",
        "Vector3",
        &[("x", 1, Kind::Double, false), ("y", 2, Kind::Double, false), ("z", 3, Kind::Double, false)]
    ),
    message!(
        "foxglove",
        "Quaternion",
        &[
            ("x", 1, Kind::Double, false),
            ("y", 2, Kind::Double, false),
            ("z", 3, Kind::Double, false),
            ("w", 4, Kind::Double, false)
        ]
    ),
    message!(
        "foxglove",
        "Pose",
        &[("position", 1, VECTOR, false), ("orientation", 2, Kind::Message("foxglove.Quaternion"), false)]
    ),
    message!(
        "foxglove",
        "Color",
        &[
            ("r", 1, Kind::Double, false),
            ("g", 2, Kind::Double, false),
            ("b", 3, Kind::Double, false),
            ("a", 4, Kind::Double, false)
        ]
    ),
    message!(
        "foxglove",
        "FrameTransform",
        &[
            TIMESTAMP,
            ("parent_frame_id", 2, Kind::Text, false),
            ("child_frame_id", 3, Kind::Text, false),
            ("translation", 4, VECTOR, false),
            ("rotation", 5, Kind::Message("foxglove.Quaternion"), false)
        ]
    ),
    message!("foxglove", "FrameTransforms", &[("transforms", 1, Kind::Message("foxglove.FrameTransform"), true)]),
    message!(
        "foxglove",
        "JointState",
        &[
            ("name", 1, Kind::Text, false),
            ("position", 2, Kind::Double, false),
            ("velocity", 3, Kind::Double, false),
            ("effort", 5, Kind::Double, false)
        ]
    ),
    message!("foxglove", "JointStates", &[TIMESTAMP, ("joints", 2, Kind::Message("foxglove.JointState"), true)]),
    message!(
        "foxglove",
        "CompressedVideo",
        &[
            TIMESTAMP,
            ("frame_id", 2, Kind::Text, false),
            ("data", 3, Kind::Bytes, false),
            ("format", 4, Kind::Text, false)
        ]
    ),
    message!(
        "foxglove",
        "CompressedImage",
        &[
            TIMESTAMP,
            ("data", 2, Kind::Bytes, false),
            ("format", 3, Kind::Text, false),
            ("frame_id", 4, Kind::Text, false)
        ]
    ),
    message!(
        "foxglove",
        "CameraCalibration",
        &[
            TIMESTAMP,
            ("width", 2, Kind::Fixed32, false),
            ("height", 3, Kind::Fixed32, false),
            ("distortion_model", 4, Kind::Text, false),
            ("D", 5, Kind::Double, true),
            ("K", 6, Kind::Double, true),
            ("R", 7, Kind::Double, true),
            ("P", 8, Kind::Double, true),
            ("frame_id", 9, Kind::Text, false)
        ]
    ),
    message!(
        "foxglove",
        "CubePrimitive",
        &[
            ("pose", 1, Kind::Message("foxglove.Pose"), false),
            ("size", 2, VECTOR, false),
            ("color", 3, Kind::Message("foxglove.Color"), false)
        ]
    ),
    message!("foxglove", "KeyValuePair", &[("key", 1, Kind::Text, false), ("value", 2, Kind::Text, false)]),
    message!(
        "foxglove",
        "SceneEntity",
        &[
            TIMESTAMP,
            ("frame_id", 2, Kind::Text, false),
            ("id", 3, Kind::Text, false),
            ("frame_locked", 5, Kind::Bool, false),
            ("metadata", 6, Kind::Message("foxglove.KeyValuePair"), true),
            ("cubes", 8, Kind::Message("foxglove.CubePrimitive"), true)
        ]
    ),
    message!("foxglove", "SceneUpdate", &[("entities", 2, Kind::Message("foxglove.SceneEntity"), true)]),
    Message {
        package: "foxglove",
        name: "Log",
        fields: &[
            TIMESTAMP,
            ("level", 2, Kind::Enum("foxglove.Log.Level"), false),
            ("message", 3, Kind::Text, false),
            ("name", 4, Kind::Text, false),
        ],
        values: Some(("Level", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"])),
    },
];

/// Protobuf descriptor of a message by name, for the schema record of an MCAP file.
pub fn schema(name: &str) -> Vec<u8> {
    descriptor(name, MESSAGES)
}

fn time(time_ns: u64) -> Wire {
    Wire::default().number(1, time_ns / 1_000_000_000).number(2, time_ns % 1_000_000_000)
}

fn stamped(time_ns: u64) -> Wire {
    Wire::default().message(1, time(time_ns))
}

fn vector([x, y, z]: [f64; 3]) -> Wire {
    Wire::default().double(1, x).double(2, y).double(3, z)
}

fn rotation(pose: &Pose) -> Wire {
    let [x, y, z, w] = pose.rotation.to_array();
    vector([x, y, z]).double(4, w)
}

/// Message of the poses of named frames in the world frame.
pub fn transforms(time_ns: u64, world_from: &[(&str, Pose)]) -> Vec<u8> {
    let mut transforms = Wire::default();
    for (child, pose) in world_from {
        let transform = stamped(time_ns).text(2, "world").text(3, child);
        let transform = transform.message(4, vector(pose.position.to_array())).message(5, rotation(pose));
        transforms = transforms.message(1, transform);
    }
    transforms.into_bytes()
}

/// Name and position (rad or m) of a joint; speed and effort, if known.
pub type Joint<'a> = (&'a str, f64, Option<[f64; 2]>);

pub fn joints<'a>(time_ns: u64, joints: impl Iterator<Item = Joint<'a>>) -> Vec<u8> {
    let mut states = stamped(time_ns);
    for (name, position, rest) in joints {
        let joint = Wire::default().text(1, name).double(2, position);
        let joint = rest.map_or(joint.clone(), |[speed, effort]| joint.double(3, speed).double(5, effort));
        states = states.message(2, joint);
    }
    states.into_bytes()
}

/// Message with an H.264 access unit seen from a camera frame.
pub fn video(time_ns: u64, frame: &str, data: &[u8]) -> Vec<u8> {
    stamped(time_ns).text(2, frame).bytes(3, data).text(4, "h264").into_bytes()
}

/// Message with a PNG image seen from a camera frame.
pub fn png(time_ns: u64, frame: &str, data: &[u8]) -> Vec<u8> {
    stamped(time_ns).bytes(2, data).text(3, "png").text(4, frame).into_bytes()
}

pub fn calibration(time_ns: u64, frame: &str, camera: &Camera) -> Vec<u8> {
    let k = &camera.intrinsics;
    let sized = stamped(time_ns).fixed32(2, k.width).fixed32(3, k.height);
    let distorted = match camera.distortion {
        None => sized,
        Some(Distortion { k1, k2, p1, p2, k3 }) => sized.text(4, "plumb_bob").doubles(5, &[k1, k2, p1, p2, k3]),
    };
    distorted
        .doubles(6, &[k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0])
        .doubles(7, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .doubles(8, &[k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0])
        .text(9, frame)
        .into_bytes()
}

/// Box fixed to a frame, as a stand-in for an object.
pub struct Cube<'a> {
    /// Name of the frame and of the entity.
    pub frame: &'a str,
    /// Name of the object it represents.
    pub name: &'a str,
    pub center: [f64; 3],
    pub size: [f64; 3],
}

pub fn scene(time_ns: u64, cubes: &[Cube]) -> Vec<u8> {
    let mut update = Wire::default();
    for cube in cubes {
        let pose = Wire::default().message(1, vector(cube.center)).message(2, rotation(&Pose::default()));
        // Half-transparent grey: the true appearance is in the images.
        let color = vector([0.6, 0.6, 0.6]).double(4, 0.5);
        let primitive = Wire::default().message(1, pose).message(2, vector(cube.size)).message(3, color);
        let name = Wire::default().text(1, "name").text(2, cube.name);
        let entity = stamped(time_ns).text(2, cube.frame).text(3, cube.frame).flag(5, true);
        update = update.message(2, entity.message(6, name).message(8, primitive));
    }
    update.into_bytes()
}

/// Message of a log entry.
pub fn event(time_ns: u64, is_warning: bool, text: &str) -> Vec<u8> {
    stamped(time_ns).number(2, if is_warning { 3 } else { 2 }).text(3, text).text(4, "genmanip").into_bytes()
}
