//! A skill of an episode: signals, segments and poses relative to what moved.

use genmanip_core::glam::DVec3;
use genmanip_core::{Episode, Frame, JointKind, Pose};
use genmanip_layout::articulation::{JointChange, joint_changes};
use genmanip_layout::{Move, moves};
use genmanip_relations::joint_state;
use genmanip_rollout::Stage;
use genmanip_rollout::replay::ContactReplay;
use genmanip_sim::BodyId;

use crate::cut::segments;
use crate::handle::{Handle, verb};
use crate::skill::{CarryMotion, Grip, JointMotion, Segments, Skill, SkillSource};
use crate::way::{spaced, start_of};
use crate::{SkillError, Verb};

/// Length of the way before and after the contact that belongs to a skill, m. Long enough to clear a handle; the
/// planner makes the rest.
pub(crate) const WAY_M: f64 = 0.07;
/// Distance between the poses of approach and retreat, m.
pub(crate) const SPACING_M: f64 = 0.01;
/// Number of equal shares of a joint's travel at which a pose is stored.
const SHARES: usize = 20;
/// Share of the control steps of a manipulation in which both fingers press on the object for it to count as grasped.
const MOSTLY: f64 = 0.5;
/// Change of the commanded opening at the contact by which fingers count as closed on something, m, and distance of the
/// hand from the contact from which on it counts, m.
const CLOSED_M: f64 = 0.003;
const NEAR_M: f64 = 0.03;
/// Control steps before and after one over which a measured pose is averaged, against the operator's tremor.
const SMOOTHED: usize = 2;

/// Cuts a skill from a stored episode of a stage; `record_hash` identifies its record.
///
/// # Errors
/// If the episode failed, has more or other than one move, or cannot be cut; if its replay breaks.
pub fn record(stage: &Stage, episode: &Episode, name: &str, record_hash: &str) -> Result<Skill, SkillError> {
    if !episode.result.success {
        return Err(SkillError::Failed { episode: episode.result.id.clone() });
    }
    let step = only_move(stage).ok_or(SkillError::NotOneMove)?;
    let take = Take::new(stage, episode, step.object)?;
    let Cut { segments, grip, verb, motion, carry } = match step.state() {
        Some(state) => take.cut(state)?,
        None => take.cut_carry(&step)?,
    };
    let model = &stage.models[step.object];
    Ok(Skill {
        name: name.into(),
        verb,
        source: SkillSource {
            episode: episode.result.id.clone(),
            record_hash: record_hash.into(),
            scenario: episode.scenario.id.clone(),
            policy: episode.result.policy.clone(),
            operator: episode.result.source,
            seed: episode.result.seed,
            object: model.asset.clone(),
            family: model.family.clone(),
            control_rate_hz: episode.result.control_rate_hz,
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        },
        segments,
        grip,
        motion,
        carry,
    })
}

/// The move of a goal whose first alternative has a single one.
fn only_move(stage: &Stage) -> Option<Move> {
    let mut alternatives = moves(&stage.goal, stage.start()).into_iter();
    let mut moves = alternatives.next()?.into_iter();
    moves.next().filter(|_| moves.next().is_none())
}

/// Parts that are cut from an episode, see [`Skill`].
pub(crate) struct Cut {
    pub segments: Segments,
    pub grip: Grip,
    pub verb: Verb,
    pub motion: Option<JointMotion>,
    pub carry: Option<CarryMotion>,
}

/// An episode and the contact of the robot with the object that it moved.
pub(crate) struct Take<'a> {
    pub stage: &'a Stage,
    pub episode: &'a Episode,
    pub object: usize,
    /// Links of the object that the robot touches, as bits, at each control step.
    pub touched: Vec<u64>,
}

impl<'a> Take<'a> {
    fn new(stage: &'a Stage, episode: &'a Episode, object: usize) -> Result<Self, SkillError> {
        let mut replay = ContactReplay::new(stage, episode)?;
        let mut touched = Vec::with_capacity(episode.frames.len());
        for step in 0..episode.frames.len() {
            let links = replay.at(step)?.into_iter().filter_map(|contact| match (contact.a, contact.b) {
                (BodyId::Robot { .. }, BodyId::Object { object: other, link })
                | (BodyId::Object { object: other, link }, BodyId::Robot { .. })
                    if other == object =>
                {
                    Some(1_u64 << link.min(63))
                }
                _ => None,
            });
            touched.push(links.fold(0, |all, link| all | link));
        }
        Ok(Self { stage, episode, object, touched })
    }

