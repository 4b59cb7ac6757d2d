//! Conversion between the gripper value of an action and the opening width.

use crate::{Gripper, GripperEncoding, GripperSpec};

impl GripperSpec {
    /// Opening width of a gripper value, metres, clamped to the gripper's range.
    pub fn width_m(self, number: f32, hand: &Gripper) -> f32 {
        let max_width = hand.max_width as f32;
        if self.is_native() {
            return number; // passed through bit-exactly; the drives clamp it
        }
        let Range { shut, open } = Range::of(self.encoding, hand.max_width);
        let (low, high) = (shut.min(open), shut.max(open));
        let number = match self.binary_threshold {
            Some(threshold) if f64::from(number) > threshold => high,
            Some(_) => low,
            None => f64::from(number).clamp(low, high),
        };
        ((number - shut) / (open - shut)) as f32 * max_width
    }

    /// Gripper value of an opening width (m).
    pub fn number(self, width_m: f32, hand: &Gripper) -> f32 {
        if self.is_native() {
            return width_m;
        }
        let Range { shut, open } = Range::of(self.encoding, hand.max_width);
        let number = shut + (open - shut) * (f64::from(width_m) / hand.max_width).clamp(0.0, 1.0);
        let (low, high) = (shut.min(open), shut.max(open));
        match self.binary_threshold {
            Some(threshold) => (if number > threshold { high } else { low }) as f32,
            None => number as f32,
        }
    }

    fn is_native(self) -> bool {
        self.encoding == GripperEncoding::WidthM && self.binary_threshold.is_none()
    }
}

/// Gripper values of a closed and an open gripper.
struct Range {
    shut: f64,
    open: f64,
}

impl Range {
    fn of(encoding: GripperEncoding, max_width: f64) -> Self {
        let (shut, open) = match encoding {
            GripperEncoding::WidthM => (0.0, max_width),
            GripperEncoding::OpenFraction => (0.0, 1.0),
            GripperEncoding::ClosedFraction => (1.0, 0.0),
            GripperEncoding::OpenPercent => (0.0, 100.0),
            GripperEncoding::PlusOneOpen => (-1.0, 1.0),
            GripperEncoding::PlusOneClosed => (1.0, -1.0),
            GripperEncoding::Closed255 => (255.0, 0.0),
        };
        Self { shut, open }
    }
}
