//! Where the moved object may end: poses drawn at random and kept when every atom of the move would hold.

use std::f64::consts::TAU;

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Aabb, Atom, Pose, Relation, Seed, Workspace};
use genmanip_scene::relations::{
    PosedObject, PosedScene, RelationSettings, judge_atom, measure_pair, placement_window,
};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::between;
use crate::moves::{Move, references};
use crate::placement::let_down;

/// A place for the object and what will carry it there.
#[derive(Clone, Debug)]
pub struct GoalPose {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Index of the object it will rest on or in; `None` for the table.
    pub support: Option<usize>,
    /// Bounds of the object there.
    pub bounds: Aabb,
}

/// How goal poses are searched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GoalPoseSettings {
    /// Goal poses kept.
    pub count: usize,
    /// Goal poses drawn at most.
    pub draws: usize,
    /// How far inside its threshold a direction must hold, metres.
    pub margin_m: f64,
    /// Free space around the object in the plane, metres.
    pub clearance_m: f64,
}

impl Default for GoalPoseSettings {
    fn default() -> Self {
        Self { count: 10, draws: 600, margin_m: 0.012, clearance_m: 0.015 }
    }
}

/// Up to `settings.count` places, the ones with the largest margins first.
///
/// Every atom of the move holds there, directions by `settings.margin_m`;
/// only places that are `usable` count, and nothing but what carries the object is nearer in the plane than `settings.clearance_m`.
#[allow(clippy::too_many_arguments)] // read-only context of one search
pub fn goal_poses(
    scene: &PosedScene,
    step: &Move,
    upright: DQuat,
    workspace: &Workspace,
    relations: &RelationSettings,
    settings: &GoalPoseSettings,
    usable: &dyn Fn(&Pose) -> bool,
    seed: Seed,
) -> Vec<GoalPose> {
    let rng = &mut seed.rng();
    let mut after = scene.clone();
    let support = step.atoms.iter().find_map(|atom| support_of(atom, scene));
    let mut found: Vec<(f64, GoalPose)> = Vec::new();
    for draw in 0..settings.draws {
        // The present heading first: most things need not be turned.
        let turn = if draw % 2 == 0 { 0.0 } else { rng.random_range(0.0..TAU) };
        let rotation = DQuat::from_rotation_z(turn) * upright;
        if !propose(scene, &mut after, step, support, rotation, workspace, relations, rng)
            || !is_free(&after, step.object, support, relations, settings)
        {
            continue;
        }
        let verdicts: Vec<_> = step.atoms.iter().map(|atom| judge_atom(&after, atom, relations)).collect();
        let holds = verdicts.iter().all(|verdict| verdict.holds && verdict.margin >= margin(&verdict.atom, settings));
        let posed = after.objects().nth(step.object).filter(|posed| holds && usable(&posed.pose));
        if let Some((posed, bounds)) = posed.zip(after.bounds(step.object)) {
            let worst = verdicts.iter().map(|verdict| verdict.margin).fold(f64::INFINITY, f64::min);
            found.push((worst, GoalPose { world_from_object: posed.pose, support, bounds }));
            if found.len() >= settings.count {
                break;
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, goal)| goal).collect()
}

/// Directions and nearness must hold with room to spare; support and containment have their own measure.
fn margin(atom: &Atom, settings: &GoalPoseSettings) -> f64 {
    match atom {
        Atom::Relation { relation, .. } if !relation.is_support() => settings.margin_m,
        _ => 0.0,
    }
}

fn support_of(atom: &Atom, scene: &PosedScene) -> Option<usize> {
    match atom {
        Atom::Relation { relation, reference, .. } if relation.is_support() => scene.index_of(reference),
        _ => None,
    }
}

/// Puts the object at a candidate pose; false when there is none.
#[allow(clippy::too_many_arguments)] // read-only context of one draw
fn propose(
    scene: &PosedScene,
    after: &mut PosedScene,
    step: &Move,
    support: Option<usize>,
    rotation: DQuat,
    workspace: &Workspace,
    relations: &RelationSettings,
    rng: &mut impl Rng,
) -> bool {
    let Some(object) = scene.objects().nth(step.object) else { return false };
    let bounds = object.model.world_bounds(&Pose { position: DVec3::ZERO, rotation }, &object.joint_positions);
    let (half, offset) = (bounds.size().truncate() * 0.5, bounds.center().truncate());
    let at = |center: DVec2, bottom: f64| Pose { position: (center - offset).extend(bottom - bounds.min.z), rotation };
    if let Some(carrier) = support {
        let Some((posed, outer)) = scene.objects().nth(carrier).zip(scene.bounds(carrier)) else { return false };
        let center = point_over(posed, &outer, half, rng);
        after.set_pose(step.object, at(center, outer.max.z + 0.01), &object.joint_positions);
        return let_down(after, step.object, carrier, 0.0005, relations);
    }
    let mut low = DVec2::new(workspace.x[0], workspace.y[0]) + half;
    let mut high = DVec2::new(workspace.x[1], workspace.y[1]) - half;
    for atom in &step.atoms {
        let Atom::Relation { relation, .. } = atom else { continue };
        let anchors: Vec<Aabb> = references(atom).filter_map(|uid| scene.bounds(scene.index_of(uid)?)).collect();
        if let (Relation::Between, [one, other]) = (relation, anchors.as_slice()) {
            let [least, most] = between::free_window(one, other, bounds.size());
            (low, high) = (low.max(least), high.min(most));
            continue;
        }
        for reference in references(atom) {
            let Some(anchor) = scene.index_of(reference).and_then(|index| scene.bounds(index)) else { return false };
            let Some(window) = placement_window(*relation, &anchor, bounds.size(), relations) else { return false };
            low = low.max(DVec2::new(window.x[0], window.y[0]));
            high = high.min(DVec2::new(window.x[1], window.y[1]));
        }
    }
    if low.cmpgt(high).any() {
        return false;
    }
    let share = DVec2::new(rng.random(), rng.random());
    after.set_pose(step.object, at(low + (high - low) * share, 0.0), &object.joint_positions);
    true
}

/// A point above the carrier: anywhere in its hollow, or near the middle of its top.
fn point_over(carrier: &PosedObject, outer: &Aabb, half: DVec2, rng: &mut impl Rng) -> DVec2 {
    let cavities = carrier.model.cavities(&carrier.joint_positions);
    let hollow = (!cavities.is_empty()).then(|| Aabb::from_pieces(&carrier.pose, &cavities));
    let area = hollow.as_ref().unwrap_or(outer);
    let slack = (area.size().truncate() * 0.5 - half - DVec2::splat(0.01)).max(DVec2::splat(0.003));
    let slack = if hollow.is_some() { slack } else { slack.min(DVec2::splat(0.02)) };
    area.center().truncate() + slack * 0.8 * DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0))
}

/// Whether nothing but its carrier, and what that stands on, is near the object in the plane.
fn is_free(
    after: &PosedScene,
    moved: usize,
    support: Option<usize>,
    relations: &RelationSettings,
    settings: &GoalPoseSettings,
) -> bool {
    let Some(bounds) = after.bounds(moved) else { return false };
    after.objects().enumerate().all(|(index, other)| {
        // Whatever lies wholly below the object is what its carrier stands on.
        let below = after.bounds(index).is_some_and(|other| other.max.z <= bounds.min.z + 0.002);
        if index == moved || Some(index) == support || (support.is_some() && below) {
            return true;
        }
        let holds_carrier = support.is_some_and(|carrier| {
            other.model.card.is_container
                && measure_pair(after, carrier, index, relations).is_some_and(|pair| pair.gap_m == 0.0)
        });
        holds_carrier
            || measure_pair(after, moved, index, relations).is_some_and(|pair| pair.gap_m >= settings.clearance_m)
    })
}
