use genmanip_core::{Aabb, Pose, Seed};

use crate::{Catalogue, variant};

/// For every rigid object, visuals, collision pieces and mass scale consistently, and graspable objects stay
/// graspable.
#[test]
fn variants_scale_consistently() {
    let catalogue = Catalogue::builtin();
    for card in catalogue.cards() {
        let model = catalogue.build(&card.uid).unwrap();
        let changed = variant(&model, Seed::new(77));
        if card.is_articulated {
            assert_eq!(changed.physics_hash(), model.physics_hash(), "{}", card.name);
            continue;
        }
        assert_ne!(changed.physics_hash(), model.physics_hash(), "{}", card.name);
        assert_ne!(changed.physics_hash(), variant(&model, Seed::new(78)).physics_hash(), "{}", card.name);
        let factors = changed.card.size_m / model.card.size_m;
        let bounds = |model: &genmanip_core::ObjectModel| Aabb::from_pieces(&Pose::IDENTITY, &model.links[0].pieces);
        // Inscribed hulls of round bodies are up to 0.5 mm smaller.
        let difference = (bounds(&changed).size() - bounds(&model).size() * factors).abs().max_element();
        assert!(difference < 6e-4, "{}: pieces differ by {difference} m", card.name);
        let seen =
            |model: &genmanip_core::ObjectModel| {
                Aabb::from_points(model.links[0].visual.iter().flat_map(|part| {
                    part.mesh.positions.iter().map(|p| part.link_from_part.transform_point(p.as_dvec3()))
                }))
            };
        let difference = (seen(&changed).size() - seen(&model).size() * factors).abs().max_element();
        assert!(difference < 1e-5, "{}: surface differs by {difference} m", card.name);
        let (before, after) = (&model.links[0].mass, &changed.links[0].mass);
        assert!((after.mass_kg - changed.card.mass_kg).abs() < 1e-9, "{}", card.name);
        assert!((after.center - before.center * factors).length() < 1e-12, "{}", card.name);
        // Inertia of a scaled body lies between those of the extreme factors.
        let share = after.mass_kg / before.mass_kg;
        for axis in 0..3 {
            let ratio = after.inertia.col(axis)[axis] / before.inertia.col(axis)[axis] / share;
            let (least, most) = (factors.min_element().powi(2), factors.max_element().powi(2));
            assert!((least - 1e-9..=most + 1e-9).contains(&ratio), "{}: {ratio}", card.name);
        }
        let narrow = |size: genmanip_core::glam::DVec3| size.x.min(size.y);
        assert!(narrow(card.size_m) > 0.0755 || narrow(changed.card.size_m) < 0.0746, "{}", card.name);
    }
}
