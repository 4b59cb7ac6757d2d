//! Fit of a skill to a scene: inverse kinematics and collisions along all its segments, before any physics.

use std::cell::OnceCell;

use genmanip_core::glam::DVec3;
use genmanip_core::{JointKind, Pose};
use genmanip_layout::articulation::JointChange;
use genmanip_layout::obstacles;
use genmanip_motion::{AllowedCollisions, Checker, CollisionWorld, Planner, PlanningScene};
use genmanip_relations::{PosedObject, PosedScene};
use serde::{Deserialize, Serialize};

use crate::handle::{Handle, flipped, rescaled};
use crate::skill::{Grip, JointMotion};
use crate::way::{at_share, dense};

/// Settings of the search for a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FitSettings {
    /// Clearances to everything but the moved object that are distinguished, largest first, m; the last one is needed.
    pub clearances_m: Vec<f64>,
    /// Clearance to the moved object, m; small, since the hand works at this distance.
    pub contact_m: f64,
    /// Distance by which a pushing finger stays off the face that it touched in the source, and by which it then goes
    /// further, m.
    pub ease_m: f64,
    /// Free space between pads and handle on both sides together, with which the grasp is checked, m.
    pub finger_clearance_m: f64,
    /// Arm configurations tried per skill and way to hold the handle.
    pub configurations: usize,
    /// Largest change of an arm joint between two states along a segment, rad.
    pub max_arm_step_rad: f64,
    /// Shares of the hand's rotation in the source that it makes along a joint whose handle pivots between the pads, in
    /// the order tried.
    pub pivot_shares: Vec<f64>,
    /// Distance to a joint limit from which more does not count, rad.
    pub enough_margin_rad: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            // The last one is `JointSettings::room_m`.
            clearances_m: vec![0.03, 0.015, 0.003],
            // As for the analytic motions of `layout::articulation`.
            contact_m: 0.0005,
            ease_m: 0.002,
            finger_clearance_m: 0.016,
            configurations: 6,
            max_arm_step_rad: 0.3,
            pivot_shares: vec![1.0, 0.5, 0.0],
            // Chosen: the arm's drives overshoot by less than a hundredth of it.
            enough_margin_rad: 0.3,
        }
    }
}

/// States along a joint's travel that are checked; 2 cm apart for a door of 25 cm that opens by a right angle.
const STATES: usize = 24;
/// Largest distance of two checked states of approach and retreat, m.
const SPACING_M: f64 = 0.01;
/// Cosine of the angle between the closing direction and a joint's axis from which on a handle pivots.
const PIVOTS: f64 = 0.98;
/// Smallest lever of a contact about the joint's axis, m, to avoid division by zero.
const MIN_LEVER_M: f64 = 1e-3;

/// A skill fitted to a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Index of the skill among those given.
    pub skill: usize,
    /// Smallest distance of an arm joint to the end of its range, rad.
    pub margin_rad: f64,
    /// Clearance to everything but the moved object that the arm keeps, of those distinguished, m.
    pub clearance_m: f64,
    /// Arm configurations of the approach, the last one at the contact.
    pub approach: Vec<Vec<f64>>,
    /// Arm configurations from the contact on: at equal shares of the joint's travel, or of the lift.
    pub along: Vec<Vec<f64>>,
    /// Arm configurations of the retreat; only the last one of `along` where the source's retreat is blocked.
    pub retreat: Vec<Vec<f64>>,
    /// Length of the hand's way in contact, m.
    pub length_m: f64,
    /// Opening of the gripper in the approach and the retreat, m.
    pub open_width_m: f64,
}

impl Fit {
    /// Value by which sources are chosen: the smaller of both margins as a share of what is enough, larger is better.
    pub(crate) fn score(&self, settings: &FitSettings) -> f64 {
        let most_m = settings.clearances_m.first().copied().unwrap_or(1.0);
        (self.margin_rad / settings.enough_margin_rad).min(1.0).min(self.clearance_m / most_m)
    }
}

