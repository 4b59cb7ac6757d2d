//! Assembly of a link from parts.

use genmanip_core::{Joint, MassProperties, ObjectLink, Piece, VisualPart};
use glam::DVec3;

use crate::solid::{Moments, Solid};

/// Geometry of a link, in the object's frame, to which parts are added.
#[derive(Debug, Default)]
pub struct LinkBuilder {
    /// Rendered surfaces with their materials.
    pub visual: Vec<VisualPart>,
    /// Convex collision pieces with their volume and moments.
    pub solids: Vec<Solid>,
    /// Convex regions in which something counts as inside the link.
    pub cavity: Vec<Piece>,
}

impl LinkBuilder {
    /// Translates all geometry by a vector, m.
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

    /// Link with this geometry; its mass is spread uniformly over the volume of its solids.
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

/// Mass properties of uniform density over all solids.
fn mass_of(solids: &[Solid], mass_kg: f64) -> MassProperties {
    let moments: Vec<Moments> = solids.iter().map(|solid| solid.moments).collect();
    Moments::sum(&moments).with_mass(mass_kg)
}
