//! Mutable simulation state: stepping, observing, saving and restoring.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Frame, ObjectState, Pose};
use mujoco_rs::wrappers::{MjData, MjModel, MjtState};

use crate::body::BodyId;
use crate::contact::{ContactReport, Finger, TouchTally, contacts};
use crate::drive::{applied_command, lerp, next_setpoint};
use crate::model::RobotIndex;
use crate::{Model, SimError};

/// State components that determine the simulation together with the future commands.
const STATE: u32 = MjtState::mjSTATE_INTEGRATION as u32;
/// Bound on positions, speeds and accelerations beyond which the simulation has diverged (the engine's own bound).
const DIVERGED: f64 = 1e10;
const CONTACTS_FULL: usize = 1;
const CONSTRAINTS_FULL: usize = 2;

/// A simulation of a [`Model`], starting with the robot at its start position and every object at its initial pose.
pub struct Sim {
    pub(crate) scene: Arc<Model>,
    pub(crate) data: MjData<Arc<MjModel>>,
    /// Bodies of the strongest stray contact in the last control interval; `None` without one.
    stray: Option<[BodyId; 2]>,
}

/// Measurements of one physics step of a robot that is driven in real time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotStep {
    /// Torques of the arm joints, N·m.
    pub torques: Vec<f64>,
    /// Index of the object pressed by both fingers; `None` without one.
    pub grasped: Option<usize>,
    /// Sum of the normal contact forces on the robot, N, in the world: the two forces of a grasp balance each other.
    pub contact_force: DVec3,
}

impl std::fmt::Debug for Sim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sim").field("time_s", &self.time_s()).finish_non_exhaustive()
    }
}

impl Sim {
    /// A simulation in the scene's initial state.
    pub fn new(scene: Arc<Model>) -> Self {
        let mut data = MjData::new(Arc::clone(&scene.model));
        // `mjcf::assemble` writes the keyframe, so it exists.
        let reset = data.reset_keyframe(0);
        debug_assert!(reset.is_ok());
        fill_delay_lines(&scene, &mut data);
        data.kinematics();
        Self { scene, data, stray: None }
    }

    /// The compiled scene that is simulated.
    pub fn scene(&self) -> &Arc<Model> {
        &self.scene
    }

    /// Simulated time, s.
    pub fn time_s(&self) -> f64 {
        self.data.time()
    }

    /// Simulates one control interval (1/60 s unless the world says otherwise).
    ///
    /// `command` = arm joint targets and gripper width.
    /// It is rounded to f32, clamped to the joint ranges and maximum joint velocities (a target too far away is
    /// approached at maximum velocity), and interpolated linearly over the interval's physics steps.
    /// The fingers move at their maximum velocity: closing the Panda's gripper from fully open takes 0.9 s.
    /// The frame holds the command as applied, the state at the *start* of the interval, and the peak torque, grip
    /// force and stray contact *during* it.
    /// - `joint_torque`: motor torque including gravity compensation; never above the published limit.
    /// - `grip_force`: sum over both fingers.
    /// - `grasped`: the object pressed by both fingers at the start; the most firmly held one if there are several.
    /// - `stray_contact_n`: normal force summed over the contact points between one robot link (fingers included) and
    ///   one other body; the maximum over pairs and physics steps.
    ///   Excluded are objects pressed by both fingers at any step of the interval, the inner side of a finger pressing
    ///   on an object in its closing direction (within 45°: the first touch of a grasp), and finger on finger.
    ///   Also excluded is the gripper on a moving link of an articulated object.
    ///   A fingertip on the table or on top of an object counts, and so does the outer side of a finger.
    ///
    /// # Errors
    /// For a command of the wrong length or with non-finite numbers (the state is then unchanged), and if the
    /// simulation diverges.
    pub fn control_step(&mut self, command: &[f32]) -> Result<Frame, SimError> {
        let scene = Arc::clone(&self.scene);
        let physics = scene.physics();
        let robot = scene.robot.as_ref().ok_or(SimError::NoRobot)?;
        let drives = scene.settings.drives.as_ref().ok_or(SimError::NoRobot)?;
        let period_s = physics.control_period_s();
        let start: Vec<f64> = self.data.ctrl().to_vec();
        let previous: Vec<f64> = robot.position_ctrl.iter().map(|&index| start[index]).collect();
        let applied = applied_command(command, &previous, &robot.model, period_s)?;
        let (targets, width) = applied.split_at(robot.model.arm_dof());
        let targets: Vec<f64> = targets.iter().copied().map(f64::from).collect();
        let width = width.iter().copied().map(f64::from).sum();
        let setpoint = next_setpoint(start[robot.grip_ctrl], width, &robot.model, drives, period_s);

        let mut frame = self.observe(robot, applied);
        let mut touches = TouchTally::default();
        for substep in 1..=physics.substeps() {
            let t = f64::from(substep) / f64::from(physics.substeps());
            let ctrl = self.data.ctrl_mut();
            for (joint, (&from, &to)) in previous.iter().zip(&targets).enumerate() {
                ctrl[robot.position_ctrl[joint]] = lerp(from, to, t);
                ctrl[robot.velocity_ctrl[joint]] = (to - from) / period_s;
            }
            ctrl[robot.grip_ctrl] = lerp(start[robot.grip_ctrl], setpoint, t);
            self.step_with(|scene, data| {
                touches.add(fingers(robot, data), robot.model.hand, contacts(scene, data));
                let torque = data.qfrc_actuator();
                for (largest, &dof) in frame.joint_torque.iter_mut().zip(&robot.arm_dof) {
                    *largest = largest.max(torque[dof].abs());
                }
                // The drive acts on a tendon, whose force is applied to each of the two fingers in full.
                frame.grip_force = frame.grip_force.max(2.0 * data.actuator_force()[robot.grip_ctrl].abs());
            })?;
        }
        self.data.kinematics();
        frame.grasped = touches.grasped();
        let (force, bodies) = touches.stray().unzip();
        frame.stray_contact_n = force.unwrap_or(0.0);
        self.stray = bodies;
        Ok(frame)
    }

