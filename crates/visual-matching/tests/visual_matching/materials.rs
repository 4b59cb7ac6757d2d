//! Materials of objects are found in rendered photographs of hidden ones, and roughness is named where nothing tells it.

use super::*;
use genmanip_core::{MeasuredMaterial, Seed};
use rand::RngExt;

const SIZE: [u32; 2] = [320, 180];

/// Two upright objects of this seed, at other places in each layout.
fn layouts(seed: u64) -> Vec<Vec<(Arc<ObjectModel>, Pose)>> {
    let catalogue = Catalogue::builtin();
    let rng = &mut Seed::new(seed).fork("layouts").rng();
    let fits = |card: &&genmanip_core::ObjectCard| card.size_m.z > 0.08 && card.size_m.max_element() < 0.3;
    let cards: Vec<_> = catalogue.cards().iter().filter(fits).collect();
    let drawn = [0, 1].map(|_| cards[rng.random_range(0..cards.len())]);
    let mut layout = || {
        let place = |(card, side): (&&genmanip_core::ObjectCard, f64)| {
            let at = DVec3::new(rng.random_range(0.45..0.6), side * rng.random_range(0.08..0.2), 0.5 * card.size_m.z);
            (catalogue.build(&card.uid).unwrap(), Pose::from_position_yaw(at, rng.random_range(-3.0..3.0)))
        };
        drawn.iter().zip([1.0, -1.0]).map(place).collect()
    };
    vec![layout(), layout()]
}

/// Random materials of all parts.
fn hidden_materials(objects: &[(Arc<ObjectModel>, Pose)], seed: u64) -> Vec<MeasuredMaterial> {
    let rng = &mut Seed::new(seed).fork("materials").rng();
    let parts = objects.iter().flat_map(|(model, _)| {
        let parts = model.links.iter().flat_map(|link| &link.visual);
        parts.map(|part| (model.card.uid.clone(), part.name.clone()))
    });
    let material = |(object, part)| {
        let color_factor = [0; 3].map(|_| rng.random_range(0.5..1.0));
        MeasuredMaterial { object, part, color_factor, roughness: Some(rng.random_range(0.1..0.9)) }
    };
    parts.map(material).collect()
}

/// The hidden light with ambient light as a matched world has it: from below as from above.
fn even_around() -> RenderVariation {
    let hidden = hidden();
    RenderVariation { ground_color: hidden.sky_color, ..hidden }
}

/// Photographs of two layouts by both cameras, under a hidden light with hidden materials.
fn photographed(seed: u64, variation: &RenderVariation) -> (MatchRequest, Vec<MeasuredMaterial>) {
    let world = world_of(SIZE);
    let layouts = layouts(seed);
    let truth = hidden_materials(&layouts[0], seed);
    let variation = RenderVariation { measured: truth.clone(), ..variation.clone() };
    let photo = |camera, objects: &[_]| photo_under(variation.clone(), &world, camera, None, objects);
    let mut request = request(world.clone(), vec![photo(0, &[]), photo(1, &[])]);
    let scenes = layouts.iter().map(|objects| scene(objects, vec![photo(0, objects), photo(1, objects)]));
    request.objects = scenes.collect();
    (request, truth)
}

/// Colours are found, roughness is found or named, and images come nearer to the photographs.
#[test]
fn materials_are_found_in_photographs() {
    let (mut colors, mut told, mut covered) = (Vec::new(), Vec::new(), 0);
    for seed in 1..=3 {
        let (request, truth) = photographed(seed, &even_around());
        let matched = match_workspace(&request).unwrap();
        assert!(!matched.materials.is_empty(), "seed {seed}");
        let names: Vec<&str> = matched.unidentified.iter().map(|it| it.what.as_str()).collect();
        for found in &matched.materials {
            let material = &found.material;
            let truth = truth.iter().find(|it| it.is_of(&material.object, &material.part)).unwrap();
            let shares = found.material.color_factor.iter().zip(truth.color_factor);
            colors.push(shares.map(|(found, truth)| (found / truth - 1.0).abs()).fold(0.0, f64::max));
            let what = format!("roughness of {}, part {}", found.material.object, found.material.part);
            let is_named = names.contains(&what.as_str());
            assert_eq!(is_named, !found.has_roughness, "{found:?}");
            let truth = truth.roughness.unwrap();
            if found.has_roughness {
                told.push((found.material.roughness.unwrap() - truth).abs());
                let [low, high] = found.roughness_range.unwrap();
                covered += usize::from((low..=high).contains(&truth));
            }
            let [before, after] = found.delta_e;
            assert!(after < before.max(1.0), "seed {seed}: {found:?}");
        }
        let written = &matched.world.appearance.as_ref().unwrap().materials;
        assert!(written.len() == matched.materials.len() && matched.world.faults(&panda()).is_empty());
    }
    colors.sort_by(f64::total_cmp);
    told.sort_by(f64::total_cmp);
    // Most colours come out 5 to 8 % too dark; the cause is not known.
    assert!(colors[colors.len() / 2] < 0.08, "{colors:?}");
    assert!(told.len() >= 3 && told[told.len() / 2] < 0.08, "{told:?}");
    // The range is no confidence interval, since errors of the light count only roughly.
    assert!(covered * 3 >= told.len() * 2, "{covered} of {}", told.len());
}

/// Without a key light no highlight exists: every roughness is named, and stays that of the object's file.
#[test]
fn roughness_without_a_highlight_is_named() {
    let even = RenderVariation { light_intensity: 0.0, ambient_intensity: 0.9, ..even_around() };
    let (request, _) = photographed(5, &even);
    let matched = match_workspace(&request).unwrap();
    assert!(!matched.materials.is_empty());
    for found in &matched.materials {
        assert!(!found.has_roughness && found.material.roughness.is_none(), "{found:?}");
        assert!(matched.unidentified.iter().any(|it| it.what.starts_with("roughness of")));
    }
}
