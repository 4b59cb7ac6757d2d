//! Friction on the table from a block that slides freely.
//!
//! While the fingers push, the block chatters against them: in the simulator, as on a table, equal commands give speeds
//! at release that differ by percents. Only the slide after release counts, with its speed as an unknown: the block
//! comes to rest under the constant deceleration of Coulomb friction, which the simulator has, too.

use genmanip_core::RobotModel;
use genmanip_core::glam::{DVec2, DVec3};

use crate::curve::{Coefficient, Curve};
use crate::recording::Recording;

/// Friction coefficients from which the search starts.
const STARTS: [f64; 5] = [0.1, 0.2, 0.35, 0.6, 1.0];
/// Share of their highest speed below which the fingers have left the block: they brake harder than friction does.
const RELEASED: f64 = 0.4;
/// Shortest slide that is a measurement, m.
const SHORTEST_M: f64 = 0.005;
/// Smallest and largest friction coefficient.
const BOUNDS: [f64; 2] = [0.01, 4.0];

/// Friction in a recorded push; `None` if nothing slides. `latency_s` delays the commands where no joints were measured.
pub fn measured(
    push: &Recording,
    robot: &RobotModel,
    latency_s: f64,
    gravity_m_s2: f64,
    least_noise: f64,
) -> Option<Coefficient> {
    let track = &push.block.as_ref()?.track_m;
    let from = released(push, robot, latency_s)?;
    let flat = |point: &[f64; 3]| DVec2::new(point[0], point[1]);
    let rest = &track[from + (track.len() - from) * 4 / 5..];
    let end = rest.iter().map(flat).sum::<DVec2>() / rest.len().max(1) as f64;
    let direction = (end - flat(track.get(from)?)).try_normalize()?;
    let positions: Vec<f64> = track[from..].iter().map(|point| (flat(point) - end).dot(direction)).collect();
    of_positions(&push.time_s[from..], &positions, gravity_m_s2, least_noise)
}

/// First moment after which the fingers have left the block; `None` if they never stop.
pub fn released(push: &Recording, robot: &RobotModel, latency_s: f64) -> Option<usize> {
    let (rows, delay_s) = match push.joint_rad.is_empty() {
        true => (&push.command_rad, latency_s),
        false => (&push.joint_rad, 0.0),
    };
    let tool: Vec<DVec3> = rows.iter().map(|row| robot.tcp_pose(row).position).collect();
    // Speeds over four moments: sensors are noisy.
    let speed = |row: usize| (tool[row + 2] - tool[row - 2]).length() / (push.time_s[row + 2] - push.time_s[row - 2]);
    let speeds: Vec<f64> = (2..tool.len().checked_sub(2)?).map(speed).collect();
    let (fastest, most) = speeds.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let slow = speeds[fastest..].iter().position(|speed| *speed < RELEASED * most)?;
    let released_s = push.time_s[2 + fastest + slow] + delay_s;
    Some(push.time_s.partition_point(|time| *time < released_s))
}

/// Friction from positions (m) at times (s), both from the release on.
fn of_positions(times_s: &[f64], positions_m: &[f64], gravity_m_s2: f64, least_noise: f64) -> Option<Coefficient> {
    let (first_s, distance_m) = (*times_s.first()?, -positions_m.first()?);
    if distance_m < SHORTEST_M || gravity_m_s2 <= 0.0 {
        return None;
    }
    let curve = Curve {
        times_s,
        values_m: positions_m,
        // Friction, moment of rest, place of rest.
        at: |[friction, stop_s, stop_m]: &[f64; 3], time_s: f64| {
            stop_m - 0.5 * friction * gravity_m_s2 * (stop_s - time_s).max(0.0).powi(2)
        },
        steps: [1e-4, 1e-4, 1e-5],
        spans: [1e-4, 1e-4, 1e-5],
        bounds: [BOUNDS, [first_s, f64::MAX], [f64::MIN, f64::MAX]],
    };
    let start = |friction: f64| [friction, first_s + (2.0 * distance_m / (friction * gravity_m_s2)).sqrt(), 0.0];
    Some(curve.fit(&STARTS.map(start), least_noise)?.coefficient(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::Seed;
    use genmanip_real::synthetic::normal;

    #[test]
    fn friction_of_known_slides_is_found_again() {
        let mut covered = 0;
        for case in 0..40_u64 {
            let rng = &mut Seed::new(case).rng();
            let truth = 0.2 + 0.015 * case as f64;
            let times: Vec<f64> = (0..80).map(|row| f64::from(row) / 100.0).collect();
            let stop_s = 0.8 / (truth * 9.81);
            let at = |time: f64| -0.5 * truth * 9.81 * (stop_s - time).max(0.0).powi(2);
            let noisy: Vec<f64> = times.iter().map(|time| at(*time) + 1e-3 * normal(rng)).collect();
            let found = of_positions(&times, &noisy, 9.81, 1e-6).unwrap();
            assert!((found.value - truth).abs() < 0.2 * truth, "{truth}: {found:?}");
            covered += usize::from((found.value - truth).abs() < 1.96 * found.sd);
        }
        assert!((34..=40).contains(&covered), "{covered} of 40");
        let times: Vec<f64> = (0..50).map(|row| f64::from(row) / 100.0).collect();
        assert_eq!(of_positions(&times, &[0.0; 50], 9.81, 1e-6), None);
    }
}
