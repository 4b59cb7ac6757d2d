//! Tests of the point-cloud sampler.

use genmanip_core::Seed;
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use rand::RngExt;

use super::*;
use crate::test_robot::test_panda;
use crate::{Planner, PlannerSettings};

const CAMERA: DVec3 = DVec3::new(1.5, 0.2, 1.0);

/// Points on the six faces of a box on the table.
fn cuboid(size: DVec3, yaw: f64, count: usize) -> Vec<(DVec3, DVec3)> {
    let mut rng = Seed::new(3).rng();
    let areas = [size.y * size.z, size.x * size.z, size.x * size.y];
    let turn = DQuat::from_rotation_z(yaw);
    (0..count)
        .map(|_| {
            let mut side = rng.random::<f64>() * areas.iter().sum::<f64>();
            let axis = (0..2).find(|&axis| {
                side -= areas[axis];
                side < 0.0
            });
            let normal = DVec3::AXES[axis.unwrap_or(2)] * if rng.random::<bool>() { 1.0 } else { -1.0 };
            let mut draw = || rng.random::<f64>() - 0.5;
            let inside = DVec3::new(draw(), draw(), draw()) * size;
            let point = inside * (DVec3::ONE - normal.abs()) + normal * size / 2.0;
            (turn * point + DVec3::new(0.5, 0.0, size.z / 2.0), turn * normal)
        })
        .collect()
}

/// Points of a convex body visible to a camera.
fn facing(points: &[(DVec3, DVec3)], camera: DVec3) -> Vec<DVec3> {
    points.iter().filter(|(point, normal)| normal.dot(camera - *point) > 0.0).map(|(point, _)| *point).collect()
}

fn planner() -> Planner {
    Planner::new(test_panda(), PlannerSettings::default()).unwrap()
}

fn target<'a>(points: &'a [DVec3], cameras: &'a [DVec3], scene: &'a [DVec3]) -> CloudTarget<'a> {
    CloudTarget { points, cameras, scene, table_height: 0.0 }
}

#[test]
fn boxes_are_grasped_across_their_narrow_side_from_all_sides_and_from_one() {
    let planner = planner();
    for (size, yaw) in [([0.05, 0.05, 0.05], 0.4), ([0.04, 0.12, 0.06], 1.1), ([0.15, 0.012, 0.006], 0.3)] {
        let size = DVec3::from_array(size);
        let body = cuboid(size, yaw, 4000);
        let whole: Vec<DVec3> = body.iter().map(|(point, _)| *point).collect();
        let seen = facing(&body, CAMERA);
        for (points, cameras) in [(&whole, [].as_slice()), (&seen, [CAMERA].as_slice())] {
            let grasps = planner.cloud_grasps(&target(points, cameras, &[])).unwrap();
            assert_eq!(grasps, planner.cloud_grasps(&target(points, cameras, &[])).unwrap(), "not deterministic");
            let best = &grasps.first().unwrap_or_else(|| panic!("{size}: no grasp")).grasp;
            let narrow = if size.x < size.y { DVec3::X } else { DVec3::Y };
            let closing = best.pose.transform_vector(DVec3::Y);
            let aligned = (DQuat::from_rotation_z(yaw) * narrow).dot(closing).abs();
            let square = (size.x - size.y).abs() < 1e-9 && aligned < 0.3;
            assert!(aligned > 0.97 || square, "{size}: closes {aligned} off the narrow side");
            // From one view half of a long side's contacts are estimates, and the grasp may be off-centre.
            let (off, width_off) = if cameras.is_empty() { (0.03, 0.006) } else { (0.07, 0.008) };
            assert!((best.width - size.x.min(size.y)).abs() < width_off, "{size}: width {}", best.width);
            assert!((best.pose.position - DVec3::new(0.5, 0.0, size.z / 2.0)).length() < off, "{size}: {best:?}");
            assert!(grasps.windows(2).all(|pair| pair[0].grasp.score >= pair[1].grasp.score), "{size}: not sorted");
        }
    }
}