    /// Bodies of the last control step's `stray_contact_n`, the robot link first; `None` without stray contact.
    pub fn stray_bodies(&self) -> Option<[BodyId; 2]> {
        self.stray
    }

    /// Simulates physics steps with the drives holding their last targets.
    ///
    /// # Errors
    /// If the simulation diverges.
    pub fn advance(&mut self, physics_steps: u32) -> Result<(), SimError> {
        for _ in 0..physics_steps {
            self.step_with(|_, _| ())?;
        }
        self.data.kinematics();
        Ok(())
    }

    /// Simulates one physics step with the arm's set points at its end (rad) and their mean velocities (rad/s), base to
    /// tip, not limited by the joints' ranges and speeds; `external_torque` (N·m) acts on the joints beside the drives.
    ///
    /// # Errors
    /// For lists of another length than the arm's, and if the simulation diverges.
    pub fn drive_step(
        &mut self,
        positions: &[f64],
        velocities: &[f64],
        external_torque: &[f64],
    ) -> Result<(), SimError> {
        let scene = Arc::clone(&self.scene);
        let robot = scene.robot.as_ref().ok_or(SimError::NoRobot)?;
        let expected = robot.arm_dof.len();
        if let Some(list) = [positions, velocities, external_torque].into_iter().find(|list| list.len() != expected) {
            return Err(SimError::CommandLength { expected, got: list.len() });
        }
        for joint in 0..expected {
            let ctrl = self.data.ctrl_mut();
            ctrl[robot.position_ctrl[joint]] = positions[joint];
            ctrl[robot.velocity_ctrl[joint]] = velocities[joint];
            self.data.qfrc_applied_mut()[robot.arm_dof[joint]] = external_torque[joint];
        }
        self.step_with(|_, _| ())
    }

