//! Virtual devices: deflections and controls as the events of a real device.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::device::{AXES, Control, Device, DeviceEvent, SIX_AXIS_CONTROLLER, SPACE_NAVIGATOR};

/// Kind of virtual device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VirtualKind {
    /// SpaceMouse with all axes in one report and sixteen buttons.
    SpaceMouse,
    /// SpaceNavigator: translation and rotation in reports of their own, two buttons.
    SpaceNavigator,
    /// Gamepad with the standard mapping.
    Gamepad,
    /// Keyboard.
    Keyboard,
}

impl VirtualKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::SpaceMouse, Self::SpaceNavigator, Self::Gamepad, Self::Keyboard];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::SpaceMouse => "space_mouse",
            Self::SpaceNavigator => "space_navigator",
            Self::Gamepad => "gamepad",
            Self::Keyboard => "keyboard",
        }
    }
}

/// Axis value of a SpaceMouse at full deflection, as in the report descriptors.
const FULL: f64 = 350.0;
/// Keys of the axes forward, left, up, roll, pitch and yaw: positive, negative.
const AXIS_KEYS: [[&str; 2]; AXES] = [
    ["KeyW", "KeyS"],
    ["KeyA", "KeyD"],
    ["KeyR", "KeyF"],
    ["ArrowRight", "ArrowLeft"],
    ["ArrowUp", "ArrowDown"],
    ["KeyQ", "KeyE"],
];

/// Device that exists in software only.
#[derive(Clone, Debug)]
pub struct VirtualDevice {
    kind: VirtualKind,
    /// Held keys of a keyboard, by `KeyboardEvent.code`.
    keys: BTreeSet<&'static str>,
    /// Bit mask of the held buttons of a SpaceMouse.
    buttons: u16,
}

impl VirtualDevice {
    /// A device with centred axes and nothing held.
    pub fn new(kind: VirtualKind) -> Self {
        Self { kind, keys: BTreeSet::new(), buttons: 0 }
    }

    /// Event of its connection.
    pub fn connected(&self) -> DeviceEvent {
        let space_mouse =
            |name: &str, descriptor: &[u8]| Device::SpaceMouse { name: name.into(), descriptor: descriptor.into() };
        DeviceEvent::Connected {
            device: match self.kind {
                VirtualKind::SpaceMouse => space_mouse("virtual SpaceMouse", SIX_AXIS_CONTROLLER),
                VirtualKind::SpaceNavigator => space_mouse("virtual SpaceNavigator", SPACE_NAVIGATOR),
                VirtualKind::Gamepad => Device::Gamepad { name: "virtual gamepad".into() },
                VirtualKind::Keyboard => Device::Keyboard,
            },
        }
    }

    /// Events of a control step in which the axes forward, left, up, roll, pitch and yaw are deflected by -1 to 1 and
    /// some controls are held. A keyboard holds the key of an axis that is deflected by more than 0.5.
    pub fn events(&mut self, axes: &[f64; AXES], held: &[Control]) -> Vec<DeviceEvent> {
        match self.kind {
            VirtualKind::SpaceMouse | VirtualKind::SpaceNavigator => self.reports(axes, held),
            VirtualKind::Gamepad => vec![gamepad(axes, held)],
            VirtualKind::Keyboard => self.key_events(axes, held),
        }
    }

    fn reports(&mut self, [forward, left, up, roll, pitch, yaw]: &[f64; AXES], held: &[Control]) -> Vec<DeviceEvent> {
        // The device's own axes: x to the right, y towards the person, z down.
        let own = [-left, -forward, -up, -pitch, -roll, -yaw];
        let numbers: Vec<u8> =
            own.iter().flat_map(|axis| ((axis.clamp(-1.0, 1.0) * FULL).round() as i16).to_le_bytes()).collect();
        let report = |id: u8, bytes: &[u8]| DeviceEvent::Report { bytes: [&[id], bytes].concat() };
        let mut events = match self.kind {
            VirtualKind::SpaceNavigator => vec![report(1, &numbers[..6]), report(2, &numbers[6..])],
            _ => vec![report(1, &numbers)],
        };
        let bit = |control: &Control| match control {
            Control::Gripper => 1,
            Control::Precision => 1 << 1,
            Control::Frame => 1 << 2,
            Control::Clutch => 1 << 3,
            Control::Finish => 1 << 4,
        };
        let buttons = held.iter().map(bit).fold(0_u16, |mask, bit| mask | bit);
        if buttons != self.buttons {
            self.buttons = buttons;
            events.push(report(3, &buttons.to_le_bytes()));
        }
        events
    }

    fn key_events(&mut self, axes: &[f64; AXES], held: &[Control]) -> Vec<DeviceEvent> {
        let mut keys = BTreeSet::new();
        for (axis, [positive, negative]) in axes.iter().zip(AXIS_KEYS) {
            if axis.abs() > 0.5 {
                keys.insert(if *axis > 0.0 { positive } else { negative });
            }
        }
        keys.extend(held.iter().map(|control| match control {
            Control::Gripper => "Space",
            Control::Precision => "ShiftLeft",
            Control::Clutch => "KeyC",
            Control::Frame => "KeyV",
            Control::Finish => "Enter",
        }));
        let event = |code: &&str, down: bool| DeviceEvent::Key { code: (*code).into(), down };
        let mut events: Vec<DeviceEvent> = self.keys.difference(&keys).map(|code| event(code, false)).collect();
        events.extend(keys.difference(&self.keys).map(|code| event(code, true)));
        // As the web page does with every frame, so that held keys do not count as silence.
        events.push(DeviceEvent::Alive);
        self.keys = keys;
        events
    }
}

fn gamepad([forward, left, up, roll, pitch, yaw]: &[f64; AXES], held: &[Control]) -> DeviceEvent {
    let mut buttons = vec![0.0; 17];
    let trigger = |value: f64| value.clamp(0.0, 1.0);
    (buttons[7], buttons[6]) = (trigger(*up), trigger(-up));
    (buttons[5], buttons[4]) = (trigger(*roll), trigger(-roll));
    for control in held {
        let button = match control {
            Control::Gripper => 0,
            Control::Precision => 1,
            Control::Frame => 2,
            Control::Clutch => 3,
            Control::Finish => 9,
        };
        buttons[button] = 1.0;
    }
    DeviceEvent::Gamepad { axes: vec![-left, -forward, -yaw, -pitch], buttons }
}
