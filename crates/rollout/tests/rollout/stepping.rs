//! The environment stepped directly: equal to the loop, saved and restored, judged without side effects.

use genmanip_core::{Ending, Episode, Seed};
use genmanip_rollout::environment::{Conclusion, EventKind};
use genmanip_rollout::{Environment, RolloutError, RolloutSettings};

use crate::{any_stage, episodes};

const NOBODY: Conclusion =
    Conclusion { id: "024_appearance", policy: "expert", oracle: true, ending: Ending::Finished, gave_up: None };

fn environment(settings: RolloutSettings) -> Environment {
    let mut environment = Environment::new(settings);
    environment.reset(any_stage(), episodes()[1].1.result.seed);
    environment
}

/// Commands of the policy, without those of settling.
fn commands(episode: &Episode) -> Vec<Vec<f32>> {
    let acted = episode.frames.len() - 60;
    episode.frames[..acted].iter().map(|frame| frame.command.clone()).collect()
}

/// Steps through the recorded commands; `between` must have no effect.
fn stepped(between: impl Fn(usize, &mut Environment)) -> Episode {
    let mut environment = environment(RolloutSettings::default());
    for (number, command) in commands(&episodes()[1].1).iter().enumerate() {
        between(number, &mut environment);
        let step = environment.step(command).unwrap();
        assert_eq!(step.verdict.is_some(), (number + 1).is_multiple_of(12), "step {number}");
        assert!(!step.terminated && !step.truncated);
    }
    environment.finish(NOBODY).unwrap()
}

#[test]
fn stepping_equals_the_loop() {
    let stepped = stepped(|number, environment| {
        if number.is_multiple_of(50) {
            environment.verdict().unwrap();
            environment.truth().unwrap();
            environment.observe(&[]).unwrap();
        }
    });
    assert_eq!(stepped, episodes()[1].1, "the same bytes as the expert's episode, observed or not");
}

/// Saved at any time, even during a grip, and restored in a new environment or one that has continued.
#[test]
fn a_restored_environment_continues_to_the_same_bytes() {
    let known = &episodes()[1].1;
    let all = commands(known);
    let held = known.frames.iter().position(|frame| frame.grasped.is_some()).unwrap() + 30;
    for at in [0, 1, 37, held, all.len()] {
        let mut first = environment(RolloutSettings::default());
        all[..at].iter().for_each(|command| drop(first.step(command).unwrap()));
        let (saved, mark) = (first.save().unwrap(), first.mark().unwrap());
        assert_eq!(mark.step(), at);
        let other = || all[at..].iter().rev().take(40);
        // Everything after saving is discarded.
        other().for_each(|command| drop(first.step(command).unwrap()));
        first.rewind(&mark).unwrap();
        all[at..].iter().for_each(|command| drop(first.step(command).unwrap()));
        assert_eq!(&first.finish(NOBODY).unwrap(), known, "rewound to {at} steps");
        first.restore(&saved).unwrap();
        other().for_each(|command| drop(first.step(command).unwrap()));
        let mut fresh = Environment::new(RolloutSettings::default());
        for environment in [&mut first, &mut fresh] {
            environment.restore(&saved).unwrap();
            all[at..].iter().for_each(|command| drop(environment.step(command).unwrap()));
            let events = environment.events().to_vec();
            assert!(events.iter().any(|event| matches!(event.kind, EventKind::Grasped(_))), "{events:?}");
            assert_eq!(&environment.finish(NOBODY).unwrap(), known, "saved after {at} steps");
        }
    }
}

/// The terminal observation is available, the verdict is final, and no further step is possible.
#[test]
fn settling_gives_the_terminal_observation() {
    let mut environment = environment(RolloutSettings::default());
    commands(&episodes()[1].1).iter().for_each(|command| drop(environment.step(command).unwrap()));
    let last = environment.settle().unwrap();
    let known = &episodes()[1].1;
    assert_eq!(last.verdict.as_ref(), Some(&known.result.verdict));
    assert!(last.terminated && !last.truncated);
    assert_eq!(last.observation.time_s, known.result.duration_s);
    let again = environment.settle().unwrap();
    assert_eq!((again.observation.state, again.verdict), (last.observation.state, last.verdict), "settled once");
    let command = known.frames[0].command.clone();
    assert!(matches!(environment.step(&command), Err(RolloutError::EpisodeOver { .. })));
    environment.finish(NOBODY).unwrap();
    assert!(matches!(environment.step(&command), Err(RolloutError::NotReset)));
}

#[test]
fn invalid_steps_are_rejected_and_change_nothing() {
    let mut environment = Environment::new(RolloutSettings { horizon_s: 0.05, ..RolloutSettings::default() });
    assert!(matches!(environment.step(&[]), Err(RolloutError::NotReset)));
    assert!(matches!(environment.observe(&[]), Err(RolloutError::NotReset)));
    assert!(matches!(environment.save(), Err(RolloutError::NotReset)));
    environment.reset(any_stage(), Seed::new(1));
    let command = episodes()[1].1.frames[0].command.clone();
    assert!(matches!(environment.step(&command[1..]), Err(RolloutError::Sim(_))));
    assert_eq!((environment.frames().len(), environment.steps_left()), (0, 3));
    for left in [2, 1, 0] {
        let step = environment.step(&command).unwrap();
        assert_eq!((step.truncated, environment.steps_left()), (left == 0, left));
    }
    assert!(matches!(environment.step(&command), Err(RolloutError::EpisodeOver { frames: 3 })));
}

/// With `stop_on_success`, the episode ends once the goal has held for the settling time.
#[test]
fn stopping_on_success_waits_until_the_goal_has_held() {
    let known = &episodes()[1].1;
    let mut all = commands(known);
    let last = all.last().unwrap().clone();
    all.extend(std::iter::repeat_n(last, 120));
    let settings = RolloutSettings { stop_on_success: true, ..RolloutSettings::default() };
    let mut environment = environment(settings);
    let ended = all.iter().position(|command| environment.step(command).unwrap().terminated).unwrap();
    let reached = environment.events().iter().rfind(|event| event.kind == EventKind::GoalReached).unwrap().time_s;
    assert_eq!(ended + 1, (reached * 60.0).round() as usize + 60, "a second after it was reached");
    let result = environment.finish(Conclusion { ending: Ending::Success, ..NOBODY }).unwrap().result;
    assert!(result.success && result.failures.is_empty() && result.ending == Some(Ending::Success));
}
