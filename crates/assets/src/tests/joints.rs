//! Articulated objects: states, range of motion, handles.

use genmanip_core::{Joint, ObjectModel};

use super::gap;
use crate::{AssetError, Catalogue, handle_bounds};

/// Runs a check on every articulated object and reports all failures.
fn check_articulated(check: impl Fn(&ObjectModel) -> Vec<String>) {
    let catalogue = Catalogue::builtin();
    let mut flaws = Vec::new();
    let articulated: Vec<_> = catalogue.cards().iter().filter(|card| card.is_articulated).collect();
    assert_eq!(articulated.len(), 8);
    for card in articulated {
        let model = catalogue.build(&card.uid).unwrap();
        flaws.extend(check(&model).into_iter().map(|flaw| format!("{} {}: {flaw}", card.uid, card.name)));
    }
    assert!(flaws.is_empty(), "{} flaws:\n{}", flaws.len(), flaws.join("\n"));
}

fn joints(model: &ObjectModel) -> Vec<&Joint> {
    model.links.iter().filter_map(|link| link.joint.as_ref()).collect()
}

#[test]
fn states_are_those_of_the_card_and_exclude_each_other() {
    check_articulated(|model| {
        let joints = joints(model);
        let mut flaws = Vec::new();
        let names: Vec<&str> = model.joint_states.iter().map(|state| state.name.as_str()).collect();
        if names != model.card.states {
            flaws.push(format!("states {names:?}"));
        }
        for state in &model.joint_states {
            for ((joint, (name, [low, high])), &nominal) in joints.iter().zip(&state.intervals).zip(&state.nominal) {
                let [least, most] = joint.range;
                let nominal_fits = (*low..=*high).contains(&nominal) && (least..=most).contains(&nominal);
                if *name != joint.name || !nominal_fits {
                    flaws.push(format!("{}: {name} at {nominal} of {low}..{high}, range {least}..{most}", state.name));
                }
            }
        }
        for (index, one) in model.joint_states.iter().enumerate() {
            for other in &model.joint_states[..index] {
                let mut pairs = one.intervals.iter().zip(&other.intervals);
                if pairs.all(|((_, a), (_, b))| a[0] <= b[1] && b[0] <= a[1]) {
                    flaws.push(format!("{} and {} overlap", one.name, other.name));
                }
            }
        }
        flaws
    });
}

#[test]
fn links_move_freely_over_the_whole_range() {
    const STEPS: usize = 12;
    check_articulated(|model| {
        let joints = joints(model);
        let mut worst = (0.0, String::new());
        // Sweep each joint over its range, with all others at one end, then at the other.
        for moving in 0..joints.len() {
            for (end, step) in (0..2).flat_map(|end| (0..=STEPS).map(move |step| (end, step))) {
                let place = |index: usize, joint: &&Joint| {
                    let [low, high] = joint.range;
                    if index == moving { low + (high - low) * step as f64 / STEPS as f64 } else { joint.range[end] }
                };
                let positions: Vec<f64> = joints.iter().enumerate().map(|(index, joint)| place(index, joint)).collect();
                let poses = model.link_poses(&positions);
                for b in 0..model.links.len() {
                    for a in 0..b {
                        let depth = -gap(&model.links[a].pieces, &poses[a], &model.links[b].pieces, &poses[b]);
                        if depth > worst.0 {
                            let names = (&model.links[a].name, &model.links[b].name);
                            worst = (depth, format!("{names:?} overlap by {:.2} mm at {positions:?}", depth * 1e3));
                        }
                    }
                }
            }
        }
        if worst.0 > 5e-4 { vec![worst.1] } else { Vec::new() }
    });
}

#[test]
fn every_moving_link_has_a_graspable_handle() {
    check_articulated(|model| {
        let moving = model.links.iter().filter(|link| link.joint.is_some());
        let thin = |size: glam::DVec3| size.min_element() < 0.075;
        moving
            .filter(|link| !handle_bounds(link).is_some_and(|bounds| thin(bounds.size())))
            .map(|link| format!("{} has no graspable handle", link.name))
            .collect()
    });
    assert!(handle_bounds(&Catalogue::builtin().build("048").unwrap().links[0]).is_none());
}

#[test]
fn invalid_links_are_rejected() {
    let good = include_str!("../../data/catalog.json");
    for (from, to, place) in [
        (
            "\"name\": \"top_open\", \"joints\": [[0.06, 0.085",
            "\"name\": \"top_open\", \"joints\": [[0.09, 0.085",
            "top_open",
        ),
        ("\"name\": \"top_open\"", "\"name\": \"ajar\"", "057: states"),
        (
            "\"name\": \"top_drawer\", \"mass_kg\": 0.45",
            "\"name\": \"top_drawer\", \"mass_kg\": 3",
            "below the card's 2.6 kg",
        ),
        ("\"kind\": \"prismatic\"", "\"kind\": \"magic\"", "kind"),
    ] {
        assert!(good.contains(from), "{from}");
        let error = Catalogue::from_json(&good.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(error, AssetError::Data { .. }) && error.to_string().contains(place), "{error} names {place}");
    }
}
