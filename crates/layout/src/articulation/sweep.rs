//! The way of the arm while it moves a joint.

use genmanip_core::{Failure, FailureCause, JointKind, Pose};
use genmanip_motion::{Allowed, CollisionWorld, Path, Planner, PlanningScene};
use genmanip_relations::{PosedObject, PosedScene};
use glam::{DQuat, DVec3};

use super::contacts::of_link;
use super::ways::{Checkers, Way};
use super::{JointChange, JointContact, JointSettings, Motion};
use crate::obstacles;

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
        let ways: Vec<Way> = self.change.targets.iter().filter_map(|&target| self.way(target)).collect();
        let link = self.object.model.links.get(self.change.link);
        let contacts =
            ways.first().zip(link).map(|(way, link)| of_link(link, &way.motion, self.planner.robot(), self.settings));
        let nothing = Allowed::none();
        let mut known: Vec<Checkers> = Vec::new();
        for start in contacts.into_iter().flatten() {
            let mut configs = self.planner.ik_coarse(&start.world_from_tcp, reference).peekable();
            if configs.peek().is_none() {
                tally.out_of_reach += 1;
                continue;
            }
            let at = known.iter().position(|checkers| checkers.width == start.open_width).unwrap_or_else(|| {
                // Pushes share one width; every hold has its own.
                known.retain(|checkers| checkers.width == 0.0);
                let others = (&self.others, self.settings.room_m);
                known.push(Checkers::new(self.planner, &nothing, &ways, others, start.open_width));
                known.len() - 1
            });
            let checkers = &known[at];
            if configs.peek().is_none_or(|config| !checkers.hand_is_free(config)) {
                tally.blocked += 1;
                continue;
            }
            let mut starts: Vec<_> =
                configs.filter(|config| checkers.is_free(0, 0, config)).take(self.settings.configurations).collect();
            if starts.is_empty() {
                tally.blocked += 1;
                continue;
            }
            starts.retain(|config| checkers.has_room(config));
            let follows = if start.turns_freely { self.settings.follow.as_slice() } else { &[1.0] };
            for (&follow, (index, way)) in follows.iter().flat_map(|f| ways.iter().enumerate().map(move |w| (f, w))) {
                let contact = JointContact { follow, ..start.clone() };
                let mut is_possible = |config: &&Vec<f64>| {
                    let followed = self.can_follow(way, &contact, config, checkers, index);
                    tally.unfollowed += usize::from(followed.is_none());
                    followed == Some(true)
                };
                let found = starts
                    .iter()
                    .filter(|config| is_possible(config))
                    .find_map(|config| Some((config.clone(), self.approach(&contact, config, &way.worlds[0].1)?)));
                let Some((config, approach)) = found else { continue };
                tally.possible += 1;
                let sweep = JointSweep { change: self.change.clone(), target: way.target, contact, config, approach };
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
        self.with_object(self.others.clone(), position)
    }

    fn with_object(&self, mut world: CollisionWorld, position: f64) -> CollisionWorld {
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

    /// The way to a position, with the object at every step, and everything else at the first.
    fn way(&self, target: f64) -> Option<Way> {
        let motion = Motion::of(self.object, self.change, target)?;
        let size = self.object.model.world_bounds(&Pose::IDENTITY, &self.object.joint_positions).size().max_element();
        let total = (target - self.change.from).abs();
        let steps = match motion.kind {
            JointKind::Prismatic => total / self.settings.step_m,
            JointKind::Revolute => (total / self.settings.step_rad).max(total * size / self.settings.step_m / 2.0),
        };
        let steps = (steps.ceil() as usize).clamp(STEPS[0], STEPS[1]);
        let at = |step: usize| {
            let by = (target - self.change.from) * step as f64 / steps as f64;
            let around = if step == 0 { self.others.clone() } else { CollisionWorld::default() };
            (by, self.with_object(around, self.change.from + by))
        };
        Some(Way { target, motion, worlds: (0..=steps).map(at).collect() })
    }

    /// Straight to the contact along the fingers.
    fn approach(&self, contact: &JointContact, config: &[f64], world: &CollisionWorld) -> Option<Path> {
        let nothing = Allowed::none();
        let back = contact.world_from_tcp.transform_vector(DVec3::NEG_Z) * self.settings.approach_m;
        let before = Pose { position: contact.world_from_tcp.position + back, ..contact.world_from_tcp };
        self.planner.straight(&around(world, &nothing, contact), config, &before).ok().map(Path::reversed)
    }

    /// Whether the arm can follow the contact along a way, and beyond its end by what a push needs, free at every step.
    ///
    /// The first step that is not possible ends it: following is costly, and most ways are blocked early.
    fn can_follow(
        &self,
        way: &Way,
        contact: &JointContact,
        config: &[f64],
        checkers: &Checkers,
        at: usize,
    ) -> Option<bool> {
        let last = way.worlds.len() - 1;
        let end = way.worlds[last].0 + beyond(&way.motion, contact);
        let mut arm = config.to_vec();
        for (step, by) in way.worlds.iter().map(|(by, _)| *by).chain([end]).enumerate().skip(1) {
            let pose = tcp_at(&way.motion, contact, by);
            arm = self.planner.ik_near(&pose, &arm, self.settings.max_arm_step_rad)?;
            // Room around everything else says that the arm touches none of it; what is left to ask is the object itself.
            if !checkers.has_room(&arm) || (step <= last && !checkers.is_free(at, step, &arm)) {
                return Some(false);
            }
        }
        Some(true)
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
