//! Mapping from a reading of a device to a twist and a gripper command.

use genmanip_core::Pose;
use genmanip_core::glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::device::{Control, Reading};

/// Settings of the mapping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MappingSettings {
    /// Share of the full deflection (0-1) that counts as none; the rest is stretched to the whole range.
    pub dead_zone: f64,
    /// Exponent of the response curve: 1 is linear, larger ones are finer near the middle.
    pub curve: f64,
    /// Speed of the tool at full deflection, m/s.
    pub linear_m_s: f64,
    /// Angular speed of the tool at full deflection, rad/s.
    pub angular_rad_s: f64,
    /// Factor on both speeds in precision mode.
    pub precision: f64,
    /// Frame at the start of an episode.
    pub frame: OperatorFrame,
}

impl Default for MappingSettings {
    fn default() -> Self {
        Self {
            // A released SpaceMouse rests within 5 % of its centre, sticks of gamepads within 10 %.
            dead_zone: 0.1,
            curve: 1.5,
            linear_m_s: 0.2,
            angular_rad_s: 0.8,
            precision: 0.25,
            frame: OperatorFrame::World,
        }
    }
}

/// Frame in which a person moves the tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OperatorFrame {
    /// World: forward is x, left is y, up is z.
    #[default]
    World,
    /// Hand: forward is z of the TCP frame (the approach direction), left is -y, and up is x, which is up in the image
    /// of a camera on the hand.
    Hand,
    /// Camera as seen: forward is the optical axis, up is the upper edge of the image.
    Camera,
}

impl OperatorFrame {
    /// All frames, in the order in which [`Control::Frame`] steps through them.
    pub const ALL: [Self; 3] = [Self::World, Self::Hand, Self::Camera];

    /// The frame after this one in [`OperatorFrame::ALL`], cyclically.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::World => Self::Hand,
            Self::Hand => Self::Camera,
            Self::Camera => Self::World,
        }
    }
}

/// Orientation of the operator's axes: forward (x), left (y) and up (z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Axes {
    /// Fixed in the world: `world_from_axes`.
    World(DQuat),
    /// Fixed to the tool: `tcp_from_axes`.
    Tool(DQuat),
}

impl Axes {
    /// Axes of the frame [`OperatorFrame::World`].
    pub const WORLD: Self = Self::World(DQuat::IDENTITY);

    /// Axes of the frame [`OperatorFrame::Hand`].
    pub fn hand() -> Self {
        Self::Tool(DQuat::from_mat3(&DMat3::from_cols(DVec3::Z, DVec3::NEG_Y, DVec3::X)))
    }

    /// Axes of a camera fixed in the world.
    pub fn world_camera(world_from_camera: &Pose) -> Self {
        Self::World(world_from_camera.rotation * as_seen())
    }

    /// Axes of a camera on the hand.
    pub fn hand_camera(tcp_from_camera: &Pose) -> Self {
        Self::Tool(tcp_from_camera.rotation * as_seen())
    }
}

/// `camera_from_axes`: the axes forward, left and up in an optical frame (x right, y down, z forward).
fn as_seen() -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y))
}

/// Velocity of the TCP along and about the axes of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Orientation of the frame.
    pub axes: Axes,
    /// Velocity in `axes`, m/s.
    pub linear_m_s: DVec3,
    /// Angular velocity in `axes`, rad/s.
    pub angular_rad_s: DVec3,
}

impl Twist {
    /// No motion.
    pub const ZERO: Self = Self { axes: Axes::WORLD, linear_m_s: DVec3::ZERO, angular_rad_s: DVec3::ZERO };

    /// True without any motion.
    pub fn is_zero(&self) -> bool {
        self.linear_m_s == DVec3::ZERO && self.angular_rad_s == DVec3::ZERO
    }
}

/// Command of the operator for one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandCommand {
    /// Motion of the tool.
    pub twist: Twist,
    /// True if the gripper is to be closed: a state, not a trigger.
    pub closed: bool,
    /// True if the episode is to end.
    pub finish: bool,
}

