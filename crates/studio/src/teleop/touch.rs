//! Touch of the device while something else is in command: any motion, press or clutch of the person's.

use genmanip_teleop::device::{Decoder, DeviceEvent};
use genmanip_teleop::mapping::{Mapping, MappingSettings};

/// Watches the events of a device for a touch.
#[derive(Debug)]
pub struct Touch {
    decoder: Decoder,
    mapping: Mapping,
}

impl Touch {
    /// A device at rest.
    pub fn new(settings: &MappingSettings) -> Self {
        Self { decoder: Decoder::default(), mapping: Mapping::new(settings.clone(), None) }
    }

    /// True if the device is touched after these events.
    pub fn is_felt(&mut self, events: &[DeviceEvent]) -> bool {
        let mut is_felt = false;
        for event in events {
            // Events that do not fit the device move nothing, as in teleoperation.
            let _ = self.decoder.apply(event);
            let reading = self.decoder.reading();
            is_felt |= self.mapping.is_deflected(&reading) || reading.clutch || !reading.pressed.is_empty();
        }
        is_felt
    }
}

#[cfg(test)]
mod tests {
    use genmanip_teleop::device::{Control, Device};

    use super::*;

    #[test]
    fn motion_presses_and_the_clutch_are_felt() {
        let key = |code: &str, down| DeviceEvent::Key { code: code.into(), down };
        let stick = |x: f64| DeviceEvent::Gamepad { axes: vec![x, 0.0, 0.0, 0.0], buttons: vec![0.0; 17] };
        let keyboard = Device::Keyboard;
        let gamepad = Device::Gamepad { name: "pad".into() };
        let cases = [
            (&keyboard, vec![DeviceEvent::Alive], false),
            (&keyboard, vec![DeviceEvent::Blurred, DeviceEvent::Silent], false),
            (&keyboard, vec![key("KeyW", false)], false),
            (&keyboard, vec![key("KeyW", true)], true),
            (&keyboard, vec![key("KeyW", true), key("KeyW", false)], true),
            (&keyboard, vec![key("KeyC", true)], true),
            (&keyboard, vec![key("Space", true)], true),
            (&keyboard, vec![DeviceEvent::Pressed { control: Control::Gripper }], true),
            (&gamepad, vec![stick(0.02)], false),
            (&gamepad, vec![stick(0.8)], true),
            (&gamepad, vec![key("KeyW", true)], false),
        ];
        for (device, events, expected) in cases {
            let mut touch = Touch::new(&MappingSettings::default());
            assert!(!touch.is_felt(&[DeviceEvent::Connected { device: device.clone() }]));
            assert_eq!(touch.is_felt(&events), expected, "{device:?} {events:?}");
        }
    }
}
