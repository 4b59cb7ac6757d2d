//! The judges on the objects of the catalogue: what people would say about everyday arrangements.

use genmanip_assets::Catalogue;
use genmanip_core::Pose;
use glam::DVec3;

use super::*;

/// Puts the first object with its base at a place relative to the second, which stands on the table.
fn label(upper: &str, lower: &str, offset: DVec3) -> PairVerdict {
    label_pair(&scene(upper, lower, offset), 0, 1, &RelationSettings::default()).unwrap()
}

fn scene(upper: &str, lower: &str, offset: DVec3) -> PosedScene {
    let catalogue = Catalogue::builtin();
    let posed = |uid: &str, position: DVec3| {
        let model = catalogue.build(uid).unwrap();
        let joint_positions = vec![0.0; model.joint_count()];
        PosedObject { id: uid.into(), model, pose: Pose::from_position(position), joint_positions }
    };
    let anchor = DVec3::new(0.5, 0.0, 0.0);
    let objects = vec![posed(upper, anchor + offset), posed(lower, anchor)];
    PosedScene::new(objects, &[], &mut ShapeCache::default())
}

/// Lowers the first object until it touches the second, and compares the label.
fn check(upper: &str, lower: &str, expected: &[Label]) {
    let mut offset = DVec3::Z * 0.5;
    for _ in 0..4 {
        let contact = label(upper, lower, offset).geometry.a_over_b.unwrap();
        offset.z -= contact.gap_m;
    }
    let pair = label(upper, lower, offset);
    assert!(expected.contains(&pair.a_to_b.unwrap()), "{upper} over {lower} at {offset}: {pair:#?}");
}

#[test]
fn everyday_arrangements() {
    check("003", "009", &[Label::On]); // white mug, saucer
    check("033", "005", &[Label::In]); // lemon, rice bowl
    check("033", "006", &[Label::In]); // lemon, salad bowl
    check("028", "008", &[Label::On, Label::In]); // green apple, porcelain plate
    check("030", "051", &[Label::In]); // orange, wicker basket
    check("044", "052", &[Label::In]); // stapler, cardboard box
    check("035", "014", &[Label::On]); // carrot, cutting board
    check("046", "048", &[Label::On]); // red cube, blue cube
    check("049", "040", &[Label::On]); // puzzle cube, blue cookbook
}

#[test]
fn neighbours_on_the_table() {
    assert_eq!(label("033", "014", DVec3::new(-0.25, 0.0, 0.0)).a_to_b, Some(Label::Back));
    assert_eq!(label("023", "010", DVec3::new(0.0, -0.2, 0.0)).a_to_b, Some(Label::Right));
}

#[test]
fn single_quantities_are_those_of_the_pair() {
    let settings = RelationSettings::default();
    for offset in [DVec3::Z * 0.1, DVec3::Z * 0.02, DVec3::new(0.1, 0.0, 0.05), DVec3::new(0.3, 0.2, 0.0)] {
        for [upper, lower] in [["033", "005"], ["044", "052"], ["046", "048"]] {
            let scene = scene(upper, lower, offset);
            let pair = measure_pair(&scene, 0, 1, &settings).unwrap();
            assert_eq!(contact_below(&scene, 0, 1, &settings), pair.a_over_b, "{upper} {lower} {offset}");
            assert_eq!(planar_gap(&scene, 0, 1), Some(pair.gap_m), "{upper} {lower} {offset}");
        }
    }
}
