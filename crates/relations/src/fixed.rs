//! Support surfaces other than the table, represented as bodies so that relations treat them like objects.

use genmanip_core::{Annotations, AssetRef, MassProperties, ObjectCard, ObjectLink, ObjectModel, SupportSurface};
use glam::{DMat3, DVec3};

/// A support surface as an object model in the surface's frame, with the slab only, not the boards beside and above it.
/// *On* then means on its top, and *near* is measured from its edges.
pub(super) fn model(surface: &SupportSurface) -> ObjectModel {
    let slab: Vec<_> = surface.pieces().into_iter().take(1).collect();
    let asset = AssetRef::builtin(&surface.id, 1);
    let card = ObjectCard {
        // A surface has no asset, so its id is used as the uid.
        uid: surface.id.clone(),
        asset: asset.clone(),
        name: surface.name.clone(),
        description: String::new(),
        category: "furniture".into(),
        general_category: "furniture".into(),
        colors: Vec::new(),
        materials: Vec::new(),
        shape: String::new(),
        size_m: surface.size_m,
        mass_kg: 0.0,
        is_container: false,
        is_articulated: false,
        states: Vec::new(),
        can_grasp: false,
        annotations: Annotations::default(),
    };
    let link = ObjectLink {
        name: surface.id.clone(),
        joint: None,
        visual: Vec::new(),
        pieces: slab,
        cavity: Vec::new(),
        mass: MassProperties { mass_kg: 0.0, center: DVec3::ZERO, inertia: DMat3::ZERO },
    };
    ObjectModel {
        card,
        family: "support surface".into(),
        asset,
        links: vec![link],
        friction: surface.friction,
        joint_states: Vec::new(),
    }
}
