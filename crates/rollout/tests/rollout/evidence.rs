//! Failure causes derived from recorded episodes.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::{Ending, EpisodeResult, FailureCause, Frame, InstanceId, Seed, Unit};
use genmanip_rollout::evidence::{Evidence, Slip, Unreachable, explain, slips};
use genmanip_rollout::{RolloutSettings, Stage, run_episode};

use crate::{any_stage, episodes, expert, planner, scenario, task};

/// Frames of a real episode in which an object is gripped and carried.
fn carried() -> Vec<Frame> {
    episodes()[1].1.frames.clone()
}

fn grip(frames: &[Frame]) -> (usize, usize, usize) {
    let begin = frames.iter().position(|frame| frame.grasped.is_some()).unwrap();
    let object = frames[begin].grasped.unwrap();
    let end = begin + frames[begin..].iter().take_while(|frame| frame.grasped == Some(object)).count();
    (object, begin, end)
}

#[test]
fn releases_are_not_slips_and_lost_grips_are() {
    let whole = carried();
    assert_eq!(slips(&whole), [], "a successful demonstration releases on purpose");
    let (object, begin, end) = grip(&whole);
    let middle = (begin + end) / 2;
    let lost = |from: usize, to: usize| {
        let mut frames = whole.clone();
        frames[from..to].iter_mut().for_each(|frame| frame.grasped = None);
        slips(&frames)
    };
    assert_eq!(lost(middle, middle + 3), [], "short interruptions of contact are ignored");
    let [slip] = lost(middle, whole.len()).try_into().unwrap();
    let expected = Slip {
        object,
        time_s: whole[middle].time_s,
        held_s: whole[middle].time_s - whole[begin].time_s,
        height_m: whole[middle].objects[object].pose.position.z - whole[begin].objects[object].pose.position.z,
        for_good: true,
    };
    assert_eq!(slip, expected);
    let [again] = lost(middle, middle + 20).try_into().unwrap();
    assert!(!again.for_good, "it was gripped again");
}

/// Each failure cause, on modified frames of a real episode.
#[test]
fn causes_are_derived_from_frames_and_verdict() {
    let (stage, episode) = &episodes()[1];
    let (object, begin, end) = grip(&episode.frames);
    let mut verdict = episode.result.verdict.clone();
    for atom in verdict.alternatives.iter_mut().flatten() {
        atom.holds = false;
        for measured in atom.measurements.iter_mut().filter(|measured| measured.unit == Unit::Metre) {
            (measured.met, measured.margin) = (false, -0.031);
        }
        atom.measurements.sort_by_key(|measured| measured.met);
    }
    let explained = |frames: &[Frame], gave_up| {
        let seen = Evidence { frames, unreachable: None };
        explain(stage, seen, &verdict, gave_up, &RolloutSettings::default()).swap_remove(0)
    };
    let held = Unreachable { actions: 3, step: 8, reason: "no configuration".into() };
    let seen = Evidence { frames: &episode.frames, unreachable: Some(&held) };
    let [first, ..] = &explain(stage, seen, &verdict, None, &RolloutSettings::default())[..] else { panic!() };
    assert_eq!(first.cause, FailureCause::NoIk);
    assert!(first.evidence.contains("3, the first at control step 8: no configuration"), "{first}");

    let missed = explained(&episode.frames, None);
    assert_eq!(missed.cause, FailureCause::GoalMissed);
    assert!(missed.evidence.contains("missed by 31 mm"), "{missed}");

    let mut slipped = episode.frames.clone();
    slipped[(begin + end) / 2..].iter_mut().for_each(|frame| frame.grasped = None);
    let slipped = explained(&slipped, None);
    assert_eq!(slipped.cause, FailureCause::Slipped);
    assert!(slipped.evidence.starts_with(stage.name(object)) && slipped.evidence.contains(" slipped at "), "{slipped}");

    let goal = &stage.scenario.task.goal;
    let is_moved = |id: &InstanceId| goal.alternatives.iter().flatten().any(|atom| atom.subject() == id);
    let bystander = stage.scenario.objects.iter().position(|object| !is_moved(&object.id)).unwrap();
    let mut pushed = episode.frames.clone();
    pushed.last_mut().unwrap().objects[bystander].pose.position.x += 0.08;
    let pushed = explained(&pushed, None);
    assert_eq!(pushed.cause, FailureCause::Disturbed);
    assert!(pushed.evidence.contains(" was pushed away: moved 80 mm"), "{pushed}");
}

/// Without pad friction nothing can be carried: the expert reports the slip and its time.
#[test]
fn slips_in_simulation_are_reported() {
    let mut slippery = (**planner().robot()).clone();
    slippery.drives.as_mut().unwrap().pad_friction = [0.005, 1e-5, 1e-5];
    let mut scenario = scenario(&task("024_appearance"));
    scenario.world.robot.physics_hash = slippery.physics_hash();
    let stage = Stage::open(Arc::new(scenario), Catalogue::builtin(), &Arc::new(slippery)).unwrap();
    let settings = RolloutSettings::default();
    let episode = run_episode(&stage, &mut expert(&stage), "slippery", Seed::new(5), &settings).unwrap();
    let EpisodeResult { success, ending, failures, .. } = episode.result;
    let failure = &failures[0];
    assert_eq!(ending, Some(Ending::GaveUp));
    assert!(!success && failure.cause == FailureCause::Slipped, "{failure}");
    assert!(failure.evidence.contains("was not in the hand after lifting (pick 4)"), "{failure}");
}

/// The strongest stray contact is reported with both bodies and its time.
#[test]
fn the_strongest_stray_contact_agrees_with_the_frames() {
    for (stage, episode) in episodes() {
        let worst = episode.frames.iter().max_by(|a, b| a.stray_contact_n.total_cmp(&b.stray_contact_n)).unwrap();
        assert_eq!(episode.result.max_stray_contact_n, worst.stray_contact_n);
        let contact = &episode.result.stray_contact;
        assert_eq!(contact.is_some(), worst.stray_contact_n > 0.0);
        if let Some(contact) = contact {
            assert!(contact.link.starts_with("robot/") && !contact.other.is_empty(), "{contact}");
            assert!(
                episode
                    .frames
                    .iter()
                    .any(|frame| { frame.time_s == contact.time_s && frame.stray_contact_n == worst.stray_contact_n })
            );
            let lately = |frame: &&Frame| (contact.time_s - 1.0..=contact.time_s).contains(&frame.time_s);
            let held = episode.frames.iter().filter(lately).rev().find_map(|frame| frame.grasped);
            let is_touched = |object: usize| contact.other.starts_with(stage.scenario.objects[object].id.as_str());
            assert_eq!(contact.let_go, held.is_some_and(is_touched), "{contact}");
        }
    }
}

/// A goal without conditions is missed without a specific cause.
#[test]
fn an_empty_goal_is_still_explained() {
    let stage = any_stage();
    let verdict = genmanip_core::GoalVerdict::from_alternatives(Vec::new());
    let seen = Evidence { frames: &[], unreachable: None };
    let failures = explain(stage, seen, &verdict, None, &RolloutSettings::default());
    let [failure] = &failures[..] else { panic!("{failures:?}") };
    assert_eq!((failure.cause, failure.evidence.as_str()), (FailureCause::GoalMissed, "the goal does not hold"));
}
