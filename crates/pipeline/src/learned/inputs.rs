//! Inputs of learned policies: state of the robot, and either simulator states of objects or images and the
//! instruction.

use std::sync::Arc;

use genmanip_core::{CameraRequest, ImageChannels, ObjectModel, ObjectState, RobotModel, RotationEncoding, Scenario};
use genmanip_policy::{ImageInput, Inputs, Preset};

/// Number of object slots, filled with the objects of the goal, then with others in the order of the scenario.
const SLOTS: usize = 6;
const ROBOT: [&str; 10] = [
    "tcp_x",
    "tcp_y",
    "tcp_z",
    "tcp_x_axis_x",
    "tcp_x_axis_y",
    "tcp_x_axis_z",
    "tcp_y_axis_x",
    "tcp_y_axis_y",
    "tcp_y_axis_z",
    "gripper_width",
];
/// Inputs of an object slot. The roles are those in the goal's first alternative; `order` is the index of the
/// condition.
const OBJECT: [&str; 23] = [
    "present",
    "is_subject",
    "is_reference",
    "is_second_reference",
    "order",
    "x",
    "y",
    "z",
    "x_axis_x",
    "x_axis_y",
    "x_axis_z",
    "y_axis_x",
    "y_axis_y",
    "y_axis_z",
    "from_tcp_x",
    "from_tcp_y",
    "from_tcp_z",
    "size_x",
    "size_y",
    "size_z",
    "joint_0",
    "joint_1",
    "is_held",
];

/// Width and height of images, pixels; the same aspect ratio as the cameras' own images.
const IMAGE: (usize, usize) = (128, 72);
/// Number of hash buckets for the words of the instruction.
const WORDS: usize = 256;

/// Layout of the inputs of a preset.
pub(crate) fn layout(preset: Preset) -> Inputs {
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    let robot = names(&ROBOT);
    match preset {
        Preset::State => Inputs { robot, object: names(&OBJECT), slots: SLOTS, ..Inputs::default() },
        Preset::Tiny | Preset::Act => {
            let image = |camera: &str| ImageInput { camera: camera.into(), width: IMAGE.0, height: IMAGE.1 };
            Inputs { robot, images: ["static", "wrist"].map(image).into(), words: WORDS, ..Inputs::default() }
        }
    }
}

/// Camera requests for the images of the inputs.
pub(crate) fn cameras(images: &[ImageInput]) -> Vec<CameraRequest> {
    let request = |image: &ImageInput| {
        CameraRequest::new(&image.camera, ImageChannels::RGB).sized(image.width as u32, image.height as u32)
    };
    images.iter().map(request).collect()
}

/// State of robot and objects at one time.
#[derive(Clone, Copy)]
pub(crate) struct Moment<'a> {
    /// Arm joint positions, rad.
    pub arm: &'a [f64],
    /// Gripper opening, m.
    pub width_m: f64,
    /// States of the objects in the order of the scenario; empty for inputs without objects.
    pub objects: &'a [ObjectState],
    /// Index of the grasped object; `None` if there is none.
    pub held: Option<usize>,
}

/// Encoder of the states in one scenario as numeric inputs.
pub(crate) struct Observer {
    robot: Arc<RobotModel>,
    /// Number of values of an encoded state.
    width: usize,
    slots: Vec<Slot>,
}

/// Constants of the object in a slot during an episode.
struct Slot {
    object: usize,
    roles: [f32; 3],
    order: f32,
    size_m: [f32; 3],
}

