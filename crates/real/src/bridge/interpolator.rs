//! Online interpolator: setpoints at a fixed rate within limits of velocity, acceleration and jerk.

use serde::{Deserialize, Serialize};

/// Bisection steps in the interval of accelerations: 2^-30 of the interval is far below any drive's resolution.
const HALVINGS: usize = 30;

/// Limits of one joint; positions in rad (revolute) or m (prismatic).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// Minimum position, rad or m.
    pub lower: f64,
    /// Maximum position, rad or m.
    pub upper: f64,
    /// Maximum velocity, rad/s or m/s.
    pub velocity: f64,
    /// Maximum acceleration, rad/s² or m/s².
    pub acceleration: f64,
    /// Maximum jerk, rad/s³ or m/s³.
    pub jerk: f64,
    /// Deceleration with which the joint can always still stop before an end of its range, rad/s² or m/s²: the velocity
    /// falls towards the ends. Absent for `acceleration`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_deceleration: Option<f64>,
}

impl JointLimits {
    /// Limits of a Franka Panda's joints, from its documentation.
    pub const PANDA: [Self; 7] = [
        Self::new(-2.8973, 2.8973, 2.175, 15.0, 7500.0),
        Self::new(-1.7628, 1.7628, 2.175, 7.5, 3750.0),
        Self::new(-2.8973, 2.8973, 2.175, 10.0, 5000.0),
        Self::new(-3.0718, -0.0698, 2.175, 12.5, 6250.0),
        Self::new(-2.8973, 2.8973, 2.61, 15.0, 7500.0),
        Self::new(-0.0175, 3.7525, 2.61, 20.0, 10000.0),
        Self::new(-2.8973, 2.8973, 2.61, 20.0, 10000.0),
    ];

    const fn new(lower: f64, upper: f64, velocity: f64, acceleration: f64, jerk: f64) -> Self {
        Self { lower, upper, velocity, acceleration, jerk, end_deceleration: None }
    }

    /// Limits of the same joint with the velocity scaled by `share`, for a slow mode.
    #[must_use]
    pub fn slowed(self, share: f64) -> Self {
        Self { velocity: self.velocity * share, ..self }
    }

    fn is_sound(&self) -> bool {
        let rates = [self.velocity, self.acceleration, self.jerk, self.end_deceleration.unwrap_or(self.acceleration)];
        rates.iter().all(|rate| rate.is_finite() && *rate > 0.0) && self.lower < self.upper
    }
}

/// Setpoint of one joint; rad or m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct JointState {
    /// Position, rad or m.
    pub position: f64,
    /// Velocity, rad/s or m/s.
    pub velocity: f64,
    /// Acceleration, rad/s² or m/s².
    pub acceleration: f64,
}

impl JointState {
    /// Setpoint of a joint at rest.
    pub fn at_rest(position: f64) -> Self {
        Self { position, ..Self::default() }
    }

    /// Position at which the joint comes to rest if it brakes with maximum jerk and acceleration.
    pub fn stop_position(&self, limits: &JointLimits) -> f64 {
        let JointLimits { acceleration: most, jerk, .. } = *limits;
        // Velocity when the acceleration has been ramped to 0; the joint has to brake against its sign.
        let coasting = self.velocity + self.acceleration * self.acceleration.abs() / (2.0 * jerk);
        let side = if coasting < 0.0 { -1.0 } else { 1.0 };
        // A joint that already brakes harder than the limit brakes no later than one at the limit.
        let (v, a) = (side * self.velocity, (side * self.acceleration).max(-most));
        // Jerk until the acceleration is -peak, a phase of constant acceleration if -peak is the limit, then jerk back
        // to 0.
        let peak = (jerk * v + a * a / 2.0).max(0.0).sqrt().min(most);
        let first = (a + peak) / jerk;
        let pause = ((v + (a * a - 2.0 * peak * peak) / (2.0 * jerk)) / peak.max(f64::MIN_POSITIVE)).max(0.0);
        let last = peak / jerk;
        let mut way = v * first + a * first * first / 2.0 - jerk * first.powi(3) / 6.0;
        let mut speed = v + a * first - jerk * first * first / 2.0;
        if pause > 0.0 && peak >= most {
            way += speed * pause - peak * pause * pause / 2.0;
            speed -= peak * pause;
        }
        way += speed * last - peak * last * last / 2.0 + jerk * last.powi(3) / 6.0;
        self.position + side * way
    }

    /// State after one tick in which the acceleration changes linearly from its current value to `acceleration`.
    fn after(&self, acceleration: f64, tick_s: f64) -> Self {
        let change = acceleration - self.acceleration;
        Self {
            position: self.position + tick_s * (self.velocity + tick_s * (self.acceleration / 2.0 + change / 6.0)),
            velocity: self.velocity + tick_s * (self.acceleration + change / 2.0),
            acceleration,
        }
    }

