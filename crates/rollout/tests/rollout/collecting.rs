//! Collection: any number of workers, interruptions, infeasible layouts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use genmanip_assets::GraspLibrary;
use genmanip_assets::worlds::default_world;
use genmanip_core::{EpisodeResult, FailureCause, PlacedObject, Policy, Scenario, Seed, Task};
use genmanip_data::EpisodeStore;
use genmanip_layout::LayoutSettings;
use genmanip_rollout::collect::{Attempt, PipelineSettings, complete, in_parallel};
use genmanip_rollout::evaluate::{Case, evaluate};
use genmanip_rollout::expert::Expert;
use genmanip_rollout::images::ImageSettings;
use genmanip_rollout::policies::{DoNothing, OpenLoop};
use genmanip_rollout::{Cores, RolloutError, Stage};

use crate::{TASKS, planner, resources, task};

fn tasks() -> Vec<Task> {
    TASKS[1..].iter().map(|id| task(id)).collect()
}

fn with_images() -> PipelineSettings {
    let images = ImageSettings { cameras: vec!["wrist".into()], fps: 10, ..ImageSettings::default() };
    PipelineSettings { images: Some(images), ..PipelineSettings::in_world((*default_world()).clone()) }
}

/// Runs all attempts with several workers; `on_result` receives each result and whether it was already stored.
fn collect(
    attempts: &[Attempt],
    store: &EpisodeStore,
    settings: &PipelineSettings,
    workers: usize,
    stop: &AtomicBool,
    on_result: &(dyn Fn(&EpisodeResult, bool) + Sync),
) -> Vec<EpisodeResult> {
    store.sweep_partial().unwrap();
    let work = |attempt: &Attempt| -> Result<EpisodeResult, RolloutError> {
        let (result, was_there) = complete(attempt, resources(), store, settings)?;
        on_result(&result, was_there);
        Ok(result)
    };
    in_parallel(attempts, workers, stop, &work).unwrap()
}

fn collect_all(
    root: &Path,
    settings: &PipelineSettings,
    workers: usize,
    stop: &AtomicBool,
    on_result: &(dyn Fn(&EpisodeResult, bool) + Sync),
) -> Vec<EpisodeResult> {
    let tasks = tasks();
    let attempts = Attempt::all(&tasks, 1, Seed::new(21));
    collect(&attempts, &EpisodeStore::create(root).unwrap(), settings, workers, stop, on_result)
}

/// Contents of all files below a folder.
fn tree(root: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(root).unwrap().display().to_string(), fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// Mass and friction differ between attempts, by seed; the layouts are the same as without randomisation.
#[test]
fn physics_are_randomised_per_attempt() {
    let folder = tempfile::tempdir().unwrap();
    let usual = PipelineSettings::in_world((*default_world()).clone());
    let varied = PipelineSettings { vary_physics: true, ..usual.clone() };
    assert!(varied.is_varied() && !usual.is_varied());
    let scenarios = |name: &str, settings: &PipelineSettings| -> Vec<Scenario> {
        let root = folder.path().join(name);
        let made = collect_all(&root, settings, 2, &AtomicBool::new(false), &|_, _| {});
        let store = EpisodeStore::open(&root).unwrap();
        let ids: BTreeSet<String> = made.into_iter().map(|result| result.id).collect();
        ids.iter().map(|id| store.read_scenario(id).unwrap().unwrap()).collect()
    };
    let (once, again, usual) = (scenarios("once", &varied), scenarios("again", &varied), scenarios("usual", &usual));
    assert_eq!(once, again);
    let mut pads = BTreeSet::new();
    for (varied, usual) in once.iter().zip(&usual) {
        pads.insert(varied.world.physics.pad_friction.to_bits());
        for (varied, usual) in varied.objects.iter().zip(&usual.objects) {
            assert!(usual.physics.is_unchanged() && !varied.physics.is_unchanged(), "{}", varied.id);
            assert!((1.0 / 1.5..=1.5).contains(&varied.physics.mass) && varied.physics.contact_damping >= 0.5);
            assert_eq!(PlacedObject { physics: usual.physics, ..varied.clone() }, *usual);
        }
    }
    assert_eq!(pads.len(), once.len(), "each attempt has its own pad friction");
}

/// One worker, interrupted after the first attempt and resumed, gives the same bytes as two workers, images included.
#[test]
fn one_worker_and_two_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let (never, stop) = (AtomicBool::new(false), AtomicBool::new(false));

    let first = collect_all(&one, &with_images(), 1, &stop, &|_, _| stop.store(true, Ordering::Relaxed));
    assert_eq!(first.len(), 1, "the current attempt is finished, no other is started");
    let known = Mutex::new(Vec::new());
    let on_result =
        |result: &EpisodeResult, was_there: bool| known.lock().unwrap().push((result.id.clone(), was_there));
    let continued = collect_all(&one, &with_images(), 1, &never, &on_result);
    let known = known.into_inner().unwrap();
    assert_eq!(known, [(first[0].id.clone(), true), (continued[1].id.clone(), false)], "finished attempts are skipped");

    let straight = collect_all(&two, &with_images(), 2, &never, &|_, _| {});
    assert_eq!(continued, straight, "results in the order of the attempts");
    assert!(straight.iter().all(|result| result.success), "{straight:?}");
    let (one, two) = (tree(&one), tree(&two));
    let differing: Vec<_> = one.keys().chain(two.keys()).filter(|name| one.get(*name) != two.get(*name)).collect();
    assert!(differing.is_empty(), "{differing:?}");
    assert_eq!(one.keys().filter(|name| name.contains("images_10hz/wrist")).count() % 2, 0);
    assert!(one.keys().any(|name| name.contains("images_10hz/wrist")), "{:?}", one.keys());
}