/// Sum of squared distances between corresponding objects of the goal in two encoded states, m²; infinite if their
/// roles differ.
pub(crate) fn goal_distance(inputs: &Inputs, one: &[f32], other: &[f32]) -> f32 {
    let place = |name: &str| inputs.object.iter().position(|it| it == name).unwrap_or_default();
    let roles = ["is_subject", "is_reference", "is_second_reference", "order"].map(place);
    let position = ["x", "y", "z"].map(place);
    let objects = |row: &[f32]| -> Vec<Vec<f32>> {
        row[inputs.robot.len()..].chunks_exact(inputs.object.len()).map(<[f32]>::to_vec).collect()
    };
    let pairs = objects(one).into_iter().zip(objects(other));
    pairs
        .map(|(one, other)| {
            if roles.iter().any(|at| one[*at] != other[*at]) {
                return f32::INFINITY;
            }
            let is_in_goal = roles[..3].iter().any(|at| one[*at] > 0.0);
            let squares = position.iter().map(|at| (one[*at] - other[*at]).powi(2));
            if is_in_goal { squares.sum() } else { 0.0 }
        })
        .sum()
}

impl Observer {
    /// Encoder for inputs without objects.
    pub fn of_robot(inputs: &Inputs, robot: &Arc<RobotModel>) -> Self {
        Self { robot: Arc::clone(robot), width: inputs.width(), slots: Vec::new() }
    }

    /// Encoder for a scenario and the models of its objects.
    ///
    /// # Errors
    /// If the goal involves more objects than there are slots.
    pub fn new(
        inputs: &Inputs,
        scenario: &Scenario,
        models: &[Arc<ObjectModel>],
        robot: &Arc<RobotModel>,
    ) -> Result<Self, String> {
        if inputs.slots == 0 {
            return Ok(Self::of_robot(inputs, robot));
        }
        let mut slots: Vec<Slot> = Vec::new();
        let slot = |object: usize, roles, order| Slot {
            object,
            roles,
            order,
            size_m: models.get(object).map_or([0.0; 3], |model| model.card.size_m.as_vec3().to_array()),
        };
        let first = scenario.task.goal.alternatives.first();
        for (order, atom) in first.into_iter().flatten().enumerate() {
            for (role, id) in atom.ids().enumerate() {
                // A reference may be a support surface, which is no object and gets no slot.
                let Some(object) = scenario.index_of(id) else { continue };
                let at = slots.iter().position(|slot| slot.object == object).unwrap_or_else(|| {
                    slots.push(slot(object, [0.0; 3], order as f32));
                    slots.len() - 1
                });
                slots[at].roles[role] = 1.0;
            }
        }
        if slots.len() > SLOTS {
            return Err(format!("the goal involves {} objects, expected at most {SLOTS}", slots.len()));
        }
        let others = (0..scenario.objects.len()).filter(|object| slots.iter().all(|slot| slot.object != *object));
        let others: Vec<Slot> = others.map(|object| slot(object, [0.0; 3], 0.0)).collect();
        slots.extend(others);
        slots.truncate(SLOTS);
        Ok(Self { robot: Arc::clone(robot), width: inputs.width(), slots })
    }

    /// Encoded state, in the order of [`layout`].
    pub fn numbers(&self, moment: Moment) -> Vec<f32> {
        let tcp = self.robot.tcp_pose(moment.arm);
        let mut row = Vec::with_capacity(self.width);
        row.extend(tcp.position.as_vec3().to_array());
        row.extend(RotationEncoding::SixD.encode(tcp.rotation).into_iter().map(|value| value as f32));
        row.push(moment.width_m as f32);
        for Slot { object, roles, order, size_m } in &self.slots {
            let Some(state) = moment.objects.get(*object) else { break };
            row.push(1.0);
            row.extend(roles);
            row.push(*order);
            row.extend(state.pose.position.as_vec3().to_array());
            row.extend(RotationEncoding::SixD.encode(state.pose.rotation).into_iter().map(|value| value as f32));
            row.extend((state.pose.position - tcp.position).as_vec3().to_array());
            row.extend(size_m);
            row.extend((0..2).map(|joint| state.joint_positions.get(joint).map_or(0.0, |angle| *angle as f32)));
            row.push(f32::from(u8::from(moment.held == Some(*object))));
        }
        row.resize(self.width, 0.0);
        row
    }
}
