//! Goal poses of moved objects: sampled and accepted if every atom of the move would hold.

use std::f64::consts::{PI, TAU};

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Aabb, Atom, AtomVerdict, Pose, ReferenceId, Relation, Seed, Unit, Workspace};
use genmanip_relations::{PosedObject, PosedScene, RelationSettings, judge_atom, placement_window, planar_gap};
use rand::{Rng, RngExt};

use crate::between;
use crate::moves::Move;
use crate::placement::{LOWERING_HEIGHT_M, lower_onto};
use crate::settings::GoalPoseSettings;

/// A goal pose and the object below it.
#[derive(Clone, Debug)]
pub struct GoalPose {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Index of the supporting or containing object; `None` for the table and other surfaces.
    pub support: Option<usize>,
    /// Bounds of the object at the goal, world frame.
    pub bounds: Aabb,
}

/// Distance between an object and the edge of its support (m). Chosen larger than the arm's placement error.
const EDGE_M: f64 = 0.01;

/// Number of samples when checking that a later move has space. Chosen: a fifth of the samples of a move itself.
const LATER_SAMPLES: usize = 120;

/// Minimum freedom on a carrier along each axis (m), and the usable share of a cavity. Chosen because cavities are
/// modelled as boxes and often round.
const MIN_SLACK_M: f64 = 0.003;
const USABLE_CAVITY_SHARE: f64 = 0.8;

/// Gap that remains to the carrier after lowering an object (m). Chosen smaller than a layout's drop height.
const RELEASE_GAP_M: f64 = 0.0005;

/// Tolerance for the top of a lower object above this object's bottom (m). Chosen larger than contact penetration.
const BELOW_TOLERANCE_M: f64 = 0.002;

/// Search for goal poses of a move in one scene.
#[derive(Clone, Copy, Debug)]
pub struct GoalSearch<'a> {
    /// Scene at the current poses.
    pub scene: &'a PosedScene,
    /// Upright orientation of each object in the world; goal poses add a yaw.
    pub upright: &'a [DQuat],
    /// Usable part of the table, for goals on it.
    pub workspace: &'a Workspace,
    /// Thresholds of the relations.
    pub relations: &'a RelationSettings,
    /// Limits and margins of the search.
    pub settings: &'a GoalPoseSettings,
    /// Order of the samples and of the goal poses found.
    pub order: GoalOrder,
}

/// Order in which goal poses are sampled and returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GoalOrder {
    /// Random samples; largest margins first.
    Margin,
    /// Half of the samples spiral from the middle of the goal region outwards with the same offsets and headings for
    /// every seed, starting with the current heading; the rest are random. Goal poses nearest to the middle come first.
    Middle,
}

/// Position of a sample in the goal region.
#[derive(Clone, Copy)]
enum Place {
    /// Random; over the top of a carrier at most `spread.sqrt()` of the way from its centre to the rim.
    Random { spread: f64 },
    /// Offset from the middle, as a share of the half region along each axis.
    At(DVec2),
}

/// Turns of a sample around the middle of the region (rad): the golden angle, for which samples cover it evenly.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Number of headings tried besides the object's own when sampling from the middle outwards.
const HEADINGS: usize = 8;

