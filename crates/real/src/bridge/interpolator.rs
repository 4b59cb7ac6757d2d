//! Setpoints at a fixed rate within limits of velocity, acceleration and jerk.

use serde::{Deserialize, Serialize};

/// Halvings of the interval of accelerations: its 2^-30th part is far below any drive's resolution.
const HALVINGS: usize = 30;

/// Limits of one joint; rad or m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// Least position.
    pub lower: f64,
    /// Largest position.
    pub upper: f64,
    /// Largest velocity, per s.
    pub velocity: f64,
    /// Largest acceleration, per s².
    pub acceleration: f64,
    /// Largest jerk, per s³.
    pub jerk: f64,
}

impl JointLimits {
    /// Joints of a Franka Panda, as its documentation gives them.
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
        Self { lower, upper, velocity, acceleration, jerk }
    }

    /// The same joint at a share of its velocity: slow mode.
    #[must_use]
    pub fn slowed(self, share: f64) -> Self {
        Self { velocity: self.velocity * share, ..self }
    }

    fn is_sound(&self) -> bool {
        let rates = [self.velocity, self.acceleration, self.jerk];
        rates.iter().all(|rate| rate.is_finite() && *rate > 0.0) && self.lower < self.upper
    }
}

/// Setpoint of one joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct JointState {
    /// Position.
    pub position: f64,
    /// Velocity, per s.
    pub velocity: f64,
    /// Acceleration, per s².
    pub acceleration: f64,
}

impl JointState {
    /// A joint at rest.
    pub fn at_rest(position: f64) -> Self {
        Self { position, ..Self::default() }
    }

    /// Position at which the joint comes to rest if it brakes as fast as acceleration and jerk allow.
    pub fn stop_position(&self, limits: &JointLimits) -> f64 {
        let JointLimits { acceleration: most, jerk, .. } = *limits;
        // Velocity once the acceleration is gone; its sign is the side to which the joint has to brake.
        let coasting = self.velocity + self.acceleration * self.acceleration.abs() / (2.0 * jerk);
        let side = if coasting < 0.0 { -1.0 } else { 1.0 };
        let (v, a) = (side * self.velocity, side * self.acceleration);
        // Jerk against the motion down to an acceleration of -peak, a pause if that is the limit, jerk back to none.
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

    /// State after a tick in which the acceleration changes linearly to `acceleration`.
    fn after(&self, acceleration: f64, tick_s: f64) -> Self {
        let change = acceleration - self.acceleration;
        Self {
            position: self.position + tick_s * (self.velocity + tick_s * (self.acceleration / 2.0 + change / 6.0)),
            velocity: self.velocity + tick_s * (self.acceleration + change / 2.0),
            acceleration,
        }
    }

    /// Accelerations after the next tick from which all limits can be kept for ever.
    ///
    /// The velocity at which the acceleration is gone, with at most one tick that is not used in full, must not exceed
    /// its limit: v₁ + a₁²/2j + a₁ dt/2 ≤ v_max with v₁ = v + (a + a₁) dt/2. The tick after that can always lower the
    /// acceleration by j dt, which keeps the inequality.
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

    /// Acceleration after the first of three ticks that end at rest on `target`, if the jerk limit allows them: near the
    /// target the fastest way is shorter than a tick, and its switching times cannot be met.
    fn landing(&self, target: f64, limits: &JointLimits, tick_s: f64) -> Option<f64> {
        // In units of a tick: contributions of three jerks to acceleration, velocity and position after three ticks are
        // (1, 1, 1), (5/2, 3/2, 1/2) and (19/6, 7/6, 1/6).
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

    /// State after a tick on the fastest way to rest at `target`.
    fn towards(&self, target: f64, limits: &JointLimits, tick_s: f64) -> Self {
        let [mut low, mut high] = self.viable(limits, tick_s);
        if let Some(acceleration) = self.landing(target, limits, tick_s).filter(|it| (low..=high).contains(it)) {
            return self.after(acceleration, tick_s);
        }
        let is_beyond = |acceleration: f64| self.after(acceleration, tick_s).stop_position(limits) > target;
        // The position of rest grows with the acceleration: the right one puts it on the target.
        if is_beyond(low) {
            return self.after(low, tick_s);
        }
        if !is_beyond(high) {
            return self.after(high, tick_s);
        }
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            if is_beyond(middle) { high = middle } else { low = middle }
        }
        self.after(low, tick_s)
    }
}

/// Interpolator of all joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolator {
    limits: Vec<JointLimits>,
    joints: Vec<JointState>,
    targets: Vec<f64>,
    tick_s: f64,
}

impl Interpolator {
    /// At rest where the arm is; `None` unless limits, positions and tick are sound. Positions outside of their limits
    /// are taken as they are: the arm may stand there.
    pub fn new(limits: &[JointLimits], measured: &[f64], tick_s: f64) -> Option<Self> {
        let is_sound = limits.len() == measured.len()
            && limits.iter().all(JointLimits::is_sound)
            && measured.iter().all(|position| position.is_finite())
            && (1e-5..=0.1).contains(&tick_s);
        is_sound.then(|| Self {
            limits: limits.to_vec(),
            joints: measured.iter().map(|&position| JointState::at_rest(position)).collect(),
            targets: measured.to_vec(),
            tick_s,
        })
    }

    /// Setpoints, one per joint.
    pub fn joints(&self) -> &[JointState] {
        &self.joints
    }

    /// Time between two setpoints, s.
    pub fn tick_s(&self) -> f64 {
        self.tick_s
    }

    /// New positions to come to rest at; they are clamped to the limits. Returns false and changes
    /// nothing if their number is wrong or one is not finite.
    pub fn aim(&mut self, targets: &[f64]) -> bool {
        if targets.len() != self.joints.len() || !targets.iter().all(|target| target.is_finite()) {
            return false;
        }
        self.targets = targets.iter().zip(&self.limits).map(|(target, it)| target.clamp(it.lower, it.upper)).collect();
        true
    }

    /// Comes to rest where the joints are; at rest, nothing moves.
    pub fn hold(&mut self) {
        self.targets = self.joints.iter().map(|joint| joint.position).collect();
    }

    /// Puts the setpoints where the arm was measured at rest: for an arm that does not follow them yet. Changes nothing
    /// if the number of positions is wrong.
    pub fn place(&mut self, measured: &[f64]) {
        if measured.len() == self.joints.len() {
            self.joints = measured.iter().map(|&position| JointState::at_rest(position)).collect();
            self.targets = measured.to_vec();
        }
    }

    /// Brakes as fast as acceleration and jerk allow, from the next tick on.
    pub fn brake(&mut self) {
        self.targets =
            self.joints.iter().zip(&self.limits).map(|(joint, limits)| joint.stop_position(limits)).collect();
    }

    /// True if no joint moves: to rounding, 1 µrad/s.
    pub fn is_at_rest(&self) -> bool {
        self.joints.iter().all(|joint| joint.velocity.abs() < 1e-6 && joint.acceleration.abs() < 1e-3)
    }

    /// Advances by one tick.
    pub fn tick(&mut self) -> &[JointState] {
        let Self { limits, joints, targets, tick_s } = self;
        for ((joint, limits), target) in joints.iter_mut().zip(limits.iter()).zip(targets.iter()) {
            *joint = joint.towards(*target, limits, *tick_s);
        }
        &self.joints
    }
}
