//! Drives and MJCF text.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{
    Annotations, AssetRef, MassProperties, ObjectCard, ObjectLink, ObjectModel, PhysicsFactors, Piece, Pose, Shape,
};

use crate::drive::{lerp, setpoint_from_width};
use crate::xml::Element;
use crate::{Model, SceneObject};

#[test]
fn width_setpoints_are_continuous_and_end_beyond_closed() {
    let drives = genmanip_assets::panda().drives.clone().expect("a robot with motors");
    let cases = [(0.08, 0.08), (0.02, 0.02), (0.01, 0.01), (0.005, 0.0), (0.0, -0.01)];
    for (width, setpoint) in cases {
        assert!((setpoint_from_width(width, &drives) - setpoint).abs() < 1e-12, "{width}");
    }
}

#[test]
fn interpolation_ends_exactly() {
    assert_eq!(lerp(0.1, 0.3, 1.0), 0.3);
    assert_eq!(lerp(0.1, 0.3, 0.0), 0.1);
}

#[test]
fn text_is_escaped_and_numbers_are_exact() {
    let element = Element::named("body", "a<b> & \"c\"").numbers("pos", &[0.1 + 0.2, -0.0, 1e-7]);
    assert_eq!(
        element.render(),
        "<body name=\"a&lt;b&gt; &amp; &quot;c&quot;\" pos=\"0.30000000000000004 -0 0.0000001\"/>\n"
    );
}

/// Names and structure of the text are an interface: `export --mjcf` writes it for users.
#[test]
fn a_small_scene_reads_well() {
    let tetrahedron = Shape::Hull { points: vec![DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1, DVec3::Z * 0.1] };
    let model = Arc::new(wedge(vec![
        Piece::at(DVec3::ZERO, tetrahedron),
        Piece::at(DVec3::Z * 0.02, Shape::Sphere { radius: 0.02 }),
    ]));
    let place = |name: &str, x: f64| SceneObject {
        name: name.into(),
        model: Arc::clone(&model),
        pose: Pose::from_position(DVec3::new(x, 0.0, 0.0)),
        joint_positions: vec![],
        physics: PhysicsFactors::default(),
    };
    let objects = [place("Left Wedge", 0.4), place("Right Wedge", 0.6)];
    let scene = Model::compile_without_robot(&default_world(), &objects).expect("a sound scene");
    insta::assert_snapshot!(scene.mjcf());
}

fn wedge(pieces: Vec<Piece>) -> ObjectModel {
    let mass =
        MassProperties { mass_kg: 0.1, center: DVec3::splat(0.025), inertia: DMat3::from_diagonal(DVec3::splat(1e-4)) };
    ObjectModel {
        card: ObjectCard {
            uid: "wedge".into(),
            asset: AssetRef::builtin("wedge", 1),
            name: "Wedge".into(),
            description: String::new(),
            category: String::new(),
            general_category: String::new(),
            colors: vec![],
            materials: vec![],
            shape: String::new(),
            size_m: DVec3::splat(0.1),
            mass_kg: 0.1,
            is_container: false,
            is_articulated: false,
            states: vec![],
            can_grasp: true,
            annotations: Annotations::default(),
        },
        family: "test".into(),
        asset: AssetRef::builtin("wedge", 1),
        links: vec![ObjectLink { name: "body".into(), joint: None, visual: vec![], pieces, cavity: vec![], mass }],
        friction: 0.5,
        joint_states: vec![],
    }
}
