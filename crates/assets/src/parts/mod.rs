//! Families of parts by construction: each makes a surface, exact convex bodies and, where it is hollow, a cavity.

mod block;
mod open_box;
mod prism;
mod ring;
mod tube;
mod turned;
mod vessel;

use std::sync::Arc;

use genmanip_core::{Pose, Seed, TriMesh, VisualPart};
use serde::Deserialize;

pub use block::Block;
pub use open_box::OpenBox;
pub use prism::Prism;
pub use ring::Ring;
pub use tube::Tube;
pub use turned::Turned;
pub use vessel::Vessel;

use crate::finish::Finish;
use crate::recipe::Draft;

/// One part of an object, all lengths in metres in the object's frame.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// A hollow body of revolution, open at the top.
    Vessel(Vessel),
    /// A full body of revolution or a regular prism.
    Turned(Turned),
    /// A swept tube, round or flattened.
    Tube(Tube),
    /// A box, sharp or rounded.
    Block(Block),
    /// A box without a lid.
    OpenBox(OpenBox),
    /// A convex polygon with thickness.
    Prism(Prism),
    /// A ring lying flat.
    Ring(Ring),
}

impl Part {
    /// Adds the part to an object; chance in its textures comes from `seed`.
    pub fn add_to(&self, draft: &mut Draft, seed: Seed) {
        match self {
            Self::Vessel(part) => part.add_to(draft, seed),
            Self::Turned(part) => part.add_to(draft, seed),
            Self::Tube(part) => part.add_to(draft, seed),
            Self::Block(part) => part.add_to(draft, seed),
            Self::OpenBox(part) => part.add_to(draft, seed),
            Self::Prism(part) => part.add_to(draft, seed),
            Self::Ring(part) => part.add_to(draft, seed),
        }
    }
}

/// A drawn surface in the object's frame.
fn surface(name: &str, mesh: TriMesh, finish: &Finish, seed: Seed) -> VisualPart {
    VisualPart {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: finish.material(seed),
        link_from_part: Pose::IDENTITY,
    }
}
