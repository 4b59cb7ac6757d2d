//! Parameters of the simulator: names, units, typical sizes and bounds.

use genmanip_core::{ArmPhysics, Drives, RobotModel, World};

use crate::recording::{Motion, Recording};

/// Engine setting of the contacts: time constant and damping ratio.
pub(crate) const CONTACT: &str = "contact_solref";

/// One parameter; joints are counted from the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Parameter {
    /// Position gain of a joint's drive, N·m/rad.
    Kp(usize),
    /// Velocity gain of a joint's drive, N·m·s/rad.
    Kv(usize),
    /// Viscous friction of a joint, N·m·s/rad.
    Damping(usize),
    /// Dry friction of a joint, N·m.
    FrictionLoss(usize),
    /// Time from a command to its effect, s.
    Latency,
    /// Mass of the payload on the hand, kg.
    PayloadMass,
    /// Centre of mass of the payload along an axis of the hand's frame, m.
    PayloadCenter(usize),
    /// Sliding friction of the block on the table.
    TableFriction,
    /// Factor on the sliding friction of the gripper's pads.
    PadFriction,
    /// Share of its speed that the block keeps when it falls on the table.
    Restitution,
}

/// Values of all parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// Joint dynamics; every list holds one number per joint.
    pub arm: ArmPhysics,
    /// Mass of the payload, kg.
    pub payload_kg: f64,
    /// Centre of mass of the payload in the frame of the hand, m.
    pub payload_center_m: [f64; 3],
    /// Sliding friction of the block on the table.
    pub table_friction: f64,
    /// Factor on the sliding friction of the pads.
    pub pad_friction: f64,
    /// Damping ratio of the contacts, on which the restitution depends.
    pub contact_damping: f64,
    /// Restitution of the block on the table with that ratio; 0 until it is simulated.
    pub restitution: f64,
}

impl Values {
    /// Values of a world with its robot, before an identification: without friction loss, latency and payload unless
    /// the world has them.
    pub fn of(world: &World, robot: &RobotModel) -> Self {
        let drives = robot.drives.as_ref();
        let own = world.physics.arm.clone().unwrap_or_default();
        let count = robot.arm_dof();
        let gains = |given: &[f64], list: Option<&Vec<f64>>| -> Vec<f64> {
            let list = list.map_or(&[][..], Vec::as_slice);
            let gain = |joint: usize| list.get(joint).or(list.last()).copied().unwrap_or(0.0);
            if given.is_empty() { (0..count).map(gain).collect() } else { given.to_vec() }
        };
        let filled = |given: &[f64], value: f64| if given.is_empty() { vec![value; count] } else { given.to_vec() };
        Self {
            arm: ArmPhysics {
                kp: gains(&own.kp, drives.map(|it: &Drives| &it.arm_kp)),
                kv: gains(&own.kv, drives.map(|it| &it.arm_kv)),
                damping: filled(&own.damping, drives.map_or(0.0, |it| it.arm_damping)),
                friction_loss: filled(&own.friction_loss, 0.0),
                latency_s: own.latency_s,
            },
            payload_kg: 0.0,
            payload_center_m: [0.0; 3],
            table_friction: world.table().map_or(0.0, |table| table.friction),
            pad_friction: world.physics.pad_friction,
            contact_damping: contact_damping(world).unwrap_or(1.0),
            restitution: 0.0,
        }
    }

    /// The same with the centre of the payload as the first of the recordings that has one states it.
    #[must_use]
    pub fn with_center_of<'a>(self, recordings: impl IntoIterator<Item = &'a Recording>) -> Self {
        let stated = recordings.into_iter().find_map(|recording| recording.payload.as_ref());
        Self { payload_center_m: stated.map_or(self.payload_center_m, |payload| payload.center_m), ..self }
    }

    /// Value of a parameter in its own unit.
    pub fn get(&self, parameter: Parameter) -> f64 {
        match parameter {
            Parameter::Kp(joint) => self.arm.kp[joint],
            Parameter::Kv(joint) => self.arm.kv[joint],
            Parameter::Damping(joint) => self.arm.damping[joint],
            Parameter::FrictionLoss(joint) => self.arm.friction_loss[joint],
            Parameter::Latency => self.arm.latency_s,
            Parameter::PayloadMass => self.payload_kg,
            Parameter::PayloadCenter(axis) => self.payload_center_m[axis],
            Parameter::TableFriction => self.table_friction,
            Parameter::PadFriction => self.pad_friction,
            Parameter::Restitution => self.restitution,
        }
    }

    /// Sets a parameter in its own unit.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        match parameter {
            Parameter::Kp(joint) => self.arm.kp[joint] = value,
            Parameter::Kv(joint) => self.arm.kv[joint] = value,
            Parameter::Damping(joint) => self.arm.damping[joint] = value,
            Parameter::FrictionLoss(joint) => self.arm.friction_loss[joint] = value,
            Parameter::Latency => self.arm.latency_s = value,
            Parameter::PayloadMass => self.payload_kg = value,
            Parameter::PayloadCenter(axis) => self.payload_center_m[axis] = value,
            Parameter::TableFriction => self.table_friction = value,
            Parameter::PadFriction => self.pad_friction = value,
            Parameter::Restitution => self.restitution = value,
        }
    }
}

impl Parameter {
    /// Parameters of the joints and the latency, for an arm with that number of joints.
    pub fn of_arm(joints: usize) -> Vec<Self> {
        let kinds: [fn(usize) -> Self; 4] = [Self::Kp, Self::Kv, Self::Damping, Self::FrictionLoss];
        kinds.iter().flat_map(|kind| (0..joints).map(kind)).chain([Self::Latency]).collect()
    }

