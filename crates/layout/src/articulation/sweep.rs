//! Search for arm motions that follow a joint.

use genmanip_core::{Failure, FailureCause, JointKind, Pose};
use genmanip_motion::{AllowedCollisions, CollisionWorld, Path, Planner, PlanningScene};
use genmanip_relations::{PosedObject, PosedScene};
use glam::{DQuat, DVec3};

use super::contacts::contacts;
use super::joint_path::{JointPath, PathCheckers};
use super::{JointChange, JointContact, JointSettings, Motion};
use crate::obstacles;

/// Minimum and maximum number of states checked along a joint path; chosen.
const MIN_MAX_STEPS: [usize; 2] = [3, 60];

/// Minimum lever of a contact about the joint axis (m), to avoid division by zero.
const MIN_LEVER_M: f64 = 1e-3;

/// A contact, and an arm configuration from which the arm can follow the moving link.
#[derive(Clone, Debug)]
pub struct JointSweep {
    /// The joint change that the sweep makes.
    pub change: JointChange,
    /// Target joint position [rad or m].
    pub target: f64,
    /// Contact of the gripper with the link.
    pub contact: JointContact,
    /// Arm configuration at the start of the motion (rad).
    pub config: Vec<f64>,
    /// Straight approach path that ends at `config`.
    pub approach: Path,
}

/// Searches for sweeps that make one joint change.
pub struct Sweeper<'a> {
    planner: &'a Planner,
    settings: &'a JointSettings,
    object: &'a PosedObject,
    change: &'a JointChange,
    /// Collision world without the articulated object.
    others: CollisionWorld,
}

impl<'a> Sweeper<'a> {
    /// Creates a search; `None` if the change refers to no object of the scene.
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

    /// First feasible sweep for which `accept` returns a value.
    ///
    /// # Errors
    /// Reports the number of contacts that were out of reach, blocked, or could not be followed.
    pub fn search<T>(&self, reference: &[f64], accept: &mut dyn FnMut(&JointSweep) -> Option<T>) -> Result<T, Failure> {
        let name = &self.object.model.card.name;
        let mut tally = Tally::default();
        let joint_path: Vec<JointPath> = self.change.targets.iter().filter_map(|&target| self.path(target)).collect();
        let link = self.object.model.links.get(self.change.link);
        let contacts = joint_path
            .first()
            .zip(link)
            .map(|(path, link)| contacts(link, &path.motion, self.planner.robot(), self.settings));
        let no_contact = AllowedCollisions::none();
        let mut known: Vec<PathCheckers> = Vec::new();
        for start in contacts.into_iter().flatten() {
            let mut configs = self.planner.ik_coarse(&start.world_from_tcp, reference).peekable();
            if configs.peek().is_none() {
                tally.out_of_reach += 1;
                continue;
            }
            let at =
                known.iter().position(|path_checkers| path_checkers.width == start.open_width).unwrap_or_else(|| {
                    // All pushes share one gripper width, so their checkers are kept; every grasp has its own width.
                    known.retain(|path_checkers| path_checkers.width == 0.0);
                    let others = (&self.others, self.settings.room_m);
                    known.push(PathCheckers::new(self.planner, &no_contact, &joint_path, others, start.open_width));
                    known.len() - 1
                });
            let path_checkers = &known[at];
            if configs.peek().is_none_or(|config| !path_checkers.gripper_is_free(config)) {
                tally.blocked += 1;
                continue;
            }
            let mut starts: Vec<_> = configs
                .filter(|config| path_checkers.is_free(0, 0, config))
                .take(self.settings.configurations)
                .collect();
            if starts.is_empty() {
                tally.blocked += 1;
                continue;
            }
            starts.retain(|config| path_checkers.has_clearance(config));
            let follows = if start.turns_freely { self.settings.follow.as_slice() } else { &[1.0] };
            for (&follow, (index, path)) in
                follows.iter().flat_map(|f| joint_path.iter().enumerate().map(move |w| (f, w)))
            {
                let contact = JointContact { follow, ..start.clone() };
                let mut is_possible = |config: &&Vec<f64>| {
                    let followed = self.can_follow(path, &contact, config, path_checkers, index);
                    tally.unfollowed += usize::from(followed.is_none());
                    followed == Some(true)
                };
                let found = starts
                    .iter()
                    .filter(|config| is_possible(config))
                    .find_map(|config| Some((config.clone(), self.approach(&contact, config, &path.worlds[0].1)?)));
                let Some((config, approach)) = found else { continue };
                tally.possible += 1;
                let sweep = JointSweep { change: self.change.clone(), target: path.target, contact, config, approach };
                if let Some(result) = accept(&sweep) {
                    return Ok(result);
                }
            }
        }
        let joint = self.object.model.links.get(self.change.link).map_or("?", |link| link.name.as_str());
        let Tally { out_of_reach, blocked, unfollowed, possible } = tally;
        let evidence = format!(
            "no path to move the {joint} of {name}: {out_of_reach} contacts out of reach, {blocked} blocked, \
             {unfollowed} arm postures could not follow, {possible} feasible but not approachable"
        );
        Err(Failure { cause: if possible > 0 { FailureCause::Planning } else { FailureCause::NoIk }, evidence })
    }