    /// Minimum and maximum acceleration at the end of the next tick from which all limits can be kept for ever.
    ///
    /// The velocity v₁ + a₁²/2j, reached when the acceleration is ramped to 0, must not exceed its limit. Since jerk
    /// changes at ticks only, a₁ dt/2 is added: v₁ + a₁²/2j + a₁ dt/2 ≤ v_max with v₁ = v + (a + a₁) dt/2. The tick
    /// after that can always lower the acceleration by j dt, which preserves the inequality.
    fn viable(&self, limits: &JointLimits, tick_s: f64) -> [f64; 2] {
        let JointLimits { velocity, acceleration, jerk, .. } = *limits;
        let bound = |side: f64| {
            let (v, a) = (side * self.velocity, side * self.acceleration);
            let rest = velocity - v - a * tick_s / 2.0;
            let root = (tick_s * tick_s + 2.0 * rest.max(0.0) / jerk).sqrt();
            let by_velocity = jerk * (root - tick_s);
            side * by_velocity.min(acceleration)
        };
        let step = jerk * tick_s;
        let (least, most) = (self.acceleration - step, self.acceleration + step);
        [bound(-1.0).clamp(least, most), bound(1.0).clamp(least, most)]
    }

    /// Acceleration at the end of the first of three ticks after which the joint rests at `target`; `None` if the jerk
    /// limit does not allow that. Needed near the target, where the time-optimal switching times lie within a tick.
    fn landing(&self, target: f64, limits: &JointLimits, tick_s: f64) -> Option<f64> {
        // In units of a tick, jerks in three consecutive ticks contribute (1, 1, 1) to the acceleration after them,
        // (5/2, 3/2, 1/2) to the velocity and (19/6, 7/6, 1/6) to the position.
        let (a, v, q) = (self.acceleration * tick_s * tick_s, self.velocity * tick_s, self.position - target);
        let velocity = a / 2.0 - (v + 3.0 * a);
        let position = a / 6.0 - (q + 3.0 * v + 4.5 * a);
        let first = position - velocity;
        let second = velocity - 2.0 * first;
        let third = -a - first - second;
        let most = limits.jerk * tick_s.powi(3);
        let fits = [first, second, third].iter().all(|jerk| jerk.abs() <= most);
        fits.then(|| self.acceleration + first / (tick_s * tick_s))
    }

    /// Acceleration after one tick of the time-optimal motion to rest at `target`, within `low` and `high`.
    fn acceleration_towards(&self, target: f64, [low, high]: [f64; 2], limits: &JointLimits, tick_s: f64) -> f64 {
        if let Some(acceleration) = self.landing(target, limits, tick_s).filter(|it| (low..=high).contains(it)) {
            return acceleration;
        }
        let is_beyond = |acceleration: f64| self.after(acceleration, tick_s).stop_position(limits) > target;
        // The stop position increases with the acceleration: bisect for the acceleration whose stop position is the
        // target.
        if is_beyond(low) {
            return low;
        }
        if !is_beyond(high) {
            return high;
        }
        let (mut low, mut high) = (low, high);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            if is_beyond(middle) { high = middle } else { low = middle }
        }
        low
    }

    /// Bounds of the acceleration from which the joint can still stop before the ends of its range with the deceleration
    /// that holds there. A joint beyond an end is not driven back.
    fn before_ends(&self, bounds: [f64; 2], limits: &JointLimits, tick_s: f64) -> [f64; 2] {
        let Some(acceleration) = limits.end_deceleration else { return bounds };
        let softer = JointLimits { acceleration: acceleration.min(limits.acceleration), ..*limits };
        let towards = |end: f64| self.acceleration_towards(end, bounds, &softer, tick_s);
        let most = if self.position <= limits.upper { towards(limits.upper) } else { bounds[1] };
        let least = if self.position >= limits.lower { towards(limits.lower) } else { bounds[0] };
        [least.min(most), most]
    }

    /// State after one tick towards a target.
    ///
    /// The joint follows the moving reference as fast as it can, as seen from the reference, but never so fast that it
    /// could not come to rest at the target: a stream that ends makes no overshoot. A joint therefore lags behind, the more
    /// the less it can decelerate for its velocity. `braking_per_s`, the ratio of deceleration to velocity that every
    /// moving joint is capable of, makes the lag the same for all joints, so that the arm stays on its path.
    fn towards(&self, target: &Target, limits: &JointLimits, braking_per_s: f64, tick_s: f64) -> Self {
        let bounds = self.before_ends(self.viable(limits, tick_s), limits, tick_s);
        let share = match target.velocity {
            0.0 => 1.0,
            velocity => (braking_per_s * velocity.abs() / limits.acceleration).min(1.0),
        };
        let softer = JointLimits { acceleration: share * limits.acceleration, jerk: share * limits.jerk, ..*limits };
        let resting = self.acceleration_towards(target.position, bounds, &softer, tick_s);
        let acceleration = match target.velocity {
            0.0 => resting,
            velocity => {
                let seen = Self {
                    position: self.position - target.reference,
                    velocity: self.velocity - velocity,
                    acceleration: self.acceleration,
                };
                let following = seen.acceleration_towards(0.0, bounds, limits, tick_s);
                if velocity > 0.0 { following.min(resting) } else { following.max(resting) }
            }
        };
        self.after(acceleration, tick_s)
    }
}

