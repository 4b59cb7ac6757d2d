//! The gripper's number of an action.

use crate::{Gripper, GripperEncoding, GripperSpec};

impl GripperSpec {
    /// The opening width that a number means, metres, within what the hand can.
    pub fn width_m(self, number: f32, hand: &Gripper) -> f32 {
        let max_width = hand.max_width as f32;
        if self.is_native() {
            return number; // kept to the last bit; the drives keep it within the range
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

    /// The number that means an opening width.
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

/// The numbers of a shut and of an open hand.
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
            GripperEncoding::PlusOneOpen => (-1.0, 1.0),
            GripperEncoding::PlusOneClosed => (1.0, -1.0),
            GripperEncoding::Closed255 => (255.0, 0.0),
        };
        Self { shut, open }
    }
}
