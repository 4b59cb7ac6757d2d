//! Restitution from a block that falls on the table and bounces.
//!
//! Between impacts the block falls freely, so that its height is known but for the moment of release, the height of the
//! drop, the height of the table, and the share of the speed that every impact leaves: four unknowns, found by least
//! squares. The engine has no restitution of its own: a contact is a spring with a damping ratio, and the ratio is
//! sought whose simulated drop bounces as much.

use genmanip_core::{RobotModel, World};
use genmanip_sim::SimError;

use crate::curve::{Coefficient, Curve};
use crate::parameters::Values;
use crate::recording::Recording;
use crate::replay::replay;

/// Shares of the speed from which the search starts.
const STARTS: [f64; 6] = [0.02, 0.1, 0.25, 0.45, 0.65, 0.85];
/// Impacts after which the block counts as at rest.
const IMPACTS: usize = 40;
/// Lowest drop that is a measurement, m: below it, the fall is as short as the noise.
const LOWEST_M: f64 = 0.02;
/// Smallest and largest damping ratio that is tried: below, contacts oscillate so fast against the default time step that
/// they gain energy. With the default time constant of 6 ms, blocks keep 0.46 to none of their speed.
const DAMPING: [f64; 2] = [0.3, 1.0];
/// Bisection steps for the damping ratio.
const STEPS: usize = 10;

/// Restitution in a recorded drop; `None` if nothing falls.
pub fn measured(drop: &Recording, gravity_m_s2: f64, least_noise: f64) -> Option<Coefficient> {
    let block = drop.block.as_ref()?;
    let heights: Vec<f64> = block.track_m.iter().map(|point| point[2]).collect();
    of_heights(&drop.time_s, &heights, gravity_m_s2, least_noise)
}

/// Restitution of a simulated drop with a damping ratio of the contacts.
///
/// # Errors
/// When the simulator refuses the model or diverges.
pub fn simulated(
    drop: &Recording,
    world: &World,
    robot: &RobotModel,
    values: &Values,
    damping: f64,
) -> Result<Option<f64>, SimError> {
    let values = Values { contact_damping: damping, ..values.clone() };
    let track = replay(drop, world, robot, &values)?;
    let heights: Vec<f64> = track.block.iter().map(|point| point.z).collect();
    Ok(of_heights(&drop.time_s, &heights, world.physics.gravity_m_s2, 1e-6).map(|found| found.value))
}

/// Damping ratio of the contacts with which the simulated drop has a restitution; `None` if none of them has.
///
/// # Errors
/// As [`simulated`].
pub fn damping_of(
    drop: &Recording,
    world: &World,
    robot: &RobotModel,
    values: &Values,
    restitution: f64,
) -> Result<Option<f64>, SimError> {
    let excess = |damping: f64| -> Result<f64, SimError> {
        Ok(simulated(drop, world, robot, values, damping)?.unwrap_or(0.0) - restitution)
    };
    let [mut low, mut high] = DAMPING;
    // The least damped contact bounces most.
    if excess(low)? < 0.0 {
        return Ok(None);
    }
    if excess(high)? > 0.0 {
        return Ok(Some(high));
    }
    for _ in 0..STEPS {
        let middle = (low * high).sqrt();
        *(if excess(middle)? > 0.0 { &mut low } else { &mut high }) = middle;
    }
    Ok(Some((low * high).sqrt()))
}

/// Restitution from heights (m) at times (s).
fn of_heights(times_s: &[f64], heights_m: &[f64], gravity_m_s2: f64, least_noise: f64) -> Option<Coefficient> {
    let rest = &heights_m[heights_m.len() * 9 / 10..];
    let level = rest.iter().sum::<f64>() / rest.len().max(1) as f64;
    let top = heights_m.first()? - level;
    let fallen = heights_m.iter().position(|height| height - level < 0.7 * top)?;
    if top < LOWEST_M || gravity_m_s2 <= 0.0 {
        return None;
    }
    let released = times_s[fallen] - (0.6 * top / gravity_m_s2).sqrt();
    let curve = Curve {
        times_s,
        values_m: heights_m,
        at: |point: &[f64; 4], time_s: f64| {
            let [released_s, drop_m, level_m, restitution] = *point;
            Fall { released_s, drop_m, level_m, restitution }.height(time_s, gravity_m_s2)
        },
        steps: [1e-4, 1e-5, 1e-5, 1e-4],
        spans: [1e-4, 1e-5, 1e-5, 0.05],
        bounds: [[f64::MIN, f64::MAX], [1e-3, f64::MAX], [f64::MIN, f64::MAX], [0.0, 0.999]],
    };
    Some(curve.fit(&STARTS.map(|share| [released, top, level, share]), least_noise)?.coefficient(3))
}

/// A fall from rest with bounces that all leave the same share of the speed.
struct Fall {
    released_s: f64,
    drop_m: f64,
    level_m: f64,
    restitution: f64,
}

impl Fall {
    fn height(&self, time_s: f64, gravity_m_s2: f64) -> f64 {
        let mut since = time_s - self.released_s;
        if since <= 0.0 {
            return self.level_m + self.drop_m;
        }
        let fall_s = (2.0 * self.drop_m / gravity_m_s2).sqrt();
        if since < fall_s {
            return self.level_m + self.drop_m - 0.5 * gravity_m_s2 * since * since;
        }
        since -= fall_s;
        let mut speed = gravity_m_s2 * fall_s;
        for _ in 0..IMPACTS {
            speed *= self.restitution;
            let flight_s = 2.0 * speed / gravity_m_s2;
            if since < flight_s {
                return self.level_m + speed * since - 0.5 * gravity_m_s2 * since * since;
            }
            since -= flight_s;
        }
        self.level_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::Seed;
    use genmanip_real::synthetic::normal;

    /// The interval contains the true share in most of many noisy drops, and is no wider than it need be.
    #[test]
    fn known_bounces_are_found_again() {
        let mut covered = 0;
        for case in 0..40_u64 {
            let rng = &mut Seed::new(case).rng();
            let truth = 0.2 + 0.012 * case as f64;
            let fall = Fall { released_s: 0.2131, drop_m: 0.15, level_m: 0.004, restitution: truth };
            let times: Vec<f64> = (0..150).map(|row| f64::from(row) / 100.0).collect();
            let heights: Vec<f64> = times.iter().map(|time| fall.height(*time, 9.81) + 1e-3 * normal(rng)).collect();
            let found = of_heights(&times, &heights, 9.81, 1e-6).unwrap();
            assert!((found.value - truth).abs() < 0.03 && found.sd < 0.02, "{truth}: {found:?}");
            covered += usize::from((found.value - truth).abs() < 1.96 * found.sd);
        }
        assert!((35..=40).contains(&covered), "{covered} of 40");
        let times: Vec<f64> = (0..50).map(|row| f64::from(row) / 100.0).collect();
        assert_eq!(of_heights(&times, &[0.01; 50], 9.81, 1e-6), None);
    }
}
