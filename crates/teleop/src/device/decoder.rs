//! Decoder: the state of a device after its events.

use std::collections::BTreeSet;

use genmanip_core::Pose;

use super::{AXES, Control, Device, DeviceError, DeviceEvent, ReportLayout, gamepad, keyboard, space_mouse};

/// State of a device's axes and controls in a control step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Forward, left, up, then rotations about these, -1 to 1.
    pub axes: [f64; AXES],
    /// True while the control of precision mode is held.
    pub precision: bool,
    /// True while the clutch is held, which disengages the device from the arm.
    pub clutch: bool,
    /// Controls that were pressed since the previous reading, in order.
    pub pressed: Vec<Control>,
    /// Pose of the tool that a leader arm or tracker asks for; `None` for other devices.
    pub goal: Option<Goal>,
    /// True if the gripper of that device is closed; `None` if it has none.
    pub is_closed: Option<bool>,
}

/// Pose of the tool that a device asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// Tool pose of these joint positions of the robot, rad.
    Joints(Vec<f64>),
    /// `world_from_tcp`.
    Absolute(Pose),
    /// Pose in the device's frame, whose motion since the device was engaged the tool makes too.
    Relative(Pose),
}

/// Decoder of the events of one connected device at a time.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    connected: Option<Connected>,
    axes: [f64; AXES],
    held: BTreeSet<Control>,
    pressed: Vec<Control>,
    goal: Option<Goal>,
    is_closed: Option<bool>,
}

#[derive(Clone, Debug)]
enum Connected {
    /// Report layout, axes in the device's own frame (X, Y, Z, Rx, Ry, Rz; -1 to 1), and bit mask of the held buttons.
    SpaceMouse(ReportLayout, [f64; AXES], u32),
    Gamepad,
    Keyboard(BTreeSet<String>),
    LeaderArm,
    /// True if its poses are those of the tool.
    PoseTracker(bool),
}

/// Openings (0 to 1) below which a stream's gripper counts as closed, and above which as open; between them it stays.
const GRIPPER: [f64; 2] = [0.4, 0.6];

/// Maximum number of presses kept between two readings; further ones are dropped, as no person presses that fast.
const MAX_PRESSED: usize = 16;

impl Decoder {
    /// Applies an event to the state.
    ///
    /// # Errors
    /// If the event does not fit the connected device; nothing changes then.
    pub fn apply(&mut self, event: &DeviceEvent) -> Result<(), DeviceError> {
        match event {
            DeviceEvent::Connected { device } => {
                let connected = match device {
                    Device::SpaceMouse { descriptor, .. } => {
                        Connected::SpaceMouse(ReportLayout::parse(descriptor)?, [0.0; AXES], 0)
                    }
                    Device::Gamepad { .. } => Connected::Gamepad,
                    Device::Keyboard => Connected::Keyboard(BTreeSet::new()),
                    Device::LeaderArm { .. } => Connected::LeaderArm,
                    Device::PoseTracker { is_absolute, .. } => Connected::PoseTracker(*is_absolute),
                };
                *self = Self { connected: Some(connected), ..Self::default() };
            }
            DeviceEvent::Report { bytes } => {
                let Some(Connected::SpaceMouse(layout, axes, buttons)) = &mut self.connected else {
                    return Err(self.other("space_mouse"));
                };
                layout.apply(bytes, axes, buttons)?;
                let (axes, buttons) = (space_mouse::axes(*axes), *buttons);
                self.axes = axes;
                self.hold(held(buttons, space_mouse::BUTTONS));
            }
            DeviceEvent::Gamepad { axes, buttons } => {
                if !matches!(self.connected, Some(Connected::Gamepad)) {
                    return Err(self.other("gamepad"));
                }
                let (axes, buttons) = gamepad::read(axes, buttons)?;
                self.axes = axes;
                self.hold(held(buttons, gamepad::BUTTONS));
            }
            DeviceEvent::Joints { position_rad, gripper, clutch } => {
                if !matches!(self.connected, Some(Connected::LeaderArm)) {
                    return Err(self.other("leader_arm"));
                }
                if position_rad.iter().chain(gripper).any(|value| !value.is_finite()) {
                    return Err(DeviceError::Stream);
                }
                self.stream(Goal::Joints(position_rad.clone()), *gripper, *clutch);
            }
            DeviceEvent::Pose { position_m, orientation_wxyz, gripper, clutch } => {
                let Some(Connected::PoseTracker(is_absolute)) = self.connected else {
                    return Err(self.other("pose_tracker"));
                };
                let length = orientation_wxyz.iter().map(|part| part * part).sum::<f64>().sqrt();
                if position_m.iter().chain(gripper).any(|value| !value.is_finite()) || (length - 1.0).abs() > 1e-3 {
                    return Err(DeviceError::Stream);
                }
                let pose = Pose::from_wxyz_array(*position_m, orientation_wxyz.map(|part| part / length));
                let goal = if is_absolute { Goal::Absolute(pose) } else { Goal::Relative(pose) };
                self.stream(goal, *gripper, *clutch);
            }
            DeviceEvent::Key { code, down } => {
                let Some(Connected::Keyboard(keys)) = &mut self.connected else {
                    return Err(self.other("keyboard"));
                };
                match down {
                    true if keyboard::is_known(code) && keys.len() < keyboard::MAX_HELD => {
                        keys.insert(code.clone());
                    }
                    true => {}
                    false => {
                        keys.remove(code);
                    }
                }
                let keys = keys.clone();
                self.axes = [0.0; AXES];
                for (key, axis, direction) in keyboard::AXIS_KEYS {
                    self.axes[*axis] += if keys.contains(*key) { *direction } else { 0.0 };
                }
                let functions = keyboard::CONTROL_KEYS.iter().filter(|(key, _)| keys.contains(*key));
                self.hold(functions.map(|(_, control)| *control).collect());
            }
            DeviceEvent::Pressed { control } => {
                if self.pressed.len() < MAX_PRESSED {
                    self.pressed.push(*control);
                }
            }
            DeviceEvent::Alive | DeviceEvent::Silent => {}
            DeviceEvent::Blurred => self.release_keys(),
            DeviceEvent::Disconnected => *self = Self::default(),
        }
        Ok(())
    }