/// Mapping with its state: chosen frame, gripper, and the requirement to release the device first.
#[derive(Clone, Debug)]
pub struct Mapping {
    settings: MappingSettings,
    camera: Option<Axes>,
    frame: OperatorFrame,
    closed: bool,
    /// True until all axes have been in the dead zone once.
    needs_release: bool,
}

impl Mapping {
    /// A mapping with an open gripper; without `camera`, [`OperatorFrame::Camera`] is skipped.
    pub fn new(settings: MappingSettings, camera: Option<Axes>) -> Self {
        let frame = settings.frame;
        let mut mapping = Self { settings, camera, frame, closed: false, needs_release: true };
        mapping.pass_over_camera();
        mapping
    }

    /// Settings given to [`Mapping::new`].
    pub fn settings(&self) -> &MappingSettings {
        &self.settings
    }

    /// Chosen frame.
    pub fn frame(&self) -> OperatorFrame {
        self.frame
    }

    /// True until all axes have been in the dead zone at once since the start, the last release of the clutch or the
    /// last [`Mapping::require_release`].
    pub fn needs_release(&self) -> bool {
        self.needs_release
    }

    /// Requires that the device is released before it moves the tool again: after a connection, a disconnection, a long
    /// silence, or more events than a device sends.
    pub fn require_release(&mut self) {
        self.needs_release = true;
    }

    /// Sets the state of the gripper without a press, such as that of another policy before the operator took command.
    pub fn set_closed(&mut self, closed: bool) {
        self.closed = closed;
    }

    /// True if an axis is outside the dead zone.
    pub fn is_deflected(&self, reading: &Reading) -> bool {
        reading.axes.iter().any(|axis| shape(*axis, &self.settings) != 0.0)
    }

    /// Command of a reading. Presses in it toggle the gripper and change the frame, so that each reading must be passed
    /// once.
    pub fn command(&mut self, reading: &Reading) -> HandCommand {
        let mut finish = false;
        for control in &reading.pressed {
            match control {
                Control::Gripper => self.closed = !self.closed,
                Control::Frame => {
                    self.frame = self.frame.next();
                    self.pass_over_camera();
                }
                Control::Finish => finish = true,
                Control::Precision | Control::Clutch => {}
            }
        }
        let shaped = reading.axes.map(|axis| shape(axis, &self.settings));
        self.needs_release = reading.clutch || self.needs_release && shaped.iter().any(|axis| *axis != 0.0);
        let factor = if reading.precision { self.settings.precision } else { 1.0 };
        let [forward, left, up, roll, pitch, yaw] = shaped;
        let twist = match self.needs_release {
            true => Twist::ZERO,
            false => Twist {
                axes: self.axes(),
                linear_m_s: DVec3::new(forward, left, up) * (factor * self.settings.linear_m_s),
                angular_rad_s: DVec3::new(roll, pitch, yaw) * (factor * self.settings.angular_rad_s),
            },
        };
        HandCommand { twist, closed: self.closed, finish }
    }

    /// Axes of the chosen frame; those of the world if it is a camera's and none is given.
    fn axes(&self) -> Axes {
        match self.frame {
            OperatorFrame::World => Axes::WORLD,
            OperatorFrame::Hand => Axes::hand(),
            OperatorFrame::Camera => self.camera.unwrap_or(Axes::WORLD),
        }
    }

    fn pass_over_camera(&mut self) {
        if self.frame == OperatorFrame::Camera && self.camera.is_none() {
            self.frame = self.frame.next();
        }
    }
}

/// Deflection of one axis (-1 to 1) after dead zone and response curve, -1 to 1.
pub fn shape(axis: f64, settings: &MappingSettings) -> f64 {
    let beyond = (axis.abs().min(1.0) - settings.dead_zone) / (1.0 - settings.dead_zone);
    if beyond > 0.0 { beyond.powf(settings.curve).copysign(axis) } else { 0.0 }
}

/// Deflection that [`shape`] turns into `shaped`: its inverse outside the dead zone.
pub fn deflection(shaped: f64, settings: &MappingSettings) -> f64 {
    let beyond = shaped.abs().min(1.0).powf(1.0 / settings.curve);
    if beyond > 0.0 { (settings.dead_zone + beyond * (1.0 - settings.dead_zone)).copysign(shaped) } else { 0.0 }
}