/// An infeasible layout is a counted attempt; an unreachable policy leaves no result.
#[test]
fn infeasible_layouts_are_counted_and_unreachable_policies_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let store = EpisodeStore::create(folder.path().join("store")).unwrap();
    let tasks = tasks();
    let attempts = Attempt::all(&tasks, 1, Seed::new(22));
    let never = AtomicBool::new(false);
    let settings = PipelineSettings::in_world((*default_world()).clone());
    let cramped = LayoutSettings { x_m: [0.4, 0.41], y_m: [0.0, 0.01], max_restarts: 3, ..LayoutSettings::default() };
    let hopeless = PipelineSettings { layout: cramped, ..settings.clone() };
    let failed = collect(&attempts[..1], &store, &hopeless, 1, &never, &|_, _| {});
    let [failure] = &failed[0].failures[..] else { panic!("{:?}", failed[0]) };
    assert_eq!((failure.cause, failed[0].ending), (FailureCause::Layout, None));
    assert!(failure.evidence.contains("3 attempts"), "{failure}");

    let all = collect(&attempts, &store, &settings, 2, &never, &|_, _| {});
    assert_eq!(all[0], failed[0], "a counted failure is not retried");
    assert!(all[1].success);
    let recorded = store.read(&all[1].id).unwrap();
    let case = Case {
        id: all[1].id.clone(),
        scenario: Arc::new(recorded.scenario.clone()),
        seed: recorded.result.seed,
        horizon_s: None,
    };
    let shared = (resources(), &settings);
    for (name, solves) in [("expert", true), ("replay", true), ("do_nothing", false)] {
        let make = |stage: &Stage, _: &Case| -> Result<Box<dyn Policy>, RolloutError> {
            Ok(match name {
                "expert" => Box::new(Expert::new(stage, planner(), GraspLibrary::builtin(), settings.expert.clone())?),
                "replay" => Box::new(OpenLoop::replay(&recorded)),
                _ => Box::new(DoNothing { duration_s: 5.0 }),
            })
        };
        let cases = std::slice::from_ref(&case);
        let evaluated =
            evaluate(cases, &make, shared, None, (3, &Cores::new(2)), &never, &|_| Ok::<_, RolloutError>(())).unwrap();
        let [result] = &evaluated.results[..] else { panic!("{evaluated:?}") };
        assert_eq!((result.success, result.policy.as_str()), (solves, name));
        assert_eq!((&result.scenario_id, result.oracle), (&all[1].scenario_id, name == "expert"));
    }
    // An unreachable policy leaves no result and nothing in the store; the other case is run.
    let kept = EpisodeStore::create(folder.path().join("kept")).unwrap();
    let twice = [case.clone(), Case { id: "again".into(), ..case.clone() }];
    let make = |_: &Stage, case: &Case| -> Result<Box<dyn Policy>, RolloutError> {
        match case.id.as_str() {
            "again" => Ok(Box::new(DoNothing { duration_s: 0.1 })),
            _ => Err(RolloutError::NotRun {
                policy: "far away".into(),
                reason: "connection refused".into(),
                mistake: false,
            }),
        }
    };
    let evaluated =
        evaluate(&twice, &make, shared, Some(&kept), (1, &Cores::new(1)), &never, &|_| Ok::<_, RolloutError>(()))
            .unwrap();
    assert_eq!(evaluated.results.len(), 1);
    let [left] = &evaluated.not_run[..] else { panic!("{evaluated:?}") };
    assert_eq!((&left.id, left.reason.as_str()), (&case.id, "connection refused"));
    assert_eq!(kept.ids().unwrap(), ["again"]);
}
