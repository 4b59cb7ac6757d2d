//! Commands along arm configurations, from rest to rest.

/// Limits of the speed along a way.
#[derive(Clone, Debug)]
pub(crate) struct Pace {
    /// Control rate, Hz.
    pub rate_hz: f64,
    /// Largest speed of the hand, m/s.
    pub hand_m_s: f64,
    /// Largest speed of each arm joint, rad/s.
    pub joint_rad_s: Vec<f64>,
}

/// Peak speed of the minimum-jerk profile relative to its mean: the largest slope of 10t³ − 15t⁴ + 6t⁵.
const PEAK_SPEED: f64 = 1.875;
/// Fewest control steps of a motion: a third of a second, below which the arm's drives do not follow.
const MIN_STEPS: f64 = 20.0;

/// States of each control step along given ones at equal distances, with the minimum-jerk profile and within the limits;
/// `length_m` is the length of the hand's way. The first state is left out.
pub(crate) fn paced(states: &[Vec<f64>], length_m: f64, pace: &Pace) -> Vec<Vec<f64>> {
    let Some(last) = states.len().checked_sub(1).filter(|last| *last > 0) else { return states.to_vec() };
    let hand_s = PEAK_SPEED * length_m / pace.hand_m_s;
    let joint_s = states.windows(2).map(|pair| {
        let times = pair[0].iter().zip(&pair[1]).zip(&pace.joint_rad_s).map(|((a, b), most)| (a - b).abs() / most);
        times.fold(0.0, f64::max)
    });
    let joint_s = joint_s.fold(0.0, f64::max) * last as f64 * PEAK_SPEED;
    let count = (hand_s.max(joint_s) * pace.rate_hz).ceil().max(MIN_STEPS) as usize;
    (1..=count)
        .map(|step| {
            let t = step as f64 / count as f64;
            let along = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t) * last as f64;
            let index = (along.floor() as usize).min(last - 1);
            let share = along - index as f64;
            states[index].iter().zip(&states[index + 1]).map(|(a, b)| a + (b - a) * share).collect()
        })
        .collect()
}
