//! Recipes: of which parts an object is made, as data.

use genmanip_core::{ObjectCard, ObjectLink, ObjectModel, Piece, Seed, VisualPart};
use serde::Deserialize;

use crate::parts::Part;
use crate::solid::{Moments, Solid};

/// Version of the physics that recipes and parts give; grows when pieces or inertia of any object change.
pub const GENERATOR_VERSION: u32 = 1;

/// An object as a list of parts in its frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Family, e.g. `mug`.
    pub family: String,
    /// Sliding friction coefficient against a like surface.
    pub friction: f64,
    /// The parts; their union is the object.
    pub parts: Vec<Part>,
}

/// What parts leave behind while an object is put together.
#[derive(Debug, Default)]
pub struct Draft {
    /// Surfaces to draw.
    pub visual: Vec<VisualPart>,
    /// Collision bodies with their moments.
    pub solids: Vec<Solid>,
    /// Where something counts as in the object.
    pub cavity: Vec<Piece>,
}

impl Recipe {
    /// The object: the mass of the card spread evenly over the parts.
    pub fn build(&self, card: &ObjectCard, seed: Seed) -> ObjectModel {
        let mut draft = Draft::default();
        for (index, part) in self.parts.iter().enumerate() {
            part.add_to(&mut draft, seed.fork("part").fork_index(index as u64));
        }
        let moments: Vec<Moments> = draft.solids.iter().map(|solid| solid.moments).collect();
        ObjectModel {
            card: card.clone(),
            family: self.family.clone(),
            seed,
            generator_version: GENERATOR_VERSION,
            links: vec![ObjectLink {
                name: "body".into(),
                joint: None,
                visual: draft.visual,
                pieces: draft.solids.into_iter().map(|solid| solid.piece).collect(),
                mass: Moments::sum(&moments).with_mass(card.mass_kg),
            }],
            cavity: draft.cavity,
            friction: self.friction,
            joint_states: Vec::new(),
        }
    }
}
