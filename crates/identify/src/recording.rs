//! Recordings of an arm: commands in force, and what was measured.

use genmanip_core::glam::DVec3;
use genmanip_core::limits::Limit;
use genmanip_core::{Document, DocumentError, RobotModel};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::IdentifyError;

/// Maximum size of a file: two minutes at 1 kHz take 30 MiB.
pub const RECORDING: Limit = Limit { what: "a recording of an arm", bytes: 64 << 20 };
/// Longest recording, s; longer ones would take minutes per simulation.
const LONGEST_S: f64 = 120.0;
/// Minimum number of measured moments.
const FEWEST: usize = 30;
/// Distance by which a block must move, m.
const MOVED_M: f64 = 5e-3;
/// Minimum time at rest before the first motion, s, from which the start position is averaged.
pub const REST_S: f64 = 0.3;

/// Document `genmanip.recording/1`: one motion of an arm. Without measurements it is a motion to be executed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Name of the robot.
    pub robot: String,
    /// Kind of motion, which decides the parameters that it shows.
    pub motion: Motion,
    /// Times of the rows below, s, ascending, on one clock.
    pub time_s: Vec<f64>,
    /// Position set points of the arm joints that were sent at these times, rad; linear in between.
    pub command_rad: Vec<Vec<f64>>,
    /// Measured positions of the arm joints at these times, rad; empty for a motion to be executed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_rad: Vec<Vec<f64>>,
    /// Commanded opening widths of the gripper at these times, m; empty if it stays open.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub width_m: Vec<f64>,
    /// Payload on the hand; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
    /// Block on the table; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block: Option<Block>,
}

/// Kind of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// The arm moves freely.
    Arm,
    /// The arm moves freely with a payload of unknown mass on its hand.
    Payload,
    /// The closed gripper pushes a block over the table, stops, and the block slides on.
    Push,
    /// The gripper lifts a block and loosens its grip until the block slips.
    Slip,
    /// A block falls on the table and bounces; the arm stands still.
    Drop,
}

/// Payload that is rigidly attached to the hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Centre of mass in the frame of the hand link, m, as far as it is known: the search starts there.
    pub center_m: [f64; 3],
    /// Radius of gyration, m: its inertia is taken as that of a ball.
    pub gyration_m: f64,
}

/// Block of known size and mass, tracked by a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Extents along its own axes, m.
    pub size_m: [f64; 3],
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of its base at the start, in the robot's base frame, m; its axes are those of the base.
    pub base_m: [f64; 3],
    /// Measured positions of the centre of its base at the times of the recording, base frame, m; empty for a motion to
    /// be executed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub track_m: Vec<[f64; 3]>,
}

impl Motion {
    /// Name of the kind in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Payload => "payload",
            Self::Push => "push",
            Self::Slip => "slip",
            Self::Drop => "drop",
        }
    }
}

impl Recording {
    /// Number of moments.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// True without moments, which no checked recording is.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// True if it holds measurements; otherwise it is a motion to be executed.
    pub fn is_measured(&self) -> bool {
        match &self.block {
            Some(block) => !block.track_m.is_empty(),
            None => !self.joint_rad.is_empty(),
        }
    }

    /// Measured positions at the start, rad, averaged over the time at rest; the first command without measurements.
    pub fn start(&self) -> Vec<f64> {
        let Some(first) = self.command_rad.first() else { return Vec::new() };
        let still = self.command_rad.iter().take_while(|command| *command == first).count();
        let rows = &self.joint_rad[..still.min(self.joint_rad.len())];
        if rows.is_empty() {
            return first.clone();
        }
        let mean = |joint: usize| rows.iter().map(|row| row[joint]).sum::<f64>() / rows.len() as f64;
        (0..first.len()).map(mean).collect()
    }

    /// First command, rad.
    pub fn start_command(&self) -> Vec<f64> {
        self.command_rad.first().cloned().unwrap_or_default()
    }

    /// First moment that is compared: half a second after the first motion. Before that, the arm rests anywhere between
    /// the limits of its dry friction, which bounds parameters but measures none.
    pub fn settled(&self) -> usize {
        /// Time after which no joint remembers where it rested, s.
        const FORGET_S: f64 = 0.5;
        let moves = self.command_rad.iter().position(|row| Some(row) != self.command_rad.first()).unwrap_or_default();
        let from_s = self.time_s.get(moves).map_or(0.0, |time| time + FORGET_S);
        self.time_s.partition_point(|time| *time < from_s)
    }

    /// Moment from which a block that slipped has fallen most of the way, or the end: its landing is chaotic, and no
    /// measure of friction.
    pub fn landed(&self) -> usize {
        let Some(block) = self.block.as_ref().filter(|_| self.motion == Motion::Slip) else { return self.len() };
        let height = |row: &[f64; 3]| row[2] - block.base_m[2];
        let top = block.track_m.iter().map(height).fold(0.0, f64::max);
        let lifted = block.track_m.iter().position(|row| height(row) > 0.9 * top).unwrap_or(0);
        let fallen = block.track_m[lifted..].iter().position(|row| height(row) < 0.4 * top);
        fallen.map_or(self.len(), |after| lifted + after)
    }