impl GoalSearch<'_> {
    /// Samples up to `settings.count` goal poses for a move, in the order `self.order`.
    ///
    /// Every atom of the move holds, directional ones with `settings.margin_m`. Only `usable` poses count, with
    /// `settings.clearance_m` to everything but the support. Objects of `later` moves on the same support still find
    /// space beside it, if possible.
    pub fn goal_poses(&self, step: &Move, later: &[Move], usable: &dyn Fn(&Pose) -> bool, seed: Seed) -> Vec<GoalPose> {
        let rng = &mut seed.rng();
        let mut after = self.scene.clone();
        let base = self.base_of(step);
        // An object placed on a surface is beside the objects there, as on the table, so the surface does not count as
        // its support.
        let support = base.filter(|&base| self.scene.surface_at(base).is_none());
        let beside: Vec<&Move> = later.iter().filter(|other| base.is_some() && self.base_of(other) == base).collect();
        let (mut found, mut blocking): (Vec<(f64, GoalPose)>, Vec<_>) = (Vec::new(), Vec::new());
        let settings = self.settings;
        for draw in 0..settings.draws {
            let (place, turn) = self.sample(draw, rng);
            let rotation = DQuat::from_rotation_z(turn) * self.upright[step.object];
            if !self.propose(&mut after, step, base, rotation, place, rng) || !self.is_free(&after, step.object, base) {
                continue;
            }
            let verdicts: Vec<_> = step.atoms.iter().map(|atom| judge_atom(&after, atom, self.relations)).collect();
            let holds = verdicts
                .iter()
                .all(|verdict| verdict.holds && verdict.normalised_margin() >= margin(&verdict.atom, settings));
            let posed = after.objects().nth(step.object).filter(|posed| holds && usable(&posed.pose));
            if let Some((posed, bounds)) = posed.zip(after.bounds(step.object)) {
                let merit = match (self.order, place) {
                    (GoalOrder::Margin, _) => {
                        verdicts.iter().map(AtomVerdict::normalised_margin).fold(f64::INFINITY, f64::min)
                    }
                    (GoalOrder::Middle, Place::At(offset)) => -offset.length() - turn.abs() / PI,
                    (GoalOrder::Middle, Place::Random { .. }) => f64::NEG_INFINITY,
                };
                let goal = (merit, GoalPose { world_from_object: posed.pose, support, bounds });
                if !self.have_space(&after, &beside, seed.fork("later").fork_index(draw as u64)) {
                    blocking.push(goal);
                    continue;
                }
                found.push(goal);
                if found.len() >= settings.count {
                    break;
                }
            }
        }
        if found.is_empty() {
            blocking.truncate(settings.count);
            found = blocking;
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.into_iter().map(|(_, goal)| goal).collect()
    }

    /// Position and heading (rad, relative to the current one) of sample number `draw`.
    fn sample(&self, draw: usize, rng: &mut impl Rng) -> (Place, f64) {
        let (draws, is_turned) = (self.settings.draws, !draw.is_multiple_of(2));
        let half = draws / 2;
        if self.order == GoalOrder::Middle && draw < half {
            let index = draw / 2;
            let radius = (2.0 * index as f64 / half as f64).sqrt();
            let turn = (0.5 + (index % HEADINGS) as f64) * TAU / HEADINGS as f64 - PI;
            let offset = radius * DVec2::from_angle(GOLDEN_ANGLE * index as f64);
            return (Place::At(offset), if is_turned { turn } else { 0.0 });
        }
        // Every second sample keeps the current heading: most objects need not be rotated.
        let turn = if is_turned { rng.random_range(0.0..TAU) } else { 0.0 };
        (Place::Random { spread: draw as f64 / draws as f64 }, turn)
    }

    /// True if each of several moves, in sequence, finds a goal pose.
    fn have_space(&self, scene: &PosedScene, steps: &[&Move], seed: Seed) -> bool {
        let settings = GoalPoseSettings { count: 1, draws: LATER_SAMPLES, ..self.settings.clone() };
        let mut scene = scene.clone();
        steps.iter().enumerate().all(|(index, step)| {
            let search = GoalSearch { scene: &scene, settings: &settings, ..*self };
            let goal_poses = search.goal_poses(step, &[], &|_| true, seed.fork_index(index as u64));
            let Some(goal_pose) = goal_poses.first() else { return false };
            let joints = scene.objects().nth(step.object).map_or(Vec::new(), |posed| posed.joint_positions.clone());
            scene.set_pose(step.object, goal_pose.world_from_object, &joints);
            true
        })
    }

    /// Index of the object or surface that supports a move's object at the goal; `None` for the table.
    fn base_of(&self, step: &Move) -> Option<usize> {
        step.atoms.iter().find_map(|atom| match atom {
            Atom::Relation { relation, reference, .. } if relation.is_support() => self.scene.index_of(reference),
            _ => None,
        })
    }

    /// Samples a candidate pose; false if there is none.
    fn propose(
        &self,
        after: &mut PosedScene,
        step: &Move,
        base: Option<usize>,
        rotation: DQuat,
        place: Place,
        rng: &mut impl Rng,
    ) -> bool {
        let Some(object) = self.scene.objects().nth(step.object) else { return false };
        let bounds = object.model.world_bounds(&Pose { position: DVec3::ZERO, rotation }, &object.joint_positions);
        let (half, offset) = (bounds.size().truncate() * 0.5, bounds.center().truncate());
        let at =
            |center: DVec2, bottom: f64| Pose { position: (center - offset).extend(bottom - bounds.min.z), rotation };
        let surface = base.and_then(|base| self.scene.surfaces().get(self.scene.surface_at(base)?));
        if let Some(carrier) = base.filter(|_| surface.is_none()) {
            let Some((posed, outer)) = self.scene.objects().nth(carrier).zip(self.scene.bounds(carrier)) else {
                return false;
            };
            let center = point_over(posed, object, rotation, place, rng);
            after.set_pose(step.object, at(center, outer.max.z + LOWERING_HEIGHT_M), &object.joint_positions);
            return lower_onto(after, step.object, carrier, RELEASE_GAP_M, self.relations);
        }
        let area = surface.map_or(*self.workspace, |surface| surface.area(EDGE_M));
        let mut low = DVec2::new(area.x[0], area.y[0]) + half;
        let mut high = DVec2::new(area.x[1], area.y[1]) - half;
        for atom in &step.atoms {
            let Atom::Relation { relation, .. } = atom else { continue };
            if surface.is_some() && relation.is_support() {
                continue;
            }
            let anchor = |id: &ReferenceId| self.scene.bounds(self.scene.index_of(id)?);
            let anchors: Vec<Aabb> = atom.references().filter_map(anchor).collect();
            if let (Relation::Between, [one, other]) = (relation, anchors.as_slice()) {
                let [least, most] = between::free_window(one, other, bounds.size());
                (low, high) = (low.max(least), high.min(most));
                continue;
            }
            for reference in atom.references() {
                let Some(anchor) = anchor(reference) else { return false };
                let Some(window) = placement_window(*relation, &anchor, bounds.size(), self.relations) else {
                    return false;
                };
                low = low.max(DVec2::new(window.x[0], window.y[0]));
                high = high.min(DVec2::new(window.x[1], window.y[1]));
            }
        }
        if low.cmpgt(high).any() {
            return false;
        }
        let share = match place {
            Place::Random { .. } => DVec2::new(rng.random(), rng.random()),
            Place::At(offset) => (offset + 1.0) * 0.5,
        };
        let height = surface.map_or(0.0, |surface| surface.top_center_m.z);
        after.set_pose(step.object, at(low + (high - low) * share, height), &object.joint_positions);
        let outline = after.outline(step.object).unwrap_or_default();
        surface.is_none_or(|surface| surface.is_over_top(outline.iter().copied(), EDGE_M))
    }

    /// True if no object but the carrier and the carrier's own supports is near the object in the plane, and no surface
    /// or board is beside it.
    fn is_free(&self, after: &PosedScene, moved: usize, support: Option<usize>) -> bool {
        if after.hits_surface(moved, self.settings.clearance_m) {
            return false;
        }
        let Some(bounds) = after.bounds(moved) else { return false };
        after.objects().enumerate().all(|(index, other)| {
            // Objects entirely below this one support its carrier.
            let below = after.bounds(index).is_some_and(|other| other.max.z <= bounds.min.z + BELOW_TOLERANCE_M);
            if index == moved || Some(index) == support || (support.is_some() && below) {
                return true;
            }
            let carrier = support.filter(|&support| after.surface_at(support).is_none());
            let holds_carrier = carrier
                .is_some_and(|carrier| other.model.card.is_container && planar_gap(after, carrier, index) == Some(0.0));
            holds_carrier || planar_gap(after, moved, index).is_some_and(|gap_m| gap_m >= self.settings.clearance_m)
        })
    }
}

