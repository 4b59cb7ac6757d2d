//! The expert takes over from a policy that failed.

use genmanip_core::{EpisodeResult, FailureCause, Policy, Seed};
use genmanip_rollout::controls::Clumsy;
use genmanip_rollout::policies::DoNothing;
use genmanip_rollout::{RolloutSettings, Stage, replay, run_corrected, run_episode};

use crate::{episodes, expert};

fn clumsy(stage: &Stage) -> Clumsy {
    Clumsy::new(stage, expert(stage))
}

/// Whoever acts first does so as in an episode of its own; what follows is the expert's, and the whole is one simulation.
#[test]
fn what_the_first_policy_did_stays_and_the_expert_goes_on_from_there() {
    let settings = RolloutSettings::default();
    let (mut corrected, mut causes) = (0, Vec::new());
    for (stage, _) in episodes() {
        for number in 0..2 {
            let seed = Seed::new(40).fork_index(number);
            let alone = run_episode(stage, &mut clumsy(stage), "a", seed, &settings).unwrap();
            let run = || run_corrected(stage, &mut clumsy(stage), &mut expert(stage), "a", seed, &settings).unwrap();
            let episode = run();
            assert_eq!(episode, run(), "the same again");
            let Some(correction) = &episode.result.correction else {
                assert!(alone.result.success && episode.result.success, "only what fails is corrected");
                assert_eq!(episode.result.policy, "clumsy");
                continue;
            };
            // As in any evaluation the last command is held for the settling time.
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
    // What each of the six does wrong follows from its seed; a mistake that does no harm is no defect.
    assert!(causes.len() >= 4 && corrected >= 3, "{corrected} of {}: {causes:?}", causes.len());
}

#[test]
fn nothing_is_corrected_where_the_goal_holds_and_all_of_it_where_nobody_moved() {
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
    // Half of the time is the first policy's, however long it would go on.
    let late = run(&mut DoNothing { duration_s: 100.0 });
    let correction = late.correction.unwrap();
    assert_eq!((correction.from_step, correction.failures[0].cause), (60 * 60 + 60, FailureCause::Timeout));
}