    /// Arm configurations at `count` equal joint steps from the current position to `to`, without the first one.
    ///
    /// `None` if inverse kinematics fails at a step.
    pub fn follow(&self, sweep: &JointSweep, to: f64, count: usize) -> Option<Vec<Vec<f64>>> {
        let motion = Motion::of(self.object, self.change, sweep.target)?;
        let path = (1..=count)
            .map(|step| tcp_at(&motion, &sweep.contact, (to - self.change.from) * step as f64 / count as f64));
        self.planner.follow(&sweep.config, path, self.settings.max_arm_step_rad)
    }

    /// Commanded joint position [rad or m]; for a push slightly beyond the target.
    pub fn end(&self, sweep: &JointSweep) -> f64 {
        let motion = Motion::of(self.object, self.change, sweep.target);
        sweep.target + motion.map_or(0.0, |motion| overshoot(&motion, &sweep.contact))
    }

    /// Collision world including the object with its joint at a position.
    pub fn world_at(&self, position: f64) -> CollisionWorld {
        self.with_object(self.others.clone(), position)
    }

    fn with_object(&self, mut world: CollisionWorld, position: f64) -> CollisionWorld {
        let mut object = self.object.clone();
        if let Some(value) = object.joint_positions.get_mut(self.change.joint) {
            *value = position;
        }
        // The models' own pieces and finite poses are always accepted.
        let _ = world.add(object.id.as_str(), &object.model.pieces(&object.joint_positions), &object.pose);
        world
    }

    /// Direction of motion at the contact (unit vector), and its speed per unit of joint velocity.
    pub fn velocity(&self, sweep: &JointSweep) -> (DVec3, f64) {
        let point = sweep.contact.world_from_tcp.transform_point(sweep.contact.tool_point);
        let velocity = Motion::of(self.object, self.change, sweep.target).map(|motion| motion.velocity(point));
        velocity.map_or((DVec3::ZERO, 1.0), |(direction, lever)| (direction, lever.max(MIN_LEVER_M)))
    }

    /// Joint path to a target, with the object at every step and everything else at the first. `None` if the change
    /// refers to no joint.
    fn path(&self, target: f64) -> Option<JointPath> {
        let motion = Motion::of(self.object, self.change, target)?;
        let size = self.object.model.world_bounds(&Pose::IDENTITY, &self.object.joint_positions).size().max_element();
        let total = (target - self.change.from).abs();
        let steps = match motion.kind {
            JointKind::Prismatic => total / self.settings.step_m,
            JointKind::Revolute => (total / self.settings.step_rad).max(total * size / self.settings.step_m / 2.0),
        };
        let steps = (steps.ceil() as usize).clamp(MIN_MAX_STEPS[0], MIN_MAX_STEPS[1]);
        let at = |step: usize| {
            let by = (target - self.change.from) * step as f64 / steps as f64;
            let scene_with = if step == 0 { self.others.clone() } else { CollisionWorld::default() };
            (by, self.with_object(scene_with, self.change.from + by))
        };
        Some(JointPath { target, motion, worlds: (0..=steps).map(at).collect() })
    }

    /// Straight approach along the fingers; `None` if it is unreachable or blocked.
    fn approach(&self, contact: &JointContact, config: &[f64], world: &CollisionWorld) -> Option<Path> {
        let no_contact = AllowedCollisions::none();
        let back = contact.world_from_tcp.transform_vector(DVec3::NEG_Z) * self.settings.approach_m;
        let before = Pose { position: contact.world_from_tcp.position + back, ..contact.world_from_tcp };
        self.planner.straight(&scene_with(world, &no_contact, contact), config, &before).ok().map(Path::reversed)
    }

    /// Returns `Some(true)` if the arm can follow the contact along the path, and beyond its end for a push, without
    /// collision; `None` if inverse kinematics fails.
    ///
    /// Stops at the first infeasible step, since most paths are blocked early.
    fn can_follow(
        &self,
        path: &JointPath,
        contact: &JointContact,
        config: &[f64],
        path_checkers: &PathCheckers,
        at: usize,
    ) -> Option<bool> {
        let last = path.worlds.len() - 1;
        let end = path.worlds[last].0 + overshoot(&path.motion, contact);
        let mut arm = config.to_vec();
        for (step, by) in path.worlds.iter().map(|(by, _)| *by).chain([end]).enumerate().skip(1) {
            let pose = tcp_at(&path.motion, contact, by);
            arm = self.planner.ik_near(&pose, &arm, self.settings.max_arm_step_rad)?;
            // The clearance check covers everything but the object, which is checked along the path up to the target.
            if !path_checkers.has_clearance(&arm) || (step <= last && !path_checkers.is_free(at, step, &arm)) {
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

fn scene_with<'a>(
    world: &'a CollisionWorld,
    allowed: &'a AllowedCollisions,
    contact: &JointContact,
) -> PlanningScene<'a> {
    PlanningScene { world, attached: None, allowed, gripper_width: contact.open_width }
}

/// Overshoot of the gripper beyond the joint target (rad or m): a push first closes the gap.
fn overshoot(motion: &Motion, contact: &JointContact) -> f64 {
    let (_, lever) = motion.velocity(contact.world_from_tcp.transform_point(contact.tool_point));
    contact.gap_m / lever.max(MIN_LEVER_M) * motion.sign
}

/// TCP pose after a joint displacement `by` (rad or m).
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
