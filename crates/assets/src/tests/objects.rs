//! Every object of the catalogue matches its card.

use genmanip_core::{Aabb, AssetRef, ObjectModel, PhysicsFactors, Piece, PlacedObject, Pose, Shape};
use glam::{DMat3, DVec3};

use super::{largest_over_directions, separation, uncovered};
use crate::solid::{Moments, Solid};
use crate::{AssetError, AssetSource, Catalogue};

/// Runs a check on every object with a recipe and reports all failures.
fn check_all(check: impl Fn(&ObjectModel) -> Vec<String>) {
    let catalogue = Catalogue::builtin();
    let mut flaws = Vec::new();
    for card in catalogue.cards() {
        match catalogue.build(&card.uid) {
            Ok(model) => {
                flaws.extend(check(&model).into_iter().map(|flaw| format!("{} {}: {flaw}", card.uid, card.name)));
            }
            Err(error) => flaws.push(error.to_string()),
        }
    }
    assert!(flaws.is_empty(), "{} flaws:\n{}", flaws.len(), flaws.join("\n"));
}

#[test]
fn sizes_are_those_of_the_cards() {
    check_all(|model| {
        let bounds = [("pieces", model.world_bounds(&Pose::IDENTITY, &[])), ("surface", model.visual_bounds(&[]))];
        let mut flaws = Vec::new();
        for (what, bounds) in bounds {
            let excess = (bounds.size() - model.card.size_m).abs();
            let allowed = (model.card.size_m * 0.03).min(DVec3::splat(0.002)).max(DVec3::splat(0.0004));
            if excess.cmpgt(allowed).any() {
                flaws.push(format!("{what} measure {}, card says {}", bounds.size(), model.card.size_m));
            }
            if bounds.min.z.abs() > 5e-4 {
                flaws.push(format!("{what} start at z = {}", bounds.min.z));
            }
        }
        flaws
    });
}

#[test]
fn lofts_are_convex_and_few() {
    check_all(|model| {
        let pieces = || model.links.iter().flat_map(|link| &link.pieces);
        let mut flaws = Vec::new();
        if !(1..=48).contains(&pieces().count()) {
            flaws.push(format!("{} pieces", pieces().count()));
        }
        for (index, piece) in pieces().chain(&model.cavities(&[])).enumerate() {
            let Shape::Hull { points } = &piece.shape else { continue };
            // A point that is not a vertex of the hull is redundant: every point must be extreme in some direction, up
            // to the chord error of a bent tube.
            let inside = points.iter().map(|&point| depth_in_hull(points, point)).fold(0.0, f64::max);
            if inside > 4e-4 {
                flaws.push(format!("piece {index} has a point {:.2} mm inside its hull", inside * 1e3));
            }
        }
        flaws
    });
}

/// Depth of a point inside the hull of others.
fn depth_in_hull(points: &[DVec3], point: DVec3) -> f64 {
    -largest_over_directions(|direction| {
        -points.iter().map(|other| (*other - point).dot(direction)).fold(0.0, f64::max)
    })
}

#[test]
fn mass_and_inertia_are_physical() {
    check_all(|model| {
        let mut flaws = Vec::new();
        let total: f64 = model.links.iter().map(|link| link.mass.mass_kg).sum();
        if (total - model.card.mass_kg).abs() > 1e-12 {
            flaws.push(format!("mass {total}"));
        }
        for link in &model.links {
            let mass = &link.mass;
            if (mass.inertia - mass.inertia.transpose()).to_cols_array().iter().any(|value| value.abs() > 1e-12) {
                flaws.push(format!("{}: inertia is not symmetric", link.name));
            }
            let moments = eigenvalues(mass.inertia);
            if moments[0] <= 0.0 || moments[0] + moments[1] < moments[2] * (1.0 - 1e-9) {
                flaws.push(format!("{}: principal moments {moments:?}", link.name));
            }
            let bounds = Aabb::from_pieces(&Pose::IDENTITY, &link.pieces);
            if mass.center.cmplt(bounds.min).any() || mass.center.cmpgt(bounds.max).any() {
                flaws.push(format!("{}: centre of mass {} outside", link.name, mass.center));
            }
        }
        flaws
    });
}

/// Eigenvalues of a symmetric matrix in ascending order, by Jacobi rotations.
fn eigenvalues(mut m: DMat3) -> [f64; 3] {
    for _ in 0..30 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let angle = 0.5 * (2.0 * m.col(p)[q]).atan2(m.col(q)[q] - m.col(p)[p]);
            let (s, c) = angle.sin_cos();
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = c;
            turn.col_mut(q)[q] = c;
            turn.col_mut(p)[q] = -s;
            turn.col_mut(q)[p] = s;
            m = turn.transpose() * m * turn;
        }
    }
    let mut values = [m.x_axis.x, m.y_axis.y, m.z_axis.z];
    values.sort_by(f64::total_cmp);
    values
}

