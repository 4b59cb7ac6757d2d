//! Gamepad with the standard mapping of the W3C Gamepad API.

use super::{AXES, Control, DeviceError};

/// Functions of the buttons: A or cross, B or circle, X or square, Y or triangle, start.
pub(super) const BUTTONS: &[(u32, Control)] =
    &[(0, Control::Gripper), (1, Control::Precision), (2, Control::Frame), (3, Control::Clutch), (9, Control::Finish)];
/// Value above which a button counts as pressed.
const PRESSED: f64 = 0.5;

/// Operator's axes (forward, left, up, roll, pitch, yaw; -1 to 1), and the bit mask of the pressed buttons.
///
/// Left stick: forward and left. Triggers: right up, left down. Right stick: pitch and yaw. Shoulder buttons: roll.
pub(super) fn read(axes: &[f64], buttons: &[f64]) -> Result<([f64; AXES], u32), DeviceError> {
    let is_standard = axes.len() == 4 && (16..=17).contains(&buttons.len());
    if !is_standard || !axes.iter().chain(buttons).all(|value| value.is_finite()) {
        return Err(DeviceError::Gamepad { axes: axes.len(), buttons: buttons.len() });
    }
    let stick = |index: usize| axes[index].clamp(-1.0, 1.0);
    let button = |index: usize| buttons[index].clamp(0.0, 1.0);
    let mask =
        buttons.iter().enumerate().filter(|(_, value)| **value > PRESSED).fold(0, |mask, (at, _)| mask | (1 << at));
    let moved =
        [0.0 - stick(1), 0.0 - stick(0), button(7) - button(6), button(5) - button(4), 0.0 - stick(3), 0.0 - stick(2)];
    Ok((moved, mask))
}
