//! The steps of an episode: which thing the arm works on, from when to when, and what that is called.

use genmanip_core::{Episode, Frame};
use genmanip_tasks::wording;

/// Fewest control steps for which a thing is worked on, 0.1 s at 60 Hz; chosen: the fingers may brush a neighbour.
const SHORTEST: usize = 6;
/// A joint of a thing that turns or slides faster is being moved, rad/s or m/s; chosen: lids at rest stay far below.
const MOVING_PER_S: f64 = 0.05;

/// The steps of an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Steps {
    /// A request for each, in their order; at least one.
    pub texts: Vec<String>,
    /// Control step behind the last of each; the last one goes on to the end.
    ends: Vec<usize>,
}

impl Steps {
    /// A step ends when the thing is let go of for another one; before its grasp, the arm is on its way to it.
    ///
    /// An episode that touches nothing has one step, which is called as the instruction.
    pub fn of(episode: &Episode) -> Self {
        let task = &episode.scenario.task;
        let worked_on = in_turn(&episode.frames, episode.result.control_rate_hz);
        if worked_on.is_empty() {
            return Self { texts: vec![task.instruction.clone()], ends: vec![episode.frames.len()] };
        }
        let alternatives = &episode.result.verdict.alternatives;
        let reached = |atoms: &Vec<genmanip_core::AtomVerdict>| atoms.iter().all(|atom| atom.holds);
        let alternative = alternatives.iter().position(reached).unwrap_or(0);
        let objects = &episode.scenario.objects;
        let text = |object: usize| {
            objects
                .get(object)
                .map_or_else(|| task.instruction.clone(), |object| wording::step(task, &object.id, alternative))
        };
        Self {
            texts: worked_on.iter().map(|(object, _)| text(*object)).collect(),
            ends: worked_on.iter().map(|(_, end)| *end).collect(),
        }
    }

    /// The control step that each begins with, and what it is called.
    pub fn begins(&self) -> impl Iterator<Item = (usize, &str)> {
        std::iter::once(0).chain(self.ends.iter().copied()).zip(self.texts.iter().map(String::as_str))
    }

    /// The step that a control step belongs to.
    pub fn at(&self, control_step: usize) -> usize {
        let before = self.ends.iter().take_while(|end| **end <= control_step).count();
        before.min(self.texts.len().saturating_sub(1))
    }
}

/// The things that the arm works on, each with the control step behind the last one; the same one is never twice in a
/// row.
fn in_turn(frames: &[Frame], rate_hz: f64) -> Vec<(usize, usize)> {
    let mut turns: Vec<(usize, usize)> = Vec::new();
    let (mut run, mut length) = (None, 0);
    for (step, frame) in frames.iter().enumerate() {
        let before = step.checked_sub(1).map(|before| &frames[before]);
        let now = frame.grasped.or_else(|| before.and_then(|before| moved_joint(before, frame, rate_hz)));
        length = if now == run { length + 1 } else { 1 };
        run = now;
        let Some(object) = now.filter(|_| length >= SHORTEST) else { continue };
        match turns.last_mut() {
            Some((last, end)) if *last == object => *end = step + 1,
            _ => turns.push((object, step + 1)),
        }
    }
    turns
}

/// The first object whose joints move from one frame to the next.
fn moved_joint(before: &Frame, now: &Frame, rate_hz: f64) -> Option<usize> {
    let moves = |(a, b): (&f64, &f64)| (b - a).abs() * rate_hz > MOVING_PER_S;
    let pairs = before.objects.iter().zip(&now.objects);
    pairs.into_iter().position(|(a, b)| a.joint_positions.iter().zip(&b.joint_positions).any(moves))
}

#[cfg(test)]
mod tests {
    use genmanip_core::{ObjectState, Pose};

    use super::*;

    /// `.` nothing, a digit a grasped object, a letter an object whose joint moves.
    fn frames(pattern: &str) -> Vec<Frame> {
        let mut joints = [0.0; 3];
        let frame = |letter: char| {
            if let Some(moved) = "abc".find(letter) {
                joints[moved] += 0.01;
            }
            let object = |joint: &f64| ObjectState {
                pose: Pose::default(),
                joint_positions: vec![*joint],
                speed: 0.0,
                angular_speed: 0.0,
            };
            Frame {
                time_s: 0.0,
                command: Vec::new(),
                joint_position: Vec::new(),
                joint_velocity: Vec::new(),
                joint_torque: Vec::new(),
                gripper_width: 0.0,
                grip_force: 0.0,
                tcp: Pose::default(),
                objects: joints.iter().map(object).collect(),
                grasped: letter.to_digit(10).map(|digit| digit as usize),
                stray_contact_n: 0.0,
            }
        };
        pattern.chars().map(frame).collect()
    }

    #[test]
    fn things_are_worked_on_in_turn() {
        let cases: [(&str, &[(usize, usize)]); 8] = [
            ("..........", &[]),
            ("..00000000..", &[(0, 10)]),
            // Brushed too briefly.
            ("..22222..00000000..", &[(0, 17)]),
            // Taken again after it slipped.
            ("..0000000....0000000..", &[(0, 20)]),
            ("..0000000...1111111..", &[(0, 9), (1, 19)]),
            // A lid that is pushed, and falls on.
            ("..aaaaaaaa....1111111..", &[(0, 10), (1, 21)]),
            // What is held counts more than what moves.
            ("..1111111aaaaaaa..", &[(1, 9), (0, 16)]),
            ("0000000111111100000000", &[(0, 7), (1, 14), (0, 22)]),
        ];
        for (pattern, expected) in cases {
            assert_eq!(in_turn(&frames(pattern), 60.0), expected, "{pattern}");
        }
    }

    #[test]
    fn every_control_step_has_a_step() {
        let steps = Steps { texts: vec!["a".into(), "b".into()], ends: vec![9, 19] };
        assert_eq!([0, 8, 9, 18, 19, 99].map(|step| steps.at(step)), [0, 0, 1, 1, 1, 1]);
    }
}
