//! Where the moved object may end: poses drawn at random and kept when every atom of the move would hold.

use std::f64::consts::TAU;

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Aabb, Atom, AtomVerdict, Pose, Relation, Seed, Unit, Workspace};
use genmanip_relations::{PosedObject, PosedScene, RelationSettings, judge_atom, placement_window, planar_gap};
use rand::{Rng, RngExt};

use crate::between;
use crate::moves::{Move, references};
use crate::placement::let_down;
use crate::settings::GoalPoseSettings;

/// A place for the object and what will carry it there.
#[derive(Clone, Debug)]
pub struct GoalPose {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Index of the object it will rest on or in; `None` for the table and other surfaces.
    pub support: Option<usize>,
    /// Bounds of the object there.
    pub bounds: Aabb,
}

/// Room between an object and the edge of what it is put on or into, metres; chosen, more than the
/// arm is off where it puts something.
const EDGE_M: f64 = 0.01;

/// Draws to see whether a later move still finds room; chosen, a fifth of what the move itself gets.
const LATER_DRAWS: usize = 120;

/// Least freedom on a carrier along each axis, metres, and the share of a hollow's that is used; chosen, since hollows are
/// boxes here and round in truth.
const LEAST_SLACK_M: f64 = 0.003;
const HOLLOW_USED: f64 = 0.8;

/// Height above its carrier from which an object is let down, and what is left between the two, metres; chosen: any height
/// above it will do, and what is left is less than a layout's drop.
const ABOVE_M: f64 = 0.01;
const LEFT_M: f64 = 0.0005;

/// How far the top of another thing may be over an object's bottom and still count as below it, metres; chosen, more than
/// contacts sink in.
const BELOW_M: f64 = 0.002;

/// Where to put things so that goals hold.
#[derive(Clone, Copy, Debug)]
pub struct GoalSearch<'a> {
    /// Everything where it is now.
    pub scene: &'a PosedScene,
    /// Orientation in which each object is put down, up to its heading.
    pub upright: &'a [DQuat],
    /// Where things may stand on the table.
    pub workspace: &'a Workspace,
    /// The judge's settings.
    pub relations: &'a RelationSettings,
    /// How to search.
    pub settings: &'a GoalPoseSettings,
}

