//! Chunks of actions requested ahead: the policy computes the next chunk while the robot executes the present one.
//!
//! ```text
//! present chunk   0 1 2 3 4 5 6 7
//!                       │   ▲ the answer has come: the chunks are joined
//!                       ▼ observation, as long before the end as the last answers took
//! next chunk            0 1 2 3 4 5 6 7     0 and 1 are skipped: actions of the present chunk stood in for them
//! ```
//!
//! Only policies that observe again after a fixed number of actions ([`PolicySpec::execute_steps`]) can be asked so:
//! others observe the outcome of a whole chunk first.

use genmanip_core::{
    ActionChunk, CameraRequest, Ending, EpisodeStart, Failure, Observation, Policy, PolicyError, PolicySpec, Seed,
};
use serde::{Deserialize, Serialize};

use crate::driver::Driver;
use crate::episode_loop::{Acted, NO_ACTION, act_once, episode_start, gave_up, mistake};
use crate::robot_interface::RobotInterface;
use crate::{RolloutError, RolloutSettings, Stage};

/// Policy that computes while the robot moves.
pub trait Asking {
    /// Images that an observation must hold; those that the policy takes by itself are not among them.
    fn cameras(&self) -> &[CameraRequest];

    /// Resets the policy.
    ///
    /// # Errors
    /// As [`Policy::reset`].
    fn begin(&mut self, start: &EpisodeStart) -> Result<(), PolicyError>;

    /// Requests a chunk; `now_s` is the robot's time.
    fn ask(&mut self, observation: Observation, now_s: f64);

    /// The answer to the request, if it has come; `None` before.
    fn answer(&mut self, now_s: f64) -> Option<Answer>;

    /// Waits for the answer.
    fn wait(&mut self, now_s: f64) -> Answer;
}

/// Answer to a request for a chunk.
#[derive(Debug)]
pub struct Answer {
    /// The chunk.
    pub chunk: Result<ActionChunk, PolicyError>,
    /// Time from the request to the answer, s.
    pub took_s: f64,
    /// Time for which the robot waited without anything to do, s.
    pub waited_s: f64,
}

/// Counts of an episode whose chunks were requested ahead.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChunkReport {
    /// Number of chunks.
    pub chunks: usize,
    /// Number of chunks that were joined to one under way.
    pub joined: usize,
    /// Number of times that the arm had nothing to do between two chunks; the first chunk does not count.
    pub holds: usize,
    /// Duration of these, s.
    pub held_s: f64,
    /// Longest time from a request to its answer, s.
    pub longest_answer_s: f64,
    /// Largest distance of the tool between the commands of two chunks for the same time, m: the jump that is smoothed.
    pub largest_seam_m: f64,
    /// Control steps at which chunks were joined.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seams: Vec<usize>,
}

/// True if the chunks of a policy can be requested ahead.
pub fn can_ask_ahead(spec: &PolicySpec) -> bool {
    spec.execute_steps > 0 && !spec.privileged
}

/// As [`crate::run_policy`], with chunks requested ahead; `report` also counts what came before an error.
///
/// # Errors
/// As [`crate::run_policy`].
pub fn run_ahead(
    robot: &mut impl RobotInterface,
    stage: &Stage,
    spec: &PolicySpec,
    policy: &mut dyn Asking,
    seed: Seed,
    settings: &RolloutSettings,
    report: &mut ChunkReport,
) -> Result<(Ending, Option<Failure>), RolloutError> {
    let mut driver = Driver::new(spec, stage, settings)?;
    if let Err(error) = policy.begin(&episode_start(stage, spec, seed.fork("policy"))?) {
        return gave_up(error, spec);
    }
    let (mut chunk, mut lead) = (Chunk::default(), Lead::default());
    let mut asked: Option<Asked> = None;
    loop {
        if robot.steps_left() == 0 {
            return Ok((Ending::Horizon, None));
        }
        let now_s = robot.frames().len() as f64 / stage.control_rate_hz();
        if asked.is_none() && chunk.is_due(spec.execute_steps, lead.actions(driver.action_s())) {
            let mut observation = robot.observe(policy.cameras())?;
            driver.add_target(robot, &mut observation)?;
            policy.ask(observation, now_s);
            asked = Some(Asked { executed: 0, measured: robot.joint_positions()? });
        }
        if let Some(question) = &asked {
            let answer = match chunk.next() {
                Some(_) => policy.answer(now_s),
                None => Some(policy.wait(now_s)),
            };
            if let Some(Answer { chunk: answered, took_s, waited_s }) = answer {
                lead.took(took_s);
                report.add(took_s, waited_s);
                let next = match answered {
                    Ok(next) => next,
                    Err(error) => return gave_up(error, spec),
                };
                let Some(last) = next.actions.len().checked_sub(1) else {
                    return match next.finished {
                        true => Ok((Ending::Finished, None)),
                        false => Err(mistake(spec, format!("it returned no action\n{NO_ACTION}"))),
                    };
                };
                let skipped = question.executed.min(last);
                let measured = question.measured.clone();
                if report.chunks > 1 {
                    let apart_m = driver.join_chunk(robot, measured, chunk.next(), &next.actions[skipped])?;
                    report.largest_seam_m = report.largest_seam_m.max(apart_m);
                    report.joined += usize::from(chunk.next().is_some());
                    report.seams.push(robot.frames().len());
                } else {
                    driver.begin_chunk(robot)?;
                }
                chunk = Chunk { actions: next.actions, at: skipped, finished: next.finished };
                asked = None;
            }
        }
        let Some(action) = chunk.next() else { return Ok((Ending::Finished, None)) };
        match act_once(robot, spec, &mut driver, action)? {
            Acted::Over(ending, failure) => return Ok((ending, failure)),
            Acted::On { .. } => {}
        }
        chunk.at += 1;
        if let Some(question) = &mut asked {
            question.executed += 1;
        }
    }
}