#[test]
fn what_stands_in_the_way_is_kept_clear_of_and_what_is_too_wide_has_no_good_grasp() {
    let planner = planner();
    let body: Vec<DVec3> = cuboid(DVec3::new(0.05, 0.05, 0.08), 0.0, 3000).iter().map(|(point, _)| *point).collect();
    // Two walls beside it, along x: the fingers only fit along x.
    let walls: Vec<DVec3> = cuboid(DVec3::new(0.2, 0.04, 0.08), 0.0, 3000)
        .iter()
        .flat_map(|(point, _)| [*point + DVec3::Y * 0.05, *point - DVec3::Y * 0.05])
        .collect();
    let grasps = planner.cloud_grasps(&target(&body, &[], &walls)).unwrap();
    assert!(!grasps.is_empty());
    for grasp in &grasps {
        let closing = grasp.grasp.pose.transform_vector(DVec3::Y);
        assert!(closing.x.abs() > 0.8, "a finger goes into the wall: {closing}");
    }
    let crate_sized: Vec<DVec3> = cuboid(DVec3::splat(0.12), 0.2, 3000).iter().map(|(point, _)| *point).collect();
    // Only its corners fit between the pads, and they would slip.
    for grasp in planner.cloud_grasps(&target(&crate_sized, &[], &[])).unwrap() {
        assert!(grasp.grasp.score < 0.75 && grasps[0].grasp.score > 0.9, "{grasp:?}");
    }
}

/// Signed distance of a point to a box as [`cuboid`] makes it, negative inside.
fn from_surface(point: DVec3, size: DVec3, yaw: f64) -> f64 {
    let local = DQuat::from_rotation_z(-yaw) * (point - DVec3::new(0.5, 0.0, size.z / 2.0));
    let beyond = local.abs() - size / 2.0;
    beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
}

#[test]
fn far_sides_of_boxes_are_guessed_however_they_are_turned() {
    for (size, yaw) in [([0.06, 0.06, 0.07], 0.5), ([0.07, 0.14, 0.06], 0.6), ([0.05, 0.18, 0.1], -0.5)] {
        let size = DVec3::from_array(size);
        let seen = facing(&cuboid(size, yaw, 6000), CAMERA);
        let unseen = occlusion::Occlusion::new(&seen, &[], &[CAMERA]);
        let guessed = unseen.complete(&seen, 0.97);
        let off = guessed.iter().filter(|seen| from_surface(seen.point, size, yaw).abs() > 0.01).count();
        assert!(guessed.len() > 200 && off * 4 < guessed.len(), "{size}: {off} of {} are off", guessed.len());
    }
}

#[test]
fn no_pad_goes_where_only_the_camera_sees_nothing() {
    let planner = planner();
    let gripper = planner.gripper();
    for (size, yaw) in [([0.05, 0.19, 0.2], 0.2), ([0.07, 0.07, 0.2], 0.5), ([0.03, 0.15, 0.22], -0.4)] {
        let size = DVec3::from_array(size);
        let seen = facing(&cuboid(size, yaw, 8000), CAMERA);
        for grasp in planner.cloud_grasps(&target(&seen, &[CAMERA], &[])).unwrap() {
            for side in [-1.0, 1.0] {
                let beside = side * (grasp.opening / 2.0 + gripper.pad_size.x / 2.0);
                let tip = grasp.grasp.pose.transform_point(DVec3::new(0.0, beside, gripper.tip - 0.003));
                let depth = from_surface(tip, size, yaw);
                assert!(depth > -0.008, "{size}: a pad is {:.1} mm inside: {grasp:?}", depth * -1e3);
            }
        }
    }
}

