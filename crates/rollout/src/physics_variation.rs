//! Physics drawn by chance: how a scenario's things weigh, slide and bounce differently from their assets.
//!
//! Ranges at strength 1 are chosen: as large as what a laboratory sees from one day to the next, and still solvable.
//! Smaller strengths shrink them in proportion.

use genmanip_core::{Scenario, Seed};
use rand::{Rng, RngExt};

/// Largest factors of friction and mass; their inverses are the least.
const FRICTION: f64 = 1.5;
const MASS: f64 = 1.5;
/// Least factor of the damping of contacts.
const CONTACT_DAMPING: f64 = 0.5;

/// Multiplies the friction of the pads, and friction, mass, damping of contacts and joint friction of each object, by
/// factors drawn independently; the same seed gives the same ones. Strength is from 0, for nothing, to 1.
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

/// Between a factor and its inverse, on a scale of ratios.
fn factor(most: f64, strength: f64, rng: &mut impl Rng) -> f64 {
    (strength * most.ln() * (2.0 * rng.random::<f64>() - 1.0)).exp()
}
