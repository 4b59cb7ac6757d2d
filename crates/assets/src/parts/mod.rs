//! Kinds of parts: each builds a surface, exact convex collision pieces and, if hollow, a cavity.

mod block;
mod capsules;
mod case;
mod mesh;
mod open_box;
mod prism;
mod ring;
mod tube;
mod turned;
mod vessel;
mod visual;

use genmanip_core::{Piece, Seed};
use serde::Deserialize;

pub use block::Block;
pub use capsules::Capsules;
pub use case::Case;
pub use mesh::Mesh;
pub use open_box::OpenBox;
pub use prism::Prism;
pub use ring::Ring;
pub use tube::Tube;
pub use turned::{Turned, TurnedSolid};
pub use vessel::Vessel;

use crate::link_builder::LinkBuilder;

/// Part of an object; lengths are in metres, in the object's frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Hollow body of revolution, open at the top.
    Vessel(Vessel),
    /// Solid body of revolution, or a regular prism.
    Turned(Turned),
    /// Swept tube, round or flattened.
    Tube(Tube),
    /// Box with sharp or rounded edges.
    Block(Block),
    /// Box without a lid.
    OpenBox(OpenBox),
    /// Box that is open at the front.
    Case(Case),
    /// Extruded convex polygon.
    Prism(Prism),
    /// Horizontal ring.
    Ring(Ring),
    /// Capsules that collide and are not rendered.
    Capsules(Capsules),
    /// Triangle mesh.
    Mesh(Mesh),
}

/// Assembles the parts of one link; `seed` drives their random textures.
pub fn assemble(parts: &[Part], seed: Seed) -> LinkBuilder {
    let mut link = LinkBuilder::default();
    for (index, part) in parts.iter().enumerate() {
        part.add_to(&mut link, seed.fork_index(index as u64));
    }
    link
}

impl Part {
    /// Adds the part to a link; `seed` drives its random texture.
    fn add_to(&self, link: &mut LinkBuilder, seed: Seed) {
        match self {
            Self::Vessel(part) => part.add_to(link, seed),
            Self::Turned(part) => part.add_to(link, seed),
            Self::Tube(part) => part.add_to(link, seed),
            Self::Block(part) => part.add_to(link, seed),
            Self::OpenBox(part) => part.add_to(link, seed),
            Self::Case(part) => part.add_to(link, seed),
            Self::Prism(part) => part.add_to(link, seed),
            Self::Ring(part) => part.add_to(link, seed),
            Self::Capsules(part) => part.add_to(link),
            Self::Mesh(part) => part.add_to(link, seed),
        }
    }

    /// Cavity of a part that is open at the top; `None` for other parts.
    pub fn cavity(&self) -> Option<Piece> {
        match self {
            Self::Vessel(part) => Some(part.cavity()),
            Self::OpenBox(part) => Some(part.cavity()),
            _ => None,
        }
    }

    /// Reason why the part cannot be built; `None` if it is valid.
    pub fn flaw(&self) -> Option<&'static str> {
        let profile = |points: &[[f64; 2]]| points.len() >= 2 && points.iter().flatten().all(|value| value.is_finite());
        let (sound, rule) = match self {
            Self::Vessel(part) => (
                profile(&part.outer)
                    && profile(&part.inner)
                    && part.outer.len() == part.inner.len()
                    && (part.outline.is_empty() || profile(&part.outline))
                    && (4..=96).contains(&part.sectors),
                "a vessel needs outer and inner profiles of equally many points (at least 2) and 4-96 sectors",
            ),
            Self::Turned(part) => {
                let rings = match &part.solid {
                    TurnedSolid::Rings(rings) => profile(rings),
                    TurnedSolid::Stack(stack) => stack.iter().all(|rings| profile(rings)),
                    _ => true,
                };
                (
                    profile(&part.profile) && rings && part.sides <= 96 && !(1..3).contains(&part.sides),
                    "a turned part needs profiles of at least 2 points, and 0 or 3-96 sides",
                )
            }
            Self::Tube(part) => (
                part.path.len() >= 2 && profile(&[part.half_widths.as_slice(), &part.half_widths].concat()),
                "a tube needs a path of at least 2 points and at least one pair of half widths",
            ),
            Self::Block(part) => (part.size.min_element() > 0.0, "a block needs a positive size"),
            Self::OpenBox(part) => (
                part.wall > 0.0
                    && part.floor > 0.0
                    && part.floor < part.size.z
                    && 2.0 * part.wall < part.size.x.min(part.size.y),
                "an open box needs walls and a floor thinner than its size",
            ),
            Self::Case(part) => (part.is_sound(), "a case needs walls and shelves that leave space between them"),
            Self::Prism(part) => (
                part.polygon.len() >= 3 && part.span[0] < part.span[1],
                "a prism needs at least 3 corners and an increasing span",
            ),
            Self::Ring(part) => (
                part.section.len() >= 3 && !(1..3).contains(&part.solid.len()) && (4..=96).contains(&part.sectors),
                "a ring needs a section of at least 3 points and 4-96 sectors",
            ),
            Self::Capsules(part) => (
                part.path.len() == part.radii.len() + 1 && !part.radii.is_empty(),
                "capsules need one radius per segment of the path",
            ),
            Self::Mesh(part) => (
                part.is_sound(),
                "a mesh needs 3-50000 vertices and valid indices; a solid one 4-512 vertices around a volume",
            ),
        };
        (!sound).then_some(rule)
    }
}