    /// Simulates one physics step of a robot that is driven in real time: as [`Sim::drive_step`], with the fingers on
    /// their way to an opening width, m.
    ///
    /// # Errors
    /// As [`Sim::drive_step`].
    pub fn robot_step(&mut self, positions: &[f64], velocities: &[f64], width_m: f64) -> Result<RobotStep, SimError> {
        let scene = Arc::clone(&self.scene);
        let robot = scene.robot.as_ref().ok_or(SimError::NoRobot)?;
        let drives = scene.settings.drives.as_ref().ok_or(SimError::NoRobot)?;
        let expected = robot.arm_dof.len();
        if let Some(list) = [positions, velocities].into_iter().find(|list| list.len() != expected) {
            return Err(SimError::CommandLength { expected, got: list.len() });
        }
        let current = self.data.ctrl()[robot.grip_ctrl];
        let ctrl = self.data.ctrl_mut();
        ctrl[robot.grip_ctrl] = next_setpoint(current, width_m, &robot.model, drives, scene.physics().timestep_s());
        for joint in 0..expected {
            ctrl[robot.position_ctrl[joint]] = positions[joint];
            ctrl[robot.velocity_ctrl[joint]] = velocities[joint];
        }
        let mut touches = TouchTally::default();
        let (mut torques, mut contact_force) = (Vec::new(), DVec3::ZERO);
        self.step_with(|scene, data| {
            let felt = |contact: &ContactReport| contact_force += contact.force_on_robot().unwrap_or_default();
            touches.add(fingers(robot, data), robot.model.hand, contacts(scene, data).inspect(felt));
            torques = robot.arm_dof.iter().map(|&dof| data.qfrc_actuator()[dof]).collect();
        })?;
        Ok(RobotStep { torques, grasped: touches.grasped(), contact_force })
    }

    /// Runs the engine's own step function without checks, for timing comparisons.
    pub fn advance_bare(&mut self, physics_steps: u32) {
        for _ in 0..physics_steps {
            self.data.step();
        }
    }

    /// Poses and speeds of the objects in scene order; the speed is that of the object's origin.
    pub fn object_states(&self) -> Vec<ObjectState> {
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        let norm = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>().sqrt();
        self.scene
            .objects
            .iter()
            .map(|object| ObjectState {
                pose: free_pose(&qpos[object.root_qpos..]),
                joint_positions: object.joint_qpos.iter().map(|&address| qpos[address]).collect(),
                speed: norm(&qvel[object.root_dof..object.root_dof + 3]),
                angular_speed: norm(&qvel[object.root_dof + 3..object.root_dof + 6]),
            })
            .collect()
    }

    /// Simulated `world_from_link` of each robot link, including each finger; empty without a robot.
    pub fn link_poses(&self) -> Vec<Pose> {
        let robot = self.scene.robot.as_ref();
        robot.iter().flat_map(|robot| robot.link_bodies.iter().map(|&body| self.body_pose(body))).collect()
    }

    /// All contacts of the current state.
    pub fn contacts(&mut self) -> Vec<ContactReport> {
        self.evaluate(|scene, data| contacts(scene, data).collect())
    }

    /// Largest penetration depth, m; 0 if nothing overlaps.
    pub fn penetration(&mut self) -> f64 {
        self.evaluate(|_, data| data.contact().iter().map(|contact| -contact.dist).fold(0.0, f64::max))
    }

    /// The complete state, which with the future commands determines the simulation bit-exactly.
    pub fn state(&self) -> Vec<f64> {
        self.data.state(STATE).into_vec()
    }

    /// Restores a state of this scene.
    ///
    /// # Errors
    /// For a state of another length or with non-finite numbers.
    pub fn set_state(&mut self, state: &[f64]) -> Result<(), SimError> {
        let expected = self.scene.model.state_size(STATE);
        if state.len() != expected {
            return Err(SimError::StateLength { expected, got: state.len() });
        }
        if !state.iter().all(|value| value.is_finite()) {
            return Err(SimError::NotFinite("the saved state".into()));
        }
        self.data.set_state(state, STATE).map_err(|_| SimError::StateLength { expected, got: state.len() })?;
        self.data.kinematics();
        Ok(())
    }

    /// Arm joint positions, rad, base to tip; empty without a robot.
    pub fn joint_positions(&self) -> Vec<f64> {
        let robot = self.scene.robot.iter();
        robot.flat_map(|robot| robot.arm_qpos.iter().map(|&address| self.data.qpos()[address])).collect()
    }

    /// Arm joint velocities, rad/s, base to tip; empty without a robot.
    pub fn joint_velocities(&self) -> Vec<f64> {
        let robot = self.scene.robot.iter();
        robot.flat_map(|robot| robot.arm_dof.iter().map(|&address| self.data.qvel()[address])).collect()
    }

    /// Opening width between the pads, m; 0 without a robot.
    pub fn gripper_width(&self) -> f64 {
        let robot = self.scene.robot.iter();
        robot.flat_map(|robot| robot.finger_qpos.iter().map(|&address| self.data.qpos()[address])).sum()
    }