#[test]
fn resting_pose_is_stable() {
    check_all(|model| {
        let states = model.joint_states.iter().map(|state| (state.name.as_str(), state.nominal.as_slice()));
        let rigid = model.joint_states.is_empty().then_some(("rigid", [].as_slice()));
        let margins = states.chain(rigid).map(|(state, joints)| (state, standing_margin(model, joints)));
        let unstable = margins.filter(|(_, margin)| *margin < 0.0008);
        unstable.map(|(state, margin)| format!("{state}: tips over, margin {:.1} mm", margin * 1e3)).collect()
    });
}

/// Stability margin: distance of the centre of mass from the edge of the support polygon, m.
fn standing_margin(model: &ObjectModel, joints: &[f64]) -> f64 {
    let poses = model.link_poses(joints);
    let masses = model.links.iter().zip(&poses);
    let weighted = masses.map(|(link, pose)| pose.transform_point(link.mass.center) * link.mass.mass_kg);
    let center = weighted.sum::<DVec3>() / model.card.mass_kg;
    let reach = |direction: DVec3| {
        let touching = model.links.iter().zip(&poses).flat_map(|(link, pose)| {
            link.pieces.iter().flat_map(move |piece| {
                let piece = Piece { link_from_piece: *pose * piece.link_from_piece, ..piece.clone() };
                [0.0, 1e-3, -1e-3].map(|t| {
                    let side = direction.cross(DVec3::Z) * t;
                    piece.support(DVec3::NEG_Z + direction * 1e-3 + side)
                })
            })
        });
        let touching = touching.filter(|point| point.z < 1.2e-3);
        touching.map(|point| (point - center).dot(direction)).fold(f64::NEG_INFINITY, f64::max)
    };
    (0..16)
        .map(|i| {
            let angle = f64::from(i) / 16.0 * std::f64::consts::TAU;
            reach(DVec3::new(angle.cos(), angle.sin(), 0.0))
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn few_pieces_touch_the_table() {
    // Every contact costs time in each physics step; a base or a few feet are sufficient support.
    check_all(|model| {
        let lowest = |piece: &Piece| piece.support(DVec3::NEG_Z).z;
        let touching = model.links[0].pieces.iter().filter(|piece| lowest(piece) < 3e-4).count();
        if touching > 6 { vec![format!("stands on {touching} pieces")] } else { Vec::new() }
    });
}

#[test]
fn hollow_objects_are_hollow() {
    check_all(|model| {
        let lidded = model.family == "teapot";
        let mut flaws = Vec::new();
        if model.is_hollow() == (!model.card.is_container || lidded) && !["spoon", "ladle"].contains(&&*model.family) {
            flaws.push(format!("container {} but hollow {}", model.card.is_container, model.is_hollow()));
        }
        let poses = model.link_poses(&[]);
        for cavity in model.cavities(&[]) {
            let center = cavity.link_from_piece.position;
            for (link, pose) in model.links.iter().zip(&poses) {
                let local = pose.inverse().transform_point(center);
                if link.pieces.iter().any(|piece| separation(piece, local) <= 0.0) {
                    flaws.push(format!("{} fills the middle of a cavity", link.name));
                }
            }
        }
        flaws
    });
}

#[test]
fn surfaces_stay_close_to_the_pieces() {
    check_all(|model| {
        let out = model.links.iter().map(|link| (&link.name, uncovered(&link.visual, &link.pieces, 127)));
        let flaws = out.filter(|(_, out)| *out > 0.0035);
        flaws.map(|(link, out)| format!("{link}: the surface stands out by {:.1} mm", out * 1e3)).collect()
    });
}

#[test]
fn surfaces_are_sound() {
    check_all(|model| {
        let mut flaws = Vec::new();
        for part in model.links.iter().flat_map(|link| &link.visual) {
            let mesh = &part.mesh;
            let count = mesh.positions.len();
            if count == 0 || mesh.normals.len() != count || mesh.uvs.len() != count {
                flaws.push(format!("{}: {count} corners", part.name));
            }
            let agree = mesh.triangles.iter().filter(|triangle| {
                let [a, b, c] = triangle.map(|index| mesh.positions[index as usize]);
                let face = (b - a).cross(c - a);
                triangle.iter().all(|&index| mesh.normals[index as usize].dot(face) >= -1e-9)
            });
            if agree.count() < mesh.triangles.len() * 98 / 100 {
                flaws.push(format!("{}: normals against faces", part.name));
            }
        }
        flaws
    });
}

#[test]
fn moments_of_known_bodies() {
    let close = |a: &Moments, b: &Moments| {
        assert!((a.volume - b.volume).abs() < 2e-3 * b.volume, "{a:?} {b:?}");
        assert!((a.center - b.center).length() < 1e-4, "{a:?} {b:?}");
        let size = b.second.x_axis.length() + b.second.y_axis.length();
        assert!((a.second - b.second).to_cols_array().iter().all(|d| d.abs() < 5e-3 * size), "{a:?} {b:?}");
    };
    let center = DVec3::new(0.3, -0.2, 0.1);
    let square = |z: f64| {
        [(0.1, -0.2), (0.1, 0.2), (-0.1, 0.2), (-0.1, -0.2)].map(|(x, y)| center + DVec3::new(x, y, z)).to_vec()
    };
    let cuboid = Solid::cuboid(Pose::from_position(center), DVec3::new(0.1, 0.2, 0.3));
    close(&Solid::loft(&[square(-0.3), square(0.3)]).moments, &cuboid.moments);
    let ring = |z: f64| {
        crate::surface::circle(glam::DVec2::new(0.1, z), 200, 0.0).into_iter().map(|p| p + center).collect::<Vec<_>>()
    };
    let cylinder = Solid::cylinder(center - DVec3::Z * 0.2, center + DVec3::Z * 0.2, 0.1);
    close(&Solid::loft(&[ring(-0.2), ring(0.2)]).moments, &cylinder.moments);
    let rings: Vec<_> = (0..=81)
        .map(|i| {
            let angle = std::f64::consts::PI * f64::from(i - i32::from(i > 40)) / 80.0;
            let height = -0.1 * angle.cos() + if i > 40 { 0.2 } else { -0.2 };
            crate::surface::circle(glam::DVec2::new(0.1 * angle.sin(), height), 120, 0.0)
        })
        .collect();
    let capsule = Solid::capsule(DVec3::Z * -0.2, DVec3::Z * 0.2, 0.1);
    close(&Solid::loft(&rings).moments, &capsule.moments);
}

proptest::proptest! {
    #[test]
    fn a_turned_box_has_the_moments_of_its_loft(
        half in proptest::array::uniform3(0.001..0.5f64),
        position in proptest::array::uniform3(-1.0..1.0f64),
        angles in proptest::array::uniform3(-3.0..3.0f64),
    ) {
        let [roll, pitch, yaw] = angles;
        let rotation = glam::DQuat::from_euler(glam::EulerRot::ZYX, yaw, pitch, roll);
        let pose = Pose::new(DVec3::from_array(position), rotation);
        let square = |z: f64| {
            let corners = [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)];
            corners.map(|(x, y)| pose.transform_point(DVec3::new(x, y, z) * DVec3::from_array(half))).to_vec()
        };
        let (loft, cuboid) = (Solid::loft(&[square(-1.0), square(1.0)]), Solid::cuboid(pose, DVec3::from_array(half)));
        let (a, b) = (loft.moments.with_mass(1.0), cuboid.moments.with_mass(1.0));
        proptest::prop_assert!((a.center - b.center).length() < 1e-9);
        proptest::prop_assert!((a.inertia - b.inertia).to_cols_array().iter().all(|d| d.abs() < 1e-9), "{a:?} {b:?}");
        proptest::prop_assert!(depth_in_hull(&[square(-1.0), square(1.0)].concat(), pose.position) > 0.0);
    }
}

#[test]
fn a_scenario_with_other_physics_is_rejected() {
    let catalogue = Catalogue::builtin();
    let model = catalogue.build("019").unwrap();
    let placed = PlacedObject {
        id: "019#2".parse().unwrap(),
        asset: model.asset.clone(),
        physics_hash: model.physics_hash(),
        judging_hash: Some(model.judging_hash()),
        looks_hash: Some(model.looks_hash()),
        pose: Pose::IDENTITY,
        joint_positions: Vec::new(),
        physics: PhysicsFactors::default(),
    };
    assert!(std::sync::Arc::ptr_eq(&catalogue.instance(&placed).unwrap(), &model));
    for (changed, expected) in [
        (PlacedObject { physics_hash: "v2:0".into(), ..placed.clone() }, "physics hash"),
        (PlacedObject { physics_hash: "v1:0".into(), ..placed.clone() }, "physics hash"),
        (PlacedObject { judging_hash: Some("v2:0".into()), ..placed.clone() }, "judging hash"),
        (PlacedObject { asset: AssetRef::builtin("019", 9), ..placed.clone() }, "asset"),
    ] {
        let error = catalogue.instance(&changed).unwrap_err();
        assert!(matches!(error, AssetError::Mismatch { what, .. } if what == expected), "{error}");
        assert!(error.to_string().contains("019#2"), "{error}");
    }
    let old = PlacedObject {
        physics_hash: format!("v1:{}", model.physics_hash_v1()),
        judging_hash: None,
        looks_hash: None,
        ..placed.clone()
    };
    assert!(catalogue.instance(&old).is_ok(), "scenarios of version 1 are checked with the version 1 hash");
    let repainted = PlacedObject { looks_hash: Some("v2:0".into()), ..placed.clone() };
    assert!(catalogue.instance(&repainted).is_ok(), "appearance is not checked");
    let full = PlacedObject { looks_hash: Some(model.with_full_meshes().looks_hash()), ..placed.clone() };
    let triangles = |placed| -> usize {
        let model = catalogue.instance(placed).unwrap();
        model.links[0].visual.iter().map(|part| part.render_mesh.triangles.len()).sum()
    };
    assert!(triangles(&full) > triangles(&placed), "an older scenario keeps its full-resolution meshes");
    assert_eq!(catalogue.changed_appearance(&[placed, old, repainted, full]).unwrap(), ["019#2"]);
}

#[test]
fn unknown_objects_get_suggestions() {
    let catalogue = Catalogue::builtin();
    let Err(AssetError::UnknownUid { near, .. }) = catalogue.build("Red Mugg") else { panic!("expected UnknownUid") };
    assert_eq!(near.first().map(String::as_str), Some("001 (Red Mug)"));
    assert!(matches!(catalogue.build(""), Err(AssetError::UnknownUid { .. })));
    assert!(catalogue.build("999999999999999999999999").is_err());
}

#[test]
fn invalid_data_is_located() {
    let record = |key: &str, value: &str| {
        let mut records: serde_json::Value = serde_json::from_str(include_str!("../../data/catalog.json")).unwrap();
        records[0][key] = serde_json::from_str(value).unwrap();
        serde_json::json!([records[0]]).to_string()
    };
    let turned =
        r##"{"family": "x", "friction": 1, "parts": [{"turned": {"profile": [], "finish": {"color": "#000000"}}}]}"##;
    for (records, place) in [
        ("[{}]".to_owned(), "[0]"),
        (record("size_m", "\"big\""), "[0].size_m"),
        (record("recipe", r#"{"family": "mug", "friction": 0.5, "parts": [{"blob": {}}]}"#), "[0].recipe.parts[0]"),
        (record("recipe", turned), "001.parts[0]: a turned part needs"),
        (record("uid", "\"00#1\""), "without # and /"),
    ] {
        let error = Catalogue::from_json(&records).unwrap_err().to_string();
        assert!(error.contains(place), "{error} should name {place}");
    }
}

#[test]
fn same_uid_same_bytes() {
    let text = |catalogue: &Catalogue| {
        let models = catalogue.cards().iter().map(|card| catalogue.build(&card.uid).unwrap());
        models.map(|model| format!("{:?}", model.links)).collect::<Vec<_>>()
    };
    let fresh = || Catalogue::from_json(include_str!("../../data/catalog.json"));
    assert!(text(&fresh().unwrap()) == text(&fresh().unwrap()));
}

/// A card's cavity size is derived from the model's cavity.
#[test]
fn cavity_sizes_match_the_cavities() {
    let catalogue = Catalogue::builtin();
    let mut cavities_found = 0;
    for card in catalogue.cards() {
        let model = catalogue.build(&card.uid).unwrap();
        let cavities = model.cavities(&vec![0.0; model.joint_count()]);
        let expected = match cavities.as_slice() {
            [cavity] if !card.is_articulated => genmanip_core::CavitySize::of_cavity(cavity),
            _ => None,
        };
        assert_eq!(card.annotations.room, expected, "{}", card.name);
        if let Some(size) = expected {
            cavities_found += 1;
            assert!(size.depth_m < card.size_m.z && size.inside_m[0] < card.size_m.x, "{}: {size:?}", card.name);
        }
    }
    assert!(cavities_found > 10);
    let inside = catalogue.card("052").and_then(|card| card.annotations.room).unwrap();
    assert!((inside.inside_m[0] - 0.192).abs() < 1e-9 && (inside.depth_m - 0.096).abs() < 1e-9, "{inside:?}");
}