/// Chunk under way.
#[derive(Default)]
struct Chunk {
    actions: Vec<Vec<f32>>,
    /// Index of the next action.
    at: usize,
    finished: bool,
}

impl Chunk {
    fn next(&self) -> Option<&[f32]> {
        self.actions.get(self.at).map(Vec::as_slice)
    }

    /// True if the next chunk is to be requested now, `lead` actions before this one has been executed.
    fn is_due(&self, execute_steps: usize, lead: usize) -> bool {
        let end = execute_steps.min(self.actions.len());
        // A chunk that was cut off by `execute_steps` is not finished.
        let is_last = self.finished && end == self.actions.len();
        // An answer that takes as long as the chunk would be out of date: it is requested once the chunk is over.
        !is_last && (self.next().is_none() || lead < end && self.at + lead >= end)
    }
}

/// Request under way.
struct Asked {
    /// Actions executed since.
    executed: usize,
    /// Arm joint positions at the observation, rad.
    measured: Vec<f64>,
}

/// Time that answers take, by the last three; the first one, for which servers load and compile, counts only while it
/// is the only one.
#[derive(Default)]
struct Lead {
    took_s: Vec<f64>,
    count: usize,
}

impl Lead {
    fn took(&mut self, took_s: f64) {
        if self.count == 1 || self.took_s.len() == 3 {
            self.took_s.remove(0);
        }
        self.took_s.push(took_s);
        self.count += 1;
    }

    /// Number of actions that an answer takes, and one for its jitter.
    fn actions(&self, action_s: f64) -> usize {
        let longest_s = self.took_s.iter().copied().fold(0.0, f64::max);
        (longest_s / action_s).ceil() as usize + 1
    }
}

impl ChunkReport {
    fn add(&mut self, took_s: f64, waited_s: f64) {
        self.longest_answer_s = self.longest_answer_s.max(took_s);
        if self.chunks > 0 && waited_s > 0.0 {
            self.holds += 1;
            self.held_s += waited_s;
        }
        self.chunks += 1;
    }
}

/// A policy whose answers come after a fixed time on the robot's clock: repeatable, for simulated robots.
pub struct Delayed<'a> {
    policy: &'a mut dyn Policy,
    cameras: Vec<CameraRequest>,
    delay_s: f64,
    /// Answer under way, and the time at which it comes, s.
    coming: Option<(f64, Result<ActionChunk, PolicyError>)>,
}

impl<'a> Delayed<'a> {
    /// The policy with answers after `delay_s`.
    pub fn new(policy: &'a mut dyn Policy, delay_s: f64) -> Self {
        let cameras = policy.spec().cameras;
        Self { policy, cameras, delay_s, coming: None }
    }
}

impl Asking for Delayed<'_> {
    fn cameras(&self) -> &[CameraRequest] {
        &self.cameras
    }

    fn begin(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.policy.reset(start)
    }

    fn ask(&mut self, observation: Observation, now_s: f64) {
        self.coming = Some((now_s + self.delay_s, self.policy.act(&observation)));
    }

    fn answer(&mut self, now_s: f64) -> Option<Answer> {
        // Half a microsecond for rounding.
        let (_, chunk) = self.coming.take_if(|(at_s, _)| *at_s <= now_s + 5e-7)?;
        Some(Answer { chunk, took_s: self.delay_s, waited_s: 0.0 })
    }

    fn wait(&mut self, now_s: f64) -> Answer {
        let nothing = || (now_s, Err(PolicyError::Unsuited("nothing was asked".into())));
        let (at_s, chunk) = self.coming.take().unwrap_or_else(nothing);
        Answer { chunk, took_s: self.delay_s, waited_s: (at_s - now_s).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_requested_in_time_for_their_end() {
        // Length, next action, `execute_steps`, finished; delay, s, at 0.1 s per action; due.
        let cases = [
            (8, 4, 8, false, 0.15, false),
            (8, 5, 8, false, 0.15, true),
            (10, 5, 8, false, 0.15, true),
            (8, 8, 8, false, 0.15, true),
            // Nothing follows the last chunk, and one cut off is not the last.
            (8, 7, 8, true, 0.15, false),
            (10, 7, 8, true, 0.15, true),
            // Too slow to be asked ahead.
            (8, 7, 8, false, 2.0, false),
            (8, 8, 8, false, 2.0, true),
            (0, 0, 8, false, 0.0, true),
        ];
        for (length, at, execute, finished, delay_s, expected) in cases {
            let chunk = Chunk { actions: vec![vec![0.0]; length], at, finished };
            let mut lead = Lead::default();
            lead.took(delay_s);
            let what = (length, at, execute, finished, delay_s);
            assert_eq!(chunk.is_due(execute, lead.actions(0.1)), expected, "{what:?}");
        }
    }

    #[test]
    fn the_first_answer_counts_only_while_it_is_the_only_one() {
        let mut lead = Lead::default();
        let actions = [5.0, 0.05, 0.08, 0.05, 0.02, 0.05].map(|took_s| {
            lead.took(took_s);
            lead.actions(0.02)
        });
        assert_eq!(actions, [251, 4, 5, 5, 5, 4]);
    }
}
