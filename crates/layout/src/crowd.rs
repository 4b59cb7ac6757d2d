//! More things beside those of a scenario, which stay where they are.

use genmanip_assets::AssetSource;
use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, ObjectModel, Pose, Scenario, Seed};
use genmanip_relations::{PosedObject, ShapeCache};
use rand::RngExt;

use crate::audit::{AuditError, posed, scene_object, settled};
use crate::{LayoutSettings, distractors, placed_object};

/// Places that are drawn for each thing.
const PLACES: usize = 200;
/// Things that are tried for each that is wanted: some roll, some find no room.
const TRIED: usize = 6;
/// Farthest that a thing of the scenario may have moved once all is at rest, m: as much as when it is left alone.
const UNMOVED_M: f64 = 0.001;

/// A scenario with so many more things on the table, none of which the instruction could mean, at rest; `None` where
/// they find no room. Things of the scenario keep their poses.
///
/// # Errors
/// When an object is unknown or changed, or physics refuses the scene.
pub fn add_distractors(
    scenario: &Scenario,
    assets: &dyn AssetSource,
    count: usize,
    seed: Seed,
    settings: &LayoutSettings,
) -> Result<Option<Scenario>, AuditError> {
    let before: Vec<PosedObject> = posed(scenario, assets, &mut ShapeCache::default())?.objects().cloned().collect();
    let mut objects = before.clone();
    let drawn = distractors::draw(&scenario.task, assets.cards(), TRIED * count, seed);
    for (number, asset) in drawn.iter().enumerate() {
        if objects.len() == before.len() + count {
            break;
        }
        let model = assets.model(asset)?;
        if objects.iter().any(|other| other.id == model.card.uid) {
            continue;
        }
        let own = seed.fork("places").fork_index(number as u64);
        let Some(pose) = place(&objects, &model, own, scenario, settings) else { continue };
        let joint_positions = vec![0.0; model.joint_count()];
        let mut with_it = objects.clone();
        with_it.push(PosedObject { id: model.card.uid.clone(), model, pose, joint_positions });
        let start: Vec<_> = with_it.iter().map(scene_object).collect();
        let Some(end) = settled(&start, &scenario.world, settings)? else { continue };
        let moved_m = |(object, pose): (&PosedObject, &Pose)| object.pose.position.distance(pose.position);
        if objects.iter().zip(&end).map(moved_m).all(|moved_m| moved_m < UNMOVED_M) {
            with_it.iter_mut().zip(end).skip(objects.len()).for_each(|(object, pose)| object.pose = pose);
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

/// A pose on the table, apart from all others; `None` where no drawn one is.
fn place(
    objects: &[PosedObject],
    model: &ObjectModel,
    seed: Seed,
    scenario: &Scenario,
    settings: &LayoutSettings,
) -> Option<Pose> {
    let rng = &mut seed.rng();
    let joints = vec![0.0; model.joint_count()];
    let area = scenario.world.workspace.within(settings.wide_x_m, settings.wide_y_m);
    let bounds_of = |object: &PosedObject| object.model.world_bounds(&object.pose, &object.joint_positions);
    let taken: Vec<Aabb> = objects.iter().map(bounds_of).collect();
    (0..PLACES).find_map(|draw| {
        // Far from everything where there is room.
        let gap_m = if 2 * draw < PLACES { settings.distractor_gap_m } else { settings.min_gap_m };
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
