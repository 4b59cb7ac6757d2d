//! Playback of an episode: poses of all links over time.

use std::sync::Arc;

use genmanip_core::{Episode, Frame, ObjectModel, ObjectState, Pose, RobotModel};

use crate::scene::scene_message::SceneMessage;

/// Maximum number of states per second of a track, Hz.
const RATE_HZ: f64 = 30.0;
/// Maximum number of states of a track; longer episodes have fewer states per second.
pub const MAX_FRAMES: usize = 9000;
/// Number of values of a pose: position (3, m) and unit quaternion (4, w first).
const POSE: usize = 7;

/// A link whose pose is part of every state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// Link of the robot, by index.
    Robot(usize),
    /// Link of an object: index of the object, index of the link.
    Object(usize, usize),
}

/// Poses of links over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Number of states.
    pub frames: usize,
    /// Number of values of a state: time (s), opening of the gripper (m), and seven for the pose of each link.
    pub width: usize,
    /// Values of all states, one after the other.
    pub values: Vec<f32>,
}

impl Track {
    /// All values as little-endian bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }
}

/// Links of a scene in the order of its message: those of the robot, then those of the objects. The message omits links
/// without a mesh.
pub fn bodies(scene: &SceneMessage, robot: &RobotModel, models: &[Arc<ObjectModel>]) -> Vec<Body> {
    let of_robot = scene.robot.links.iter().filter_map(|shown| {
        let link = robot.links.iter().position(|link| link.name == shown.name)?;
        Some(Body::Robot(link))
    });
    let objects = scene.state.objects.iter().zip(models).enumerate();
    let of_objects = objects.flat_map(|(index, (object, model))| {
        object.links.iter().filter_map(move |shown| {
            let link = model.links.iter().position(|link| link.name == shown.name)?;
            Some(Body::Object(index, link))
        })
    });
    of_robot.chain(of_objects).collect()
}

/// Recorded states of an episode for playback: at most `RATE_HZ` per second, the last one included.
pub fn states(episode: &Episode) -> impl Iterator<Item = &Frame> {
    let count = episode.frames.len();
    let by_rate = (episode.result.control_rate_hz / RATE_HZ).round().max(1.0) as usize;
    let stride = by_rate.max(count.div_ceil(MAX_FRAMES));
    let last = (count > 0 && !(count - 1).is_multiple_of(stride)).then(|| count - 1);
    (0..count).step_by(stride).chain(last).filter_map(|index| episode.frames.get(index))
}

/// Poses of all links in the [`states`] of an episode; links in the order of `scene`, which is that of the episode's
/// scenario.
pub fn track(episode: &Episode, scene: &SceneMessage, robot: &RobotModel, models: &[Arc<ObjectModel>]) -> Track {
    let bodies = bodies(scene, robot, models);
    let rows: Vec<Vec<f32>> = states(episode)
        .map(|frame| {
            row(frame.time_s, &frame.joint_position, frame.gripper_width, &frame.objects, &bodies, robot, models)
        })
        .collect();
    Track { frames: rows.len(), width: width(&bodies), values: rows.concat() }
}

/// Number of values of a state.
pub fn width(bodies: &[Body]) -> usize {
    2 + POSE * bodies.len()
}

/// Values of one state: time (s), opening of the gripper (m), and the pose of each of `bodies`.
pub fn row(
    time_s: f64,
    joint_position: &[f64],
    gripper_width: f64,
    objects: &[ObjectState],
    bodies: &[Body],
    robot: &RobotModel,
    models: &[Arc<ObjectModel>],
) -> Vec<f32> {
    let mut values = vec![time_s as f32, gripper_width as f32];
    let of_robot = robot.link_poses(joint_position, gripper_width);
    let of_objects: Vec<Vec<Pose>> = objects
        .iter()
        .zip(models)
        .map(|(state, model)| {
            model.link_poses(&state.joint_positions).into_iter().map(|link| state.pose * link).collect()
        })
        .collect();
    for body in bodies {
        let pose = match *body {
            Body::Robot(link) => of_robot.get(link),
            Body::Object(object, link) => of_objects.get(object).and_then(|links| links.get(link)),
        };
        values.extend(pose.copied().unwrap_or_default().to_row().map(|value| value as f32));
    }
    values
}
