//! Appearance randomisation of a world: factors, strength and seed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Seed;

/// Appearance randomisation of a world; the renderer defines the range of each factor.
///
/// ```
/// use genmanip_core::{AppearanceFactor, AppearanceRandomisation, Seed};
/// let look = AppearanceRandomisation::new(Seed::new(7), vec![AppearanceFactor::Light]);
/// assert_eq!(look.strength, 1.0);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AppearanceRandomisation {
    /// Seed of the randomisation.
    pub seed: Seed,
    /// Factors that are randomised; all others keep their defaults.
    pub vary: Vec<AppearanceFactor>,
    /// Strength of the randomisation: 0 is the default appearance, 1 the full range.
    #[serde(default = "full_strength", skip_serializing_if = "is_full_strength")]
    pub strength: f64,
}

impl AppearanceRandomisation {
    /// Full-strength randomisation of the given factors.
    pub fn new(seed: Seed, vary: Vec<AppearanceFactor>) -> Self {
        Self { seed, vary, strength: full_strength() }
    }
}

fn full_strength() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "what serde asks for; exactly the default")]
fn is_full_strength(strength: &f64) -> bool {
    *strength == full_strength()
}

/// Group of appearance properties that are randomised together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AppearanceFactor {
    /// Direction, colour, intensity and size of the key light; ambient light; exposure.
    Light,
    /// Background: one colour, or a room with walls and floor.
    Background,
    /// Material of the table top.
    Material,
    /// Tint, roughness and gloss of the objects, small enough that every colour word stays true.
    Objects,
    /// Camera poses, by a small perturbation.
    Camera,
}

impl AppearanceFactor {
    /// All factors.
    pub const ALL: [Self; 5] = [Self::Light, Self::Background, Self::Material, Self::Objects, Self::Camera];

    /// Name in files and on the command line.
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
