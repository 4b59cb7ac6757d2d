//! The expert takes over from a policy that failed.

use genmanip_core::{EpisodeResult, FailureCause, Policy, Seed};
use genmanip_rollout::baselines::Clumsy;
use genmanip_rollout::policies::DoNothing;
use genmanip_rollout::{RolloutSettings, Stage, replay, run_corrected, run_episode};

use crate::{episodes, expert};

fn clumsy(stage: &Stage) -> Clumsy {
    Clumsy::new(stage, expert(stage))
}

/// The first policy acts as if alone, the expert continues from its final state, and the recording is one simulation.
#[test]
fn the_expert_continues_where_the_first_policy_ended() {
    let settings = RolloutSettings::default();
    let (mut corrected, mut causes) = (0, Vec::new());
    for (stage, _) in episodes() {
        for number in 0..2 {
            let seed = Seed::new(40).fork_index(number);
            let alone = run_episode(stage, &mut clumsy(stage), "a", seed, &settings).unwrap();
            let run = || run_corrected(stage, &mut clumsy(stage), &mut expert(stage), "a", seed, &settings).unwrap();
            let episode = run();
            assert_eq!(episode, run(), "deterministic");
            let Some(correction) = &episode.result.correction else {
                assert!(alone.result.success && episode.result.success, "only failures are corrected");
                assert_eq!(episode.result.policy, "clumsy");
                continue;
            };
            // As in any evaluation, the last command is held for the settling time.
            assert_eq!(correction.from_step, alone.frames.len());
            assert_eq!(episode.frames[..correction.from_step], alone.frames);
            assert_eq!(correction.failures, alone.result.failures);
            assert_eq!((correction.policy.as_str(), episode.result.policy.as_str()), ("clumsy", "expert"));
            assert!(!alone.result.success && episode.result.oracle);
            assert!(replay::check(stage, &episode).unwrap().identical, "{}", stage.scenario.id);
            corrected += usize::from(episode.result.success);
            causes.extend(correction.failures.first().map(|failure| failure.cause));
        }
    }
    // The mistake in each of the six episodes depends on its seed; some mistakes are harmless.
    assert!(causes.len() >= 4 && corrected >= 3, "{corrected} of {}: {causes:?}", causes.len());
}

#[test]
fn successes_are_not_corrected_and_idle_policies_are_replaced() {
    let (stage, recorded) = &episodes()[1];
    let (settings, seed) = (RolloutSettings::default(), recorded.result.seed);
    let run = |first: &mut dyn Policy| -> EpisodeResult {
        run_corrected(stage, first, &mut expert(stage), "a", seed, &settings).unwrap().result
    };
    let skilled = run(&mut expert(stage));
    assert!(skilled.success && skilled.correction.is_none(), "{skilled:?}");
    let idle = run(&mut DoNothing { duration_s: 0.5 });
    let correction = idle.correction.as_ref().unwrap();
    assert!(idle.success, "{idle:?}");
    assert_eq!((correction.policy.as_str(), correction.from_step), ("do_nothing", 30 + 60));
    assert_eq!(correction.failures[0].cause, FailureCause::GoalMissed);
    // The first policy has half of the time limit, even if it would continue.
    let late = run(&mut DoNothing { duration_s: 100.0 });
    let correction = late.correction.unwrap();
    assert_eq!((correction.from_step, correction.failures[0].cause), (60 * 60 + 60, FailureCause::Timeout));
}
