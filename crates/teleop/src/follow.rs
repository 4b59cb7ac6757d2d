//! Following of a leader arm or tracker: a twist towards the pose that it asks for, slow until the tool has caught up.

use genmanip_core::Pose;
use genmanip_core::glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::mapping::{Axes, Twist};

/// Settings of following.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FollowSettings {
    /// Distance from the pose asked for below which the tool follows at full speed, m.
    pub near_m: f64,
    /// Angle from it below which the tool follows at full speed, rad.
    pub near_rad: f64,
    /// Speed at which the tool approaches that pose before, m/s.
    pub ramp_m_s: f64,
    /// Angular speed at which it approaches that pose before, rad/s.
    pub ramp_rad_s: f64,
    /// Distance below which the tool stands still, m.
    pub still_m: f64,
    /// Angle below which the tool stands still, rad.
    pub still_rad: f64,
}

impl Default for FollowSettings {
    fn default() -> Self {
        // A third of the largest speeds; the tremor of a hand is below 1 mm.
        Self { near_m: 0.02, near_rad: 0.15, ramp_m_s: 0.08, ramp_rad_s: 0.5, still_m: 0.0005, still_rad: 0.003 }
    }
}

impl FollowSettings {
    /// True for the defaults, which files omit.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// State of following: engaged or not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Follow {
    /// True once the tool has caught up with the device.
    is_near: bool,
    /// Poses of the tool and of a relative device when the device was engaged.
    anchor: Option<[Pose; 2]>,
}

impl Follow {
    /// Disengages: the tool has to catch up again, and a relative device starts anew from where it is then.
    pub fn disengage(&mut self) {
        *self = Self::default();
    }

    /// True while the tool follows at full speed.
    pub fn is_near(&self) -> bool {
        self.is_near
    }

    /// Pose that a relative device at `world_from_device` asks for; engages it at the tool's pose.
    pub fn moved(&mut self, tool: Pose, device: Pose) -> Pose {
        let [tool_then, device_then] = *self.anchor.get_or_insert([tool, device]);
        let turn = device.rotation * device_then.rotation.inverse();
        Pose {
            position: tool_then.position + (device.position - device_then.position),
            rotation: (turn * tool_then.rotation).normalize(),
        }
    }

    /// Twist that brings the tool from `tool` to `goal` within a control step of `period_s` (s), or as near as the ramp
    /// allows.
    pub fn twist(&mut self, tool: &Pose, goal: &Pose, period_s: f64, settings: &FollowSettings) -> Twist {
        let way = goal.position - tool.position;
        let turn = goal.rotation * tool.rotation.inverse();
        // The shorter way round.
        let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
        self.is_near |= way.length() < settings.near_m && turn.length() < settings.near_rad;
        let still = |motion: DVec3, limit: f64| if motion.length() < limit { DVec3::ZERO } else { motion };
        let linear = still(way, settings.still_m) / period_s;
        let angular = still(turn, settings.still_rad) / period_s;
        let (linear_m_s, angular_rad_s) = match self.is_near {
            true => (linear, angular),
            false => (linear.clamp_length_max(settings.ramp_m_s), angular.clamp_length_max(settings.ramp_rad_s)),
        };
        Twist { axes: Axes::WORLD, linear_m_s, angular_rad_s }
    }
}
