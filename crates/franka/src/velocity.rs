//! Velocity limits of an FR3, which fall towards the ends of its joints' ranges.
//!
//! Franka's robot specifications allow towards an end at `q_end` at most
//! `min(v_max, -offset + sqrt(2 deceleration |q_end - q|))`. A joint that can always still stop at `q_stop` with a
//! deceleration `a` moves at most at `sqrt(2 a |q_stop - q|)`. That parabola lies below the limit everywhere for
//! `a = deceleration (1 - offset² / (2 deceleration |q_end - q_stop|))`.

use genmanip_real::bridge::JointLimits;

/// Name of the robot with these limits.
pub const FR3: &str = "fr3";
/// Margin on the offsets, rad/s: above the margin that libfranka takes for rounding.
const MARGIN_RAD_S: f64 = 0.01;
/// Share of an end's deceleration that is used at least; a joint's range is shortened where less would be left.
const LEAST_SHARE: f64 = 0.5;

/// Limit of a joint, from Franka's robot specifications; rad, rad/s, rad/s².
struct Limit {
    lower: f64,
    upper: f64,
    velocity: f64,
    offset: f64,
    deceleration: f64,
}

const fn limit(lower: f64, upper: f64, velocity: f64, offset: f64, deceleration: f64) -> Limit {
    Limit { lower, upper, velocity, offset, deceleration }
}

const LIMITS: [Limit; 7] = [
    limit(-2.9007, 2.9007, 2.62, 0.6599, 6.0),
    limit(-1.8361, 1.8361, 2.62, 0.2517, 2.585),
    limit(-2.9007, 2.9007, 2.62, 0.2000, 3.5),
    limit(-3.0770, -0.1169, 2.62, 0.3533, 4.0),
    limit(-2.8763, 2.8763, 5.26, 0.5757, 17.0),
    limit(0.4398, 4.6216, 4.18, 0.4878, 5.5),
    limit(-3.0508, 3.0508, 5.26, 0.4628, 17.0),
];

/// Changes the limits of an FR3's joints so that setpoints within them keep its velocity limits.
pub fn limit_velocity(joints: &mut [JointLimits]) {
    for (joint, limit) in joints.iter_mut().zip(&LIMITS) {
        // Distance from the end at which the allowed velocity is 0.
        let standing = (limit.offset + MARGIN_RAD_S).powi(2) / (2.0 * limit.deceleration);
        let nearest = standing / (1.0 - LEAST_SHARE);
        joint.lower = joint.lower.max(limit.lower + nearest);
        joint.upper = joint.upper.min(limit.upper - nearest);
        joint.velocity = joint.velocity.min(limit.velocity);
        let room = (joint.lower - limit.lower).min(limit.upper - joint.upper);
        joint.end_deceleration = Some(joint.acceleration.min(limit.deceleration * (1.0 - standing / room)));
    }
}

#[cfg(test)]
mod tests {
    use genmanip_real::bridge::Interpolator;

    use super::*;

    /// Velocity that Franka's specifications allow towards the upper and the lower end.
    fn allowed(limit: &Limit, q: f64) -> [f64; 2] {
        [limit.upper - q, q - limit.lower].map(|left: f64| {
            let falling = (2.0 * limit.deceleration * left.max(0.0)).sqrt() - limit.offset;
            falling.clamp(0.0, limit.velocity)
        })
    }

    #[test]
    fn setpoints_keep_the_limits_of_an_fr3_and_reach_both_ends() {
        let mut limits = JointLimits::PANDA;
        limit_velocity(&mut limits);
        let (mut fastest, mut closest) = ([0.0_f64; 7], f64::INFINITY);
        for (joint, (it, limit)) in limits.iter().zip(&LIMITS).enumerate() {
            let mut arm = Interpolator::new(&[*it], &[f64::midpoint(it.lower, it.upper)], 1e-3).unwrap();
            let mut target = it.upper;
            for tick in 0..40_000 {
                // The ends in turn, later any target, often changed at speed.
                match tick {
                    0..16_000 if tick % 4000 == 0 => target = if tick % 8000 == 0 { it.upper } else { it.lower },
                    16_000.. if tick % 150 == 0 => {
                        // Multiples of the golden ratio are spread evenly.
                        let share = (f64::from(tick) * 0.618_034).fract();
                        target = it.lower - 0.5 + share * (it.upper - it.lower + 1.0);
                    }
                    _ => {}
                }
                arm.aim(&[target], if tick % 3 == 0 { 0.0 } else { 0.02 });
                let now = arm.tick()[0];
                let [up, down] = allowed(limit, now.position);
                assert!(
                    now.velocity <= up && -now.velocity <= down,
                    "joint {joint}, tick {tick}: {now:?}, {up}, {down}"
                );
                fastest[joint] = fastest[joint].max(now.velocity.abs() / it.velocity);
                closest = closest.min((up - now.velocity).min(down + now.velocity));
                if tick == 3999 || tick == 7999 {
                    let end = if tick == 3999 { it.upper } else { it.lower };
                    assert!((now.position - end).abs() < 0.01, "joint {joint} ends at {now:?}, not {end}");
                }
            }
        }
        assert!(fastest.iter().all(|share| *share > 0.95), "{fastest:?}");
        assert!(closest < 0.1, "the limits are never approached: {closest}");
    }

    #[test]
    fn the_limits_of_a_panda_would_be_violated() {
        let it = JointLimits::PANDA[1];
        let mut arm = Interpolator::new(&[it], &[0.0], 1e-3).unwrap();
        arm.aim(&[it.upper], 0.0);
        let is_above = |_| {
            let now = arm.tick()[0];
            now.velocity > allowed(&LIMITS[1], now.position)[0]
        };
        assert!((0..2000).any(is_above));
    }
}
