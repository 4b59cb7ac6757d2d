//! The way of the tool: poses that were asked for, followed one after the other as fast as the joints may go.
//!
//! An arm of seven joints follows a tool in more than one posture, and where its own is near a singularity it may be too
//! slow for a while.
//! It is then late, and not beside the way: the tool goes on along the poses that it has not come to, until it has made
//! up for what it missed.

use genmanip_core::{Pose, RobotModel};
use genmanip_motion::InverseKinematics;

/// How quickly the posture goes back to that of the robot's home where the tool leaves it free, 1/s; chosen: slow beside
/// an action of 10 Hz, quick beside an episode.
const POSTURE_PULL_PER_S: f64 = 2.0;
/// Longest time by which the tool is late; what lies farther back on its way is given up. Chosen.
const MOST_LATE_S: f64 = 2.0;
/// Halvings in the search of how far along the way the joints can follow: to a hundredth of an action.
const HALVINGS: usize = 7;
/// Share of an action's time that is not worth another pose.
const LEAST_TIME: f64 = 1e-3;

/// What the actions so far asked for and the arm has not done yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pending {
    /// The tool pose that the last action asked for; none where the command comes from elsewhere.
    pub(super) asked: Option<Pose>,
    /// Poses on the way to it, and itself, that the tool has not come to; oldest first.
    pub(super) behind: Vec<Pose>,
    /// The configuration for the first of them that the arm goes to because it cannot follow in its own posture, rad.
    pub(super) posture: Option<Vec<f64>>,
}

/// What follows the way.
pub(super) struct Follower<'a> {
    pub(super) robot: &'a RobotModel,
    pub(super) kinematics: &'a InverseKinematics,
    /// How far each arm joint can turn while an action lasts, rad.
    pub(super) reach: &'a [f64],
    /// How long an action lasts, s.
    pub(super) duration_s: f64,
}

impl Follower<'_> {
    /// The configuration (rad, base to hand) at the end of an action that asks for a pose, from that in force, and what
    /// is then still to be done; `None` for a pose that no configuration reaches.
    pub(super) fn follow(&self, wanted: Pose, from: &[f64], late: Pending) -> Option<(Vec<f64>, Pending)> {
        let Pending { mut behind, mut posture, .. } = late;
        let most = (MOST_LATE_S / self.duration_s) as usize;
        if behind.len() > most {
            behind.drain(..behind.len() - most);
            posture = None;
        }
        if !behind.is_empty() {
            self.somehow(&wanted, from)?;
        }
        behind.push(wanted);
        let (mut arm, mut time, mut done) = (from.to_vec(), 1.0, 0);
        while done < behind.len() && time > LEAST_TIME {
            let next = &behind[done];
            let reached = match &posture {
                Some(posture) => (self.actions_to(posture, &arm) <= time).then(|| posture.clone()),
                None => self.in_time(next, &arm, time),
            };
            if let Some(reached) = reached {
                time -= self.actions_to(&reached, &arm);
                (arm, posture) = (reached, None);
                done += 1;
                continue;
            }
            if posture.is_none() {
                let (share, farthest) = self.along(next, &arm, time);
                let other = self.somehow(next, &arm)?;
                // In actions of this length: the rest of the way at this pace, or all joints at once.
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
        behind.drain(..done);
        Some((arm, Pending { asked: Some(wanted), behind, posture }))
    }

    /// A configuration for a pose that is reached in a share of an action's time; what the tool leaves free goes back
    /// towards home.
    fn in_time(&self, pose: &Pose, arm: &[f64], time: f64) -> Option<Vec<f64>> {
        let reach: Vec<f64> = self.reach.iter().map(|reach| reach * time).collect();
        let pull = (POSTURE_PULL_PER_S * self.duration_s * time).min(1.0);
        let drift = arm.iter().zip(&self.robot.home).map(|(q, home)| pull * (home - q)).collect();
        let drifting = self.kinematics.follow_drifting(pose, arm, &reach, drift);
        drifting.or_else(|| self.kinematics.follow(pose, arm, &reach))
    }

    /// How far towards a pose, as a share of the way, the tool can go in a share of an action's time, and how.
    fn along(&self, pose: &Pose, arm: &[f64], time: f64) -> (f64, Vec<f64>) {
        let reach: Vec<f64> = self.reach.iter().map(|reach| reach * time).collect();
        let here = self.robot.tcp_pose(arm);
        let (mut near, mut far, mut farthest) = (0.0, 1.0, arm.to_vec());
        for _ in 0..HALVINGS {
            let middle = (near + far) / 2.0;
            match self.kinematics.follow(&here.interpolate(pose, middle), arm, &reach) {
                Some(arm) => (near, farthest) = (middle, arm),
                None => far = middle,
            }
        }
        (near, farthest)
    }

    /// A configuration for a pose, however far from that of now.
    fn somehow(&self, pose: &Pose, arm: &[f64]) -> Option<Vec<f64>> {
        let however_far = vec![f64::INFINITY; self.reach.len()];
        let followed = self.kinematics.follow(pose, arm, &however_far);
        followed.or_else(|| self.kinematics.solutions(pose, arm).next())
    }

    /// How many actions the slowest joint needs to another configuration.
    fn actions_to(&self, to: &[f64], arm: &[f64]) -> f64 {
        let each = arm.iter().zip(to).zip(self.reach);
        each.map(|((q, to), reach)| (to - q).abs() / reach).fold(0.0, f64::max)
    }
}
