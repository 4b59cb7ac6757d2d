//! Every number the physics depends on, on one screen.

use serde::{Deserialize, Serialize};

use crate::SimError;

/// How physics, drives and contacts behave; stored beside every result.
///
/// The contact values hold thin and heavy objects by friction alone; they were tuned on scripted picks
/// (see `tests/sim`), starting from MuJoCo Menagerie's Panda.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimSettings {
    /// Physics steps per second; a whole multiple of the control rate. 480, so that 60, 30 and 15 Hz all divide it.
    pub physics_rate_hz: u32,
    /// Control steps per second. 60, the rate of recording.
    pub control_rate_hz: u32,
    /// Newton iterations of the contact solver, at most. 100; it stops at its tolerance, mostly after 2-4.
    pub solver_iterations: u32,
    /// Ratio of frictional to normal impedance. 30: friction is stiffer than contact; held things creep a third as fast
    /// as with 10, at the same cost.
    pub impedance_ratio: f64,
    /// Downward acceleration, m/s². 9.81.
    pub gravity: f64,
    /// Room for contacts and constraints per simulation, MiB. 16, about 1,500 contacts.
    pub arena_mib: usize,

    /// Position gains of the arm joints, base to hand, N·m/rad; the last one holds for all further joints.
    pub arm_kp: Vec<f64>,
    /// Velocity gains, N·m·s/rad, about critical for the arm's inertia; the last one holds for all further joints.
    pub arm_kv: Vec<f64>,
    /// Inertia of a motor's rotor seen at the joint, kg·m². 0.1, as in MuJoCo Menagerie.
    pub arm_armature: f64,
    /// Viscous friction of an arm joint, N·m·s/rad. 1.
    pub arm_damping: f64,

    /// Largest grip force, sum over both fingers, N. 40: of 146 test picks (8-73 mm, 12-700 g) all hold from 25 N on,
    /// with 15 N some slip 10 mm; the hand's limit is 70 N.
    pub grip_force_n: f64,
    /// Stiffness of the width drive, N per metre of opening. 5,000: full force from 5 mm of squeeze on.
    pub grip_kp: f64,
    /// How far beyond closed a commanded width of 0 aims, m. 0.01, so that thin things are held with full force.
    pub grip_overclose_m: f64,
    /// Inertia of the finger drive seen at one finger, kg. 0.3.
    pub finger_armature: f64,
    /// Viscous friction of a finger, N·s/m. 80. Times a physics step it must stay well below the inertia:
    /// the integrator adds it after the contacts are solved, and more makes the grip chatter and creep.
    pub finger_damping: f64,

    /// Friction of the pads: sliding (1), turning (m), rolling (m). 1, 0.02, 0.0001; it overrides the object's.
    pub pad_friction: [f64; 3],
    /// Time constant (s) and damping ratio of pad contacts. 0.006, 1: stiff, three physics steps.
    pub pad_solref: [f64; 2],
    /// Impedance of pad contacts: at touch, at depth, and that depth (m). 0.95, 0.99, 0.001.
    pub pad_solimp: [f64; 3],

    /// Turning (m) and rolling (m) friction of objects; sliding comes from the model. 0.005 and 0.0005:
    /// a ball of 65 mm set rolling at 0.1 m/s comes to rest within 6 cm.
    pub object_rotational_friction: [f64; 2],
    /// Time constant (s) and damping ratio of all other contacts. 0.006, 1.
    pub contact_solref: [f64; 2],
    /// Impedance of all other contacts. 0.95, 0.99, 0.001: things rest less than 0.02 mm deep.
    pub contact_solimp: [f64; 3],
    /// Impedance of the dry friction of objects' joints: at rest, at speed, and the width between, as of contacts.
    /// 0.999, 0.9999, 0.001: near 1, since dry friction as soft as a contact creeps under the weight of a lid.
    pub joint_friction_solimp: [f64; 3],
    /// Sliding friction of table and floor. 0.3; in a contact the larger coefficient of the two counts,
    /// so that the object decides.
    pub table_friction: f64,
    /// Sliding friction of the robot's hull, the pads apart. 0.3.
    pub robot_friction: f64,
}

impl Default for SimSettings {
    fn default() -> Self {
        Self {
            physics_rate_hz: 480,
            control_rate_hz: 60,
            solver_iterations: 100,
            impedance_ratio: 30.0,
            gravity: 9.81,
            arena_mib: 16,
            arm_kp: vec![4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0],
            arm_kv: vec![200.0, 200.0, 150.0, 150.0, 60.0, 60.0, 40.0],
            arm_armature: 0.1,
            arm_damping: 1.0,
            grip_force_n: 40.0,
            grip_kp: 5_000.0,
            grip_overclose_m: 0.01,
            finger_armature: 0.3,
            finger_damping: 80.0,
            pad_friction: [1.0, 0.02, 0.0001],
            pad_solref: [0.006, 1.0],
            pad_solimp: [0.95, 0.99, 0.001],
            object_rotational_friction: [0.005, 0.0005],
            contact_solref: [0.006, 1.0],
            contact_solimp: [0.95, 0.99, 0.001],
            joint_friction_solimp: [0.999, 0.9999, 0.001],
            table_friction: 0.3,
            robot_friction: 0.3,
        }
    }
}

impl SimSettings {
    /// Physics steps in one control interval.
    pub fn substeps(&self) -> u32 {
        self.physics_rate_hz / self.control_rate_hz.max(1)
    }

    /// Length of a physics step, seconds.
    pub fn timestep_s(&self) -> f64 {
        1.0 / f64::from(self.physics_rate_hz)
    }

    /// Length of a control interval, seconds.
    pub fn control_period_s(&self) -> f64 {
        1.0 / f64::from(self.control_rate_hz)
    }

    /// Checks what a typing mistake could break.
    ///
    /// # Errors
    /// [`SimError::Settings`] names the field, the expected and the given value.
    pub fn check(&self) -> Result<(), SimError> {
        let fail = |text: String| Err(SimError::Settings(text));
        if self.control_rate_hz == 0 || self.physics_rate_hz == 0 {
            return fail("`physics_rate_hz` and `control_rate_hz` must be positive".into());
        }
        if !self.physics_rate_hz.is_multiple_of(self.control_rate_hz) {
            return fail(format!(
                "`physics_rate_hz` must be a whole multiple of `control_rate_hz`, got {} and {}",
                self.physics_rate_hz, self.control_rate_hz
            ));
        }
        if self.arm_kp.is_empty() || self.arm_kv.is_empty() {
            return fail("`arm_kp` and `arm_kv` need at least one number".into());
        }
        for (name, solref) in [("pad_solref", self.pad_solref), ("contact_solref", self.contact_solref)] {
            if solref[0] < 2.0 * self.timestep_s() {
                return fail(format!(
                    "the time constant in `{name}` must be at least two physics steps ({:.5} s), got {}",
                    2.0 * self.timestep_s(),
                    solref[0]
                ));
            }
        }
        let positive = [
            ("impedance_ratio", self.impedance_ratio),
            ("grip_force_n", self.grip_force_n),
            ("grip_kp", self.grip_kp),
            ("grip_overclose_m", self.grip_overclose_m),
            ("finger_damping", self.finger_damping),
        ];
        match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((name, value)) => fail(format!("`{name}` must be positive, got {value}")),
            None => Ok(()),
        }
    }
}
