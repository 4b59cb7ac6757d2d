//! Fit of a skill that picks and places: grasp and lift where the object lies, lowering and retreat at a goal pose.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{ObjectModel, Piece, Pose};
use genmanip_layout::obstacles;
use genmanip_motion::{AllowedCollisions, Attached, Checker, CollisionWorld, Planner, PlanningScene};
use genmanip_relations::{PosedObject, PosedScene};

use crate::fit::{Fit, FitSettings, Misfits, Poses, Way, margin_rad};
use crate::handle::{flipped, rescaled};
use crate::skill::{CarryMotion, Grip};
use crate::way::dense;

/// Largest distance of two checked states, m.
const SPACING_M: f64 = 0.01;
/// Distance of the object from where it lies or is put from which on its own collisions count, m: nearer, it touches
/// its support.
const RAISED_M: f64 = 0.015;

/// A skill fitted to an object and its goal poses.
#[derive(Clone, Debug, PartialEq)]
pub struct CarryFit {
    /// Approach, and the lift as the motion in contact; no retreat.
    pub pick: Fit,
    /// True if the fingers are exchanged.
    pub turned: bool,
    /// Goal poses (`world_from_object`) at which the object can be put down, the best first.
    pub goals: Vec<Pose>,
    score: f64,
}

/// Motions that put a held object down.
#[derive(Clone, Debug, PartialEq)]
pub struct Lowering {
    /// Arm configurations from above the goal to the release.
    pub lower: Vec<Vec<f64>>,
    /// Length of the hand's way to the release, m.
    pub length_m: f64,
    /// Arm configurations from the release on.
    pub retreat: Vec<Vec<f64>>,
    /// Smallest distance of an arm joint to the end of its range, rad.
    pub margin_rad: f64,
}

/// Frame at the centre of an object's bounds with the object's axes, in which hand poses of a carry are stored:
/// `object_from_center`, and half of the size, m.
pub fn center_of(model: &ObjectModel, joint_positions: &[f64]) -> (Pose, DVec3) {
    let bounds = model.world_bounds(&Pose::IDENTITY, joint_positions);
    (Pose::from_position(bounds.center()), bounds.size() / 2.0)
}

/// An object to be carried by skills.
pub struct Carrying<'a> {
    object: &'a PosedObject,
    object_from_center: Pose,
    half_m: DVec3,
    pieces: Vec<Piece>,
    planner: &'a Planner,
    settings: &'a FitSettings,
    /// Obstacles without the object.
    others: CollisionWorld,
}

impl<'a> Carrying<'a> {
    /// The object of a scene with an index; `None` if there is none.
    pub fn new(scene: &'a PosedScene, object: usize, planner: &'a Planner, settings: &'a FitSettings) -> Option<Self> {
        let others = obstacles::around(scene, Some(object));
        let object = scene.objects().nth(object)?;
        let (object_from_center, half_m) = center_of(&object.model, &object.joint_positions);
        let pieces = object.model.pieces(&object.joint_positions);
        Some(Self { object, object_from_center, half_m, pieces, planner, settings, others })
    }

    /// Obstacles without the object.
    pub fn others(&self) -> &CollisionWorld {
        &self.others
    }

    /// The object held at a pose in the hand; `None` if its shape is invalid.
    pub fn attached(&self, tcp_from_object: &Pose) -> Option<Attached> {
        Attached::new(self.object.id.as_str(), &self.pieces, tcp_from_object).ok()
    }

    /// Fits of skills (motion and grip) that pick the object up and can put it down at a goal, the best first; one per
    /// skill and way to hold the object.
    pub fn fits(&self, skills: &[(&CarryMotion, Grip)], goals: &[Pose], reference: &[f64]) -> (Vec<CarryFit>, Misfits) {
        let (mut fits, mut misfits) = (Vec::new(), Misfits::default());
        for (index, (motion, grip)) in skills.iter().enumerate() {
            for turned in [false, true] {
                fits.extend(self.fit(index, motion, *grip, turned, goals, reference, &mut misfits));
            }
        }
        fits.sort_by(|a, b| b.score.total_cmp(&a.score));
        (fits, misfits)
    }

