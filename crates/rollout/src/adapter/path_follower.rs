//! Follows the tool path: the requested poses, in order, as fast as the joint limits allow.
//!
//! A seven-joint arm can follow a tool pose in several postures, and near a singularity its current one may be too
//! slow. The tool then lags behind but stays on its path: it visits the pending poses until it has caught up.

use genmanip_core::{Pose, RobotModel};
use genmanip_motion::InverseKinematics;

/// Rate at which the posture returns to the robot's home in the null space, 1/s. Chosen by hand: slow compared with an
/// action at 10 Hz, fast compared with an episode.
const POSTURE_PULL_PER_S: f64 = 2.0;
/// Maximum lag of the tool behind the path, s; older poses of the path are dropped. Chosen by hand.
const MAX_LAG_S: f64 = 2.0;
/// Bisection steps for the reachable share of a path segment: precision of a hundredth of an action.
const BISECTIONS: usize = 7;
/// Minimum remaining share of an action's duration to start another pose. Chosen by hand.
const MIN_TIME: f64 = 1e-3;

/// Requested path that the arm has not executed yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pending {
    /// Tool pose requested by the last action; `None` if the command in force has another source.
    pub(super) requested: Option<Pose>,
    /// Poses up to and including the requested one that the tool has not reached; oldest first.
    pub(super) path: Vec<Pose>,
    /// Configuration (rad) of the first pose of `path` in another posture, to which the arm moves because it cannot
    /// follow the path in its own. `None` while it can.
    pub(super) posture: Option<Vec<f64>>,
}

/// Follower of the tool path for one action.
pub(super) struct Follower<'a> {
    pub(super) robot: &'a RobotModel,
    pub(super) kinematics: &'a InverseKinematics,
    /// Maximum rotation of each arm joint during an action, rad.
    pub(super) reach: &'a [f64],
    /// Duration of an action, s.
    pub(super) duration_s: f64,
}

impl Follower<'_> {
    /// Arm configuration (rad, base to tip) at the end of an action that requests the pose `requested`, starting from
    /// `from`, and the remaining path; `None` if the pose is unreachable.
    pub(super) fn follow(&self, requested: Pose, from: &[f64], pending: Pending) -> Option<(Vec<f64>, Pending)> {
        let Pending { mut path, mut posture, .. } = pending;
        let max_poses = (MAX_LAG_S / self.duration_s) as usize;
        if path.len() > max_poses {
            path.drain(..path.len() - max_poses);
            posture = None;
        }
        if !path.is_empty() {
            self.any_configuration(&requested, from)?;
        }
        path.push(requested);
        let (mut arm, mut time, mut done) = (from.to_vec(), 1.0, 0);
        while done < path.len() && time > MIN_TIME {
            let next = &path[done];
            let reached = match &posture {
                Some(posture) => (self.actions_to(posture, &arm) <= time).then(|| posture.clone()),
                None => self.reached_in_time(next, &arm, time),
            };
            if let Some(reached) = reached {
                time -= self.actions_to(&reached, &arm);
                (arm, posture) = (reached, None);
                done += 1;
                continue;
            }
            if posture.is_none() {
                let (share, farthest) = self.partway(next, &arm, time);
                let other = self.any_configuration(next, &arm)?;
                // Compares durations in units of actions: the rest of the path at this pace, and a joint motion to the
                // other posture.
                if share * self.actions_to(&other, &arm) < time {
                    posture = Some(other);
                } else {
                    arm = farthest;
                    break;
                }
            }
            if let Some(posture) = &posture {
                let share = (time / self.actions_to(posture, &arm)).min(1.0);
                arm = arm.iter().zip(posture).map(|(q, to)| q + share * (to - q)).collect();
            }
            break;
        }
        path.drain(..done);
        Some((arm, Pending { requested: Some(requested), path, posture }))
    }

    /// Configuration of a pose that is reachable within the share `time` of an action, with null-space drift towards
    /// home; `None` if it is not reachable in time.
    fn reached_in_time(&self, pose: &Pose, arm: &[f64], time: f64) -> Option<Vec<f64>> {
        let reach: Vec<f64> = self.reach.iter().map(|reach| reach * time).collect();
        let pull = (POSTURE_PULL_PER_S * self.duration_s * time).min(1.0);
        let drift = arm.iter().zip(&self.robot.home).map(|(q, home)| pull * (home - q)).collect();
        let drifting = self.kinematics.follow_drifting(pose, arm, &reach, drift);
        drifting.or_else(|| self.kinematics.follow(pose, arm, &reach))
    }

    /// Share of the path segment to a pose that is reachable within the share `time` of an action, and the
    /// configuration there.
    fn partway(&self, pose: &Pose, arm: &[f64], time: f64) -> (f64, Vec<f64>) {
        let reach: Vec<f64> = self.reach.iter().map(|reach| reach * time).collect();
        let here = self.robot.tcp_pose(arm);
        let (mut near, mut far, mut farthest) = (0.0, 1.0, arm.to_vec());
        for _ in 0..BISECTIONS {
            let middle = (near + far) / 2.0;
            match self.kinematics.follow(&here.interpolate(pose, middle), arm, &reach) {
                Some(arm) => (near, farthest) = (middle, arm),
                None => far = middle,
            }
        }
        (near, farthest)
    }

    /// Configuration of a pose at any joint distance; `None` if the pose is unreachable.
    fn any_configuration(&self, pose: &Pose, arm: &[f64]) -> Option<Vec<f64>> {
        let unlimited = vec![f64::INFINITY; self.reach.len()];
        let followed = self.kinematics.follow(pose, arm, &unlimited);
        followed.or_else(|| self.kinematics.solutions(pose, arm).next())
    }

    /// Number of actions that the slowest joint needs to reach another configuration.
    fn actions_to(&self, to: &[f64], arm: &[f64]) -> f64 {
        let each = arm.iter().zip(to).zip(self.reach);
        each.map(|((q, to), reach)| (to - q).abs() / reach).fold(0.0, f64::max)
    }
}
