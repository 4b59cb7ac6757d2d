//! Validity of every family's objects, the list of generated objects, and search.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{AssetRef, Pose, Seed};
use serde_json::json;

use crate::instances::generated_instances;
use crate::metadata::{Split, asset_metadata, geometry_metadata};
use crate::search::Filter;
use crate::{AssetSource, Catalogue, Families};

/// Number of seeds checked per family.
const SEEDS: u64 = 3;

#[test]
fn there_are_enough_families() {
    let families = Families::builtin();
    let count = |wanted: &dyn Fn(&crate::Family) -> bool| families.all().filter(|family| wanted(family)).count();
    assert!(count(&|family| !family.articulated) >= 80);
    assert!(count(&|family| !family.articulated && family.unseen) >= 16);
    assert!(count(&|family| family.articulated) >= 12);
    // Every family has synonyms, uses and a category path.
    assert!(
        families.all().all(|family| !family.synonyms.is_empty() && !family.uses.is_empty() && family.path.len() > 1)
    );
}

#[test]
fn objects_of_every_family_are_sound() {
    let families = Families::builtin();
    let mut flaws = Vec::new();
    for family in families.all() {
        for seed in (1..=SEEDS).map(|seed| Seed::new(1_000 + seed)) {
            let model = match families.instance(&family.family, &BTreeMap::new(), seed) {
                Ok(model) => model,
                Err(error) => {
                    flaws.push(error.to_string());
                    continue;
                }
            };
            let card = &model.card;
            let mut check = |holds: bool, what: String| {
                if !holds {
                    flaws.push(format!("{}: {what}", card.uid));
                }
            };
            let words = card.description.split_whitespace().count();
            check((6..=32).contains(&words), format!("a description of {words} words"));
            check(card.description.starts_with("A ") || card.description.starts_with("An "), card.description.clone());
            check(!card.description.contains(['{', '}']) && !card.name.contains("  "), card.name.clone());
            check(!card.colors.is_empty() && !card.materials.is_empty(), "no colour or material".into());
            check((0.004..8.0).contains(&card.mass_kg), format!("{} kg", card.mass_kg));
            check(!card.uid.as_str().contains(['#', '/']), "uid".into());
            let pieces: usize = model.links.iter().map(|link| link.pieces.len()).sum();
            check((1..=60).contains(&pieces), format!("{pieces} collision pieces"));
            if card.can_grasp {
                let narrow = card.size_m.min_element();
                check(narrow <= 0.0765, format!("its narrowest side is {narrow} m"));
            }
            check(card.is_articulated == (model.joint_count() > 0), "joints".into());
            check(!geometry_metadata(&model).stable_poses.is_empty(), "no pose to stand in".into());
            let moving = model.links.iter().filter(|link| link.joint.is_some());
            check(
                moving.clone().all(|link| crate::handle_bounds(link).is_some()),
                "a moving link without handle".into(),
            );
        }
    }
    assert!(flaws.is_empty(), "{} flaws:\n{}", flaws.len(), flaws.join("\n"));
}

#[test]
fn seeds_are_reproducible_and_fixed_parameters_leave_the_others() {
    let families = Families::builtin();
    let make = |params: &[(&str, serde_json::Value)], seed| {
        let params = params.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        families.instance("mug", &params, Seed::new(seed)).unwrap()
    };
    let mug = make(&[], 5);
    assert_eq!(mug.hashes(), make(&[], 5).hashes());
    assert_ne!(mug.hashes().physics, make(&[], 6).hashes().physics);
    let red = make(&[("color", json!({"word": "red", "hex": "#ff0000"}))], 5);
    assert_eq!(red.hashes().physics, mug.hashes().physics);
    assert_eq!(red.card.colors[0], "red");
    assert_ne!(red.card.uid, mug.card.uid);
    let tall = make(&[("h", json!(0.1))], 5);
    assert!((tall.card.size_m.z - 0.1).abs() < 1e-6, "{}", tall.card.size_m);
}