    /// `center_from_tcp` of a motion, for this object's size.
    fn own(&self, motion: &CarryMotion, pose: &Pose, turned: bool) -> Pose {
        let pose = rescaled(pose, motion.object_half_m, self.half_m);
        if turned { flipped(&pose) } else { pose }
    }

    #[allow(clippy::too_many_arguments, reason = "one call")]
    fn fit(
        &self,
        skill: usize,
        motion: &CarryMotion,
        grip: Grip,
        turned: bool,
        goals: &[Pose],
        reference: &[f64],
        misfits: &mut Misfits,
    ) -> Option<CarryFit> {
        let (planner, settings) = (self.planner, self.settings);
        let Grip::Grasp { width_m, .. } = grip else { return None };
        let world_from_center = self.object.pose * self.object_from_center;
        let own = |pose: &Pose| self.own(motion, pose, turned);
        let grasp = own(motion.approach.last()?);
        let approach: Vec<Pose> = motion.approach.iter().map(|pose| world_from_center * own(pose)).collect();
        let lift: Vec<Pose> = dense(&motion.lift, SPACING_M);
        let along: Vec<Pose> = lift.iter().map(|moved| world_from_center * *moved * grasp).collect();
        let poses = Poses { approach: dense(&approach, SPACING_M), along, retreat: Vec::new() };

        let open_width_m = planner.robot().gripper.max_width;
        let closing = motion.approach.last()?.rotation * DVec3::Y;
        let wider = 2.0 * closing.abs().dot(self.half_m - motion.object_half_m);
        let held_m = (width_m + wider.max(-width_m) + settings.finger_clearance_m).min(open_width_m);
        let tcp_from_object = (self.object_from_center * grasp).inverse();
        let attached = self.attached(&tcp_from_object)?;
        let nothing = AllowedCollisions::none();
        let mut with_object = self.others.clone();
        // The models' own pieces and finite poses are always accepted.
        let _ = with_object.add(self.object.id.as_str(), &self.pieces, &self.object.pose);
        let around =
            |world, attached, gripper_width| PlanningScene { world, attached, allowed: &nothing, gripper_width };
        let before = planner.checker(&around(&with_object, None, open_width_m), settings.contact_m);
        let hand = planner.checker(&around(&self.others, None, held_m), settings.contact_m);
        let loaded = planner.checker(&around(&self.others, Some(&attached), held_m), settings.contact_m);
        let is_raised = |state: usize| lift.get(state).is_some_and(|moved| moved.position.length() > RAISED_M);
        let held =
            |state: usize, config: &[f64]| if is_raised(state) { loaded.is_free(config) } else { hand.is_free(config) };
        let clearances = self.clearances(&around(&self.others, None, open_width_m));
        let way = Way {
            poses: &poses,
            before: &|config| before.is_free(config),
            reaches: &|config| before.gripper_is_free(config),
            held: &held,
            after: &|_| true,
            clearances: &clearances,
            open_width_m,
        };
        let pick = way.fit(planner, skill, reference, settings, misfits)?;
        let end = pick.along.last().cloned().unwrap_or_default();
        let mut reached: Vec<(f64, Pose)> = goals
            .iter()
            .filter_map(|goal| Some((self.lowering(motion, goal, &tcp_from_object, turned, &end)?.margin_rad, *goal)))
            .collect();
        reached.sort_by(|a, b| b.0.total_cmp(&a.0));
        let Some((margin, _)) = reached.first() else {
            misfits.unplaced += 1;
            return None;
        };
        let score = pick.score(settings).min(margin / settings.enough_margin_rad);
        Some(CarryFit { pick, turned, score, goals: reached.into_iter().map(|(_, goal)| goal).collect() })
    }

