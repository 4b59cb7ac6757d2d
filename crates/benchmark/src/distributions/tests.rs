//! The shipped suite, and documents that somebody changed.

use std::collections::BTreeSet;
use std::path::Path;

use genmanip_assets::worlds::default_world;
use genmanip_core::{AssetUid, Document};
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::Resources;
use genmanip_workspace::worlds;
use serde_json::{Value, json};

use super::check::compare;
use super::{Distributions, DistributionsFile, DrawnTask, Split, SplitChoice, layout_hash};

fn shipped() -> Distributions {
    Distributions::open(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../suites/genmanip-learn-10"))).unwrap()
}

fn drawn(suite: &Distributions, split: Split, distribution: Option<&str>, first: u64) -> Vec<DrawnTask> {
    let distribution = distribution.map(str::to_owned);
    suite.draw(&SplitChoice { split, distribution, first: Some(first) }).unwrap()
}

#[test]
fn all_layouts_of_the_shipped_suite_are_frozen_and_differ() {
    let (frozen, faults) = compare(&shipped());
    assert_eq!((frozen, faults), (18_500, vec![]));
}

#[test]
fn layouts_made_anew_are_as_they_were_frozen() {
    let suite = shipped();
    let world = suite.judged_in(&default_world());
    let planner = worlds::planner(&world, &PlannerSettings::default()).unwrap();
    for split in [Split::Train, Split::Category] {
        for one in drawn(&suite, split, None, 1) {
            let scenario = suite.lay_out(&one.task, Resources::builtin(&planner), &world).unwrap();
            assert_eq!(Some(layout_hash(&scenario)), one.hash, "{}", one.task.id);
        }
    }
}

#[test]
fn a_task_depends_on_distribution_split_and_number_alone() {
    let suite = shipped();
    for split in Split::ALL {
        let all = drawn(&suite, split, None, 8);
        let ids: BTreeSet<&str> = all.iter().map(|one| one.task.id.as_str()).collect();
        assert_eq!(ids.len(), 8 * suite.file.distributions.len(), "{split:?}");
        for distribution in &suite.file.distributions {
            let name = distribution.name.as_str();
            let alone = drawn(&suite, split, Some(name), 5);
            let among: Vec<DrawnTask> = all.iter().filter(|one| one.distribution == name).take(5).cloned().collect();
            assert_eq!(alone, among, "{name} {split:?}");
            let first = distribution.roles[0].objects.of(split);
            assert!(alone.iter().all(|one| first.contains(&one.task.objects[0].uid)), "{name} {split:?}");
        }
    }
    // Another split is another stream, also of the same objects.
    let objects = |split| -> Vec<Vec<AssetUid>> {
        let uids = |one: DrawnTask| one.task.objects.iter().map(|card| card.uid.clone()).collect();
        drawn(&suite, split, Some("into"), 8).into_iter().map(uids).collect()
    };
    assert_ne!(objects(Split::Train), objects(Split::Familiar));
}

#[test]
fn documents_whose_splits_are_not_what_their_names_say_are_refused() {
    let check = |pointer: &str, value: Value, wanted: &str| {
        let mut document = shipped().file.to_value();
        *document.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        let fault = DistributionsFile::from_value(document).unwrap().fault().unwrap_or_default();
        assert!(fault.contains(wanted), "{pointer}: {fault}");
    };
    let objects = |set: &str| format!("/distributions/0/roles/0/objects/{set}");
    check("/layouts/validation", json!(0), "no layout of split `validation`");
    check("/distributions/1/name", json!("into"), "names of their own");
    check("/distributions/0/name", json!("a/b"), "fit for files");
    check("/distributions/0/horizon_s", json!(0.0), "distribution `into`: expected a positive horizon_s");
    check(&objects("train"), json!(["apple-1"]), "1 objects to train on, expected 8");
    check(&format!("{}/0", objects("train")), json!("apple-5"), "`apple-5` does not belong into split `train`");
    check(&format!("{}/0", objects("train")), json!("apple-99"), "`apple-99` is not in the full catalogue");
    check(&objects("instance"), json!(["apple-1"]), "`apple-1` does not belong into split `instance`");
    check(&objects("instance"), json!([]), "an empty set");
    check(&objects("category"), json!(["apple-2"]), "`apple-2` does not belong into split `category`");
    check("/distributions/0/distractors/objects/0", json!("mug"), "`mug` is not in the full catalogue");
    let goals = "/distributions/0/goals";
    check(&format!("{goals}/train"), json!([]), "train: expected goals");
    check(&format!("{goals}/train/0/wordings/0"), json!("Lift the {thing}."), "train: there is no role `thing`");
    check(
        &format!("{goals}/relation"),
        shipped().file.to_value()["distributions"][0]["goals"]["train"].clone(),
        "a goal of train",
    );
    assert_eq!(shipped().file.fault(), None);
}

#[test]
fn choices_beyond_the_suite_are_refused() {
    let suite = shipped();
    let check = |distribution: Option<&str>, first, wanted: &str| {
        let distribution = distribution.map(str::to_owned);
        let choice = SplitChoice { split: Split::Familiar, distribution, first: Some(first) };
        let error = suite.draw(&choice).unwrap_err();
        let said = format!("{error} {}", error.hint().unwrap_or_default());
        assert!(said.contains(wanted), "{said}");
    };
    check(Some("in"), 1, "into");
    check(None, 201, "--first takes 1 to 200");
}
