//! More things beside those of a scenario, which stay where they are.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, ObjectModel, Pose, Scenario, Seed};
use genmanip_scene::relations::{PosedObject, PosedScene, ShapeCache};
use rand::RngExt;

use crate::audit::{AuditError, posed, scene_object, settled};
use crate::{LayoutSettings, distractors, placed_object};

/// Places that are drawn for each thing.
const PLACES: usize = 200;
/// Whole arrangements that are drawn.
const ARRANGEMENTS: usize = 12;
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
    let before = posed(scenario, assets, &mut ShapeCache::default())?;
    for arrangement in 0..ARRANGEMENTS {
        let seed = seed.fork_index(arrangement as u64);
        let drawn = distractors::draw(&scenario.task, assets.cards(), count, seed);
        let is_new = |uid: &str| scenario.objects.iter().all(|object| object.id != uid);
        let models = drawn.iter().map(|asset| assets.model(asset)).collect::<Result<Vec<_>, _>>()?;
        if models.len() < count || !models.iter().all(|model| is_new(&model.card.uid)) {
            continue;
        }
        let Some(poses) = places(&before, &models, seed, scenario, settings) else { continue };
        let mut objects: Vec<PosedObject> = before.objects().cloned().collect();
        objects.extend(models.iter().zip(poses).map(|(model, pose)| PosedObject {
            id: model.card.uid.clone(),
            model: Arc::clone(model),
            pose,
            joint_positions: vec![0.0; model.joint_count()],
        }));
        let known = before.objects().count();
        let start: Vec<_> = objects.iter().map(scene_object).collect();
        let Some(end) = settled(&start, &scenario.world, settings)? else { continue };
        let is_unmoved =
            start.iter().zip(&end).take(known).all(|(a, b)| a.pose.position.distance(b.position) < UNMOVED_M);
        if !is_unmoved {
            continue;
        }
        let mut crowded = scenario.clone();
        for (object, pose) in objects.iter().zip(&end).skip(known) {
            let object = PosedObject { pose: *pose, ..object.clone() };
            crowded.objects.push(placed_object(&object, assets)?);
        }
        return Ok(Some(crowded));
    }
    Ok(None)
}

/// A pose for each thing, apart from all others; `None` where one finds no place.
fn places(
    scene: &PosedScene,
    models: &[Arc<ObjectModel>],
    seed: Seed,
    scenario: &Scenario,
    settings: &LayoutSettings,
) -> Option<Vec<Pose>> {
    let rng = &mut seed.fork("places").rng();
    let area = scenario.world.workspace.within(settings.x_m, settings.y_m);
    let mut taken: Vec<Aabb> = (0..scene.objects().count()).filter_map(|index| scene.bounds(index)).collect();
    let mut poses = Vec::new();
    for model in models {
        let found = (0..PLACES).find_map(|_| {
            let between = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
            let center = DVec2::new(between(area.x, rng.random()), between(area.y, rng.random()));
            let pose = Pose::from_position_yaw(
                DVec3::new(center.x, center.y, 0.0),
                std::f64::consts::TAU * rng.random::<f64>(),
            );
            let bounds = model.world_bounds(&pose, &vec![0.0; model.joint_count()]);
            let is_inside = bounds.min.x >= area.x[0]
                && bounds.max.x <= area.x[1]
                && bounds.min.y >= area.y[0]
                && bounds.max.y <= area.y[1];
            let gap_m = settings.distractor_gap_m;
            let apart = |other: &Aabb| {
                let distance = (other.min - bounds.max).max(bounds.min - other.max).truncate();
                distance.max_element() >= gap_m
            };
            (is_inside && taken.iter().all(apart)).then_some((pose, bounds))
        });
        let (pose, bounds) = found?;
        taken.push(bounds);
        poses.push(pose);
    }
    Some(poses)
}
