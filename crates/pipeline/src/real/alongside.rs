//! A policy in a thread of its own: it looks and computes while the arm moves.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use genmanip_core::{ActionChunk, CameraRequest, EpisodeStart, Observation, Policy, PolicyError, RgbdImage};
use genmanip_real::bridge::server::Clock;
use genmanip_rollout::ahead::{Answer, Asking};

/// Images that a policy takes by itself, by the name of the camera.
pub type Images = BTreeMap<String, Arc<RgbdImage>>;
/// Function that takes the images of one observation; its error is a sentence.
pub type Eyes = Box<dyn FnMut() -> Result<Images, String> + Send>;
/// Chunk or error, and the time at which it was ready, s.
type Made = (Result<ActionChunk, PolicyError>, f64);

/// A policy in a thread of its own.
pub struct Alongside {
    clock: Clock,
    asked_s: f64,
    state: State,
}

/// The thread ends with the sender.
enum State {
    Ready(Box<dyn Policy>, Eyes),
    Running(Sender<Observation>, Receiver<Made>),
    Ended,
}

impl Alongside {
    /// The policy, which takes its images with `eyes`.
    pub fn new(policy: Box<dyn Policy>, eyes: Eyes) -> Self {
        Self { clock: Clock::new(), asked_s: 0.0, state: State::Ready(policy, eyes) }
    }

    /// Answer from what came, after the arm waited for it.
    fn answered(&self, made: Option<Made>, waited_s: f64) -> Answer {
        let panicked = || (Err(PolicyError::Unreachable("its thread has ended".into())), self.clock.now_s());
        let (chunk, ready_s) = made.unwrap_or_else(panicked);
        Answer { chunk, took_s: ready_s - self.asked_s, waited_s }
    }
}

impl Asking for Alongside {
    fn cameras(&self) -> &[CameraRequest] {
        &[]
    }

    fn begin(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let State::Ready(mut policy, mut eyes) = std::mem::replace(&mut self.state, State::Ended) else {
            return Err(PolicyError::Unsuited("it has begun an episode already".into()));
        };
        policy.reset(start)?;
        let (questions, asked) = channel::<Observation>();
        let (answers, made) = channel();
        let clock = self.clock;
        thread::spawn(move || {
            for mut observation in asked {
                let chunk = match eyes() {
                    Ok(images) => {
                        observation.images = images;
                        policy.act(&observation)
                    }
                    Err(why) => Err(PolicyError::Unreachable(why)),
                };
                if answers.send((chunk, clock.now_s())).is_err() {
                    return;
                }
            }
        });
        self.state = State::Running(questions, made);
        Ok(())
    }

    fn ask(&mut self, observation: Observation, _now_s: f64) {
        self.asked_s = self.clock.now_s();
        if let State::Running(questions, _) = &self.state {
            // A thread that has ended is reported with the answer.
            let _ = questions.send(observation);
        }
    }

    fn answer(&mut self, _now_s: f64) -> Option<Answer> {
        let State::Running(_, made) = &self.state else { return Some(self.answered(None, 0.0)) };
        match made.try_recv() {
            Ok(made) => Some(self.answered(Some(made), 0.0)),
            Err(std::sync::mpsc::TryRecvError::Empty) => None,
            Err(std::sync::mpsc::TryRecvError::Disconnected) => Some(self.answered(None, 0.0)),
        }
    }

    fn wait(&mut self, _now_s: f64) -> Answer {
        let since_s = self.clock.now_s();
        let made = match &self.state {
            State::Running(_, made) => made.recv().ok(),
            State::Ready(..) | State::Ended => None,
        };
        self.answered(made, self.clock.now_s() - since_s)
    }
}

impl std::fmt::Debug for Alongside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Alongside").field("asked_s", &self.asked_s).finish_non_exhaustive()
    }
}
