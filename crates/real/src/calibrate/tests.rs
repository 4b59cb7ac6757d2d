//! Calibrations of synthetic views.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Distortion, Document, Pose, Seed};

use super::*;
use crate::synthetic::{Degeneracy, Scene};

const MOUNTINGS: [Mounting; 2] = [Mounting::EyeInHand, Mounting::EyeToHand];

fn scene(mounting: Mounting, index: u64) -> Scene {
    Scene::random(mounting, 15 + index as usize % 6, Seed::new(11).fork_index(index))
}

fn run(scene: &Scene, views: &[View]) -> Result<Calibration, CalibrationError> {
    calibrate(&scene.camera, scene.mounting, views, Vec::new(), &CalibrationSettings::default())
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

#[test]
fn exact_views_give_the_exact_pose_by_every_method() {
    let exact = Noise { corner_px: 0.0, hand_m: 0.0, hand_rad: 0.0 };
    for mounting in MOUNTINGS {
        for index in 0..4 {
            let mut scene = scene(mounting, index);
            if index % 2 == 1 {
                scene.camera.distortion = Some(Distortion { k1: -0.08, k2: 0.02, p1: 0.001, p2: -0.001, k3: 0.0 });
            }
            let found = run(&scene, &scene.views(&exact, Seed::new(1))).unwrap();
            let pose = found.camera.mount_from_camera;
            assert!(pose.position.distance(scene.mount_from_camera.position) < 1e-7, "{found:?}");
            assert!(pose.angle_to(&scene.mount_from_camera) < 1e-6, "{found:?}");
            assert_eq!(found.starts.len(), 2);
            assert!(found.starts.iter().all(|start| start.position_m < 1e-5 && start.rotation_rad < 1e-5), "{found:?}");
            assert!((found.board_scale[0] - 1.0).abs() < 1e-6 && !found.intrinsics.unwrap().is_suspicious);
            assert!(found.warnings.is_empty() && found.skipped.is_empty());
        }
    }
}

#[test]
fn points_on_the_table_are_placed_within_the_bars() {
    // Median and 95th percentile, m.
    let clean = (Noise { corner_px: 0.1, hand_m: 0.0, hand_rad: 0.0 }, 0.5e-3, 1e-3);
    let noisy = (Noise { corner_px: 0.3, ..Noise::default() }, 3e-3, 6e-3);
    for mounting in MOUNTINGS {
        for (noise, median, p95) in [&clean, &noisy] {
            let (mut errors, mut within) = (Vec::new(), 0);
            for index in 0..8 {
                let scene = scene(mounting, index);
                let found = run(&scene, &scene.views(noise, Seed::new(index))).unwrap();
                let pose = found.camera.mount_from_camera;
                errors.extend(scene.table_errors_m(&pose));
                let off = (pose.inverse() * scene.mount_from_camera).position.to_array();
                within += (0..3).filter(|&axis| off[axis].abs() < 3.0 * found.position_sd_m[axis]).count();
            }
            assert!(within >= 22, "{mounting:?} {noise:?}: {within} of 24 coordinates within three deviations");
            let got = (quantile(errors.clone(), 0.5), quantile(errors, 0.95));
            assert!(got.0 <= *median && got.1 <= *p95, "{mounting:?} {noise:?}: {got:?}");
        }
    }
}

#[test]
fn degenerate_sets_are_refused_with_their_reason() {
    let noise = Noise { corner_px: 0.3, ..Noise::default() };
    for mounting in MOUNTINGS {
        for index in 0..3 {
            let scene = scene(mounting, index);
            for how in Degeneracy::ALL {
                let (stated, views) = scene.degenerate(how, &noise, Seed::new(index));
                let error = run(&stated, &views).expect_err(&format!("{mounting:?} {how:?} {index}"));
                let is_right = match how {
                    Degeneracy::TwoRotations => matches!(error, CalibrationError::FewRotations { .. }),
                    Degeneracy::ParallelAxes => matches!(error, CalibrationError::ParallelAxes { .. }),
                    Degeneracy::SmallTurns => matches!(error, CalibrationError::LittleRotation { .. }),
                    Degeneracy::PlanarFlip => matches!(error, CalibrationError::PlanarFlip { .. }),
                    Degeneracy::WrongScale => matches!(error, CalibrationError::Scale { .. }),
                    Degeneracy::OtherMounting => matches!(error, CalibrationError::OtherMounting { .. }),
                    Degeneracy::ShuffledIds => matches!(
                        error,
                        CalibrationError::Inconsistent { .. }
                            | CalibrationError::Scale { .. }
                            | CalibrationError::OtherMounting { .. }
                    ),
                };
                assert!(is_right, "{mounting:?} {how:?}: {error}");
            }
        }
    }
}

#[test]
fn robot_poses_of_other_images_are_refused() {
    let noise = Noise { corner_px: 0.3, ..Noise::default() };
    for index in 0..24 {
        let scene = scene(MOUNTINGS[index as usize % 2], 100 + index);
        let (stated, views) = scene.degenerate(Degeneracy::ShuffledIds, &noise, Seed::new(index));
        let found = run(&stated, &views);
        assert!(found.is_err(), "{index}: {found:?}");
    }
}

#[test]
fn a_moving_arm_and_missing_partners_are_left_out_by_name() {
    let scene = scene(Mounting::EyeInHand, 1);
    let noise = Noise { corner_px: 0.2, ..Noise::default() };
    let mut views = scene.views(&noise, Seed::new(3));
    views[4].base_from_hand =
        views[4].base_from_hand * Pose::new(DVec3::new(0.02, 0.0, 0.01), DQuat::from_rotation_z(0.05));
    let found = run(&scene, &views).unwrap();
    assert_eq!(found.skipped.iter().map(|it| it.id.as_str()).collect::<Vec<_>>(), ["004"], "{found:?}");
    assert!(found.camera.mount_from_camera.position.distance(scene.mount_from_camera.position) < 2e-3);

    let list = |view: &View| view.corners.iter().enumerate().map(|(id, (_, px))| (id as u32, px.x, px.y)).collect();
    let mut file = BoardViews {
        camera: scene.camera.clone(),
        mounting: scene.mounting,
        board: scene.board.clone(),
        robot: views.iter().map(|view| (view.id.clone(), RobotState::BaseFromHand(view.base_from_hand))).collect(),
        detections: views.iter().map(|view| (view.id.clone(), list(view))).collect(),
    };
    file.detections.insert("001".into(), Vec::new());
    file.robot.remove("002");
    file.detections.remove("003");
    let again = BoardViews::from_json(&file.to_json()).unwrap();
    let (paired, skipped) = again.paired(|_| Err("no robot".into())).unwrap();
    let reasons: Vec<(&str, &str)> = skipped.iter().map(|it| (it.id.as_str(), it.reason.as_str())).collect();
    let wanted = [
        ("003", "a robot state without an image"),
        ("001", "no board in the image"),
        ("002", "an image without a robot state"),
    ];
    assert_eq!((reasons.as_slice(), paired.len()), (&wanted[..], views.len() - 3));

    file.board = Board::Grid { columns: 7, rows: 5, spacing_m: 0.0 };
    let error = BoardViews::from_json(&file.to_json()).unwrap_err().to_string();
    assert!(error.contains("spacing_m") && error.contains("expected metres"), "{error}");
}

#[test]
fn wrong_intrinsics_are_noticed() {
    let scene = scene(Mounting::EyeToHand, 2);
    let noise = Noise { corner_px: 0.1, hand_m: 0.0, hand_rad: 0.0 };
    let views = scene.views(&noise, Seed::new(5));
    let mut stated = scene.camera.clone();
    stated.intrinsics.cx += 12.0;
    stated.intrinsics.fx *= 1.006;
    stated.intrinsics.fy *= 1.006;
    let poses: Vec<Pose> = views.iter().map(|view| board_pose(&stated, view).unwrap().camera_from_board).collect();
    let check = check_intrinsics(&stated, &views.iter().collect::<Vec<_>>(), &poses).unwrap();
    assert!(check.is_suspicious && (check.estimated[2] - scene.camera.intrinsics.cx).abs() < 2.0, "{check:?}");
    assert!(check.estimated_rms_px < check.stated_rms_px);
}

#[test]
fn planned_poses_beat_random_ones() {
    for mounting in MOUNTINGS {
        let scene = scene(mounting, 3);
        let poses = [scene.mount_from_camera, scene.mount_from_board];
        let (noise, settings) = (Noise::default(), PlanSettings::default());
        let all = candidates(&scene.camera, mounting, &scene.board, poses, &noise, &settings);
        let planned = choose(&all, 12).unwrap();
        assert_eq!(planned.base_from_hand.len(), 12);
        let first = choose(&all[..12], 12).unwrap();
        let volume = |sd: [f64; 3]| sd.iter().product::<f64>();
        assert!(volume(planned.position_sd_m) < volume(first.position_sd_m) / 4.0, "{planned:?} {first:?}");
        // The accuracy that is promised is the one that comes out.
        let views = Scene { hands: planned.base_from_hand.clone(), ..scene.clone() }.views(&noise, Seed::new(9));
        let found = run(&scene, &views).unwrap();
        let (got, wanted) = (found.position_sd_m, planned.position_sd_m);
        assert!((0..3).all(|axis| (0.3..3.0).contains(&(got[axis] / wanted[axis]))), "{got:?} {wanted:?}");
    }
}

#[test]
fn the_shipped_example_is_calibrated() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/calibrate/wrist.json");
    let file = BoardViews::from_json(&std::fs::read_to_string(path).unwrap()).unwrap();
    let (views, skipped) = file.paired(|_| Err("no robot".into())).unwrap();
    let found = calibrate(&file.camera, file.mounting, &views, skipped, &CalibrationSettings::default()).unwrap();
    // The truth with which it was made.
    let truth = DVec3::new(0.03857, 0.02372, 0.05375);
    assert!(found.camera.mount_from_camera.position.distance(truth) < 1e-3, "{found:?}");
    assert_eq!(found.skipped.iter().map(|it| it.id.as_str()).collect::<Vec<_>>(), ["007"]);
    assert!(found.warnings.is_empty() && found.statement.contains("FROM the camera"), "{found:?}");
}

#[test]
fn the_schema_on_disk_is_that_of_the_type() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas/board_views.schema.json");
    let text = serde_json::to_string_pretty(&schemars::schema_for!(BoardViews)).unwrap() + "\n";
    if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let stored = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(stored == text, "schemas/board_views.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
}
