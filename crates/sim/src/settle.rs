//! Settling: simulating a layout until all objects are at rest.

use serde::{Deserialize, Serialize};

use crate::{Sim, SimError};

/// Rest criterion and time limit of settling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SettleSettings {
    /// Time limit, s; 2 by default.
    pub max_seconds: f64,
    /// Largest speed of an object's origin that counts as rest, m/s; 0.002 by default.
    pub max_speed: f64,
    /// Largest angular speed that counts as rest, rad/s; 0.02 by default.
    pub max_angular_speed: f64,
    /// Duration for which all objects must stay below both speeds, s; 0.2 by default.
    pub quiet_seconds: f64,
}

impl Default for SettleSettings {
    fn default() -> Self {
        Self { max_seconds: 2.0, max_speed: 0.002, max_angular_speed: 0.02, quiet_seconds: 0.2 }
    }
}

/// Result of settling a layout.
#[derive(Clone, Debug, PartialEq)]
pub struct SettleReport {
    /// True if all objects came to rest within the time limit.
    pub settled: bool,
    /// Simulated time, s.
    pub seconds: f64,
    /// Displacement of each object's origin from start to end, m.
    pub displacement: Vec<f64>,
    /// Rotation angle of each object from start to end, rad.
    pub rotation: Vec<f64>,
    /// Largest penetration depth during settling, m; a deep one at the start indicates an overlapping layout.
    pub max_penetration: f64,
    /// Largest penetration depth at the end, m.
    pub final_penetration: f64,
}

impl Sim {
    /// Steps until all objects are at rest, with the drives holding their last targets.
    ///
    /// # Errors
    /// If the simulation diverges.
    pub fn settle(&mut self, settings: &SettleSettings) -> Result<SettleReport, SimError> {
        let substeps = self.scene.physics().substeps();
        let period_s = self.scene.physics().control_period_s();
        let intervals = |seconds: f64| (seconds / period_s).ceil().max(1.0) as u64;
        let before = self.object_states();
        let mut max_penetration = self.penetration();
        let (mut elapsed, mut quiet) = (0, 0);
        while quiet < intervals(settings.quiet_seconds) && elapsed < intervals(settings.max_seconds) {
            self.advance(substeps)?;
            elapsed += 1;
            // After a step, the engine still holds the contacts computed at the beginning of that step.
            max_penetration = self.data.contact().iter().map(|contact| -contact.dist).fold(max_penetration, f64::max);
            let at_rest = self
                .object_states()
                .iter()
                .all(|object| object.speed <= settings.max_speed && object.angular_speed <= settings.max_angular_speed);
            quiet = if at_rest { quiet + 1 } else { 0 };
        }
        let after = self.object_states();
        let pairs = || before.iter().zip(&after);
        Ok(SettleReport {
            settled: quiet >= intervals(settings.quiet_seconds),
            seconds: elapsed as f64 * period_s,
            displacement: pairs().map(|(from, to)| from.pose.position.distance(to.pose.position)).collect(),
            rotation: pairs().map(|(from, to)| from.pose.angle_to(&to.pose)).collect(),
            max_penetration,
            final_penetration: self.penetration(),
        })
    }
}
