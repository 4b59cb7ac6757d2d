//! Rendering meshes stay close to the full-resolution meshes.

use genmanip_core::{Seed, TriMesh};
use glam::DVec3;

use crate::{Catalogue, Families, panda};

/// Maximum deviation: the tolerance of rendering meshes plus the chord error of a full-resolution circle, m.
const FAR_M: f64 = 2.5e-4;

#[test]
fn rendering_meshes_stay_close_to_full_resolution() {
    let catalogue = Catalogue::builtin();
    let families = Families::builtin();
    let built = catalogue.cards().iter().map(|card| catalogue.build(&card.uid).unwrap());
    let made =
        families.all().map(|family| families.instance(&family.family, &Default::default(), Seed::new(5)).unwrap());
    let objects = built.flat_map(|model| model.links.clone()).chain(made.flat_map(|model| model.links));
    let robot = panda();
    let surfaces = objects.flat_map(|link| link.visual).chain(robot.links.iter().flat_map(|link| link.visual.clone()));
    let (mut full, mut simplified, mut flaws) = (0, 0, Vec::new());
    for part in surfaces {
        full += part.mesh.triangles.len();
        simplified += part.render_mesh.triangles.len();
        let gaps: Vec<[f64; 2]> = sampled(&part.mesh).map(|(at, normal)| gap(&part.render_mesh, at, normal)).collect();
        let farthest = gaps.iter().map(|gap| gap[0]).fold(0.0, f64::max);
        let alike = gaps.iter().map(|gap| gap[1]).sum::<f64>() / gaps.len() as f64;
        if farthest > FAR_M || alike < 0.985 {
            flaws.push(format!("{}: {:.2} mm off, normals {alike:.3} alike", part.name, farthest * 1e3));
        }
    }
    assert!(flaws.is_empty(), "{} flaws:\n{}", flaws.len(), flaws.join("\n"));
    assert!(simplified * 10 < full * 6, "{simplified} triangles of {full}");
}

/// A sample of vertices with their normals.
fn sampled(mesh: &TriMesh) -> impl Iterator<Item = (DVec3, DVec3)> {
    let corners = mesh.positions.iter().zip(&mesh.normals).map(|(at, normal)| (at.as_dvec3(), normal.as_dvec3()));
    corners.step_by(mesh.positions.len() / 50 + 1)
}

/// Distance of a point from a mesh, and the largest cosine between its normal and that of a triangle within tolerance.
fn gap(mesh: &TriMesh, at: DVec3, normal: DVec3) -> [f64; 2] {
    let mut best = [f64::INFINITY, -1.0];
    for triangle in &mesh.triangles {
        let corner = |i: usize| mesh.positions[triangle[i] as usize].as_dvec3();
        let (gap, shares) = closest([corner(0), corner(1), corner(2)], at);
        let normals = triangle.iter().zip(shares).map(|(&i, share)| mesh.normals[i as usize].as_dvec3() * share);
        if gap < best[0] {
            best[0] = gap;
        }
        if gap < FAR_M {
            best[1] = best[1].max(normals.sum::<DVec3>().normalize_or_zero().dot(normal));
        }
    }
    best
}

/// Distance of a point from a triangle, and the barycentric coordinates of the nearest point; after Ericson,
/// *Real-Time Collision Detection*, 5.1.5.
fn closest([a, b, c]: [DVec3; 3], at: DVec3) -> (f64, [f64; 3]) {
    let on_edge = |from: DVec3, to: DVec3| {
        ((at - from).dot(to - from) / (to - from).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    };
    let (ab, bc, ca) = (on_edge(a, b), on_edge(b, c), on_edge(c, a));
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared().max(f64::MIN_POSITIVE);
    let (u, v) = ((c - b).cross(at - b).dot(normal) / area, (a - c).cross(at - c).dot(normal) / area);
    let inside = [u, v, 1.0 - u - v];
    let edges = [[1.0 - ab, ab, 0.0], [0.0, 1.0 - bc, bc], [ca, 0.0, 1.0 - ca]];
    let is_inside = inside.iter().all(|share| *share >= 0.0);
    let candidates = edges.into_iter().chain(is_inside.then_some(inside));
    let distance = |shares: [f64; 3]| at.distance(a * shares[0] + b * shares[1] + c * shares[2]);
    candidates.map(|shares| (distance(shares), shares)).min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((0.0, inside))
}
