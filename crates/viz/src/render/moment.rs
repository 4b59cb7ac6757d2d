//! Moments of an episode or scenario: poses of robot and objects in one image.

use genmanip_core::geometry::OrientedBox;
use genmanip_core::{Aabb, Frame, Pose};
use genmanip_rollout::Stage;

/// Pose in the world and joint positions (rad or m) of an object.
pub(super) type Posed = (Pose, Vec<f64>);

/// Moment of an episode, or the initial state of a scenario.
pub(super) struct Moment<'a> {
    /// Index of the rendered image, from 0.
    pub(super) picture: usize,
    /// Index of the episode's control step.
    pub(super) control_step: usize,
    /// Recorded frame; `None` before the start of an episode.
    pub(super) frame: Option<&'a Frame>,
    /// Joint positions of the arm, rad.
    pub(super) arm: Vec<f64>,
    /// Opening width of the gripper, m.
    pub(super) width: f64,
    /// State of each object of the scenario, in its order.
    pub(super) objects: Vec<Posed>,
}

impl<'a> Moment<'a> {
    /// Initial state of a scenario.
    pub(super) fn start(stage: &Stage, picture: usize) -> Self {
        let objects = stage.scenario.objects.iter().map(|placed| (placed.pose, placed.joint_positions.clone()));
        Self {
            picture,
            control_step: 0,
            frame: None,
            arm: stage.scenario.world.robot.start().to_vec(),
            width: stage.robot.gripper.max_width,
            objects: objects.collect(),
        }
    }

    /// Recorded state at a control step of an episode.
    pub(super) fn recorded(frame: &'a Frame, picture: usize, control_step: usize) -> Self {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.clone()));
        Self {
            picture,
            control_step,
            frame: Some(frame),
            arm: frame.joint_position.clone(),
            width: frame.gripper_width,
            objects: objects.collect(),
        }
    }

    /// Pose and joint positions of each object, in the form that the renderer takes.
    pub(super) fn placed(&self) -> impl Iterator<Item = (Pose, &[f64])> {
        self.objects.iter().map(|(pose, joints)| (*pose, joints.as_slice()))
    }
}

/// Oriented bounding boxes of a stage's objects, aligned with each object's axes.
pub(super) struct Boxes<'a> {
    stage: &'a Stage,
    /// Bounds in the frame of each rigid object; `None` for objects with joints, whose bounds depend on the moment.
    rigid: Vec<Option<Aabb>>,
}

impl<'a> Boxes<'a> {
    pub(super) fn new(stage: &'a Stage) -> Self {
        let rigid = (0..stage.models.len()).map(|object| {
            let is_rigid = stage.models[object].joint_count() == 0;
            is_rigid.then(|| bounds(stage, object, &[]))
        });
        Self { stage, rigid: rigid.collect() }
    }

    /// Bounding box of each object at a moment, in the world frame.
    pub(super) fn at(&self, moment: &Moment) -> Vec<OrientedBox> {
        let placed = moment.objects.iter().zip(&self.rigid).enumerate();
        let of = |(object, ((pose, joints), rigid)): (usize, (&Posed, &Option<Aabb>))| {
            let bounds = rigid.unwrap_or_else(|| bounds(self.stage, object, joints));
            OrientedBox::of_bounds(pose, &bounds)
        };
        placed.map(of).collect()
    }
}

/// Bounds of an object's visuals in its frame; bounds of its collision geometry if it has no visuals.
fn bounds(stage: &Stage, object: usize, joints: &[f64]) -> Aabb {
    let model = &stage.models[object];
    let drawn = model.visual_bounds(joints);
    let is_empty = drawn.min.cmpgt(drawn.max).any();
    if is_empty { model.world_bounds(&Pose::IDENTITY, joints) } else { drawn }
}
