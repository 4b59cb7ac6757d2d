//! Gripper commands that always end in time with a word, also when an object is in the way.

use serde::{Deserialize, Serialize};

/// Time limits and tolerances of gripper commands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GripperSettings {
    /// Difference of widths that counts as none, m; a target that changes by less starts no new command.
    pub tolerance_m: f64,
    /// Time without motion after which the fingers count as stopped, s.
    pub stall_s: f64,
    /// Change of width that counts as motion, m.
    pub motion_m: f64,
    /// Time after which a command ends in any case, s.
    pub longest_s: f64,
}

impl Default for GripperSettings {
    fn default() -> Self {
        // Chosen by hand: a Franka Hand takes 0.8 s from open to closed at 0.1 m/s, and repeats widths to 0.1 mm.
        Self { tolerance_m: 2e-3, stall_s: 0.25, motion_m: 3e-4, longest_s: 3.0 }
    }
}

/// State of the last gripper command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripperWord {
    /// No command yet.
    Idle,
    /// The fingers are on the way.
    Moving,
    /// The target width is reached.
    Arrived,
    /// The fingers stopped closing before the target: something is between them.
    Holding,
    /// The fingers stopped opening before the target.
    Blocked,
    /// The fingers still moved when the time was up.
    TimedOut,
}

/// State of the gripper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GripperState {
    /// State of the last command.
    pub word: GripperWord,
    /// Measured opening width, m.
    pub width_m: f64,
    /// Target width, m.
    pub target_m: f64,
}

/// Monitor of the gripper: decides when a command begins and how it ended.
#[derive(Clone, Debug, PartialEq)]
pub struct GripperMonitor {
    settings: GripperSettings,
    max_width_m: f64,
    word: GripperWord,
    /// Target of the command that was given last, m; `None` before the first.
    given_m: Option<f64>,
    /// Latest requested width, m; `None` before the first.
    wanted_m: Option<f64>,
    began_s: f64,
    /// Width and time of the last motion.
    moved: (f64, f64),
    is_closing: bool,
}

impl GripperMonitor {
    /// Monitor before the first command.
    pub fn new(max_width_m: f64, settings: GripperSettings) -> Self {
        let (given_m, wanted_m, word) = (None, None, GripperWord::Idle);
        Self { settings, max_width_m, word, given_m, wanted_m, began_s: 0.0, moved: (0.0, 0.0), is_closing: false }
    }

    /// Requests an opening width, m, which is clamped to what the gripper can do.
    pub fn want(&mut self, width_m: f64) {
        self.wanted_m = Some(width_m.clamp(0.0, self.max_width_m));
    }

    /// Advances to `now_s` with the measured width; returns a width, m, if the gripper must be given a new command.
    ///
    /// Widths that a policy changes little by little would be a command each: a change below the tolerance waits.
    pub fn tick(&mut self, now_s: f64, measured_m: f64) -> Option<f64> {
        let GripperSettings { tolerance_m, stall_s, motion_m, longest_s } = self.settings;
        if (measured_m - self.moved.0).abs() > motion_m {
            self.moved = (measured_m, now_s);
        }
        let wanted_m = self.wanted_m?;
        let is_end = wanted_m == 0.0 || wanted_m == self.max_width_m;
        let least_m = if is_end { f64::MIN_POSITIVE } else { tolerance_m };
        if self.given_m.is_none_or(|given_m| (given_m - wanted_m).abs() >= least_m) {
            self.given_m = Some(wanted_m);
            self.began_s = now_s;
            self.moved = (measured_m, now_s);
            self.is_closing = wanted_m < measured_m;
            self.word = GripperWord::Moving;
            return Some(wanted_m);
        }
        if self.word == GripperWord::Moving {
            let has_stopped = now_s - self.moved.1 >= stall_s;
            let is_there = (measured_m - wanted_m).abs() <= tolerance_m;
            self.word = match () {
                () if is_there && has_stopped => GripperWord::Arrived,
                () if has_stopped && self.is_closing => GripperWord::Holding,
                () if has_stopped => GripperWord::Blocked,
                () if now_s - self.began_s >= longest_s => GripperWord::TimedOut,
                () => GripperWord::Moving,
            };
        }
        None
    }

    /// State at a measured width.
    pub fn state(&self, measured_m: f64) -> GripperState {
        GripperState { word: self.word, width_m: measured_m, target_m: self.wanted_m.unwrap_or(measured_m) }
    }
}
