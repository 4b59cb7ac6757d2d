//! What the planner must keep clear of: the support surfaces and the objects where they are now.

use genmanip_core::glam::DVec3;
use genmanip_core::{Grasp, ObjectModel, Seed, TriedGrasp};
use genmanip_motion::{CollisionWorld, GeometryError, GraspTarget, Planner};
use genmanip_relations::PosedScene;

/// Grasps that held in a smaller share of their trials are not used; chosen: of five trials, which bakes make, one may be
/// lost.
const SOUND: f64 = 0.8;

/// Every support surface by its id, and every object but one by its own, exact pieces at their present poses.
pub fn around(scene: &PosedScene, without: Option<usize>) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    for surface in scene.surfaces() {
        // A checked world's boxes and finite poses are always accepted.
        let _ = world.add(&surface.id, &surface.pieces(), &surface.world_from_surface());
    }
    for (index, object) in scene.objects().enumerate() {
        if Some(index) != without {
            let _ = world.add(&object.id, &object.model.pieces(&object.joint_positions), &object.pose);
        }
    }
    world
}

/// Points on the drawn surface of an object's first link with outward normals, in the object's frame.
fn surface(model: &ObjectModel, count: usize) -> Vec<(DVec3, DVec3)> {
    let Some(link) = model.links.first() else { return Vec::new() };
    let areas: Vec<f64> = link
        .visual
        .iter()
        .map(|part| part.mesh.corners().map(|[a, b, c]| (b - a).cross(c - a).length()).sum::<f64>())
        .collect();
    let total: f64 = areas.iter().sum();
    let mut points = Vec::new();
    for (index, (part, area)) in link.visual.iter().zip(&areas).enumerate() {
        let share = (count as f64 * area / total.max(f64::MIN_POSITIVE)).round() as usize;
        let rng = &mut Seed::new(0).fork("grasp surface").fork_index(index as u64).rng();
        points.extend(part.mesh.sample_surface(share, rng).into_iter().map(|(point, normal)| {
            (part.link_from_part.transform_point(point), part.link_from_part.transform_vector(normal))
        }));
    }
    points
}

/// Of grasps that were tried on an object in physics beforehand, those that held and fit where the object lies, best
/// first, in its own frame. `known` is what a [`GraspLibrary`](genmanip_assets::GraspLibrary) has of it.
///
/// # Errors
/// A piece of the object that is not finite or has no size.
pub fn tried_grasps(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    known: &[TriedGrasp],
) -> Result<Vec<Grasp>, GeometryError> {
    if known.is_empty() {
        return Ok(Vec::new());
    }
    let sound = known.iter().filter(|tried| tried.share() >= SOUND).map(|tried| &tried.grasp);
    with_target(planner, scene, object, |target| planner.fitting_grasps(target, sound))
}

/// Grasp candidates on an object as it lies, from its geometry alone, best first, in its own frame.
///
/// # Errors
/// A piece of the object that is not finite or has no volume.
pub fn generated_grasps(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    seed: Seed,
) -> Result<Vec<Grasp>, GeometryError> {
    with_target(planner, scene, object, |target| planner.grasps(target, seed.fork("grasps")))
}

fn with_target(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    use_it: impl FnOnce(&GraspTarget) -> Result<Vec<Grasp>, GeometryError>,
) -> Result<Vec<Grasp>, GeometryError> {
    let Some((posed, bounds)) = scene.objects().nth(object).zip(scene.bounds(object)) else { return Ok(Vec::new()) };
    let Some(link) = posed.model.links.first() else { return Ok(Vec::new()) };
    use_it(&GraspTarget {
        surface: &surface(&posed.model, planner.settings().grasp.surface_points),
        pieces: &link.pieces,
        center_of_mass: link.mass.center,
        world_from_object: posed.pose,
        table_height: bounds.min.z,
    })
}
