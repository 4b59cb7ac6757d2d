//! Where the moved object may end: poses drawn at random and kept when every atom of the move would hold.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Atom, Pose, Relation, Seed, Workspace};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings, judge_atom, placement_window};
use rand::{Rng, RngExt};

use super::subgoals::{Move, references};
use super::ExpertSettings;

/// A place for the object and what will carry it there.
#[derive(Clone, Debug)]
pub struct GoalPose {
    /// `world_from_object` at rest.
    pub world_from_object: Pose,
    /// Index of the object it will rest on or in; `None` for the table.
    pub support: Option<usize>,
}

/// Up to `settings.goal_poses` places, the ones with the largest margins first.
///
/// Every atom of the move holds there by `settings.goal_margin_m`, atoms that hold already for other objects are
/// not this function's concern; nothing but the support is nearer than `settings.goal_clearance_m`.
pub fn sample(
    scene: &PosedScene,
    step: &Move,
    upright: DQuat,
    workspace: &Workspace,
    relations: &RelationSettings,
    settings: &ExpertSettings,
    seed: Seed,
) -> Vec<GoalPose> {
    let rng = &mut seed.rng();
    let object = &scene.objects()[step.object];
    let support = step.atoms.iter().find_map(|atom| support_of(atom, scene));
    let mut found: Vec<(f64, GoalPose)> = Vec::new();
    for draw in 0..settings.goal_pose_draws {
        // The present heading first: most things need not be turned.
        let turn = if draw % 2 == 0 { 0.0 } else { rng.random_range(0.0..TAU) };
        let rotation = DQuat::from_rotation_z(turn) * upright;
        let Some(goal) = candidate(scene, object, step, support, rotation, workspace, relations, rng) else {
            continue;
        };
        let placed = PosedObject::new(Arc::clone(&object.model), goal.world_from_object, object.joint_positions.clone());
        if !is_free(scene, &placed, step.object, support, settings) {
            continue;
        }
        let after = scene.with(step.object, placed);
        let verdicts: Vec<_> = step.atoms.iter().map(|atom| judge_atom(&after, atom, relations)).collect();
        if verdicts.iter().all(|verdict| verdict.holds && verdict.margin >= margin(&verdict.atom, settings)) {
            let worst = verdicts.iter().map(|verdict| verdict.margin).fold(f64::INFINITY, f64::min);
            found.push((worst, goal));
            if found.len() >= settings.goal_poses {
                break;
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, goal)| goal).collect()
}

/// Directions and nearness must hold with room to spare; containment has its own measure.
fn margin(atom: &Atom, settings: &ExpertSettings) -> f64 {
    match atom {
        Atom::Relation { relation, .. } if !relation.is_support() => settings.goal_margin_m,
        _ => 0.0,
    }
}

fn support_of(atom: &Atom, scene: &PosedScene) -> Option<usize> {
    match atom {
        Atom::Relation { relation, reference, .. } if relation.is_support() => scene.index_of(reference),
        _ => None,
    }
}

#[allow(clippy::too_many_arguments)] // read-only context of one draw
fn candidate(
    scene: &PosedScene,
    object: &PosedObject,
    step: &Move,
    support: Option<usize>,
    rotation: DQuat,
    workspace: &Workspace,
    relations: &RelationSettings,
    rng: &mut impl Rng,
) -> Option<GoalPose> {
    let turned = Pose { position: DVec3::ZERO, rotation };
    let bounds = object.model.world_bounds(&turned, &object.joint_positions);
    let (half, offset) = (bounds.size().truncate() * 0.5, bounds.center().truncate());
    if let Some(support) = support {
        let carrier = &scene.objects()[support];
        let center = over(carrier, half, rng);
        let over = Pose { position: (center - offset).extend(0.0), rotation };
        let world_from_object = lowered(object, &over, carrier);
        return Some(GoalPose { world_from_object, support: Some(support) });
    }
    let mut low = DVec2::new(workspace.x[0], workspace.y[0]) + half;
    let mut high = DVec2::new(workspace.x[1], workspace.y[1]) - half;
    for atom in &step.atoms {
        let Atom::Relation { relation, .. } = atom else { continue };
        for reference in references(atom) {
            let anchor = scene.objects().get(scene.index_of(reference)?)?;
            let relation = if *relation == Relation::Between { Relation::Near } else { *relation };
            let window = placement_window(relation, &anchor.bounds(), bounds.size(), relations)?;
            low = low.max(DVec2::new(window.x[0], window.y[0]));
            high = high.min(DVec2::new(window.x[1], window.y[1]));
        }
    }
    if low.cmpgt(high).any() {
        return None;
    }
    let draw = DVec2::new(rng.random(), rng.random());
    let center = low + (high - low) * draw;
    let position = (center - offset).extend(-bounds.min.z);
    Some(GoalPose { world_from_object: Pose { position, rotation }, support: None })
}

/// A point above the carrier: near the middle of what it offers.
fn over(carrier: &PosedObject, half: DVec2, rng: &mut impl Rng) -> DVec2 {
    let bounds = carrier.hollow_bounds().unwrap_or_else(|| carrier.bounds());
    let slack = (bounds.size().truncate() * 0.5 - half - DVec2::splat(0.01)).max(DVec2::splat(0.004));
    let slack = slack.min(if carrier.hollow_bounds().is_some() { DVec2::splat(1.0) } else { DVec2::splat(0.02) });
    bounds.center().truncate()
        + DVec2::new(slack.x * rng.random_range(-1.0..1.0), slack.y * rng.random_range(-1.0..1.0)) * 0.8
}

/// The object let down along z until it touches its carrier, by bisection over exact distances.
fn lowered(object: &PosedObject, over: &Pose, carrier: &PosedObject) -> Pose {
    let at = |z: f64| Pose { position: over.position.with_z(z), ..*over };
    let touches = |z: f64| {
        PosedObject::new(Arc::clone(&object.model), at(z), object.joint_positions.clone()).distance(carrier) <= 0.0
    };
    let depth = object.model.world_bounds(&at(0.0), &object.joint_positions).min.z;
    let (mut low, mut high) = (carrier.bounds().min.z - depth, carrier.bounds().max.z - depth + 0.002);
    for _ in 0..14 {
        let middle = (low + high) / 2.0;
        if touches(middle) { low = middle } else { high = middle }
    }
    at(high + 0.0005)
}

fn is_free(
    scene: &PosedScene,
    placed: &PosedObject,
    moved: usize,
    support: Option<usize>,
    settings: &ExpertSettings,
) -> bool {
    scene.objects().iter().enumerate().all(|(index, other)| {
        if index == moved || Some(index) == support {
            return true;
        }
        let carries_support = support.is_some_and(|support| scene.objects()[support].distance(other) < 0.002);
        let needed = if carries_support { 0.002 } else { settings.goal_clearance_m };
        placed.distance(other) >= needed
    })
}