    /// Joint of the parameter, from the base; `None` for the others.
    pub const fn joint(self) -> Option<usize> {
        match self {
            Self::Kp(joint) | Self::Kv(joint) | Self::Damping(joint) | Self::FrictionLoss(joint) => Some(joint),
            _ => None,
        }
    }

    /// Name in results, such as `joint3.friction_loss`.
    pub fn name(self, robot: &RobotModel) -> String {
        let of_joint = |joint: usize, key: &str| {
            robot.arm_joints().nth(joint).map_or_else(|| format!("{joint}.{key}"), |it| format!("{}.{key}", it.name))
        };
        match self {
            Self::Kp(joint) => of_joint(joint, "kp"),
            Self::Kv(joint) => of_joint(joint, "kv"),
            Self::Damping(joint) => of_joint(joint, "damping"),
            Self::FrictionLoss(joint) => of_joint(joint, "friction_loss"),
            Self::Latency => "latency".into(),
            Self::PayloadMass => "payload_mass".into(),
            Self::PayloadCenter(axis) => format!("payload_center.{}", ["x", "y", "z"][axis]),
            Self::TableFriction => "table_friction".into(),
            Self::PadFriction => "pad_friction".into(),
            Self::Restitution => "restitution".into(),
        }
    }

    /// Unit of the value; empty for a pure number.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Kp(_) => "N·m/rad",
            Self::Kv(_) | Self::Damping(_) => "N·m·s/rad",
            Self::FrictionLoss(_) => "N·m",
            Self::Latency => "s",
            Self::PayloadMass => "kg",
            Self::PayloadCenter(_) => "m",
            Self::TableFriction | Self::PadFriction | Self::Restitution => "",
        }
    }

    /// True if a kind of motion can show this parameter.
    pub fn is_shown_by(self, motion: Motion) -> bool {
        match self {
            Self::TableFriction => motion == Motion::Push,
            Self::PadFriction => motion == Motion::Slip,
            Self::Restitution => motion == Motion::Drop,
            Self::PayloadMass | Self::PayloadCenter(_) => motion == Motion::Payload,
            _ => matches!(motion, Motion::Arm | Motion::Payload),
        }
    }

    /// Motion from which the parameter can be identified, as advice.
    pub fn advice(self, robot: &RobotModel) -> String {
        let joint = |number: usize| robot.arm_joints().nth(number).map_or("the joint", |it| it.name.as_str());
        match self {
            Self::Kp(number) | Self::Kv(number) => format!("accelerate {} and reverse it at speed", joint(number)),
            Self::Damping(number) => {
                format!("move {} at several speeds, up to half its maximum", joint(number))
            }
            Self::FrictionLoss(number) => format!("reverse {} several times", joint(number)),
            Self::Latency => "move any joint fast".into(),
            Self::PayloadMass => {
                "move the joints near the base up and down with the payload, not the last joint alone".into()
            }
            Self::PayloadCenter(_) => {
                "turn the wrist with the payload, so that gravity pulls along every axis of the hand".into()
            }
            Self::TableFriction => "push the block at 0.2 m/s or faster, stop, and let it slide".into(),
            Self::PadFriction => "loosen the grip until the block slips".into(),
            Self::Restitution => "drop the block flat on the table, from 10 cm or more".into(),
        }
    }

    /// Typical size: the unit of the search, and of what counts as identified.
    pub fn scale(self, nominal: &Values, robot: &RobotModel) -> f64 {
        match self {
            Self::Kp(_) | Self::Kv(_) => nominal.get(self).max(1e-6),
            // Without a value of its own, as large as a well-lubricated gear of such a drive.
            Self::Damping(joint) => nominal.arm.damping[joint].max(nominal.arm.kv[joint] / 200.0).max(1e-6),
            Self::FrictionLoss(joint) => 0.01 * robot.arm_joints().nth(joint).map_or(10.0, |it| it.max_effort),
            Self::Latency => 0.01,
            Self::PayloadMass | Self::TableFriction => 0.5,
            Self::PayloadCenter(_) => 0.05,
            Self::PadFriction => 1.0,
            Self::Restitution => 0.2,
        }
    }

    /// Smallest and largest value that the search may take, in multiples of [`Parameter::scale`].
    pub const fn bounds(self) -> [f64; 2] {
        match self {
            Self::Kp(_) | Self::Kv(_) => [0.05, 20.0],
            Self::Damping(_) | Self::FrictionLoss(_) => [0.0, 40.0],
            Self::Latency => [0.0, 100.0 * 0.4],
            Self::PayloadMass => [0.0, 40.0],
            Self::PayloadCenter(_) => [-10.0, 10.0],
            Self::TableFriction | Self::PadFriction => [0.02, 4.0],
            Self::Restitution => [0.0, 5.0],
        }
    }
}

/// Damping ratio of the contacts of a world; `None` if its engine settings have none.
pub fn contact_damping(world: &World) -> Option<f64> {
    world.physics.engine.get(CONTACT)?.get(1)?.as_f64()
}

/// Sets the damping ratio of the contacts of a world.
pub fn set_contact_damping(world: &mut World, damping: f64) {
    if let Some(ratio) = world.physics.engine.get_mut(CONTACT).and_then(|pair| pair.get_mut(1)) {
        *ratio = damping.into();
    }
}