/// Reasons why skills do not fit, counted over skills, ways to hold and arm configurations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Misfits {
    /// The contact is out of the arm's reach.
    pub out_of_reach: usize,
    /// Something is in the way of the contact.
    pub blocked: usize,
    /// The arm cannot follow the approach or the joint.
    pub unfollowed: usize,
    /// Something is in the way of the approach or the motion.
    pub collides: usize,
    /// The object cannot be put down at any goal pose.
    pub unplaced: usize,
}

/// Fits of skills (motion and grip) to a joint change, the best first; one per skill and way to hold the handle.
pub fn fit_joint(
    scene: &PosedScene,
    change: &JointChange,
    planner: &Planner,
    skills: &[(&JointMotion, Grip)],
    reference: &[f64],
    settings: &FitSettings,
) -> (Vec<Fit>, Misfits) {
    let (mut fits, mut misfits) = (Vec::new(), Misfits::default());
    let Some(object) = scene.objects().nth(change.object) else { return (fits, misfits) };
    let Some(handle) = Handle::of(&object.model, change.link, change.joint) else { return (fits, misfits) };
    let others = obstacles::around(scene, Some(change.object));
    for &nominal in &change.targets {
        for (index, (motion, grip)) in skills.iter().enumerate() {
            let target = change.from + (nominal - change.from) * motion.travelled();
            let place = Place { object, handle: &handle, change, target, planner, others: &others, settings };
            // A handle that pivots between the pads leaves the hand's tilt free.
            let shares = if place.pivots(motion, *grip) { settings.pivot_shares.as_slice() } else { &[1.0] };
            for turned in [false, true] {
                let mut tilts = shares.iter().map(|share| Hold { turned, share: *share });
                fits.extend(tilts.find_map(|hold| place.fit(index, motion, *grip, hold, reference, &mut misfits)));
            }
        }
        if !fits.is_empty() {
            break;
        }
    }
    fits.sort_by(|a, b| b.score(settings).total_cmp(&a.score(settings)));
    (fits, misfits)
}

/// A way to hold the handle.
#[derive(Clone, Copy)]
struct Hold {
    /// True if the fingers are exchanged.
    turned: bool,
    /// Share of the hand's rotation along the joint in the source that it makes.
    share: f64,
}

/// A joint change in a scene.
struct Place<'a> {
    object: &'a PosedObject,
    handle: &'a Handle,
    change: &'a JointChange,
    target: f64,
    planner: &'a Planner,
    /// Obstacles without the object.
    others: &'a CollisionWorld,
    settings: &'a FitSettings,
}

/// Poses of a skill in the scene, `world_from_tcp`.
pub(crate) struct Poses {
    pub approach: Vec<Pose>,
    pub along: Vec<Pose>,
    pub retreat: Vec<Pose>,
}

