//! The block of pushing and slipping motions as an object of a scene.

use std::sync::Arc;

use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{
    Annotations, AssetRef, MassProperties, ObjectCard, ObjectLink, ObjectModel, PhysicsFactors, Piece, Pose, Shape,
};
use genmanip_sim::SceneObject;

use crate::recording::Block;

/// A block in its place; `friction` is its own sliding friction.
pub fn scene_object(block: &Block, friction: f64) -> SceneObject {
    let size = DVec3::from_array(block.size_m);
    let middle = DVec3::Z * (size.z / 2.0);
    let squares = size * size;
    let inertia =
        DVec3::new(squares.y + squares.z, squares.x + squares.z, squares.x + squares.y) * (block.mass_kg / 12.0);
    let link = ObjectLink {
        name: "block".into(),
        joint: None,
        visual: Vec::new(),
        pieces: vec![Piece::at(middle, Shape::Box { half_extents: size / 2.0 })],
        cavity: Vec::new(),
        mass: MassProperties { mass_kg: block.mass_kg, center: middle, inertia: DMat3::from_diagonal(inertia) },
    };
    let asset = AssetRef::builtin("block", 1);
    let card = ObjectCard {
        uid: "block".into(),
        asset: asset.clone(),
        name: "block".into(),
        description: "Block of known size and mass.".into(),
        category: "block".into(),
        general_category: "block".into(),
        colors: Vec::new(),
        materials: Vec::new(),
        shape: "cuboid".into(),
        size_m: size,
        mass_kg: block.mass_kg,
        is_container: false,
        is_articulated: false,
        states: Vec::new(),
        can_grasp: true,
        annotations: Annotations::default(),
    };
    let model =
        ObjectModel { card, family: "block".into(), asset, links: vec![link], friction, joint_states: Vec::new() };
    SceneObject {
        name: "block".into(),
        model: Arc::new(model),
        pose: Pose::from_position(DVec3::from_array(block.base_m)),
        joint_positions: Vec::new(),
        physics: PhysicsFactors::default(),
    }
}
