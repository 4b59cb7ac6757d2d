//! Physical plausibility: no welds, no teleports, normal gravity, and robot limits as published.

use genmanip_core::{Atom, Episode, Frame, ObjectState, ReferenceId, Relation};
use genmanip_relations::judge_goal;
use genmanip_rollout::{RolloutSettings, Stage};
use genmanip_sim::{BodyId, ContactReport, Sim};
use std::collections::BTreeSet;
use std::sync::Arc;

use crate::episodes;

/// The manufacturer's limits of the Panda, repeated here to detect errors in the model.
const LOWER_RAD: [f64; 7] = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973];
const UPPER_RAD: [f64; 7] = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];
const SPEED_RAD_S: [f64; 7] = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61];
const TORQUE_N_M: [f64; 7] = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0];
const GRIP_N: f64 = 70.0;
const WIDTH_M: f64 = 0.08;
const PERIOD_S: f64 = 1.0 / 60.0;

fn each(check: impl Fn(&Stage, &Episode)) {
    for (stage, episode) in episodes() {
        check(stage, episode);
    }
}

#[test]
fn the_expert_solves_these_tasks() {
    each(|_, episode| {
        let result = &episode.result;
        assert!(result.success, "{}: {:?}", result.id, result.failures);
        assert!(result.oracle && result.policy == "expert" && result.frames == episode.frames.len());
        assert!(result.success_once && result.verdict.score == 1.0);
    });
}

#[test]
fn positions_velocities_torques_and_grip_stay_within_published_limits() {
    each(|_, episode| {
        let within = |what: &str, frame: &Frame, values: &[f64], low: &dyn Fn(usize) -> f64, high: &[f64]| {
            assert_eq!(values.len(), 7);
            for (joint, &value) in values.iter().enumerate() {
                let fits = (low(joint)..=high[joint]).contains(&value);
                assert!(fits, "{} {what} of joint {}: {value} at {} s", episode.result.id, joint + 1, frame.time_s);
            }
        };
        for (index, frame) in episode.frames.iter().enumerate() {
            assert!((frame.time_s - index as f64 * PERIOD_S).abs() < 1e-9);
            within("position", frame, &frame.joint_position, &|j| LOWER_RAD[j], &UPPER_RAD);
            within("velocity", frame, &frame.joint_velocity, &|j| -SPEED_RAD_S[j], &SPEED_RAD_S);
            within("torque", frame, &frame.joint_torque, &|_| 0.0, &TORQUE_N_M);
            let command: Vec<f64> = frame.command.iter().map(|&value| f64::from(value)).collect();
            within("command", frame, &command[..7], &|j| LOWER_RAD[j], &UPPER_RAD);
            assert!((0.0..=GRIP_N).contains(&frame.grip_force), "grip {} N", frame.grip_force);
            // The finger stops are compliant, like those of the real gripper.
            assert!((-5e-4..=WIDTH_M + 5e-4).contains(&frame.gripper_width), "{} m", frame.gripper_width);
        }
    });
}

/// Positions, commands and object poses are continuous, so the velocity limits above are meaningful.
#[test]
fn motions_are_continuous() {
    each(|_, episode| {
        for pair in episode.frames.windows(2) {
            let (before, after) = (&pair[0], &pair[1]);
            for (joint, speed) in SPEED_RAD_S.iter().enumerate() {
                let moved = (after.joint_position[joint] - before.joint_position[joint]).abs();
                assert!(moved <= speed * PERIOD_S, "joint {} moved {moved} in one step", joint + 1);
                let commanded = f64::from(after.command[joint] - before.command[joint]).abs();
                assert!(commanded <= speed * PERIOD_S, "the command of joint {} jumped by {commanded}", joint + 1);
            }
            for (object, (from, to)) in before.objects.iter().zip(&after.objects).enumerate() {
                let moved = from.pose.position.distance(to.pose.position);
                // Between two frames, gravity and one contact change the speed only slightly.
                let explained = from.speed.max(to.speed) * PERIOD_S + 0.003;
                assert!(
                    moved < 0.05 && moved <= explained,
                    "{}: object {object} moved {moved} m at {} s, more than its speed allows, {explained}",
                    episode.result.id,
                    before.time_s
                );
            }
        }
    });
}

/// Objects rest until the gripper comes near, and untouched objects never move.
#[test]
fn objects_move_only_when_touched() {
    each(|stage, episode| {
        let first = &episode.frames[0];
        // Gripper and fingers are within this distance of the tool point.
        let near = |frame: &Frame| {
            frame.objects.iter().zip(&stage.models).any(|(object, model)| {
                let bounds = model.world_bounds(&object.pose, &object.joint_positions);
                let nearest = frame.tcp.position.clamp(bounds.min, bounds.max);
                nearest.distance(frame.tcp.position) < 0.12
            })
        };
        let shift = |frame: &Frame, object: usize| {
            frame.objects[object].pose.position.distance(first.objects[object].pose.position)
        };
        let mut alone = 0;
        for frame in episode.frames.iter().take_while(|frame| !near(frame)) {
            alone += 1;
            for object in 0..frame.objects.len() {
                assert!(shift(frame, object) < 5e-4, "object {object} moved {} m untouched", shift(frame, object));
                assert!(frame.objects[object].speed < 0.01, "object {object} is moving untouched");
            }
        }
        assert!(alone > 6, "{}: the gripper starts among the objects", episode.result.id);

        let held: BTreeSet<usize> = episode.frames.iter().filter_map(|frame| frame.grasped).collect();
        assert!(!held.is_empty(), "something was grasped");
        let atoms = stage.scenario.task.goal.alternatives.iter().flatten();
        let concerned: BTreeSet<usize> =
            atoms.flat_map(Atom::references).filter_map(|id| stage.scenario.index_of(id)).collect();
        let last = episode.frames.last().unwrap();
        for object in (0..last.objects.len()).filter(|object| !held.contains(object) && !concerned.contains(object)) {
            let moved = shift(last, object);
            assert!(moved < 0.002, "{} moved {moved} m although not part of the task", stage.name(object));
        }
        let moved_most = held.iter().map(|&object| shift(last, object)).fold(0.0, f64::max);
        assert!(moved_most > 0.03, "a grasped object was carried");
    });
}

