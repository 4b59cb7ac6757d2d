//! A policy trained on the demonstrations of a run.

use std::path::Path;
use std::sync::atomic::AtomicBool;

#[cfg(feature = "learn")]
use genmanip_pipeline::evaluate::EndingRules;
use genmanip_pipeline::learn::{CheckOptions, Head, Length, Preset, TrainOptions, check, controls, train};
#[cfg(feature = "learn")]
use genmanip_pipeline::learn::{SuiteDemonstrations, demonstrate};
#[cfg(feature = "learn")]
use genmanip_pipeline::offered::offered;

use super::*;

fn options(run: &Path, out: &str, steps: u64) -> TrainOptions {
    let out = run.with_file_name(out);
    TrainOptions {
        sources: Vec::new(),
        run: run.into(),
        preset: Preset::State,
        head: Head::L1,
        length: Length::Steps(steps),
        seed: Seed::new(1),
        labels: true,
        out,
        threads: 1,
    }
}

#[cfg(not(feature = "learn"))]
#[test]
fn without_the_feature_the_refusal_names_the_command_that_installs_it() {
    let (never, run) = (AtomicBool::new(false), Path::new("run"));
    let trained = train(&options(run, "policy", 1), &NoProgress, &never).unwrap_err();
    let asked = CheckOptions { run: run.into(), preset: Preset::State, demonstrations: 1, workers: 1 };
    let checked = check(&asked, &NoProgress, &never).unwrap_err();
    let evaluated = PolicyFactory::resolve("learned:policy").unwrap_err();
    let controlled = controls(Path::new("policy"), run, 1, &NoProgress, &never).unwrap_err();
    for refused in [trained, checked, evaluated, controlled] {
        assert!(refused.hint().unwrap().contains("cargo xtask install --learn"), "{refused}");
    }
}

/// Steps after which one episode is known by heart.
#[cfg(feature = "learn")]
const STEPS: u64 = 500;

/// Demonstrations of a suite are collected once; a network without training has its controls, of which the nearest
/// demonstration solves the layout that it was recorded on.
#[cfg(feature = "learn")]
#[test]
fn controls_of_a_learned_policy() {
    let folder = tempfile::tempdir().unwrap();
    let (run, never) = (folder.path().join("run"), AtomicBool::new(false));
    let suite = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../suites/genmanip-learn-10");
    let distribution = Some("switch".to_owned());
    let asked = SuiteDemonstrations { suite, distribution, count: 1, run: run.clone(), workers: 1 };
    assert!(demonstrate(&asked, &NoProgress, &never).unwrap());
    let suite = Suite::of_run(&run).unwrap();
    assert!(demonstrate(&asked, &NoProgress, &never).unwrap());
    assert_eq!((suite.cases.len(), Suite::of_run(&run).unwrap().cases.len()), (1, 1), "none is missing");

    let trained = train(&options(&run, "policy", 1), &NoProgress, &never).unwrap().unwrap();
    let refused = offered(&format!("learned:{}", trained.policy.display())).err().unwrap().to_string();
    assert!(refused.contains("reads simulator ground truth"), "{refused}");
    let state = controls(&trained.policy, &run, 1, &NoProgress, &never).unwrap().unwrap();
    let names: Vec<&str> = state.iter().map(PolicyFactory::name).collect();
    assert_eq!(names, ["learned", "execute_1", "execute_2", "execute_4", "execute_16", "nearest_replay"]);
    let alone = EvaluateOptions { workers: 1, ..EvaluateOptions::default() };
    let reports = evaluate(&suite, &state[5..], &alone, &NoProgress, &never).unwrap();
    assert!(reports[0].results[0].success, "the nearest demonstration is its own: {:?}", reports[0].results[0]);
}

/// A policy with other images moves otherwise, though it has hardly learned anything.
#[cfg(feature = "learn")]
#[test]
fn learned_policies_with_other_images() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, never) = (folder.path().join("run"), AtomicBool::new(false));
    assert!(collected(&folder, &run(1), &NoProgress, &never).is_met());
    let suite = Suite::of_run(&folder).unwrap();
    let ending = EndingRules { horizon_s: Some(2.0), ..EndingRules::default() };
    let short = EvaluateOptions { workers: 1, ending, ..EvaluateOptions::default() };
    let paths_m = |seed: u64| -> Vec<f64> {
        let tiny = options(&folder, &format!("tiny-{seed}"), 1);
        let tiny = TrainOptions { preset: Preset::Tiny, seed: Seed::new(seed), ..tiny };
        let trained = train(&tiny, &NoProgress, &never).unwrap().unwrap();
        let mut all = controls(&trained.policy, &folder, 1, &NoProgress, &never).unwrap().unwrap();
        all.retain(|policy| ["learned", "no_images", "other_images"].contains(&policy.name()));
        let reports = evaluate(&suite, &all, &short, &NoProgress, &never).unwrap();
        reports.iter().map(|report| report.results[0].tcp_path_m).collect()
    };
    let act = TrainOptions { preset: Preset::Act, ..options(&folder, "act", 1) };
    let act = train(&act, &NoProgress, &never).unwrap().unwrap();
    assert!(!act.privileged && !act.labels, "ACT learns without the simulator: {act:?}");
    // Half of all initial networks say at once that they have finished.
    let moving = (0..8).map(paths_m).find(|paths_m| paths_m.iter().all(|path_m| *path_m > 0.01));
    let Some(&[own, none, other]) = moving.as_deref() else { panic!("no policy moves with all images: {moving:?}") };
    assert!(own != none && own != other && none != other, "{moving:?}");
}