#[test]
fn invalid_requests_are_explained() {
    let check = |family: &str, params: serde_json::Value, expected: &str| {
        let params = serde_json::from_value(params).unwrap();
        let error = Families::builtin().instance(family, &params, Seed::new(1)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check("mugs", json!({}), "near misses: ");
    check("mug", json!({"height": 0.1}), "unknown parameter `height`; known parameters: ");
    check("mug", json!({"h": "tall"}), "mm(1 arguments) is unknown");
    check("mug", json!({"h": 3.0}), "its size is ");
}

#[test]
fn invalid_data_is_located() {
    let check = |record: serde_json::Value, expected: &str| {
        let files = [("own", json!([record]).to_string())];
        let files: Vec<(&str, &str)> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
        let made = Families::from_json(&files, "{}", "{}")
            .and_then(|families| families.instance("x", &BTreeMap::new(), Seed::new(1)));
        let error = made.unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    let record = |parts: serde_json::Value, vars: serde_json::Value| {
        json!({"family": "x", "version": 1, "path": ["a", "x"], "synonyms": ["y"], "uses": ["z"], "vars": vars,
               "card": {"name": "X", "description": "An x.", "colors": ["red"], "materials": ["wood"], "shape": "x",
                        "mass_kg": 0.1}, "parts": parts})
    };
    check(record(json!([{"block": {"size": ["=w", 0.1, 0.1], "finish": {"color": "#ffffff"}}}]), json!({})), "`w`");
    check(record(json!([{"use": "nothing"}]), json!({})), "unknown shape `nothing`");
    check(record(json!([{"blok": {}}]), json!({})), "unknown variant `blok`");
    check(record(json!([]), json!({})), "its size is ");
    let loops = record(
        json!([{"block": {"size": ["=a", 0.1, 0.1], "finish": {"color": "#ffffff"}}}]),
        json!({"a": "=b", "b": "=a"}),
    );
    check(loops, "depends on itself");
}

/// A family whose physics changed still generates its earlier objects.
#[test]
fn earlier_versions_are_still_generated() {
    let catalogue = Catalogue::builtin();
    let pan = |version| {
        let asset = AssetRef::Generated { family: "pan".into(), params: BTreeMap::new(), seed: Seed::new(8), version };
        let model = catalogue.model(&asset).unwrap();
        let AssetRef::Generated { version, .. } = model.asset else { panic!("not generated") };
        (version, model.links[0].pieces.len(), catalogue.hashes(&asset).unwrap().physics)
    };
    let [first, second, third] = [1, 2, 3].map(pan);
    assert_eq!([first.0, second.0, third.0, pan(7).0], [1, 2, 3, 3]);
    assert_eq!(second.1 - first.1, 4, "24 wedges instead of 20");
    assert!(first.2 != second.2 && second.2 != third.2, "distinct physics");
}

#[test]
fn the_list_is_complete_and_up_to_date() {
    let full = Catalogue::full();
    let (articulated, rigid): (Vec<_>, Vec<_>) = full.cards().iter().partition(|card| card.is_articulated);
    assert_eq!((rigid.len(), articulated.len()), (1000, 120));
    let distinct =
        |of: &dyn Fn(&genmanip_core::ObjectCard) -> String| full.cards().iter().map(of).collect::<BTreeSet<_>>().len();
    assert_eq!(distinct(&|card| card.uid.to_string()), 1120);
    assert!(distinct(&|card| card.description.clone()) >= 1120 * 97 / 100);
    for text in full.cards().iter().map(|card| &card.description) {
        let words: Vec<&str> = text.split(' ').collect();
        let misfit =
            words.windows(2).find(|pair| ["a", "A"].contains(&pair[0]) && pair[1].starts_with(['a', 'e', 'i', 'o']));
        assert_eq!(misfit, None, "{text}");
    }
    for one in generated_instances().iter().step_by(23) {
        let model = full.model(&one.card.asset).unwrap();
        assert_eq!(model.card, one.card, "the list is stale: regenerate it with `genmanip assets freeze`");
        assert!(
            (model.world_bounds(&Pose::IDENTITY, &[]).size() - one.card.size_m).abs().max_element() < 0.02
                || model.joint_count() > 0
        );
    }
    // Families and single objects are held out for testing.
    let with = |split: Split| generated_instances().iter().filter(|one| one.split == split).count();
    assert!(with(Split::UnseenFamily) > 100 && with(Split::UnseenInstance) > 100 && with(Split::Train) > 600);
    let families: BTreeSet<&str> = generated_instances()
        .iter()
        .filter_map(|one| match &one.card.asset {
            AssetRef::Generated { family, .. } => Some(family.as_str()),
            _ => None,
        })
        .collect();
    assert_eq!(families.len(), Families::builtin().all().count());
}

#[test]
fn searches_return_relevant_objects() {
    let index = Catalogue::full().index();
    // Query, and a word that the category path or synonyms of each of the first five results must contain.
    let cases = [
        ("something to drink from", "drinkware|cup|glass|pitcher|kettle|mug"),
        ("something to drink from that is not red", "drinkware|cup|glass|pitcher|mug"),
        ("cup", "cup"),
        ("coffee mug", "mug"),
        ("red mug", "mug"),
        ("wine glass", "wine glass"),
        ("fork", "fork"),
        ("cutlery", "cutlery"),
        ("knife", "knife"),
        ("wooden spoon", "spoon"),
        ("frying pan", "pan"),
        ("fruit", "fruit"),
        ("vegetable", "vegetables|vegetable"),
        ("citrus", "citrus"),
        ("apple", "apple"),
        ("aubergine", "eggplant"),
        ("donut", "doughnut"),
        ("loaf of bread", "bread"),
        ("cheese", "cheese"),
        ("egg", "egg"),
        ("soft drink", "soda can|drink"),
        ("tin of soup", "food tin|tin"),
        ("jam", "jar"),
        ("tea", "tea"),
        ("milk", "milk"),
        ("breakfast cereal", "cereal"),
        ("something to write with", "writing|pen|pencil|marker"),
        ("ballpoint", "pen"),
        ("book", "books"),
        ("rubber", "eraser|rubber|ball"),
        ("sticky tape", "tape"),
        ("dice", "die"),
        ("lego", "toy brick"),
        ("flashlight", "torch"),
        ("spanner", "wrench"),
        ("hammer", "hammer"),
        ("soap", "soap"),
        ("toothbrush", "toothbrush"),
        ("trash can", "bin"),
        ("notebook computer", "laptop"),
        ("chest of drawers", "drawer cabinet"),
        ("tap", "faucet"),
        ("container:yes articulated:no material:glass", "glass|tumbler|measuring"),
    ];
    let mut flaws = Vec::new();
    for (query, expected) in cases {
        let found = index.search(query, &Filter::default(), 5);
        let fits = |card: &genmanip_core::ObjectCard| {
            let metadata = asset_metadata(card);
            let known = metadata.category_path.iter().chain(&metadata.synonyms).chain([&card.category]);
            let known: Vec<&String> = known.collect();
            expected.split('|').any(|word| known.iter().any(|text| text.contains(word)))
        };
        let wrong: Vec<&str> = found.iter().filter(|one| !fits(one.card)).map(|one| one.card.name.as_str()).collect();
        if found.is_empty() || !wrong.is_empty() {
            flaws.push(format!("{query}: {} found, not {expected}: {wrong:?}", found.len()));
        }
    }
    assert!(cases.len() >= 40 && flaws.is_empty(), "{}", flaws.join("\n"));
}

#[test]
fn searches_exclude_and_filter() {
    let index = Catalogue::full().index();
    let all = |query: &str| index.search(query, &Filter::default(), usize::MAX);
    assert!(all("mug not red").iter().all(|one| !one.card.colors.iter().any(|color| color == "red")));
    assert!(all("mug -blue").len() < all("mug").len());
    assert!(
        all("color:red container:yes")
            .iter()
            .all(|one| one.card.is_container && one.card.colors.contains(&"red".into()))
    );
    assert!(all("articulated:yes").iter().all(|one| one.card.is_articulated) && all("articulated:yes").len() == 120);
    assert!(all("max-size:0.1 graspable:yes").iter().all(|one| one.card.size_m.max_element() <= 0.1));
    assert!(all("split:unseen_family").iter().all(|one| Catalogue::full().split(&one.card.uid) == Split::UnseenFamily));
    assert_eq!(all("").len(), 1120);
    assert!(all("xylophone").is_empty());
}
