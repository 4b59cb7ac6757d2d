//! The way of the arm while it moves a joint.

use genmanip_core::{Failure, FailureCause, JointKind, Pose};
use genmanip_motion::{Allowed, CollisionWorld, Path, Planner, PlanningScene};
use genmanip_scene::relations::{PosedObject, PosedScene};
use glam::{DQuat, DVec3};

use super::contacts::of_link;
use super::{JointChange, JointContact, JointSettings, Motion};
use crate::obstacles;

/// Distance between robot and object while it is moved, but for the gap at the contact itself, metres; chosen, since the
/// hand is meant to be this near.
const CONTACT_M: f64 = 0.0005;

/// Fewest and most states tested along a joint; chosen: short ways need a middle, long ones must end.
const STEPS: [usize; 2] = [3, 60];

/// Least distance of a contact from a joint's axis that is reckoned with, metres; chosen, so that nothing is divided by 0.
const LEAST_LEVER_M: f64 = 1e-3;

/// A contact with an arm that can follow it.
#[derive(Clone, Debug)]
pub struct JointSweep {
    /// The change it makes.
    pub change: JointChange,
    /// Position at which the joint is meant to end.
    pub target: f64,
    /// The hand on the link.
    pub contact: JointContact,
    /// Arm configuration at the start.
    pub config: Vec<f64>,
    /// Straight way of the hand to that start.
    pub approach: Path,
}

/// Searches and follows the ways to make one change.
pub struct Sweeper<'a> {
    planner: &'a Planner,
    settings: &'a JointSettings,
    object: &'a PosedObject,
    change: &'a JointChange,
    /// Everything but the object.
    others: CollisionWorld,
}

impl<'a> Sweeper<'a> {
    /// A search in a scene; `None` when the change names no joint of it.
    pub fn new(
        scene: &'a PosedScene,
        change: &'a JointChange,
        planner: &'a Planner,
        settings: &'a JointSettings,
    ) -> Option<Self> {
        let object = scene.objects().nth(change.object)?;
        let others = obstacles::around(scene, Some(change.object));
        Some(Self { planner, settings, object, change, others })
    }

    /// The first sweep that is possible and that `accept` makes something of; the nearest obstacle otherwise.
    ///
    /// # Errors
    /// A failure that says how many contacts were out of reach, blocked, or could not be followed.
    pub fn search<T>(&self, reference: &[f64], accept: &mut dyn FnMut(&JointSweep) -> Option<T>) -> Result<T, Failure> {
        let name = &self.object.model.card.name;
        let mut tally = Tally::default();
        let motions: Vec<_> = self
            .change
            .targets
            .iter()
            .filter_map(|&target| {
                let motion = Motion::of(self.object, self.change, target)?;
                Some((target, motion, self.worlds(&motion, target)))
            })
            .collect();
        let link = self.object.model.links.get(self.change.link);
        let contacts = motions
            .first()
            .zip(link)
            .map(|((_, motion, _), link)| of_link(link, motion, self.planner.robot(), self.settings));
        for start in contacts.into_iter().flatten() {
            let mut configs = self.planner.ik_each(&start.world_from_tcp, reference).peekable();
            if configs.peek().is_none() {
                tally.out_of_reach += 1;
                continue;
            }
            let world = &motions[0].2[0].1;
            let nothing = Allowed::none();
            let checker = self.planner.checker(&around(world, &nothing, &start), CONTACT_M);
            let starts: Vec<_> =
                configs.filter(|config| checker.is_free(config)).take(self.settings.configurations).collect();
            if starts.is_empty() {
                tally.blocked += 1;
                continue;
            }
            let follows = if start.turns_freely { self.settings.follow.as_slice() } else { &[1.0] };
            for (&follow, (target, motion, worlds)) in follows.iter().flat_map(|f| motions.iter().map(move |m| (f, m)))
            {
                let contact = JointContact { follow, ..start.clone() };
                let found = starts
                    .iter()
                    .filter(|config| self.is_possible(motion, &contact, config, worlds, &mut tally))
                    .find_map(|config| Some((config.clone(), self.approach(&contact, config, world)?)));
                let Some((config, approach)) = found else { continue };
                tally.possible += 1;
                let sweep = JointSweep { change: self.change.clone(), target: *target, contact, config, approach };
                if let Some(result) = accept(&sweep) {
                    return Ok(result);
                }
            }
        }
        let joint = self.object.model.links.get(self.change.link).map_or("?", |link| link.name.as_str());
        let Tally { out_of_reach, blocked, unfollowed, possible } = tally;
        let evidence = format!(
            "no way to move the {joint} of {name}: {out_of_reach} contacts out of reach, {blocked} blocked, \
             {unfollowed} arm postures could not follow, {possible} could but not be got to"
        );
        Err(Failure { cause: if possible > 0 { FailureCause::Planning } else { FailureCause::NoIk }, evidence })
    }

    /// Arm configurations at `count` equal steps of the joint from its present position to `to`, the start left out.
    ///
    /// `None` when the arm cannot follow.
    pub fn follow(&self, sweep: &JointSweep, to: f64, count: usize) -> Option<Vec<Vec<f64>>> {
        let motion = Motion::of(self.object, self.change, sweep.target)?;
        let way = (1..=count)
            .map(|step| tcp_at(&motion, &sweep.contact, (to - self.change.from) * step as f64 / count as f64));
        self.planner.follow(&sweep.config, way, self.settings.max_arm_step_rad)
    }

