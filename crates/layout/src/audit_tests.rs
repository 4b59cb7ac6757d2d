//! Stability tests: stable objects and objects that topple slowly.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, panda};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{InstanceId, ObjectModel, Pose};
use genmanip_relations::{PosedObject, PosedScene, ShapeCache};

use crate::audit::{check_stability, scene_object, simulate_drift};
use crate::{LayoutSettings, Rejection, visibility};

/// One object on the table, rotated about the world's y axis.
fn scene(model: &Arc<ObjectModel>, tilt_rad: f64) -> PosedScene {
    let tilted = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_y(tilt_rad) };
    let lowest = model.world_bounds(&tilted, &vec![0.0; model.joint_count()]).min.z;
    let object = PosedObject {
        id: InstanceId::new(&model.card.uid, 1),
        pose: Pose { position: DVec3::new(0.45, 0.0, -lowest), ..tilted },
        joint_positions: vec![0.0; model.joint_count()],
        model: Arc::clone(model),
    };
    PosedScene::new(vec![object], &default_world().surfaces, &mut ShapeCache::default())
}

/// A rendering failure is an error, never a layout that passes.
#[test]
fn what_cannot_be_drawn_does_not_count_as_seen() {
    let model = Catalogue::builtin().build("046").unwrap();
    let hidden =
        |scene: &PosedScene| visibility::first_hidden(scene, &default_world(), 1, &panda(), &LayoutSettings::default());
    let mut scene = scene(&model, 0.0);
    assert!(matches!(hidden(&scene), Ok(None)), "a cube in the middle of the table is seen");
    scene.set_pose(0, Pose::from_position(DVec3::new(0.45, 0.0, -2.0)), &[]);
    assert!(matches!(hidden(&scene), Ok(Some(Rejection::Unseen(object))) if object.id == "046"), "below the table");
    scene.set_pose(0, Pose::from_position(DVec3::NAN), &[]);
    assert!(hidden(&scene).is_err(), "what is nowhere cannot be drawn");
}

#[test]
fn what_ends_early_would_have_stayed() {
    let settings = LayoutSettings::default();
    let (mut stayed, mut tipped) = (0, 0);
    let model = Catalogue::builtin().build("024").unwrap();
    let size = model.world_bounds(&Pose::IDENTITY, &[]).size();
    // Balanced on its edge: the smallest perturbation decides, and the fall is slow.
    let balance = size.x.atan2(size.z);
    for tilt_rad in [0.0, FRAC_PI_2, balance - 1e-2, balance + 1e-3, balance - 1e-4, balance + 1e-5, balance - 1e-5] {
        let scene = scene(&model, tilt_rad);
        let objects: Vec<_> = scene.objects().map(scene_object).collect();
        let (_, drift_m) = simulate_drift(&default_world(), &objects, settings.stay_s).unwrap();
        let stays = drift_m[0] <= settings.max_drift_m;
        assert_eq!(
            check_stability(&scene, &default_world(), &settings).is_ok(),
            stays,
            "at {tilt_rad} rad: {drift_m:?} m"
        );
        if stays { stayed += 1 } else { tipped += 1 }
    }
    assert!(stayed >= 2 && tipped >= 3, "{stayed} stayed, {tipped} tipped");
}