    /// Present state of axes and held controls, with the presses since the last reading, which are cleared.
    pub fn reading(&mut self) -> Reading {
        Reading {
            axes: self.axes,
            precision: self.held.contains(&Control::Precision),
            clutch: self.held.contains(&Control::Clutch),
            pressed: std::mem::take(&mut self.pressed),
            goal: self.goal.clone(),
            is_closed: self.is_closed,
        }
    }

    /// Takes the state of a leader arm or tracker.
    fn stream(&mut self, goal: Goal, gripper: Option<f64>, clutch: bool) {
        self.goal = Some(goal);
        let [closed, open] = GRIPPER;
        self.is_closed = match gripper {
            Some(opening) if opening < closed => Some(true),
            Some(opening) if opening > open => Some(false),
            Some(_) => self.is_closed,
            None => None,
        };
        self.hold(clutch.then_some(Control::Clutch).into_iter().collect());
    }

    /// Counts all keys of a keyboard as released; other devices report their whole state with every event.
    pub fn release_keys(&mut self) {
        if let Some(Connected::Keyboard(keys)) = &mut self.connected {
            keys.clear();
            self.axes = [0.0; AXES];
            self.held.clear();
        }
    }

    /// True if an event shows that the device is still connected. [`DeviceEvent::Alive`] counts for keyboards only,
    /// since other devices report for as long as they are deflected.
    pub fn is_alive_after(&self, event: &DeviceEvent) -> bool {
        match event {
            DeviceEvent::Alive => matches!(self.connected, Some(Connected::Keyboard(_))),
            DeviceEvent::Pressed { .. } | DeviceEvent::Silent => false,
            _ => true,
        }
    }

    /// Replaces the held controls; those that were not held count as pressed.
    fn hold(&mut self, held: BTreeSet<Control>) {
        let room = MAX_PRESSED.saturating_sub(self.pressed.len());
        self.pressed.extend(held.difference(&self.held).take(room));
        self.held = held;
    }

    fn other(&self, got: &'static str) -> DeviceError {
        let expected = match &self.connected {
            None => "none",
            Some(Connected::SpaceMouse(..)) => "space_mouse",
            Some(Connected::Gamepad) => "gamepad",
            Some(Connected::Keyboard(_)) => "keyboard",
            Some(Connected::LeaderArm) => "leader_arm",
            Some(Connected::PoseTracker(_)) => "pose_tracker",
        };
        DeviceError::OtherDevice { expected, got }
    }
}

fn held(buttons: u32, functions: &[(u32, Control)]) -> BTreeSet<Control> {
    functions.iter().filter(|(bit, _)| (buttons >> bit) & 1 == 1).map(|(_, control)| *control).collect()
}