/// Required normalised margin of an atom: `settings.margin_m` for directional relations, `near` and `between`; 0 for
/// support and containment, which have criteria of their own.
fn margin(atom: &Atom, settings: &GoalPoseSettings) -> f64 {
    match atom {
        Atom::Relation { relation, .. } if !relation.is_support() => Unit::Metre.normalise(settings.margin_m),
        _ => 0.0,
    }
}

/// Samples the xy position of the object's centre above the carrier: over its cavity, or over its top.
fn point_over(carrier: &PosedObject, object: &PosedObject, rotation: DQuat, place: Place, rng: &mut impl Rng) -> DVec2 {
    // Bounds are tightest in a frame aligned with the carrier.
    let ahead = carrier.pose.transform_vector(DVec3::X);
    let heading = DQuat::from_rotation_z(ahead.y.atan2(ahead.x));
    let relative = |rotation: DQuat| Pose { position: DVec3::ZERO, rotation: heading.inverse() * rotation };
    let half = object.model.world_bounds(&relative(rotation), &object.joint_positions).size().truncate() * 0.5;
    let top = relative(carrier.pose.rotation);
    let cavities = carrier.model.cavities(&carrier.joint_positions);
    let is_hollow = !cavities.is_empty();
    let area = match is_hollow {
        true => Aabb::from_pieces(&top, &cavities),
        false => carrier.model.world_bounds(&top, &carrier.joint_positions),
    };
    let slack = (area.size().truncate() * 0.5 - half - DVec2::splat(EDGE_M)).max(DVec2::splat(MIN_SLACK_M));
    let share = match (place, is_hollow) {
        (Place::At(offset), true) => USABLE_CAVITY_SHARE * offset,
        (Place::At(offset), false) => offset,
        (Place::Random { .. }, true) => {
            USABLE_CAVITY_SHARE * DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0))
        }
        // Uniform over a disc, so that an object does not end up over the missing corners of a round top.
        (Place::Random { spread }, false) => {
            spread.sqrt() * DVec2::from_angle(rng.random_range(0.0..TAU)) * rng.random::<f64>().sqrt()
        }
    };
    let center = area.center() + (slack * share).extend(0.0);
    carrier.pose.position.truncate() + (heading * center).truncate()
}
