//! Identity of the content that a review is bound to.

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Document, Scenario, hexadecimal};
use sha2::{Digest, Sha256};

/// SHA-256 of a scenario, its assets and the physics engine. It changes with any edit of the scenario, with the
/// physics,
/// judging or look of an object, and with the engine's version.
///
/// A scenario refers to its assets by hash. A scenario of an older version has no hash of looks; that of the
/// catalogue's object is used instead.
pub fn content_sha256(scenario: &Scenario) -> String {
    let mut hasher = Sha256::new();
    hasher.update(scenario.to_json().as_bytes());
    hasher.update([0]);
    hasher.update(genmanip_sim::engine_version().as_bytes());
    for placed in scenario.objects.iter().filter(|placed| placed.looks_hash.is_none()) {
        hasher.update([0]);
        if let Ok(model) = Catalogue::all().instance(placed) {
            hasher.update(model.looks_hash().as_bytes());
        }
    }
    hexadecimal(&hasher.finalize())
}
