//! Physics randomisation of a scenario.
//!
//! The ranges at strength 1 are chosen by hand: as large as the day-to-day variation in a laboratory, and still
//! solvable. Smaller strengths shrink them in proportion.

use genmanip_core::{Scenario, Seed};
use rand::{Rng, RngExt};

/// Maximum factors of friction and (`MASS`) of mass; the minimum is the inverse.
const FRICTION: f64 = 1.5;
const MASS: f64 = 1.5;
/// Minimum factor of contact damping. The maximum is 1.
const CONTACT_DAMPING: f64 = 0.5;

/// Multiplies pad friction, and the friction, mass, contact damping and joint friction of each object, by independent
/// random factors; deterministic for a seed. `strength` ranges from 0 (no change) to 1.
pub fn vary_physics(scenario: &mut Scenario, seed: Seed, strength: f64) {
    let rng = &mut seed.rng();
    scenario.world.physics.pad_friction *= factor(FRICTION, strength, rng);
    for object in &mut scenario.objects {
        object.physics.friction *= factor(FRICTION, strength, rng);
        object.physics.mass *= factor(MASS, strength, rng);
        object.physics.contact_damping *= 1.0 - strength * (1.0 - CONTACT_DAMPING) * rng.random::<f64>();
        object.physics.joint_friction *= factor(FRICTION, strength, rng);
    }
}

/// Log-uniform factor between `1 / most` and `most`, at strength 1.
fn factor(most: f64, strength: f64, rng: &mut impl Rng) -> f64 {
    (strength * most.ln() * (2.0 * rng.random::<f64>() - 1.0)).exp()
}
