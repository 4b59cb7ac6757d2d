//! Tests of the relations with objects of the catalogue: everyday arrangements get the labels that people would give.

use genmanip_assets::Catalogue;
use genmanip_core::Pose;
use glam::DVec3;
use parry3d_f64::math::{Pose as Placing, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::ConvexPolyhedron;

use super::shape::outline_points;
use super::*;

/// The label with the first object's base at `offset` from the second object, which stands on the table.
fn label(upper: &str, lower: &str, offset: DVec3) -> PairVerdict {
    label_pair(&scene(upper, lower, offset), 0, 1, &RelationSettings::default()).unwrap()
}

fn scene(upper: &str, lower: &str, offset: DVec3) -> PosedScene {
    let catalogue = Catalogue::builtin();
    let posed = |uid: &str, position: DVec3| {
        let model = catalogue.build(uid).unwrap();
        let joint_positions = vec![0.0; model.joint_count()];
        PosedObject { id: uid.parse().unwrap(), model, pose: Pose::from_position(position), joint_positions }
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

/// The pieces of an object in the world as polyhedra; curved pieces are up to a millimetre too small.
fn polyhedra(scene: &PosedScene, index: usize) -> Vec<ConvexPolyhedron> {
    let body = &scene.bodies[index];
    let of_piece = |piece: &super::posed_scene::WorldPiece| {
        let corners = outline_points(body.shape_of(piece)).into_iter().map(|corner| {
            let corner = piece.world_from_piece.transform_point(corner);
            Vector::new(corner.x, corner.y, corner.z)
        });
        ConvexPolyhedron::from_convex_hull(&corners.collect::<Vec<_>>()).unwrap()
    };
    body.pieces.iter().map(of_piece).collect()
}

/// True if the objects touch after lowering the first one, according to a collision library that the relations do not
/// use.
fn touches(scene: &PosedScene, lowered_m: f64) -> bool {
    let (upper, lower) = (polyhedra(scene, 0), polyhedra(scene, 1));
    let down = Placing::from_translation(Vector::new(0.0, 0.0, -lowered_m));
    upper
        .iter()
        .any(|a| lower.iter().any(|b| query::distance(&down, a, &Placing::IDENTITY, b).unwrap().distance == 0.0))
}

#[test]
fn a_contact_is_where_a_fall_ends() {
    const TOLERANCE_M: f64 = 0.0015;
    let settings = RelationSettings::default();
    let mut met = 0;
    for offset in [DVec3::Z * 0.3, DVec3::Z * 0.12, DVec3::new(0.02, -0.015, 0.2), DVec3::new(0.3, 0.2, 0.3)] {
        for [upper, lower] in [["033", "005"], ["044", "052"], ["046", "048"], ["003", "009"]] {
            let scene = scene(upper, lower, offset);
            let pair = measure_pair(&scene, 0, 1, &settings).unwrap();
            assert_eq!(contact_below(&scene, 0, 1, &settings), pair.a_over_b, "{upper} {lower} {offset}");
            assert_eq!(planar_gap(&scene, 0, 1), Some(pair.gap_m), "{upper} {lower} {offset}");
            let Some(contact) = pair.a_over_b else {
                let heights = (0..60).map(|step| f64::from(step) * 0.01);
                let mut falls = heights.filter(|&lowered_m| touches(&scene, lowered_m));
                assert_eq!(falls.next(), None, "{upper} falls past {lower} at {offset}");
                continue;
            };
            met += 1;
            assert!(!touches(&scene, contact.gap_m - TOLERANCE_M), "{upper} {lower} {offset}: stopped too late");
            assert!(touches(&scene, contact.gap_m + TOLERANCE_M), "{upper} {lower} {offset}: stopped too early");
        }
    }
    assert_eq!(met, 12, "all but those beside each other");
}