    fn clearances<'b>(&'b self, around: &PlanningScene<'b>) -> Vec<Checker<'b>> {
        self.settings.clearances_m.iter().map(|clearance_m| self.planner.checker(around, *clearance_m)).collect()
    }

    /// Motions that put the object down at a goal pose (`world_from_object`) and leave it, held at `tcp_from_object`;
    /// arm configurations are near `reference`. `None` if the arm cannot follow, or something is in the way.
    pub fn lowering(
        &self,
        motion: &CarryMotion,
        goal: &Pose,
        tcp_from_object: &Pose,
        turned: bool,
        reference: &[f64],
    ) -> Option<Lowering> {
        let (planner, settings) = (self.planner, self.settings);
        let open_width_m = planner.robot().gripper.max_width;
        let world_from_center = *goal * self.object_from_center;
        let center_from_tcp = self.object_from_center.inverse() * tcp_from_object.inverse();
        let moved = dense(&motion.lower, SPACING_M);
        let lower: Vec<Pose> = moved.iter().map(|moved| world_from_center * *moved * center_from_tcp).collect();
        let (release, dropped) = (*lower.last()?, *moved.last()?);
        // The hand leaves as in the source, relative to its pose at the release.
        let from_release = |pose: &Pose| {
            let left = motion.retreat.first().map_or(Pose::IDENTITY, |first| first.inverse() * *pose);
            if turned { conjugated(&left) } else { left }
        };
        let retreat: Vec<Pose> = motion.retreat.iter().map(|pose| release * from_release(pose)).collect();

        let nothing = AllowedCollisions::none();
        let attached = self.attached(tcp_from_object)?;
        let mut with_object = self.others.clone();
        let _ = with_object.add(self.object.id.as_str(), &self.pieces, &(*goal * self.about_origin(&dropped)));
        let around =
            |world, attached, gripper_width| PlanningScene { world, attached, allowed: &nothing, gripper_width };
        let hand = planner.checker(&around(&self.others, None, open_width_m), settings.contact_m);
        let loaded = planner.checker(&around(&self.others, Some(&attached), open_width_m), settings.contact_m);
        let after = planner.checker(&around(&with_object, None, open_width_m), settings.contact_m);
        let is_raised = |state: usize| moved[state].position.distance(dropped.position) > RAISED_M;
        let mut best: Option<Lowering> = None;
        let configs = planner.ik_coarse(&release, reference).filter(|config| hand.is_free(config));
        for config in configs.take(settings.configurations) {
            let back = planner.follow(&config, lower.iter().rev().copied(), settings.max_arm_step_rad);
            let Some(mut states) = back else { continue };
            states.reverse();
            let is_free = states
                .iter()
                .enumerate()
                .all(|(state, config)| if is_raised(state) { loaded.is_free(config) } else { hand.is_free(config) });
            if !is_free {
                continue;
            }
            let left = planner
                .follow(&config, retreat.iter().copied(), settings.max_arm_step_rad)
                .filter(|states| states.iter().all(|config| after.is_free(config)))
                .unwrap_or_default();
            let margin = states.iter().map(|config| margin_rad(planner, config)).fold(f64::INFINITY, f64::min);
            if best.as_ref().is_none_or(|best| margin > best.margin_rad) {
                best = Some(Lowering {
                    lower: states,
                    length_m: lower.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum(),
                    retreat: std::iter::once(config).chain(left).collect(),
                    margin_rad: margin,
                });
            }
        }
        best
    }

    /// A motion of the centre frame as one of the object's own frame.
    fn about_origin(&self, moved: &Pose) -> Pose {
        self.object_from_center * *moved * self.object_from_center.inverse()
    }
}

/// A motion in the tool's frame with the fingers exchanged.
fn conjugated(tcp_from_moved: &Pose) -> Pose {
    let turn = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_z(std::f64::consts::PI) };
    turn.inverse() * *tcp_from_moved * turn
}
