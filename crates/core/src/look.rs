//! How a world is drawn differently from the usual: which parts of the picture, how much, and by which chance.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Seed;

/// A look of a world that is drawn by chance; the renderer knows what each part may become.
///
/// ```
/// use genmanip_core::{Look, Seed, Vary};
/// let look = Look::new(Seed::new(7), vec![Vary::Light]);
/// assert_eq!(look.strength, 1.0);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// Where the chance comes from.
    pub seed: Seed,
    /// What differs from the usual look.
    pub vary: Vec<Vary>,
    /// How far it may differ: 1 for all that can still be told, 0 for nothing.
    #[serde(default = "whole", skip_serializing_if = "is_whole")]
    pub strength: f64,
}

impl Look {
    /// A look as different as can be.
    pub fn new(seed: Seed, vary: Vec<Vary>) -> Self {
        Self { seed, vary, strength: whole() }
    }
}

fn whole() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "what serde asks for; exactly the default")]
fn is_whole(strength: &f64) -> bool {
    *strength == whole()
}

/// What a drawing may vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Vary {
    /// Direction, colour, strength and size of the key light, the light of the sky, exposure.
    Light,
    /// What is seen where nothing stands: one colour, or a room of some walls and floor.
    Background,
    /// What the table's top is made of.
    Material,
    /// Tint, roughness and shine of the objects, so little that every colour word stays true.
    Objects,
    /// Where the cameras stand, by a hand's tremble.
    Camera,
}

impl Vary {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Light, Self::Background, Self::Material, Self::Objects, Self::Camera];

    /// The name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Background => "background",
            Self::Material => "material",
            Self::Objects => "objects",
            Self::Camera => "camera",
        }
    }
}