    /// True if the block of a push was moved, or that of a slip fell from the grip; without that, contacts show no
    /// friction.
    pub fn is_block_moved(&self) -> bool {
        let Some(block) = self.block.as_ref().filter(|block| !block.track_m.is_empty()) else { return false };
        let track = &block.track_m;
        let height = |row: &[f64; 3]| row[2] - block.base_m[2];
        if self.motion == Motion::Slip {
            let top = track.iter().map(height).fold(0.0, f64::max);
            let lifted = track.iter().position(|row| height(row) > 0.9 * top).unwrap_or(0);
            return top > MOVED_M && track[lifted..].iter().any(|row| height(row) < 0.7 * top);
        }
        // Means over a tenth of the recording: the block is at rest before and after.
        let count = track.len().div_ceil(10);
        let mean = |rows: &[[f64; 3]], axis: usize| rows.iter().map(|row| row[axis]).sum::<f64>() / rows.len() as f64;
        let moved = |axis: usize| mean(&track[track.len() - count..], axis) - mean(&track[..count], axis);
        moved(0).hypot(moved(1)) > MOVED_M
    }

    /// Checks the recording against the robot that it names.
    ///
    /// # Errors
    /// [`IdentifyError::Recording`] for another number of joints, positions out of range, or no time at rest.
    pub fn check_robot(&self, robot: &RobotModel) -> Result<(), IdentifyError> {
        let fail = |message: String| Err(IdentifyError::Recording { message });
        if self.robot != robot.name {
            return fail(format!("it is of robot `{}`, the world's is `{}`", self.robot, robot.name));
        }
        let got = self.command_rad.first().map_or(0, Vec::len);
        if got != robot.arm_dof() {
            return fail(format!("it has {got} joints; {} has {}", robot.name, robot.arm_dof()));
        }
        for (joint, (number, limits)) in robot.arm_joints().enumerate().map(|(number, it)| (&it.name, (number, it))) {
            let slack = 0.05;
            let is_out = |row: &Vec<f64>| row[number] < limits.lower - slack || row[number] > limits.upper + slack;
            if let Some(row) = self.command_rad.iter().chain(&self.joint_rad).find(|row| is_out(row)) {
                let (low, high) = (limits.lower, limits.upper);
                return fail(format!("{joint} at {} rad; its range is {low} to {high} rad", row[number]));
            }
        }
        let moves = self.command_rad.iter().position(|row| Some(row) != self.command_rad.first());
        let rest_s = moves.map_or(f64::INFINITY, |at| self.time_s[at] - self.time_s[0]);
        if rest_s < REST_S {
            return fail(format!(
                "its commands move after {rest_s:.2} s; it must begin with at least {REST_S} s at rest under one command"
            ));
        }
        Ok(())
    }
}

impl Document for Recording {
    const SCHEMA: &'static str = "genmanip.recording/1";

    fn check(&self) -> Result<(), DocumentError> {
        let fault = |path: &str, message: String| Err(DocumentError::Invalid { path: path.into(), message });
        let count = self.time_s.len();
        if count < FEWEST {
            return fault("time_s", format!("{count} moments; expected at least {FEWEST}"));
        }
        if !self.time_s.iter().all(|time| time.is_finite()) || !self.time_s.windows(2).all(|two| two[0] < two[1]) {
            return fault("time_s", "expected ascending seconds".into());
        }
        let duration_s = self.time_s[count - 1] - self.time_s[0];
        if duration_s > LONGEST_S {
            return fault("time_s", format!("{duration_s:.0} s; expected at most {LONGEST_S} s, in seconds"));
        }
        let joints = self.command_rad.first().map_or(0, Vec::len);
        for (key, rows, is_needed) in [("command_rad", &self.command_rad, true), ("joint_rad", &self.joint_rad, false)]
        {
            if rows.len() != count && (is_needed || !rows.is_empty()) {
                return fault(key, format!("{} rows; expected one per time, {count}", rows.len()));
            }
            let is_bad = |row: &Vec<f64>| row.len() != joints || !row.iter().all(|value| value.abs() < 100.0);
            if let Some(index) = rows.iter().position(is_bad) {
                return fault(&format!("{key}[{index}]"), format!("expected {joints} finite positions, rad"));
            }
        }
        if !self.width_m.is_empty() && self.width_m.len() != count {
            return fault("width_m", format!("{} widths; expected one per time, {count}", self.width_m.len()));
        }
        if !self.width_m.iter().all(|width| (0.0..1.0).contains(width)) {
            return fault("width_m", "expected metres from 0".into());
        }
        let needs = |is_there: bool, key: &str| match is_there {
            true => Ok(()),
            false => fault(key, format!("a {} needs it", self.motion.name())),
        };
        match self.motion {
            Motion::Arm => {}
            Motion::Payload => needs(self.payload.is_some(), "payload")?,
            Motion::Drop => needs(self.block.is_some(), "block")?,
            Motion::Push | Motion::Slip => {
                needs(self.block.is_some(), "block")?;
                needs(!self.width_m.is_empty(), "width_m")?;
            }
        }
        if let Some(Payload { center_m, gyration_m }) = &self.payload
            && !(center_m.iter().all(|value| value.abs() < 2.0) && (1e-3..1.0).contains(gyration_m))
        {
            return fault("payload", "expected a centre and a radius of gyration in metres".into());
        }
        if let Some(block) = &self.block {
            if !block.size_m.iter().all(|extent| (1e-3..1.0).contains(extent)) || !(1e-3..50.0).contains(&block.mass_kg)
            {
                return fault("block", "expected extents in metres and a mass in kilograms".into());
            }
            let tracked = block.track_m.len();
            if tracked != 0 && tracked != count {
                return fault("block.track_m", format!("{tracked} positions; expected one per time, {count}"));
            }
            let is_near = |point: &[f64; 3]| DVec3::from_array(*point).length() < 10.0;
            if !block.track_m.iter().chain([&block.base_m]).all(is_near) {
                return fault("block", "expected positions in the base frame, m".into());
            }
        }
        Ok(())
    }
}