    /// Index of the object currently pressed by both fingers, the most firmly held one if there are several; `None`
    /// without one.
    pub fn grasped(&mut self) -> Option<usize> {
        self.evaluate(|scene, data| {
            let mut touches = TouchTally::default();
            let robot = scene.robot.as_ref()?;
            touches.add(fingers(robot, data), robot.model.hand, contacts(scene, data));
            touches.grasped()
        })
    }

    fn observe(&self, robot: &RobotIndex, command: Vec<f32>) -> Frame {
        let pick = |values: &[f64], addresses: &[usize]| addresses.iter().map(|&address| values[address]).collect();
        Frame {
            time_s: self.time_s(),
            command,
            joint_position: pick(self.data.qpos(), &robot.arm_qpos),
            joint_velocity: pick(self.data.qvel(), &robot.arm_dof),
            joint_torque: vec![0.0; robot.arm_dof.len()],
            gripper_width: self.gripper_width(),
            grip_force: 0.0,
            tcp: self.body_pose(robot.link_bodies[robot.model.hand]) * robot.model.hand_from_tcp,
            objects: self.object_states(),
            grasped: None,
            stray_contact_n: 0.0,
        }
    }

    fn body_pose(&self, body: usize) -> Pose {
        Pose::from_wxyz_array(self.data.xpos()[body], self.data.xquat()[body])
    }

    /// One physics step; `inspect` sees forces and contacts before integration.
    ///
    /// Splits the engine's step function, so that divergence is an error instead of a silent reset.
    fn step_with(&mut self, inspect: impl FnOnce(&Model, &MjData<Arc<MjModel>>)) -> Result<(), SimError> {
        self.data.fwd_position();
        self.data.fwd_velocity();
        self.data.fwd_actuation();
        self.data.fwd_acceleration();
        self.data.fwd_constraint();
        self.check()?;
        inspect(&self.scene, &self.data);
        self.data.implicit();
        Ok(())
    }

    fn check(&self) -> Result<(), SimError> {
        let bounded = |values: &[f64]| values.iter().all(|value| value.abs() < DIVERGED);
        let quantities =
            [("position", self.data.qpos()), ("speed", self.data.qvel()), ("acceleration", self.data.qacc())];
        if let Some((what, _)) = quantities.iter().find(|(_, values)| !bounded(values)) {
            return Err(SimError::Unstable { time_s: self.time_s(), what: format!("a {what} diverged") });
        }
        let warnings = self.data.warning();
        if warnings[CONTACTS_FULL].number > 0 || warnings[CONSTRAINTS_FULL].number > 0 {
            return Err(SimError::ContactsDropped {
                time_s: self.time_s(),
                arena_mib: self.scene.settings.engine.arena_mib,
            });
        }
        Ok(())
    }

    /// Computes contacts and forces of the current state without changing it.
    fn evaluate<T>(&mut self, inspect: impl FnOnce(&Model, &MjData<Arc<MjModel>>) -> T) -> T {
        let state = self.data.state(STATE);
        self.data.forward();
        let result = inspect(&self.scene, &self.data);
        // The state was read from this simulation, so it has the right length.
        let restored = self.data.set_state(&state, STATE);
        debug_assert!(restored.is_ok());
        result
    }
}

/// Fills the delay lines of the arm's drives with the set points at the start; the engine fills them with zeros.
fn fill_delay_lines(scene: &Model, data: &mut MjData<Arc<MjModel>>) {
    let Some(robot) = &scene.robot else { return };
    for &drive in robot.position_ctrl.iter().chain(&robot.velocity_ctrl) {
        let [samples, _] = scene.model.actuator_history()[drive];
        if samples > 0 {
            let start = data.ctrl()[drive];
            let filled = data.init_ctrl_history(drive, None, &vec![start; samples as usize]);
            debug_assert!(filled.is_ok());
        }
    }
}

/// The fingers with their current closing directions.
fn fingers(robot: &RobotIndex, data: &MjData<Arc<MjModel>>) -> [Finger; 2] {
    let gripper = &robot.model.gripper;
    [0, 1].map(|index| Finger {
        link: gripper.fingers[index],
        // Positive joint positions open the gripper.
        closing: -DVec3::from_array(data.xaxis()[robot.finger_joints[index]]),
    })
}

fn free_pose(qpos: &[f64]) -> Pose {
    match qpos {
        [x, y, z, qw, qx, qy, qz, ..] => Pose::from_wxyz_array([*x, *y, *z], [*qw, *qx, *qy, *qz]),
        _ => Pose::from_position(DVec3::NAN),
    }
}