/// Target of a joint, and the reference that moves there at constant velocity; rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Target {
    position: f64,
    reference: f64,
    velocity: f64,
}

impl Target {
    fn at(position: f64) -> Self {
        Self { position, reference: position, velocity: 0.0 }
    }

    /// The same reference on its way to another position, within a time.
    fn moved(&self, position: f64, over_s: f64) -> Self {
        let way = position - self.reference;
        match over_s > 0.0 && way != 0.0 {
            true => Self { position, reference: self.reference, velocity: way / over_s },
            false => Self::at(position),
        }
    }

    /// Moves the reference by one tick.
    fn tick(&mut self, tick_s: f64) {
        let step = self.velocity * tick_s;
        if (self.position - self.reference).abs() <= step.abs() {
            *self = Self::at(self.position);
        } else {
            self.reference += step;
        }
    }
}

/// Interpolator of all joints of an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolator {
    /// Limits in force, with the share of the velocity.
    limits: Vec<JointLimits>,
    /// Limits at full speed.
    full: Vec<JointLimits>,
    joints: Vec<JointState>,
    targets: Vec<Target>,
    tick_s: f64,
}

impl Interpolator {
    /// Interpolator at rest at the measured positions; `None` unless limits, positions and tick are finite and valid.
    /// Positions outside of the limits are accepted, since the arm may stand there.
    pub fn new(limits: &[JointLimits], measured: &[f64], tick_s: f64) -> Option<Self> {
        let is_sound = limits.len() == measured.len()
            && limits.iter().all(JointLimits::is_sound)
            && measured.iter().all(|position| position.is_finite())
            && (1e-5..=0.1).contains(&tick_s);
        is_sound.then(|| Self {
            limits: limits.to_vec(),
            full: limits.to_vec(),
            joints: measured.iter().map(|&position| JointState::at_rest(position)).collect(),
            targets: measured.iter().copied().map(Target::at).collect(),
            tick_s,
        })
    }

    /// Current setpoints, one per joint.
    pub fn joints(&self) -> &[JointState] {
        &self.joints
    }

    /// Time between two setpoints, s.
    pub fn tick_s(&self) -> f64 {
        self.tick_s
    }

    /// Sets new target positions, which are clamped to the limits; the reference that the joints follow moves there
    /// within `over_s`, at constant velocity. Returns false and changes nothing if a number is missing or not finite.
    pub fn aim(&mut self, targets: &[f64], over_s: f64) -> bool {
        if targets.len() != self.joints.len() || !targets.iter().all(|target| target.is_finite()) || !over_s.is_finite()
        {
            return false;
        }
        for ((target, position), limits) in self.targets.iter_mut().zip(targets).zip(&self.limits) {
            *target = target.moved(position.clamp(limits.lower, limits.upper), over_s);
        }
        true
    }

    /// Limits the velocity to a share of the maximum, for a slow mode. Changes nothing and returns false while a joint
    /// moves, or unless the share is above 0 and at most 1.
    pub fn limit_speed(&mut self, share: f64) -> bool {
        let is_sound = share > 0.0 && share <= 1.0 && self.is_at_rest();
        if is_sound {
            self.limits = self.full.iter().map(|limits| limits.slowed(share)).collect();
        }
        is_sound
    }

    /// Positions at which the joints come to rest if they brake now, rad or m.
    pub fn stop_positions(&self) -> Vec<f64> {
        self.joints.iter().zip(&self.limits).map(|(joint, limits)| joint.stop_position(limits)).collect()
    }

    /// Sets the current positions as targets of all joints; at rest, nothing moves.
    pub fn hold(&mut self) {
        self.targets = self.joints.iter().map(|joint| Target::at(joint.position)).collect();
    }

    /// Sets the setpoints to measured positions at rest, while the arm does not follow setpoints yet. Changes nothing
    /// if the number of positions is wrong.
    pub fn place(&mut self, measured: &[f64]) {
        if measured.len() == self.joints.len() {
            self.joints = measured.iter().map(|&position| JointState::at_rest(position)).collect();
            self.targets = measured.iter().copied().map(Target::at).collect();
        }
    }

    /// Brakes to rest with maximum jerk and acceleration, from the next tick on.
    pub fn brake(&mut self) {
        self.targets = self.stop_positions().into_iter().map(Target::at).collect();
    }

    /// True if no joint moves; tolerance 1 µrad/s, for rounding.
    pub fn is_at_rest(&self) -> bool {
        self.joints.iter().all(|joint| joint.velocity.abs() < 1e-6 && joint.acceleration.abs() < 1e-3)
    }

    /// Advances by one tick; returns the new setpoints.
    pub fn tick(&mut self) -> &[JointState] {
        let Self { limits, joints, targets, tick_s, .. } = self;
        let ratios = targets.iter().zip(limits.iter()).map(|(target, it)| it.acceleration / target.velocity.abs());
        let braking_per_s = ratios.fold(f64::INFINITY, f64::min);
        for ((joint, limits), target) in joints.iter_mut().zip(limits.iter()).zip(targets.iter_mut()) {
            *joint = joint.towards(target, limits, braking_per_s, *tick_s);
            target.tick(*tick_s);
        }
        &self.joints
    }
}