impl Place<'_> {
    fn handle_at(&self, position: f64) -> Pose {
        self.handle.world_pose(&self.object.model, &self.object.pose, &self.object.joint_positions, position)
    }

    /// Position of the joint at a share of the travel, rad or m; a push goes on by the distance (m) that its finger
    /// stays off the face.
    fn position(&self, share: f64, ease_m: f64) -> f64 {
        let travel = self.target - self.change.from;
        let near_m = self.handle_at(self.change.from + 0.02 * travel).position.distance(self.start().position);
        let lever = near_m / (0.02 * travel).abs();
        self.change.from + (travel + ease_m / lever.max(MIN_LEVER_M) * travel.signum()) * share
    }

    /// True if the fingers close along the axis of a revolute joint.
    fn pivots(&self, motion: &JointMotion, grip: Grip) -> bool {
        let joint = self.object.model.links.get(self.handle.link).and_then(|link| link.joint.as_ref());
        let Some(axis) = joint.filter(|joint| joint.kind == JointKind::Revolute).map(|joint| joint.axis) else {
            return false;
        };
        let closing = motion.along[0].rotation * DVec3::Y;
        matches!(grip, Grip::Grasp { .. }) && closing.dot(axis).abs() > PIVOTS
    }

    /// `world_from_handle` at the start.
    fn start(&self) -> Pose {
        self.handle_at(self.change.from)
    }

    /// Distance by which the fingers of a grip stay off the face that they pushed in the source, m.
    fn ease_m(&self, grip: Grip) -> f64 {
        if matches!(grip, Grip::Fixed { .. }) { self.settings.ease_m } else { 0.0 }
    }

    fn poses(&self, motion: &JointMotion, grip: Grip, hold: Hold) -> Poses {
        let (start, ease_m) = (self.start(), self.ease_m(grip));
        let near = self.handle_at(self.position(0.02, 0.0)).position - start.position;
        let direction = start.rotation.inverse() * near.normalize_or_zero();
        let own = |pose: &Pose| {
            let pose = rescaled(pose, motion.handle_half_m, self.handle.half_m);
            let pose = Pose { position: pose.position - direction * ease_m, ..pose };
            if hold.turned { flipped(&pose) } else { pose }
        };
        let along: Vec<Pose> = motion.along.iter().map(own).collect();
        let contact = start * along[0];
        let at = |state: usize| {
            let share = state as f64 / STATES as f64;
            let pose = self.handle_at(self.position(share, ease_m)) * at_share(&along, share);
            Pose { rotation: contact.rotation.slerp(pose.rotation, hold.share), ..pose }
        };
        let mut approach: Vec<Pose> = motion.approach.iter().map(|pose| start * own(pose)).collect();
        // The contact is the first pose of the manipulation.
        approach.pop();
        approach.push(contact);
        let end = self.handle_at(self.target);
        let retreat: Vec<Pose> = motion.retreat.iter().map(|pose| end * own(pose)).collect();
        Poses {
            approach: dense(&approach, SPACING_M),
            along: (0..=STATES).map(at).collect(),
            retreat: dense(&retreat, SPACING_M),
        }
    }

    fn fit(
        &self,
        skill: usize,
        motion: &JointMotion,
        grip: Grip,
        hold: Hold,
        reference: &[f64],
        misfits: &mut Misfits,
    ) -> Option<Fit> {
        let poses = self.poses(motion, grip, hold);
        let widest_m = self.planner.robot().gripper.max_width;
        let (open_width_m, held_width_m) = match grip {
            Grip::Fixed { width_m } => (width_m, width_m),
            Grip::Grasp { width_m, .. } => {
                let closing = motion.along[0].rotation * DVec3::Y;
                let wider = 2.0 * closing.abs().dot(self.handle.half_m - motion.handle_half_m);
                let held_m = width_m + wider + self.settings.finger_clearance_m;
                if held_m > widest_m {
                    misfits.blocked += 1;
                    return None;
                }
                (widest_m, held_m)
            }
        };
        let nothing = AllowedCollisions::none();
        let ease_m = self.ease_m(grip);
        // The object moves as far as the hand goes, so that a finger keeps its distance to the end.
        let worlds: Vec<CollisionWorld> =
            (0..=STATES).map(|state| self.world_at(self.position(state as f64 / STATES as f64, ease_m))).collect();
        let around =
            |world, width: f64| PlanningScene { world, attached: None, allowed: &nothing, gripper_width: width };
        let object =
            |state: usize, width: f64| self.planner.checker(&around(&worlds[state], width), self.settings.contact_m);
        let before = object(0, open_width_m);
        let after = object(STATES, open_width_m);
        let during: Vec<OnceCell<Checker>> = (0..=STATES).map(|_| OnceCell::new()).collect();
        let held =
            |state: usize, config: &[f64]| during[state].get_or_init(|| object(state, held_width_m)).is_free(config);
        let clearances: Vec<Checker> = self
            .settings
            .clearances_m
            .iter()
            .map(|clearance_m| self.planner.checker(&around(self.others, open_width_m), *clearance_m))
            .collect();

        let way = Way {
            poses: &poses,
            before: &|config| before.is_free(config),
            reaches: &|config| before.gripper_is_free(config),
            held: &held,
            after: &|config| after.is_free(config),
            clearances: &clearances,
            open_width_m,
        };
        way.fit(self.planner, skill, reference, self.settings, misfits)
    }

    /// The object alone, with its joint at a position.
    fn world_at(&self, position: f64) -> CollisionWorld {
        let mut world = CollisionWorld::new();
        let mut positions = self.object.joint_positions.clone();
        if let Some(own) = positions.get_mut(self.change.joint) {
            *own = position;
        }
        // The models' own pieces and finite poses are always accepted.
        let _ = world.add(self.object.id.as_str(), &self.object.model.pieces(&positions), &self.object.pose);
        world
    }
}

