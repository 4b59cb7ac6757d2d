//! Adds distractors to a finished scenario without moving its objects.

use genmanip_assets::{AssetSource, robots};
use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, InstanceId, ObjectModel, ObjectState, Pose, Scenario, Seed, Workspace};
use genmanip_relations::{PosedObject, ShapeCache};
use rand::RngExt;

use crate::audit::{AuditError, posed, rest_states, scene_object};
use crate::placed_object::placed_object;
use crate::{LayoutSettings, distractors};

/// Number of poses sampled per object. Chosen by hand.
const POSES_PER_OBJECT: usize = 200;
/// Number of candidates sampled per requested distractor: some roll away, some do not fit.
const CANDIDATES_PER_OBJECT: usize = 6;
/// Maximum displacement of the scenario's objects after settling (m), as for an undisturbed layout.
const MAX_DISPLACEMENT_M: f64 = 0.001;

/// Adds `count` distractors at rest, none of which the instruction could refer to; `None` if they do not fit. The
/// objects of the scenario keep their poses.
///
/// # Errors
/// Fails if an object is unknown or changed, or the simulation fails.
pub fn add_distractors(
    scenario: &Scenario,
    assets: &dyn AssetSource,
    count: usize,
    seed: Seed,
    settings: &LayoutSettings,
) -> Result<Option<Scenario>, AuditError> {
    let before: Vec<PosedObject> = posed(scenario, assets, &mut ShapeCache::default())?.objects().cloned().collect();
    let reach_scale = robots::of_world(&scenario.world)?.reach_scale();
    let area = settings.area(&scenario.world.workspace, reach_scale, true);
    let mut objects = before.clone();
    let sampled = distractors::sample(&scenario.task, assets.cards(), CANDIDATES_PER_OBJECT * count, seed);
    for (number, asset) in sampled.iter().enumerate() {
        if objects.len() == before.len() + count {
            break;
        }
        let model = assets.model(asset)?;
        let id = InstanceId::new(&model.card.uid, 1);
        if objects.iter().any(|other| other.id == id) {
            continue;
        }
        let stream = seed.fork("places").fork_index(number as u64);
        let Some(pose) = place(&objects, &model, stream, &area, settings) else { continue };
        let joint_positions = vec![0.0; model.joint_count()];
        let mut with_it = objects.clone();
        with_it.push(PosedObject { id, model, pose, joint_positions });
        let start: Vec<_> = with_it.iter().map(scene_object).collect();
        let Some(end) = rest_states(&start, &scenario.world, settings)? else { continue };
        let moved_m = |(object, end): (&PosedObject, &ObjectState)| object.pose.position.distance(end.pose.position);
        if objects.iter().zip(&end).map(moved_m).all(|moved_m| moved_m < MAX_DISPLACEMENT_M) {
            with_it.iter_mut().zip(end).skip(objects.len()).for_each(|(object, end)| object.pose = end.pose);
            objects = with_it;
        }
    }
    if objects.len() < before.len() + count {
        return Ok(None);
    }
    let mut crowded = scenario.clone();
    for object in &objects[before.len()..] {
        crowded.objects.push(placed_object(object, assets)?);
    }
    Ok(Some(crowded))
}

/// Samples a pose in the area on the table clear of all other objects; `None` if there is none.
fn place(
    objects: &[PosedObject],
    model: &ObjectModel,
    seed: Seed,
    area: &Workspace,
    settings: &LayoutSettings,
) -> Option<Pose> {
    let rng = &mut seed.rng();
    let joints = vec![0.0; model.joint_count()];
    let bounds_of = |object: &PosedObject| object.model.world_bounds(&object.pose, &object.joint_positions);
    let taken: Vec<Aabb> = objects.iter().map(bounds_of).collect();
    (0..POSES_PER_OBJECT).find_map(|sample| {
        // The first half of the samples keeps the distractors' usual gap, the second half only the minimum gap.
        let gap_m = if 2 * sample < POSES_PER_OBJECT { settings.distractor_gap_m } else { settings.min_gap_m };
        let between = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
        let position = DVec3::new(between(area.x, rng.random()), between(area.y, rng.random()), 0.0);
        let pose = Pose::from_position_yaw(position, std::f64::consts::TAU * rng.random::<f64>());
        let bounds = model.world_bounds(&pose, &joints);
        let is_inside = |axis: usize, [low, high]: [f64; 2]| bounds.min[axis] >= low && bounds.max[axis] <= high;
        let apart = |other: &Aabb| {
            let gap = (other.min - bounds.max).max(bounds.min - other.max).truncate();
            gap.max_element() >= gap_m
        };
        (is_inside(0, area.x) && is_inside(1, area.y) && taken.iter().all(apart)).then_some(pose)
    })
}
