//! Segmentation of an episode into steps (subtasks): manipulated object, interval and instruction of each.

use genmanip_core::{Episode, Frame};
use genmanip_tasks::wording;

/// Minimum duration of a grasp that counts as a step, control steps: 0.1 s at 60 Hz. Chosen by hand: the fingers may
/// brush a neighbour.
const MIN_STEPS: usize = 6;
/// Joint speed of an object above which it counts as being moved, rad/s or m/s. Chosen by hand: lids at rest stay far
/// below.
const MOVING_PER_S: f64 = 0.05;

/// Steps (subtasks) of an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Steps {
    /// Instruction of each step, in order; at least one.
    pub texts: Vec<String>,
    /// Control step at which each step ends, exclusive; the last step lasts to the end of the episode.
    ends: Vec<usize>,
}

impl Steps {
    /// A step ends when its object is released for another one; it includes the approach before the grasp.
    ///
    /// An episode that touches no object has one step, with the task instruction as its text.
    pub fn of(episode: &Episode) -> Self {
        let task = &episode.scenario.task;
        let segments = segments(&episode.frames, episode.result.control_rate_hz);
        if segments.is_empty() {
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
            texts: segments.iter().map(|(object, _)| text(*object)).collect(),
            ends: segments.iter().map(|(_, end)| *end).collect(),
        }
    }

    /// First control step and instruction of each step.
    pub fn begins(&self) -> impl Iterator<Item = (usize, &str)> {
        std::iter::once(0).chain(self.ends.iter().copied()).zip(self.texts.iter().map(String::as_str))
    }

    /// Index of the step that contains a control step.
    pub fn at(&self, control_step: usize) -> usize {
        let before = self.ends.iter().take_while(|end| **end <= control_step).count();
        before.min(self.texts.len().saturating_sub(1))
    }
}

/// Manipulated objects with the exclusive end control step of each; consecutive entries differ.
fn segments(frames: &[Frame], rate_hz: f64) -> Vec<(usize, usize)> {
    let mut segments: Vec<(usize, usize)> = Vec::new();
    let (mut run, mut length) = (None, 0);
    for (step, frame) in frames.iter().enumerate() {
        let before = step.checked_sub(1).map(|before| &frames[before]);
        let now = frame.grasped.or_else(|| before.and_then(|before| moved_joint(before, frame, rate_hz)));
        length = if now == run { length + 1 } else { 1 };
        run = now;
        let Some(object) = now.filter(|_| length >= MIN_STEPS) else { continue };
        match segments.last_mut() {
            Some((last, end)) if *last == object => *end = step + 1,
            _ => segments.push((object, step + 1)),
        }
    }
    segments
}

/// First object whose joints move between two frames. `None` if none moves.
fn moved_joint(before: &Frame, now: &Frame, rate_hz: f64) -> Option<usize> {
    let moves = |(a, b): (&f64, &f64)| (b - a).abs() * rate_hz > MOVING_PER_S;
    let pairs = before.objects.iter().zip(&now.objects);
    pairs.into_iter().position(|(a, b)| a.joint_positions.iter().zip(&b.joint_positions).any(moves))
}

#[cfg(test)]
mod tests {
    use genmanip_core::{ObjectState, Pose};

    use super::*;

    /// One character per frame: `.` nothing, a digit the grasped object, a letter an object whose joint moves.
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
    fn objects_are_segmented_in_order() {
        let cases: [(&str, &[(usize, usize)]); 8] = [
            ("..........", &[]),
            ("..00000000..", &[(0, 10)]),
            // Too brief to count as a step.
            ("..22222..00000000..", &[(0, 17)]),
            // Grasped again after it slipped.
            ("..0000000....0000000..", &[(0, 20)]),
            ("..0000000...1111111..", &[(0, 9), (1, 19)]),
            // A lid that is pushed and keeps falling.
            ("..aaaaaaaa....1111111..", &[(0, 10), (1, 21)]),
            // A grasped object takes precedence over a moving one.
            ("..1111111aaaaaaa..", &[(1, 9), (0, 16)]),
            ("0000000111111100000000", &[(0, 7), (1, 14), (0, 22)]),
        ];
        for (pattern, expected) in cases {
            assert_eq!(segments(&frames(pattern), 60.0), expected, "{pattern}");
        }
    }

    #[test]
    fn every_control_step_has_a_step() {
        let steps = Steps { texts: vec!["a".into(), "b".into()], ends: vec![9, 19] };
        assert_eq!([0, 8, 9, 18, 19, 99].map(|step| steps.at(step)), [0, 0, 1, 1, 1, 1]);
    }
}