/// Recorded rows solve their layouts as a learned policy's output; one episode is learned by heart, and solved in closed
/// loop by the policy that was stopped and continued.
#[cfg(feature = "learn")]
#[test]
fn one_episode_is_learned_by_heart() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, never) = (folder.path().join("run"), AtomicBool::new(false));
    let collected = collected(&folder, &run(1), &NoProgress, &never);
    assert!(collected.is_met(), "{collected:?}");

    let asked = CheckOptions { run: folder.clone(), preset: Preset::State, demonstrations: 9, workers: 1 };
    let checked = check(&asked, &NoProgress, &never).unwrap().unwrap();
    assert_eq!((checked.demonstrations, checked.replay_success.successes), (1, 1));

    // Stopped after 20 of 40 steps, and once by heart; reading counts one unit.
    let short = train(&options(&folder, "short", 40), &NoProgress, &never).unwrap().unwrap();
    let stop = AtomicBool::new(false);
    let halves = options(&folder, "halves", 40);
    assert_eq!(train(&halves, &Listener::new(21, &stop), &stop).unwrap(), None);
    let other = TrainOptions { seed: Seed::new(2), ..halves.clone() };
    let refused = train(&other, &NoProgress, &never).unwrap_err().to_string();
    assert!(refused.contains("holds another training: seed is 1 there, 2 here"), "{refused}");
    let continued = train(&halves, &NoProgress, &never).unwrap().unwrap();
    assert_eq!((continued.resumed_from, &continued.tensors_sha256), (Some(20), &short.tensors_sha256));
    // A finished training is not repeated.
    let again = train(&halves, &NoProgress, &never).unwrap().unwrap();
    assert_eq!((again.resumed_from, again.tensors_sha256), (Some(40), short.tensors_sha256));
    let read = |name: &str| std::fs::read(folder.with_file_name(name)).unwrap();
    assert_eq!(read("short/weights.safetensors"), read("halves/weights.safetensors"));
    assert_eq!(read("short/policy.json"), read("halves/policy.json"));

    // The samples of a flow differ from row to row, but not from run to run.
    let flow = TrainOptions { head: Head::Flow, ..options(&folder, "flow", 2) };
    let flow = train(&flow, &NoProgress, &never).unwrap().unwrap();
    let suite = Suite::of_run(&folder).unwrap();
    let alone = EvaluateOptions { workers: 1, ..EvaluateOptions::default() };
    let ending = EndingRules { horizon_s: Some(2.0), ..EndingRules::default() };
    let limited = EvaluateOptions { ending, ..alone.clone() };
    let sampled = PolicyFactory::resolve(&format!("learned:{}", flow.policy.display())).unwrap();
    let sampled =
        [(); 2].map(|()| evaluate(&suite, std::slice::from_ref(&sampled), &limited, &NoProgress, &never).unwrap());
    assert_eq!(sampled[0][0].results, sampled[1][0].results);

    let trained = train(&options(&folder, "policy", STEPS), &NoProgress, &never).unwrap().unwrap();
    assert!(trained.final_l1 < 0.1, "{trained:?}");
    let page = std::fs::read_to_string(trained.policy.join("training.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 4 + 2, "four curves, and both charts of a moment of the only episode");
    let learned = PolicyFactory::resolve(&format!("learned:{}", trained.policy.display())).unwrap();
    assert!(learned.label().starts_with("learned_folder=policy-"), "{}", learned.label());
    let reports = evaluate(&suite, &[learned], &alone, &NoProgress, &never).unwrap();
    let result = &reports[0].results[0];
    assert!(result.success && result.oracle, "{result:?}");

    // Other settings of execution are other rows of results, and solve the layout too.
    let named = |more: &str| PolicyFactory::resolve(&format!("learned:{}{more}", trained.policy.display()));
    let ensembled = named(",ensemble=0.01").unwrap();
    assert!(ensembled.label().ends_with("_ensemble=0.01"), "{}", ensembled.label());
    assert!(evaluate(&suite, &[ensembled], &alone, &NoProgress, &never).unwrap()[0].results[0].success);
    assert!(named(",execute=4").unwrap().label().ends_with("_execute=4"));
    let refused = named(",execute=17").unwrap_err();
    assert!(refused.hint().unwrap().contains("expected 1 to 16"), "{refused}");

    // Other weights than those of the description are refused, and so are damaged ones.
    let weights = trained.policy.join("weights.safetensors");
    let refused = || {
        let error = PolicyFactory::resolve(&format!("learned:{}", trained.policy.display())).unwrap_err();
        std::iter::successors(Some(&error as &dyn std::error::Error), |error| error.source())
            .map(|error| format!("{error}; "))
            .collect::<String>()
    };
    std::fs::copy(short.policy.join("weights.safetensors"), &weights).unwrap();
    assert!(refused().contains("the tensors have hash"), "{}", refused());
    std::fs::write(&weights, b"no weights").unwrap();
    assert!(refused().contains("not a safetensors file"), "{}", refused());
}
