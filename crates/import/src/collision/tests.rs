use std::f64::consts::TAU;

use super::*;
use crate::clean::tests::cuboid;

/// A surface of revolution from a closed (radius, height) profile, counter-clockwise in the half plane.
fn turned(profile: &[[f64; 2]], sectors: u32) -> RawMesh {
    let count = profile.len() as u32;
    let mut mesh = RawMesh::default();
    for sector in 0..sectors {
        let (sin, cos) = (TAU * f64::from(sector) / f64::from(sectors)).sin_cos();
        mesh.positions.extend(profile.iter().map(|[r, z]| DVec3::new(r * cos, r * sin, *z)));
    }
    for sector in 0..sectors {
        let next = (sector + 1) % sectors;
        for i in 0..count {
            let j = (i + 1) % count;
            let [a, b, c, d] = [[sector, i], [next, i], [next, j], [sector, j]].map(|[s, i]| s * count + i);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut raw = crate::clean::tests::object(mesh);
    crate::clean::clean("turned", &mut raw).unwrap();
    raw.links.remove(0).surfaces.remove(0).mesh
}

fn cup() -> RawMesh {
    // Up the outside, over the rim, down the inside; the axis closes top and bottom.
    turned(&[[0.0, 0.0], [0.03, 0.0], [0.04, 0.09], [0.036, 0.09], [0.027, 0.005], [0.0, 0.005]], 48)
}

#[test]
fn solid_objects_become_primitives_or_hulls() {
    let how = |mesh: &RawMesh| of_surface(mesh, true).how;
    assert_eq!(how(&cuboid(DVec3::ZERO, DVec3::new(0.1, 0.05, 0.2))), "a box");
    assert_eq!(how(&turned(&[[0.0, 0.0], [0.03, 0.0], [0.03, 0.12], [0.0, 0.12]], 48)), "a cylinder");
    assert_eq!(how(&turned(&[[0.0, 0.0], [0.05, 0.0], [0.0, 0.12]], 48)), "its convex hull");
}

#[test]
fn a_cup_stays_hollow_with_its_wall() {
    let body = of_surface(&cup(), true);
    let [cavity] = body.cavity.as_slice() else { panic!("no hollow: {}", body.how) };
    let depth = cavity.support(DVec3::Z).z + cavity.support(DVec3::NEG_Z).z.abs();
    assert!((0.07..0.095).contains(&depth), "{depth}");
    assert!(body.how.contains("walls of 4") || body.how.contains("walls of 3"), "{}", body.how);
    // The interior is free from just above the floor, the wall is solid, and the base stands at 0.
    let holds = |point: DVec3| {
        body.pieces.iter().any(|piece| {
            let outward = |d: DVec3| piece.support(d).dot(d) - point.dot(d);
            (0..200).all(|i| {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 200.0;
                let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
                outward(DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)) > 0.0
            })
        })
    };
    assert!(!holds(DVec3::new(0.0, 0.0, 0.02)) && !holds(DVec3::new(0.015, 0.01, 0.05)));
    assert!(holds(DVec3::new(0.0, 0.0, 0.003)) && holds(DVec3::new(0.0345, 0.0, 0.05)));
    let lowest = body.pieces.iter().map(|piece| piece.support(DVec3::NEG_Z).z).fold(f64::INFINITY, f64::min);
    assert!(lowest.abs() < 1e-4, "{lowest}");
}

#[test]
fn a_handle_protrudes_from_its_cup() {
    let mut mug = cup();
    mug.append(&cuboid(DVec3::new(0.036, -0.005, 0.02), DVec3::new(0.07, 0.005, 0.03)));
    mug.append(&cuboid(DVec3::new(0.06, -0.005, 0.03), DVec3::new(0.07, 0.005, 0.06)));
    mug.append(&cuboid(DVec3::new(0.036, -0.005, 0.06), DVec3::new(0.07, 0.005, 0.07)));
    let body = of_surface(&mug, true);
    assert_eq!(body.cavity.len(), 1, "{}", body.how);
    let reach = body.pieces.iter().map(|piece| piece.support(DVec3::X).x).fold(0.0, f64::max);
    assert!((reach - 0.07).abs() < 0.004, "{reach}: {}", body.how);
}

#[test]
fn a_table_is_decomposed() {
    let mut table = cuboid(DVec3::new(-0.1, -0.1, 0.09), DVec3::new(0.1, 0.1, 0.1));
    for (x, y) in [(-0.09, -0.09), (0.08, -0.09), (-0.09, 0.08), (0.08, 0.08)] {
        table.append(&cuboid(DVec3::new(x, y, 0.0), DVec3::new(x + 0.01, y + 0.01, 0.092)));
    }
    let body = of_surface(&table, true);
    assert!(body.how.contains("decomposition") && (2..=24).contains(&body.pieces.len()), "{}", body.how);
    let volume: f64 = body.pieces.iter().map(piece_volume).sum();
    assert!(volume < 0.0016, "mostly free below the top: {volume}");
}

#[test]
fn a_pre_decomposed_mesh_keeps_its_parts() {
    let mut parts = cuboid(DVec3::ZERO, DVec3::splat(0.05));
    parts.append(&cuboid(DVec3::new(0.04, 0.0, 0.0), DVec3::new(0.1, 0.02, 0.02)));
    let link = RawLink { collision: vec![RawCollision::Mesh(parts.clone())], ..RawLink::default() };
    let body = body(&link);
    assert_eq!((body.pieces.len(), body.how.as_str()), (2, "from the collision mesh: 2 convex parts"));
    // One non-convex component: the mesh is decomposed as a whole.
    parts.append(&cup());
    assert!(convex_parts(&parts).is_none());
}
