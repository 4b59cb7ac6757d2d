//! Key bindings of the keyboard, by physical key position (`KeyboardEvent.code`): independent of the keyboard layout.

use super::Control;

/// Maximum number of keys held at once; further ones are ignored.
pub(super) const MAX_HELD: usize = 32;

/// Keys that deflect an axis: code, index of the axis (forward, left, up, roll, pitch, yaw) and deflection (-1 or 1).
pub(super) const AXIS_KEYS: &[(&str, usize, f64)] = &[
    ("KeyW", 0, 1.0),
    ("KeyS", 0, -1.0),
    ("KeyA", 1, 1.0),
    ("KeyD", 1, -1.0),
    ("KeyR", 2, 1.0),
    ("KeyF", 2, -1.0),
    ("ArrowRight", 3, 1.0),
    ("ArrowLeft", 3, -1.0),
    ("ArrowUp", 4, 1.0),
    ("ArrowDown", 4, -1.0),
    ("KeyQ", 5, 1.0),
    ("KeyE", 5, -1.0),
];

/// Functions of further keys.
pub(super) const CONTROL_KEYS: &[(&str, Control)] = &[
    ("Space", Control::Gripper),
    ("ShiftLeft", Control::Precision),
    ("ShiftRight", Control::Precision),
    ("KeyC", Control::Clutch),
    ("KeyV", Control::Frame),
    ("Enter", Control::Finish),
];

/// True if the key has a function.
pub(super) fn is_known(code: &str) -> bool {
    AXIS_KEYS.iter().any(|(key, ..)| *key == code) || CONTROL_KEYS.iter().any(|(key, _)| *key == code)
}
