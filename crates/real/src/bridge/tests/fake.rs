//! Arm of two joints with a gripper, for tests.

use std::sync::Arc;
use std::time::Duration;

use crate::bridge::{
    BridgeRobot, BridgeSettings, Driver, DriverError, JointLimits, JointState, Orders, Reading, ToolPosition,
};

/// Arm that follows setpoints one period late.
#[derive(Clone, Debug)]
pub struct FakeArm {
    pub joints: Vec<JointState>,
    pub width_m: f64,
    pub target_m: f64,
    /// Width of an object between the fingers, m.
    pub object_m: f64,
    /// Error words until the arm is recovered.
    pub errors: Vec<String>,
    /// Number of attempts that recovery takes.
    pub needed_recoveries: usize,
    /// True to wait for the wall clock.
    pub is_paced: bool,
}

impl FakeArm {
    pub fn new() -> Self {
        Self {
            joints: vec![JointState::at_rest(0.3), JointState::at_rest(-0.5)],
            width_m: 0.08,
            target_m: 0.08,
            object_m: 0.0,
            errors: Vec::new(),
            needed_recoveries: 1,
            is_paced: false,
        }
    }

    pub fn reading(&self) -> Reading {
        Reading {
            positions: self.joints.iter().map(|joint| joint.position).collect(),
            velocities: self.joints.iter().map(|joint| joint.velocity).collect(),
            torques: Vec::new(),
            width_m: Some(self.width_m),
            errors: self.errors.clone(),
            ..Reading::default()
        }
    }

    pub fn follow(&mut self, orders: &Orders) {
        if self.errors.is_empty() {
            self.joints.clone_from(&orders.setpoints);
        } else if orders.recover {
            self.needed_recoveries = self.needed_recoveries.saturating_sub(1);
            if self.needed_recoveries == 0 {
                self.errors.clear();
            }
        }
        self.target_m = orders.width_m.unwrap_or(self.target_m);
        let step = (self.target_m - self.width_m).clamp(-1e-4, 1e-4);
        self.width_m = (self.width_m + step).max(self.object_m);
    }
}

impl Driver for FakeArm {
    fn read(&mut self) -> Result<Reading, DriverError> {
        if self.is_paced {
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(self.reading())
    }

    fn write(&mut self, orders: &Orders) -> Result<(), DriverError> {
        self.follow(orders);
        Ok(())
    }
}

/// Planar arm of two links of 0.5 m, and its bridge's settings.
pub fn robot() -> (BridgeRobot, BridgeSettings) {
    let joints = [JointLimits::PANDA[0], JointLimits::PANDA[1]].to_vec();
    let tool: ToolPosition = Arc::new(|q: &[f64]| {
        [0.5 * q[0].cos() + 0.5 * (q[0] + q[1]).cos(), 0.5 * q[0].sin() + 0.5 * (q[0] + q[1]).sin(), 0.0]
    });
    (BridgeRobot { name: "planar".into(), joints, max_width_m: 0.08, tool }, BridgeSettings::default())
}