    fn cut(&self, state: &str) -> Result<Cut, SkillError> {
        let model = &self.stage.models[self.object];
        let change = self.change(state).ok_or(SkillError::NothingMoved)?;
        let handle = Handle::of(model, change.link, change.joint).ok_or(SkillError::NothingMoved)?;
        let position = |step: usize| self.joints(step).get(change.joint).copied().unwrap_or_default();
        let count = self.episode.frames.len();
        let contact: Vec<bool> = self.touched.iter().map(|links| links >> change.link.min(63) & 1 == 1).collect();
        // The hand is not the cause of later falls and swings.
        let last = contact.iter().rposition(|touches| *touches).ok_or(SkillError::NoContact { step: 0 })?;
        let (from, to) = (position(0), position(last));
        let travel: Vec<f64> = (0..count).map(|step| (position(step) - from) / (to - from)).collect();
        let segments = segments(&travel, &contact)?;
        let handle_from_tcp = |step: usize| {
            let pose = self.episode.frames[step].objects[self.object].pose;
            let world_from_handle = handle.world_pose(model, &pose, self.joints(step), position(step));
            world_from_handle.inverse() * self.episode.frames[step].tcp
        };
        let poses = smoothed(count, handle_from_tcp);
        let [begin, end] = segments.manipulate;
        let at_share = |share: f64| {
            let wanted = travel[begin] + (travel[end] - travel[begin]) * share;
            (begin..=end).find(|step| travel[*step] >= wanted).unwrap_or(end)
        };
        let along: Vec<Pose> = (0..=SHARES).map(|share| poses[at_share(share as f64 / SHARES as f64)]).collect();
        let motion = JointMotion {
            joint: model.links[change.link].joint.as_ref().map_or(JointKind::Prismatic, |joint| joint.kind),
            states: [self.initial_state(), state.to_owned()],
            from_to: [from, to],
            nominal: change.targets.first().copied().unwrap_or(to),
            handle_half_m: handle.half_m,
            approach: self.approach(&poses, &segments, along[0]),
            retreat: self.retreat(&poses, &segments),
            along,
        };
        let verb = verb(model, &JointChange { targets: vec![to], ..change });
        Ok(Cut { segments, grip: self.grip(&segments, &poses), verb, motion: Some(motion), carry: None })
    }

    /// Poses of the approach, the last one that at the start of the manipulation.
    pub(crate) fn approach(&self, poses: &[Pose], segments: &Segments, contact: Pose) -> Vec<Pose> {
        let [_, touched] = segments.approach;
        let from = start_of(&poses[..=touched], WAY_M);
        let mut approach = spaced(&poses[from..=touched], SPACING_M);
        // The last pose before the contact is nearly that of the contact, which takes its place.
        if approach.len() > 1 {
            approach.pop();
        }
        approach.push(contact);
        approach
    }

    pub(crate) fn retreat(&self, poses: &[Pose], segments: &Segments) -> Vec<Pose> {
        let reversed: Vec<Pose> = poses[segments.retreat[0].min(poses.len() - 1)..].iter().rev().copied().collect();
        let from = start_of(&reversed, WAY_M);
        let mut retreat = spaced(&reversed[from..], SPACING_M);
        retreat.reverse();
        retreat
    }

    /// Fingers during the manipulation: they grasp if both press on the object for most of it and have closed at the
    /// contact; closed fingers that push may press with both as well.
    pub(crate) fn grip(&self, segments: &Segments, poses: &[Pose]) -> Grip {
        let [begin, end] = segments.manipulate;
        let frames = &self.episode.frames[begin..end];
        let held = frames.iter().filter(|frame| frame.grasped == Some(self.object)).count();
        let commanded = |frame: &Frame| f64::from(frame.command.last().copied().unwrap_or_default());
        let median = |value: &dyn Fn(&Frame) -> f64| {
            let mut values: Vec<f64> = frames.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or_default()
        };
        let width_m = median(&|frame| frame.gripper_width).max(0.0);
        let commanded_m = median(&commanded);
        let near = start_of(&poses[..=segments.approach[1]], NEAR_M)..=segments.approach[1];
        let before_m = self.episode.frames[near].iter().map(commanded).fold(0.0, f64::max);
        let has_closed = before_m - commanded_m > CLOSED_M;
        match has_closed && held as f64 > MOSTLY * frames.len() as f64 {
            true => Grip::Grasp { width_m, squeeze_m: (width_m - commanded_m).max(0.0) },
            false => Grip::Fixed { width_m: commanded_m.max(0.0) },
        }
    }

    /// The joint that moved most on the way to a state, as a share of its range.
    fn change(&self, state: &str) -> Option<JointChange> {
        let model = &self.stage.models[self.object];
        let (first, last) = (self.joints(0), self.joints(self.episode.frames.len().saturating_sub(1)));
        let moved = |change: &JointChange| {
            let joint = model.links[change.link].joint.as_ref();
            let range = joint.map_or(1.0, |joint| joint.range[1] - joint.range[0]);
            (last.get(change.joint).unwrap_or(&0.0) - first.get(change.joint).unwrap_or(&0.0)).abs() / range
        };
        let changes = joint_changes(self.stage.start(), self.object, state);
        changes.into_iter().max_by(|a, b| moved(a).total_cmp(&moved(b)))
    }

    /// Named state of the object at the start; empty if it is in none.
    fn initial_state(&self) -> String {
        joint_state(self.stage.start(), self.object, &self.stage.relations).unwrap_or_default()
    }

    pub(crate) fn joints(&self, step: usize) -> &[f64] {
        self.episode.frames.get(step).map_or(&[], |frame| &frame.objects[self.object].joint_positions)
    }
}

/// Poses averaged over a few control steps before and after each.
pub(crate) fn smoothed(count: usize, pose: impl Fn(usize) -> Pose) -> Vec<Pose> {
    let raw: Vec<Pose> = (0..count).map(pose).collect();
    let average = |step: usize| {
        let around = &raw[step.saturating_sub(SMOOTHED)..(step + SMOOTHED + 1).min(count)];
        let share = 1.0 / around.len() as f64;
        let position = around.iter().map(|pose| pose.position).sum::<DVec3>() * share;
        let same_side = |pose: &Pose| if pose.rotation.dot(raw[step].rotation) < 0.0 { -1.0 } else { 1.0 };
        let rotation = around.iter().map(|pose| pose.rotation * same_side(pose)).reduce(|sum, one| sum + one);
        Pose::new(position, rotation.unwrap_or(raw[step].rotation))
    };
    (0..count).map(average).collect()
}
