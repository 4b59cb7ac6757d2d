//! Commanded pose: the twist integrated with exact composition of rotations, within limits.

use genmanip_core::Pose;
use genmanip_core::glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::mapping::{Axes, Twist};

/// Smallest fraction of a step that is tried where the arm cannot follow the whole; below it the target stays.
const LEAST_SHARE: f64 = 0.05;

/// Limits of the commanded pose, always in force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TargetSettings {
    /// Largest speed, m/s.
    pub linear_m_s: f64,
    /// Largest angular speed, rad/s.
    pub angular_rad_s: f64,
    /// Lower and upper corner of the box that the TCP stays in, in the world frame, m.
    pub workspace_m: [[f64; 3]; 2],
    /// Largest distance from the measured TCP, m: with the stiffness of the arm it bounds the contact force.
    pub lead_m: f64,
    /// Largest angle from the measured orientation, rad.
    pub lead_rad: f64,
}

impl Default for TargetSettings {
    fn default() -> Self {
        Self {
            // The reduced speed of collaborative operation in ISO 10218-1.
            linear_m_s: 0.25,
            angular_rad_s: 1.5,
            // The default table and the space above it; pads touch its top when the tool is 5 mm above.
            workspace_m: [[0.1, -0.7, 0.004], [0.95, 0.7, 0.9]],
            // Twice the tracking lag of free motion at full speed; a Panda then pushes with about 100 N.
            lead_m: 0.015,
            lead_rad: 0.2,
        }
    }
}

/// Reason why the tool moves less than commanded by the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// The largest speed.
    Speed,
    /// The border of the workspace.
    Workspace,
    /// The measured tool is as far behind as it may be: the arm is blocked, or too slow.
    Lead,
    /// A joint is at the end of its range.
    Joint,
    /// The arm is near a singularity.
    Singularity,
    /// The tool approaches the pose of a leader arm or tracker slowly, until it has caught up.
    Ramp,
    /// The arm cannot reach the pose within a control step, at its maximum joint speeds and without changing its
    /// configuration branch.
    Reach,
}

/// Commanded pose of the tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    settings: TargetSettings,
    /// `world_from_tcp`.
    pose: Pose,
}

impl Target {
    /// Target at a pose.
    pub fn new(settings: TargetSettings, world_from_tcp: Pose) -> Self {
        Self { settings, pose: world_from_tcp }
    }

    /// `world_from_tcp`.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Replaces the commanded pose, e.g. by the pose in force after the adapter has refused one.
    pub fn place(&mut self, world_from_tcp: Pose) {
        self.pose = world_from_tcp;
    }

    /// Moves the target along a twist for `period_s` (s) and returns the limits that were in force. `measured` is
    /// `world_from_tcp` as measured.
    ///
    /// Where `can_follow` rejects the new pose, the step is halved, in the same direction, down to a twentieth; below
    /// that the target stays.
    pub fn advance(
        &mut self,
        twist: &Twist,
        period_s: f64,
        measured: &Pose,
        can_follow: impl Fn(&Pose) -> bool,
    ) -> Vec<Limit> {
        let mut limits = Vec::new();
        if !twist.is_zero() {
            let linear = twist.linear_m_s.clamp_length_max(self.settings.linear_m_s);
            let angular = twist.angular_rad_s.clamp_length_max(self.settings.angular_rad_s);
            if linear != twist.linear_m_s || angular != twist.angular_rad_s {
                limits.push(Limit::Speed);
            }
            let twist = Twist { linear_m_s: linear, angular_rad_s: angular, ..*twist };
            let mut share = 1.0;
            loop {
                let next = moved(&self.pose, &twist, share * period_s);
                let (next, is_outside) = self.inside(next);
                let (next, is_ahead) = self.near(next, measured);
                if next == self.pose || can_follow(&next) {
                    limits.extend(is_outside.then_some(Limit::Workspace));
                    limits.extend(is_ahead.then_some(Limit::Lead));
                    self.pose = next;
                    break;
                }
                share /= 2.0;
                if share < LEAST_SHARE {
                    break;
                }
            }
            limits.extend((share < 1.0).then_some(Limit::Reach));
        }
        if self.pull(measured) && !limits.contains(&Limit::Lead) {
            limits.push(Limit::Lead);
        }
        limits
    }

    /// A pose clamped to the workspace, and true if that changed it; a target outside may only come nearer.
    fn inside(&self, next: Pose) -> (Pose, bool) {
        let [lower, upper] = self.settings.workspace_m.map(DVec3::from_array);
        let now = self.pose.position;
        let position = next.position.clamp(lower.min(now), upper.max(now));
        (Pose { position, ..next }, position != next.position)
    }

    /// Keeps position or rotation if its step would exceed the allowed lead over the measured pose and increase it; the
    /// flag is true if either was kept.
    fn near(&self, next: Pose, measured: &Pose) -> (Pose, bool) {
        let TargetSettings { lead_m, lead_rad, .. } = self.settings;
        let distance_m = next.position.distance(measured.position);
        let is_far = distance_m > lead_m && distance_m > self.pose.position.distance(measured.position);
        let angle_rad = next.angle_to(measured);
        let is_turned = angle_rad > lead_rad && angle_rad > self.pose.angle_to(measured);
        let position = if is_far { self.pose.position } else { next.position };
        let rotation = if is_turned { self.pose.rotation } else { next.rotation };
        (Pose { position, rotation }, is_far || is_turned)
    }

    /// Pulls the target back to the allowed lead if it exceeds it, e.g. because the arm was pushed away; returns true
    /// if so.
    fn pull(&mut self, measured: &Pose) -> bool {
        let TargetSettings { lead_m, lead_rad, .. } = self.settings;
        let (distance_m, angle_rad) = (self.pose.position.distance(measured.position), self.pose.angle_to(measured));
        if distance_m > lead_m {
            self.pose.position = measured.position.lerp(self.pose.position, lead_m / distance_m);
        }
        if angle_rad > lead_rad {
            self.pose.rotation = measured.rotation.slerp(self.pose.rotation, lead_rad / angle_rad).normalize();
        }
        distance_m > lead_m || angle_rad > lead_rad
    }
}

/// `world_from_tcp` after moving along a twist for `period_s` (s).
///
/// The rotation is composed by the exponential map. A translation in the tool's frame uses the orientation half-way, so
/// that the opposite twist leads back exactly.
fn moved(world_from_tcp: &Pose, twist: &Twist, period_s: f64) -> Pose {
    let Pose { position, rotation } = *world_from_tcp;
    let way = twist.linear_m_s * period_s;
    let turn = twist.angular_rad_s * period_s;
    match twist.axes {
        Axes::World(world_from_axes) => {
            let rotation = match turn == DVec3::ZERO {
                true => rotation,
                false => (DQuat::from_scaled_axis(world_from_axes * turn) * rotation).normalize(),
            };
            Pose { position: position + world_from_axes * way, rotation }
        }
        Axes::Tool(tcp_from_axes) => {
            let turn = tcp_from_axes * turn;
            let half_way = rotation * DQuat::from_scaled_axis(turn / 2.0);
            let rotation = match turn == DVec3::ZERO {
                true => rotation,
                false => (rotation * DQuat::from_scaled_axis(turn)).normalize(),
            };
            Pose { position: position + half_way * (tcp_from_axes * way), rotation }
        }
    }
}