/// A way of the hand, and the checks along it.
pub(crate) struct Way<'a> {
    /// Poses to follow.
    pub poses: &'a Poses,
    /// True if the arm is free on the approach.
    pub before: &'a dyn Fn(&[f64]) -> bool,
    /// True if the hand alone is free at the contact.
    pub reaches: &'a dyn Fn(&[f64]) -> bool,
    /// True if the arm is free in a state, by its index, of the motion in contact.
    pub held: &'a dyn Fn(usize, &[f64]) -> bool,
    /// True if the arm is free on the retreat.
    pub after: &'a dyn Fn(&[f64]) -> bool,
    /// Checkers of [`FitSettings::clearances_m`].
    pub clearances: &'a [Checker<'a>],
    /// Opening of the gripper in the approach and the retreat, m.
    pub open_width_m: f64,
}

impl Way<'_> {
    /// The best arm configurations along the way.
    pub(crate) fn fit(
        &self,
        planner: &Planner,
        skill: usize,
        reference: &[f64],
        settings: &FitSettings,
        misfits: &mut Misfits,
    ) -> Option<Fit> {
        let contact = self.poses.along.first()?;
        let mut configs = planner.ik_coarse(contact, reference).peekable();
        let Some(first) = configs.peek() else {
            misfits.out_of_reach += 1;
            return None;
        };
        if !(self.reaches)(first) {
            misfits.blocked += 1;
            return None;
        }
        let mut best: Option<Fit> = None;
        for config in
            configs.filter(|config| (self.before)(config) && (self.held)(0, config)).take(settings.configurations)
        {
            let step_rad = settings.max_arm_step_rad;
            let follow = |poses: &mut dyn Iterator<Item = Pose>, from: &[f64]| planner.follow(from, poses, step_rad);
            let approach = follow(&mut self.poses.approach.iter().rev().copied(), &config);
            let along = follow(&mut self.poses.along.iter().copied(), &config);
            let (Some(mut approach), Some(along)) = (approach, along) else {
                misfits.unfollowed += 1;
                continue;
            };
            approach.reverse();
            let is_free = approach.iter().all(|config| (self.before)(config))
                && along.iter().enumerate().all(|(state, config)| (self.held)(state, config));
            if !is_free {
                misfits.collides += 1;
                continue;
            }
            let states = || approach.iter().chain(&along);
            let kept = self.clearances.iter().position(|checker| states().all(|config| checker.is_free(config)));
            let Some(kept) = kept else {
                misfits.collides += 1;
                continue;
            };
            let end = along.last().cloned().unwrap_or_default();
            let retreat = follow(&mut self.poses.retreat.iter().copied(), &end)
                .filter(|states| states.iter().all(|config| (self.after)(config)))
                .unwrap_or_default();
            let found = Fit {
                skill,
                margin_rad: states().map(|config| margin_rad(planner, config)).fold(f64::INFINITY, f64::min),
                clearance_m: settings.clearances_m[kept],
                length_m: self.poses.along.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum(),
                open_width_m: self.open_width_m,
                approach,
                along,
                retreat: std::iter::once(end).chain(retreat).collect(),
            };
            let is_better = best.as_ref().is_none_or(|best| found.score(settings) > best.score(settings));
            if is_better {
                best = Some(found);
            }
        }
        best
    }
}

/// Smallest distance of a configuration to the end of a joint's range, rad.
pub(crate) fn margin_rad(planner: &Planner, config: &[f64]) -> f64 {
    let ranges = planner.ranges();
    let margins = ranges.iter().zip(config).map(|(range, q)| (q - range.start()).min(range.end() - q));
    margins.fold(f64::INFINITY, f64::min)
}
