//! Simulation of a recording's commands with given parameters.

use std::sync::Arc;

use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{ArmPhysics, MassProperties, RobotModel, World};
use genmanip_sim::{Model, Sim, SimError};

use crate::block::scene_object;
use crate::parameters::{Values, set_contact_damping};
use crate::recording::{Payload, Recording};
use crate::set_points::SetPoints;

/// Simulated states at the times of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Positions of the arm joints, rad.
    pub joints: Vec<Vec<f64>>,
    /// Positions of the centre of the block's base, base frame, m; empty without a block.
    pub block: Vec<DVec3>,
}

/// Robot without collision geometry, apart from hand and fingers if `with_hand`. Free motions touch nothing, and such
/// a model compiles and runs several times as fast.
pub fn bare(robot: &RobotModel, with_hand: bool) -> RobotModel {
    let mut bare = robot.clone();
    for (index, link) in bare.links.iter_mut().enumerate() {
        let is_hand = index == robot.hand || robot.gripper.fingers.contains(&index);
        if !(with_hand && is_hand) {
            link.pieces.clear();
        }
        link.visual.clear();
    }
    bare
}

/// Model of a recording with given parameters; `robot` may be [`bare`]. The arm's latency is that of the values.
pub fn compile(recording: &Recording, world: &World, robot: &RobotModel, values: &Values) -> Result<Model, SimError> {
    let mut world = world.clone();
    world.robot.start = Some(recording.start());
    world.physics.arm = Some(values.arm.clone());
    world.physics.pad_friction = values.pad_friction;
    set_contact_damping(&mut world, values.contact_damping);
    if let Some(table) = world.surfaces.first_mut() {
        table.friction = values.table_friction;
    }
    match (&recording.block, &recording.payload) {
        // The larger friction of two bodies counts: that of the table, which is identified.
        (Some(block), _) => Model::compile(&world, robot, &[scene_object(block, 0.01)]),
        (None, Some(payload)) if values.payload_kg > 0.0 => {
            Model::compile_with_payload(&world, robot, &mass(payload, values))
        }
        _ => Model::compile(&world, robot, &[]),
    }
}

fn mass(payload: &Payload, values: &Values) -> MassProperties {
    let mass_kg = values.payload_kg;
    let moment = mass_kg * payload.gyration_m * payload.gyration_m;
    MassProperties {
        mass_kg,
        center: DVec3::from_array(values.payload_center_m),
        inertia: DMat3::from_diagonal(DVec3::splat(moment)),
    }
}

/// States that the simulator predicts for a recording.
///
/// # Errors
/// When the model is refused or the simulation diverges.
pub fn replay(recording: &Recording, world: &World, robot: &RobotModel, values: &Values) -> Result<Track, SimError> {
    // The latency shifts the commands, which is exact and leaves the delay lines of the engine one step long.
    let latency_s = values.arm.latency_s;
    let values = Values { arm: ArmPhysics { latency_s: 0.0, ..values.arm.clone() }, ..values.clone() };
    let mut sim = Sim::new(Arc::new(compile(recording, world, robot, &values)?));
    let commands = SetPoints::of(recording);
    let start_s = recording.time_s.first().copied().unwrap_or_default();
    let step_s = world.physics.timestep_s();
    let node = |number: f64| start_s + number * step_s;
    let velocities = |number: f64| commands.velocities(node(number), node(number + 1.0));
    let shift = latency_s / step_s;
    let mut sampler = Sampler::new(recording, &sim);
    let mut step = 0.0;
    while !sampler.is_done() {
        // Position set points take effect one step after they are given; velocity set points at once, interpolated
        // between the means over the steps.
        let positions = commands.positions(node(step + 1.0 - shift));
        let (before, share) = ((step - shift).floor(), (step - shift) - (step - shift).floor());
        let (from, to) = (velocities(before), velocities(before + 1.0));
        let speeds: Vec<f64> = from.iter().zip(&to).map(|(from, to)| from + (to - from) * share).collect();
        match commands.width_m(node(step + 1.0)) {
            Some(width_m) => drop(sim.robot_step(&positions, &speeds, width_m)?),
            None => sim.drive_step(&positions, &speeds, &vec![0.0; positions.len()])?,
        }
        step += 1.0;
        sampler.take(node(step), &sim);
    }
    Ok(sampler.track)
}

/// States at the times of a recording, interpolated between physics steps by cubic Hermite splines.
pub struct Sampler<'a> {
    times_s: &'a [f64],
    has_block: bool,
    last: Knot,
    /// States so far.
    pub track: Track,
}

struct Knot {
    time_s: f64,
    joints: Vec<f64>,
    speeds: Vec<f64>,
    block: Option<DVec3>,
}

impl<'a> Sampler<'a> {
    /// Sampler of a simulation at the first moment of the recording.
    pub fn new(recording: &'a Recording, sim: &Sim) -> Self {
        let start_s = recording.time_s.first().copied().unwrap_or_default();
        let has_block = recording.block.is_some();
        let last = Knot::of(start_s, sim, has_block);
        let mut sampler = Self { times_s: &recording.time_s, has_block, last, track: Track::default() };
        sampler.track.joints.push(sampler.last.joints.clone());
        sampler.track.block.extend(sampler.last.block);
        sampler
    }

    /// True after the last moment.
    pub fn is_done(&self) -> bool {
        self.track.joints.len() >= self.times_s.len()
    }

    /// Samples all moments up to the simulation's time.
    pub fn take(&mut self, time_s: f64, sim: &Sim) {
        let next = Knot::of(time_s, sim, self.has_block);
        while let Some(&wanted) = self.times_s.get(self.track.joints.len()).filter(|&&wanted| wanted <= time_s + 1e-12)
        {
            let (joints, block) = self.last.between(&next, wanted);
            self.track.joints.push(joints);
            self.track.block.extend(block);
        }
        self.last = next;
    }
}

impl Knot {
    fn of(time_s: f64, sim: &Sim, has_block: bool) -> Self {
        let block = has_block.then(|| sim.object_states().first().map(|state| state.pose.position)).flatten();
        Self { time_s, joints: sim.joint_positions(), speeds: sim.joint_velocities(), block }
    }

    fn between(&self, next: &Self, time_s: f64) -> (Vec<f64>, Option<DVec3>) {
        let span = next.time_s - self.time_s;
        let t = ((time_s - self.time_s) / span).clamp(0.0, 1.0);
        let (t2, t3) = (t * t, t * t * t);
        let weights = [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2];
        let joint = |index: usize| {
            weights[0] * self.joints[index]
                + weights[1] * span * self.speeds[index]
                + weights[2] * next.joints[index]
                + weights[3] * span * next.speeds[index]
        };
        let block = self.block.zip(next.block).map(|(from, to)| from.lerp(to, t));
        ((0..self.joints.len()).map(joint).collect(), block)
    }
}