    /// Position of the joint to which the hand is sent, a little farther than the joint is to go when it pushes.
    pub fn end(&self, sweep: &JointSweep) -> f64 {
        let motion = Motion::of(self.object, self.change, sweep.target);
        sweep.target + motion.map_or(0.0, |motion| beyond(&motion, &sweep.contact))
    }

    /// The object's surroundings and itself, joint at a position.
    pub fn world_at(&self, position: f64) -> CollisionWorld {
        let mut world = self.others.clone();
        let mut object = self.object.clone();
        if let Some(value) = object.joint_positions.get_mut(self.change.joint) {
            *value = position;
        }
        // The models' own pieces and finite poses are always accepted.
        let _ = world.add(&object.id, &object.model.pieces(&object.joint_positions), &object.pose);
        world
    }

    /// Direction in which the link moves at the contact, and how far per unit of the joint.
    pub fn velocity(&self, sweep: &JointSweep) -> (DVec3, f64) {
        let point = sweep.contact.world_from_tcp.transform_point(sweep.contact.tool_point);
        let velocity = Motion::of(self.object, self.change, sweep.target).map(|motion| motion.velocity(point));
        velocity.map_or((DVec3::ZERO, 1.0), |(direction, lever)| (direction, lever.max(LEAST_LEVER_M)))
    }

    /// Positions on the way with the world at each, the present one first.
    fn worlds(&self, motion: &Motion, target: f64) -> Vec<(f64, CollisionWorld)> {
        let size = self.object.model.world_bounds(&Pose::IDENTITY, &self.object.joint_positions).size().max_element();
        let total = (target - self.change.from).abs();
        let steps = match motion.kind {
            JointKind::Prismatic => total / self.settings.step_m,
            JointKind::Revolute => (total / self.settings.step_rad).max(total * size / self.settings.step_m / 2.0),
        };
        let steps = (steps.ceil() as usize).clamp(STEPS[0], STEPS[1]);
        (0..=steps)
            .map(|step| {
                let by = (target - self.change.from) * step as f64 / steps as f64;
                (by, self.world_at(self.change.from + by))
            })
            .collect()
    }

    /// Straight to the contact along the fingers.
    fn approach(&self, contact: &JointContact, config: &[f64], world: &CollisionWorld) -> Option<Path> {
        let nothing = Allowed::none();
        let back = contact.world_from_tcp.transform_vector(DVec3::NEG_Z) * self.settings.approach_m;
        let before = Pose { position: contact.world_from_tcp.position + back, ..contact.world_from_tcp };
        self.planner.straight(&around(world, &nothing, contact), config, &before).ok().map(Path::reversed)
    }

    fn is_possible(
        &self,
        motion: &Motion,
        contact: &JointContact,
        config: &[f64],
        worlds: &[(f64, CollisionWorld)],
        tally: &mut Tally,
    ) -> bool {
        let end = worlds.last().map_or(0.0, |(by, _)| *by) + beyond(motion, contact);
        let mut way = vec![config.to_vec()];
        for by in worlds.iter().skip(1).map(|(by, _)| *by).chain([end]) {
            let pose = tcp_at(motion, contact, by);
            let Some(next) = self.planner.ik_near(&pose, &way[way.len() - 1], self.settings.max_arm_step_rad) else {
                tally.unfollowed += 1;
                return false;
            };
            way.push(next);
        }
        let nothing = Allowed::none();
        let roomy = self.planner.checker(&around(&self.others, &nothing, contact), self.settings.room_m);
        let is_free = |(config, (_, world)): (&Vec<f64>, &(f64, CollisionWorld))| {
            self.planner.checker(&around(world, &nothing, contact), CONTACT_M).is_free(config)
        };
        way.iter().all(|config| roomy.is_free(config)) && way.iter().zip(worlds).skip(1).all(is_free)
    }
}

#[derive(Default)]
struct Tally {
    out_of_reach: usize,
    blocked: usize,
    unfollowed: usize,
    possible: usize,
}

fn around<'a>(world: &'a CollisionWorld, allowed: &'a Allowed, contact: &JointContact) -> PlanningScene<'a> {
    PlanningScene { world, attached: None, allowed, gripper_width: contact.open_width }
}

/// By how much farther than the joint the hand is sent: a push first closes the gap, and presses no more at the end.
fn beyond(motion: &Motion, contact: &JointContact) -> f64 {
    let (_, lever) = motion.velocity(contact.world_from_tcp.transform_point(contact.tool_point));
    contact.gap_m / lever.max(LEAST_LEVER_M) * motion.sign
}

/// Pose of the tcp when the joint has moved `by`.
fn tcp_at(motion: &Motion, contact: &JointContact, by: f64) -> Pose {
    let start = contact.world_from_tcp;
    match motion.kind {
        JointKind::Prismatic => Pose { position: start.position + motion.axis * by, ..start },
        JointKind::Revolute => {
            let point = start.transform_point(contact.tool_point);
            let point = motion.pivot + DQuat::from_axis_angle(motion.axis, by) * (point - motion.pivot);
            let rotation = DQuat::from_axis_angle(motion.axis, by * contact.follow) * start.rotation;
            Pose { position: point - rotation * contact.tool_point, rotation }
        }
    }
}
