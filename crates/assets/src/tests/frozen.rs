//! Frozen objects: contents and integrity.

use genmanip_core::Document;

use crate::{AssetSource, Catalogue, FrozenAsset};

#[test]
fn a_frozen_object_is_the_one_that_was_frozen() {
    let catalogue = Catalogue::full();
    let mut bytes = 0;
    // Every tenth card: hand-written and generated, rigid and articulated.
    let some: Vec<_> = catalogue.cards().iter().step_by(10).collect();
    assert!(some.iter().any(|card| card.is_articulated) && some.len() > 100);
    for card in &some {
        let frozen = FrozenAsset::of(&card.asset, catalogue).unwrap();
        let text = frozen.to_json();
        bytes += serde_json::to_string(&frozen).unwrap().len();
        let read = FrozenAsset::from_json(&text).unwrap();
        assert_eq!(read, frozen, "{}", card.uid);
        let (made, kept) = (catalogue.model(&card.asset).unwrap(), read.model().unwrap());
        assert_eq!(made.hashes(), kept.hashes(), "{}", card.uid);
        assert_eq!(made.card, kept.card);
        // Compare bit-exactly, not only by hash.
        for (made, kept) in made.links.iter().zip(&kept.links) {
            assert_eq!((&made.pieces, &made.cavity, made.mass), (&kept.pieces, &kept.cavity, kept.mass));
        }
    }
    // Modified objects are rejected: links that do not match the hashes, and a recipe that does not match the links.
    let sound = FrozenAsset::of(&some[0].asset, catalogue).unwrap();
    let mut heavier = sound.clone();
    heavier.links[0].mass.mass_kg += 0.001;
    assert!(heavier.model().unwrap_err().to_string().contains("physics hash: expected"));
    let mut other = sound.clone();
    other.recipe["parts"] = serde_json::json!([]);
    assert!(other.model().is_err());
    assert_eq!(heavier.differences(&sound, 3), ["links[0].mass.mass_kg"]);
    // 600 objects of a suite with 200 scenarios should stay within a few megabytes.
    assert!(bytes / some.len() < 16_000, "{} bytes each", bytes / some.len());
}
