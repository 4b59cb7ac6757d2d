//! Identity of what is reviewed.

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Document, Scenario, hexadecimal};
use sha2::{Digest, Sha256};

/// SHA-256 of a scenario, its assets and the engine: any edit of the scenario, another physics, judging or look of an
/// object, and another engine give another one.
///
/// A scenario names its assets by hash; for one made by an older version, whose looks have none, the hash of the
/// catalogue's looks is taken.
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
