//! A link while it is put together from parts.

use genmanip_core::{Joint, MassProperties, ObjectLink, Piece, VisualPart};
use glam::DVec3;

use crate::solid::{Moments, Solid};

/// What the parts of a link have added to it so far, in the frame of its object.
#[derive(Debug, Default)]
pub struct LinkBuilder {
    /// Surfaces to draw.
    pub visual: Vec<VisualPart>,
    /// Collision bodies with their moments.
    pub solids: Vec<Solid>,
    /// Where something counts as in the link.
    pub cavity: Vec<Piece>,
}

impl LinkBuilder {
    /// Moves everything by a vector, m.
    pub fn shift(&mut self, by: DVec3) {
        for part in &mut self.visual {
            part.link_from_part.position += by;
        }
        for solid in &mut self.solids {
            solid.piece.link_from_piece.position += by;
            solid.moments.center += by;
        }
        for piece in &mut self.cavity {
            piece.link_from_piece.position += by;
        }
    }

    /// The link, its mass spread evenly over the volume of its solids.
    pub fn into_link(self, name: &str, mass_kg: f64, joint: Option<Joint>) -> ObjectLink {
        ObjectLink {
            name: name.to_owned(),
            joint,
            mass: mass_of(&self.solids, mass_kg),
            visual: self.visual,
            pieces: self.solids.into_iter().map(|solid| solid.piece).collect(),
            cavity: self.cavity,
        }
    }
}

/// Matter of uniform density in all solids.
fn mass_of(solids: &[Solid], mass_kg: f64) -> MassProperties {
    let moments: Vec<Moments> = solids.iter().map(|solid| solid.moments).collect();
    Moments::sum(&moments).with_mass(mass_kg)
}
