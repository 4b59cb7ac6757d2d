//! Collision world of the support surfaces and the objects at their current poses.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, ObjectModel, Seed, VerifiedGrasp};
use genmanip_motion::{CollisionWorld, GeometryError, GraspTarget, Planner};
use genmanip_relations::PosedScene;

/// Minimum success rate of a known grasp in its physics trials. Chosen: of five trials one may fail.
const MIN_SUCCESS_RATE: f64 = 0.8;

/// Angle between the approach direction and the vertical from which a grasp counts as tilted, rad: the error of the
/// orientation that arms with fewer than six joints may have.
const TILTED_RAD: f64 = 0.06;

/// Collision world of all support surfaces and all objects but one, with exact collision pieces.
pub fn around(scene: &PosedScene, without: Option<usize>) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    for surface in scene.surfaces() {
        // Boxes of a validated world and finite poses cannot be rejected.
        let _ = world.add(surface.id.as_str(), &surface.pieces(), &surface.world_from_surface());
    }
    for (index, object) in scene.objects().enumerate() {
        if Some(index) != without {
            let _ = world.add(object.id.as_str(), &object.model.pieces(&object.joint_positions), &object.pose);
        }
    }
    world
}

/// Samples points with outward normals on the visual surface of an object's first link, object frame.
pub fn surface(model: &ObjectModel, count: usize) -> Vec<(DVec3, DVec3)> {
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

/// Known grasps that passed their physics trials and fit the object's pose, best first, in the object frame. `known`
/// comes from a [`GraspLibrary`](genmanip_assets::GraspLibrary).
///
/// # Errors
/// Fails if a collision piece is not finite or has no size.
pub fn verified_grasps(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    known: &[VerifiedGrasp],
) -> Result<Vec<Grasp>, GeometryError> {
    if known.is_empty() {
        return Ok(Vec::new());
    }
    let reliable = known.iter().filter(|tried| tried.share() >= MIN_SUCCESS_RATE).map(|tried| &tried.grasp);
    with_target(planner, scene, object, |target| planner.fitting_grasps(target, reliable))
}

/// Samples grasps on an object at its pose from geometry alone, best first, in the object frame.
///
/// An arm with fewer than six joints tilts its gripper only in the vertical plane through its first axis: for such an
/// arm, tilted grasps on round objects are turned into that plane.
///
/// # Errors
/// Fails if a collision piece is not finite or has no volume.
pub fn generated_grasps(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    seed: Seed,
) -> Result<Vec<Grasp>, GeometryError> {
    let has_few = planner.tool_dof() < 6;
    with_target(planner, scene, object, |target| {
        let grasps = planner.grasps(target, seed.fork("grasps"))?;
        if !has_few {
            return Ok(grasps);
        }
        let object_from_world = target.world_from_object.rotation.inverse();
        let is_tilted = |grasp: &Grasp| (object_from_world * DVec3::NEG_Z).angle_between(grasp.approach()) > TILTED_RAD;
        let outward = planner.tilted_outward(target.world_from_object.position, TILTED_RAD);
        let turned = planner.grasps_towards(target, grasps.clone(), outward)?;
        Ok(grasps
            .into_iter()
            .zip(turned)
            .map(|(grasp, turned)| if is_tilted(&grasp) { turned } else { grasp })
            .collect())
    })
}

/// Grasps (object frame) on a round object, turned about the vertical as near to a tool orientation (world frame) as
/// possible if they then still fit; other grasps unchanged.
///
/// # Errors
/// Fails if a collision piece is not finite or has no volume.
pub fn grasps_towards(
    planner: &Planner,
    scene: &PosedScene,
    object: usize,
    grasps: Vec<Grasp>,
    world_from_tcp: DQuat,
) -> Result<Vec<Grasp>, GeometryError> {
    with_target(planner, scene, object, |target| {
        let turned = planner.grasps_towards(target, grasps, world_from_tcp)?;
        planner.fitting_grasps(target, turned.iter())
    })
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
