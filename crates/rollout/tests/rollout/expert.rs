//! The expert on tasks that cannot be solved: it gives up with a cause and evidence, in bounded time.

use genmanip_core::{Atom, Failure, FailureCause, Relation, Scenario, Seed};
use genmanip_rollout::{RolloutSettings, run_episode};

use crate::{expert, scenario, stage, task};

fn relation(subject: &str, relation: Relation, reference: &str) -> Atom {
    Atom::Relation { subject: subject.into(), relation, reference: reference.into(), second_reference: None }
}

/// How the expert fails when the goal of a good scenario is replaced.
fn failure(scenario: &Scenario, goal: Vec<Atom>) -> Failure {
    let mut scenario = scenario.clone();
    scenario.task.goal.alternatives = vec![goal];
    let stage = stage(scenario);
    let episode =
        run_episode(&stage, &mut expert(&stage), "hopeless", Seed::new(5), &RolloutSettings::default()).unwrap();
    assert!(!episode.result.success);
    episode.result.failure.unwrap()
}

/// Task 021 has cubes 046, 048, 049, a mug 001 and a pencil case 043.
#[test]
fn it_gives_up_with_a_typed_cause() {
    let scenario = scenario(&task("021_spatial"));
    let state = Atom::State { object: "046".into(), state: "open".into() };
    let cases = [
        ("too large for the mug", vec![relation("043", Relation::In, "001")], FailureCause::NoGoalPose, "Pencil Case"),
        (
            "left and right at once",
            vec![relation("046", Relation::Left, "001"), relation("046", Relation::Right, "001")],
            FailureCause::NoGoalPose,
            "Red Cube",
        ),
        ("a state to change", vec![state], FailureCause::Policy, "pick and place"),
        ("an object that is not there", vec![relation("064", Relation::Left, "001")], FailureCause::Policy, "pick"),
    ];
    for (name, goal, cause, evidence) in cases {
        let failure = failure(&scenario, goal);
        assert_eq!(failure.cause, cause, "{name}: {failure}");
        assert!(failure.evidence.contains(evidence), "{name}: {failure}");
    }
}

/// Same stage, same seed: the same episode to the last bit; another seed moves otherwise.
#[test]
fn an_episode_is_a_function_of_its_seed() {
    let (stage, known) = &crate::episodes()[1];
    let run =
        |seed| run_episode(stage, &mut expert(stage), "024_appearance", seed, &RolloutSettings::default()).unwrap();
    assert!(run(Seed::new(11).fork("024_appearance")) == *known);
    assert!(run(Seed::new(12)).final_state != known.final_state);
}