/// Objects are held by friction alone: the model contains nothing else that could hold them.
#[test]
fn the_model_has_no_welds_and_no_lighter_objects() {
    each(|stage, _| {
        let mjcf = stage.scene.mjcf();
        for trick in ["weld", "mocap", "<connect", "sleep"] {
            assert!(!mjcf.contains(trick), "the model contains `{trick}`");
        }
        // The only equality constraint couples the robot's fingers, and only parts of the robot are excluded from
        // mutual collision.
        let section = |name: &str| mjcf.split(name).nth(1).unwrap_or_default();
        let equalities: Vec<&str> = section("equality>").lines().filter(|line| line.contains('=')).collect();
        let [fingers] = equalities[..] else { panic!("{equalities:?}") };
        assert!(fingers.contains(r#"joint1="robot/right_finger" joint2="robot/left_finger""#), "{fingers}");
        for line in mjcf.lines().filter(|line| line.contains("<exclude")) {
            assert_eq!(line.matches("\"robot/").count(), 2, "{line}");
        }
        assert!(mjcf.contains(r#"gravity="0 0 -9.81""#));
        let bodies = mjcf.lines().filter(|line| line.contains("<body ") && !line.contains("\"robot/"));
        for body in bodies {
            assert!(!body.contains("gravcomp"), "gravity compensation: {body}");
        }
        let free = mjcf.matches("<freejoint").count();
        assert_eq!(free, stage.models.len(), "every object is a free body");
    });
}

/// True if one object is on another according to bounds and engine contacts, independently of the judge.
fn seems_to_hold(stage: &Stage, objects: &[ObjectState], contacts: &[ContactReport], atom: &Atom) -> bool {
    let Atom::Relation { subject, relation: Relation::Top, reference, .. } = atom else { panic!("no rule for {atom}") };
    let index = |id: &ReferenceId| stage.scenario.index_of(id).unwrap();
    let bounds = |object: usize| stage.models[object].world_bounds(&objects[object].pose, &[]);
    let (a, b) = (index(subject), index(reference));
    let (middle, lower) = (bounds(a).center(), bounds(b));
    let is_over =
        middle.truncate().cmpge(lower.min.truncate()).all() && middle.truncate().cmple(lower.max.truncate()).all();
    let is = |body: BodyId, which: usize| matches!(body, BodyId::Object { object, .. } if object == which);
    let touches =
        |contact: &ContactReport| is(contact.a, a) && is(contact.b, b) || is(contact.a, b) && is(contact.b, a);
    is_over && middle.z > lower.center().z && contacts.iter().any(touches)
}

/// In a new simulation of the stored state, the goal holds according to the judge and an independent check, and the
/// gripper is open and empty.
#[test]
fn success_agrees_with_the_final_state() {
    each(|stage, episode| {
        let goal = &stage.scenario.task.goal.alternatives;
        let holds = |sim: &mut Sim| {
            let (objects, contacts) = (sim.object_states(), sim.contacts());
            goal.iter().any(|atoms| atoms.iter().all(|atom| seems_to_hold(stage, &objects, &contacts, atom)))
        };
        let mut start = Sim::new(Arc::clone(&stage.scene));
        start.set_state(&episode.initial_state).unwrap();
        assert!(!holds(&mut start), "{}: it holds at the start", episode.result.id);
        let mut sim = Sim::new(Arc::clone(&stage.scene));
        sim.set_state(&episode.final_state).unwrap();
        let states = sim.object_states();
        assert_eq!(holds(&mut sim), episode.result.success, "{}: {:?}", episode.result.id, episode.result.verdict);
        assert_eq!(sim.grasped(), None);
        assert!(sim.gripper_width() > 0.03, "the gripper is at {} m", sim.gripper_width());
        let rest = Stage::rest(&states, None, &RolloutSettings::default());
        assert!(!rest.moving.contains(&true), "something still moves");
        let verdict = judge_goal(&stage.posed(&states), &stage.scenario.task.goal, &rest, &stage.relations);
        assert_eq!(verdict, episode.result.verdict, "the stored verdict belongs to the stored state");
        let start = stage.posed(&episode.frames[0].objects);
        let verdict = judge_goal(&start, &stage.scenario.task.goal, &rest, &stage.relations);
        assert!(!verdict.success, "the goal holds at the start");
    });
}
