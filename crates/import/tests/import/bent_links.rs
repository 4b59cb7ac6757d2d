//! Collision geometry of bent links: the hulls of a few parts of the mesh, which contain it.

use std::fmt::Write;

use genmanip_core::Piece;
use genmanip_core::glam::DVec3;
use genmanip_import::robots::Choices;
use genmanip_motion::triangulate;

use crate::robots::read_files;

/// A tube between two housings that stick out to one side, as the upper arm of a UR3: corners of three boxes.
const BENT: [[[f64; 3]; 2]; 3] = [
    [[-0.05, -0.05, -0.05], [0.05, 0.1, 0.05]],
    [[-0.03, 0.0, 0.05], [0.03, 0.1, 0.4]],
    [[-0.05, -0.05, 0.4], [0.05, 0.1, 0.5]],
];

/// Squares of boxes, `fine`² on each side, facing outwards.
fn boxes(boxes: &[[[f64; 3]; 2]], fine: usize) -> Vec<[DVec3; 4]> {
    let mut squares = Vec::new();
    for &[min, max] in boxes {
        for (axis, end) in (0..3).flat_map(|axis| [(axis, min), (axis, max)]) {
            let at = |u: usize, v: usize| {
                let mut point = end;
                for (other, step) in [((axis + 1) % 3, u), ((axis + 2) % 3, v)] {
                    point[other] = min[other] + (max[other] - min[other]) * step as f64 / fine as f64;
                }
                DVec3::from(point)
            };
            let all = (0..fine).flat_map(|u| (0..fine).map(move |v| (u, v)));
            squares.extend(all.map(|(u, v)| {
                let mut square = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)];
                if end == min {
                    square.reverse();
                }
                square
            }));
        }
    }
    squares
}

/// Collision pieces of a link with this mesh, and the notes of the reader.
fn pieces(mesh: &[[DVec3; 4]]) -> (Vec<Piece>, Vec<String>) {
    let mut obj = String::new();
    for square in mesh {
        square.iter().for_each(|corner| writeln!(obj, "v {} {} {}", corner.x, corner.y, corner.z).unwrap());
        obj.push_str("f -4 -3 -2 -1\n");
    }
    let urdf = "<robot name=\"one\"><link name=\"base\"/><link name=\"arm\"><collision><geometry>\
                <mesh filename=\"arm.obj\" scale=\"1 -2 1\"/></geometry></collision></link><joint name=\"j\" type=\"revolute\">\
                <parent link=\"base\"/><child link=\"arm\"/><limit lower=\"-1\" upper=\"1\"/></joint></robot>";
    let read = read_files(&[("arm.urdf", urdf.as_bytes()), ("arm.obj", obj.as_bytes())], Choices::default()).unwrap();
    (read.model.links[1].pieces.clone(), read.notes)
}

/// Outward normal, distance from the origin and volume under it, of each face of a piece.
fn faces(piece: &Piece) -> Vec<(DVec3, f64, f64)> {
    let (corners, triangles) = triangulate(piece).unwrap();
    let face = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|index| corners[index as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        (normal, normal.dot(a), a.dot(b.cross(c)) / 6.0)
    };
    triangles.iter().map(face).collect()
}

#[test]
fn bent_meshes_are_cut_and_contained() {
    // The scale doubles the volume of the three boxes.
    let solid = 2.0 * (0.1 * 0.15 * 0.1 * 2.0 + 0.06 * 0.1 * 0.35);
    for fine in [1, 5, 60] {
        let mesh = boxes(&BENT, fine);
        let (found, notes) = pieces(&mesh);
        assert!((2..=4).contains(&found.len()), "{fine}: {}", found.len());
        let faces: Vec<_> = found.iter().map(faces).collect();
        let volume: f64 = faces.iter().flatten().map(|face| face.2).sum();
        assert!((0.99 * solid..1.25 * solid).contains(&volume), "{fine}: {volume} m³ around {solid} m³");
        for square in mesh.iter().step_by(mesh.len().div_ceil(500)) {
            for weights in [[1.0, 0.0, 0.0, 0.0], [0.4, 0.3, 0.2, 0.1], [0.1, 0.1, 0.4, 0.4]] {
                let point: DVec3 = square.iter().zip(weights).map(|(corner, weight)| *corner * weight).sum();
                let point = point * DVec3::new(1.0, -2.0, 1.0);
                let outside = |faces: &Vec<(DVec3, f64, f64)>| {
                    faces.iter().map(|(normal, reach, _)| normal.dot(point) - reach).fold(f64::NEG_INFINITY, f64::max)
                };
                let outside = faces.iter().map(outside).fold(f64::INFINITY, f64::min);
                assert!(outside < 1e-6, "{fine}: {point} is {outside} m outside");
            }
        }
        let note = format!("bent meshes collide as the hulls of their parts: arm.obj ({})", found.len());
        assert!(notes.contains(&note), "{notes:?}");
    }
}

/// The hull of an open surface is all that is known of it.
#[test]
fn convex_and_open_meshes_stay_whole() {
    let open = boxes(&BENT, 3).into_iter().filter(|square| square.iter().any(|corner| corner.z != 0.5)).collect();
    for mesh in [boxes(&BENT[..1], 1), boxes(&BENT[..1], 20), open] {
        let (found, notes) = pieces(&mesh);
        assert_eq!(found.len(), 1);
        assert!(!notes.iter().any(|note| note.contains("bent")), "{notes:?}");
    }
}
