//! Models of the bodies of a scene, so that relations treat support surfaces other than the table like objects.

use std::sync::Arc;

use genmanip_core::{JointState, MassProperties, ObjectLink, ObjectModel, Pose, SupportSurface};
use glam::{DMat3, DVec3};

/// Model of an object or of a support surface.
#[derive(Debug)]
pub(super) enum BodyModel {
    Object(Arc<ObjectModel>),
    /// A slab in the surface's frame.
    Surface(Box<ObjectLink>),
}

impl BodyModel {
    /// The slab of a surface only, not the boards beside and above it. *On* then means on its top, and *near* is
    /// measured from its edges.
    pub fn of_surface(surface: &SupportSurface) -> Self {
        Self::Surface(Box::new(ObjectLink {
            name: "slab".into(),
            joint: None,
            visual: Vec::new(),
            pieces: surface.pieces().into_iter().take(1).collect(),
            cavity: Vec::new(),
            mass: MassProperties { mass_kg: 0.0, center: DVec3::ZERO, inertia: DMat3::ZERO },
        }))
    }

    /// Links, parents first.
    pub fn links(&self) -> &[ObjectLink] {
        match self {
            Self::Object(model) => &model.links,
            Self::Surface(slab) => std::slice::from_ref(slab),
        }
    }

    /// Named states; none for a surface.
    pub fn joint_states(&self) -> &[JointState] {
        match self {
            Self::Object(model) => &model.joint_states,
            Self::Surface(_) => &[],
        }
    }

    /// `object_from_link` for each link, given joint positions in link order.
    pub fn link_poses(&self, joint_positions: &[f64]) -> Vec<Pose> {
        match self {
            Self::Object(model) => model.link_poses(joint_positions),
            Self::Surface(_) => vec![Pose::IDENTITY],
        }
    }
}