impl GoalSearch<'_> {
    /// Up to `settings.count` places for the object of a move, the ones with the largest margins first.
    ///
    /// Every atom of the move holds there, directions by `settings.margin_m`;
    /// only places that are `usable` count, and nothing but what carries the object is nearer in the plane than `settings.clearance_m`.
    /// What `later` moves put on or into the same thing still finds room beside it; if that cannot be, it need not.
    pub fn places(&self, step: &Move, later: &[Move], usable: &dyn Fn(&Pose) -> bool, seed: Seed) -> Vec<GoalPose> {
        let rng = &mut seed.rng();
        let mut after = self.scene.clone();
        let base = self.base_of(step);
        // What is put on a surface stands beside what is there, as on the table.
        let support = base.filter(|&base| self.scene.surface_at(base).is_none());
        let beside: Vec<&Move> = later.iter().filter(|other| base.is_some() && self.base_of(other) == base).collect();
        let (mut found, mut selfish): (Vec<(f64, GoalPose)>, Vec<_>) = (Vec::new(), Vec::new());
        let settings = self.settings;
        for draw in 0..settings.draws {
            // The present heading first: most things need not be turned.
            let turn = if draw % 2 == 0 { 0.0 } else { rng.random_range(0.0..TAU) };
            let rotation = DQuat::from_rotation_z(turn) * self.upright[step.object];
            let spread = draw as f64 / settings.draws as f64;
            if !self.propose(&mut after, step, base, rotation, spread, rng) || !self.is_free(&after, step.object, base)
            {
                continue;
            }
            let verdicts: Vec<_> = step.atoms.iter().map(|atom| judge_atom(&after, atom, self.relations)).collect();
            let holds = verdicts
                .iter()
                .all(|verdict| verdict.holds && verdict.normalised_margin() >= margin(&verdict.atom, settings));
            let posed = after.objects().nth(step.object).filter(|posed| holds && usable(&posed.pose));
            if let Some((posed, bounds)) = posed.zip(after.bounds(step.object)) {
                let worst = verdicts.iter().map(AtomVerdict::normalised_margin).fold(f64::INFINITY, f64::min);
                let goal = (worst, GoalPose { world_from_object: posed.pose, support, bounds });
                if !self.have_room(&after, &beside, seed.fork("later").fork_index(draw as u64)) {
                    selfish.push(goal);
                    continue;
                }
                found.push(goal);
                if found.len() >= settings.count {
                    break;
                }
            }
        }
        if found.is_empty() {
            selfish.truncate(settings.count);
            found = selfish;
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.into_iter().map(|(_, goal)| goal).collect()
    }

    /// Whether moves find their places, one after the other.
    fn have_room(&self, scene: &PosedScene, steps: &[&Move], seed: Seed) -> bool {
        let settings = GoalPoseSettings { count: 1, draws: LATER_DRAWS, ..self.settings.clone() };
        let mut scene = scene.clone();
        steps.iter().enumerate().all(|(index, step)| {
            let search = GoalSearch { scene: &scene, settings: &settings, ..*self };
            let places = search.places(step, &[], &|_| true, seed.fork_index(index as u64));
            let Some(place) = places.first() else { return false };
            let joints = scene.objects().nth(step.object).map_or(Vec::new(), |posed| posed.joint_positions.clone());
            scene.set_pose(step.object, place.world_from_object, &joints);
            true
        })
    }

    /// The object or surface that a move puts its object on or into; `None` for the table.
    fn base_of(&self, step: &Move) -> Option<usize> {
        step.atoms.iter().find_map(|atom| match atom {
            Atom::Relation { relation, reference, .. } if relation.is_support() => self.scene.index_of(reference),
            _ => None,
        })
    }

    /// Puts the object at a candidate pose; false when there is none. `spread` in 0-1 is how far from the middle.
    fn propose(
        &self,
        after: &mut PosedScene,
        step: &Move,
        base: Option<usize>,
        rotation: DQuat,
        spread: f64,
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
            let center = point_over(posed, object, rotation, spread, rng);
            after.set_pose(step.object, at(center, outer.max.z + ABOVE_M), &object.joint_positions);
            return let_down(after, step.object, carrier, LEFT_M, self.relations);
        }
        let area = surface.map_or(*self.workspace, |surface| surface.area(EDGE_M));
        let mut low = DVec2::new(area.x[0], area.y[0]) + half;
        let mut high = DVec2::new(area.x[1], area.y[1]) - half;
        for atom in &step.atoms {
            let Atom::Relation { relation, .. } = atom else { continue };
            if surface.is_some() && relation.is_support() {
                continue;
            }
            let anchor = |id: &str| self.scene.bounds(self.scene.index_of(id)?);
            let anchors: Vec<Aabb> = references(atom).filter_map(anchor).collect();
            if let (Relation::Between, [one, other]) = (relation, anchors.as_slice()) {
                let [least, most] = between::free_window(one, other, bounds.size());
                (low, high) = (low.max(least), high.min(most));
                continue;
            }
            for reference in references(atom) {
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
        let share = DVec2::new(rng.random(), rng.random());
        let height = surface.map_or(0.0, |surface| surface.top_center_m.z);
        after.set_pose(step.object, at(low + (high - low) * share, height), &object.joint_positions);
        let outline = after.outline(step.object).unwrap_or_default();
        surface.is_none_or(|surface| surface.is_over_top(outline.iter().copied(), EDGE_M))
    }

    /// Whether nothing but its carrier, and what that stands on, is near the object in the plane, and no surface or board
    /// is beside it.
    fn is_free(&self, after: &PosedScene, moved: usize, support: Option<usize>) -> bool {
        if after.hits_surface(moved, self.settings.clearance_m) {
            return false;
        }
        let Some(bounds) = after.bounds(moved) else { return false };
        after.objects().enumerate().all(|(index, other)| {
            // Whatever lies wholly below the object is what its carrier stands on.
            let below = after.bounds(index).is_some_and(|other| other.max.z <= bounds.min.z + BELOW_M);
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

/// The normalised margin that an atom needs: directions, nearness and between must hold with room to spare, support
/// and containment have their own measure.
fn margin(atom: &Atom, settings: &GoalPoseSettings) -> f64 {
    match atom {
        Atom::Relation { relation, .. } if !relation.is_support() => Unit::Metre.normalise(settings.margin_m),
        _ => 0.0,
    }
}

/// A point above the carrier for the middle of an object turned like this: anywhere in its hollow, or over its top,
/// the farther from the middle the larger `spread`.
fn point_over(carrier: &PosedObject, object: &PosedObject, rotation: DQuat, spread: f64, rng: &mut impl Rng) -> DVec2 {
    // In a frame that is turned with the carrier its bounds fit best.
    let ahead = carrier.pose.transform_vector(DVec3::X);
    let heading = DQuat::from_rotation_z(ahead.y.atan2(ahead.x));
    let turned = |rotation: DQuat| Pose { position: DVec3::ZERO, rotation: heading.inverse() * rotation };
    let half = object.model.world_bounds(&turned(rotation), &object.joint_positions).size().truncate() * 0.5;
    let top = turned(carrier.pose.rotation);
    let cavities = carrier.model.cavities(&carrier.joint_positions);
    let is_hollow = !cavities.is_empty();
    let area = match is_hollow {
        true => Aabb::from_pieces(&top, &cavities),
        false => carrier.model.world_bounds(&top, &carrier.joint_positions),
    };
    let slack = (area.size().truncate() * 0.5 - half - DVec2::splat(EDGE_M)).max(DVec2::splat(LEAST_SLACK_M));
    let share = match is_hollow {
        true => HOLLOW_USED * DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)),
        // Evenly over a disc, so that nothing stands on a corner that round things do not have.
        false => spread.sqrt() * DVec2::from_angle(rng.random_range(0.0..TAU)) * rng.random::<f64>().sqrt(),
    };
    let center = area.center() + (slack * share).extend(0.0);
    carrier.pose.position.truncate() + (heading * center).truncate()
}