#[test]
fn what_others_hide_and_what_lies_below_a_top_is_known_to_be_unknown() {
    let size = DVec3::new(0.06, 0.06, 0.08);
    let seen = facing(&cuboid(size, 0.0, 6000), CAMERA);
    // A wall between camera and box, to its left.
    let wall: Vec<DVec3> =
        (0..6000).map(|i| DVec3::new(0.6, 0.02 + 0.0015 * f64::from(i % 60), 0.0015 * f64::from(i / 60))).collect();
    let unseen = occlusion::Occlusion::new(&seen, &wall, &[CAMERA]);
    let cases = [
        ("in the box", [0.5, -0.01, 0.04], false, true),
        ("before the box", [0.56, -0.02, 0.04], false, false),
        ("behind the box", [0.45, -0.01, 0.04], false, false),
        ("above the box", [0.5, -0.01, 0.1], false, false),
        ("behind the wall", [0.56, 0.05, 0.03], true, false),
        ("before the wall", [0.65, 0.05, 0.03], false, false),
    ];
    for (what, [x, y, z], behind_others, inside) in cases {
        let point = DVec3::new(x, y, z);
        assert_eq!((unseen.is_behind_others(point), unseen.is_inside(point)), (behind_others, inside), "{what}");
    }
    let everything = occlusion::Occlusion::new(&seen, &wall, &[]);
    assert!(!everything.is_behind_others(DVec3::new(0.56, 0.05, 0.03)) && !everything.is_inside(DVec3::Z * 0.04));
}

#[test]
fn broken_clouds_are_refused_with_the_reason() {
    let mut far: Vec<DVec3> = cuboid(DVec3::splat(0.05), 0.0, 300).iter().map(|(point, _)| *point).collect();
    far[3].y = 4e10;
    let planner = planner();
    let line: Vec<DVec3> = (0..200).map(|i| DVec3::new(0.5 + 0.001 * f64::from(i), 0.0, 0.02)).collect();
    let mut broken = line.clone();
    broken[7].y = f64::NAN;
    let cases: [(&[DVec3], &str); 6] = [
        (&[], "the cloud of the target is empty"),
        (&line[..1], "the cloud of the target has 1 points, expected at least 12"),
        (&[DVec3::ONE; 100], "the cloud of the target has no extent: 0.00 mm across, expected a surface"),
        (&line, "the cloud of the target has no extent: 0.00 mm across, expected a surface"),
        (&broken, "point 7 of the target is not finite"),
        (&far, "the cloud of the target is 4.000e10 m wide, expected at most 5 m: are its points metres?"),
    ];
    for (points, message) in cases {
        let error = planner.cloud_grasps(&target(points, &[], &[])).unwrap_err();
        assert_eq!(error.to_string(), message);
    }
    let body: Vec<DVec3> = cuboid(DVec3::splat(0.05), 0.0, 300).iter().map(|(point, _)| *point).collect();
    let error = planner.cloud_grasps(&target(&body, &[], &[DVec3::INFINITY])).unwrap_err();
    assert_eq!(error.to_string(), "point 0 of the scene is not finite");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Any cloud yields grasps that fit the gripper and stay above the table, or one error.
    #[test]
    fn any_cloud_gives_sound_grasps(
        points in prop::collection::vec(prop::array::uniform3(-0.1..0.1_f64), 0..400),
        camera in prop::option::of(prop::array::uniform3(-2.0..2.0_f64)),
    ) {
        let points: Vec<DVec3> = points.into_iter().map(|p| DVec3::from_array(p) + DVec3::Z * 0.1).collect();
        let cameras: Vec<DVec3> = camera.into_iter().map(DVec3::from_array).collect();
        let planner = planner();
        for grasp in planner.cloud_grasps(&target(&points, &cameras, &[])).unwrap_or_default() {
            let pose = grasp.grasp.pose;
            prop_assert!((0.0..=1.0).contains(&grasp.grasp.score) && pose.position.is_finite());
            prop_assert!(grasp.grasp.width <= grasp.opening && grasp.opening <= 0.08);
            prop_assert!(pose.position.z + planner.gripper().tip * grasp.grasp.approach().z > 0.001);
            prop_assert!(pose.transform_vector(DVec3::Y).z.abs() < 1e-9, "closing is level");
        }
    }
}
