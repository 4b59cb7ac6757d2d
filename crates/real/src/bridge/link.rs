//! Connection with latency, jitter and loss, on any clock.

use genmanip_core::Seed;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// Flaws of a connection in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinkSettings {
    /// Mean delay, s.
    pub latency_s: f64,
    /// Largest deviation of the delay from its mean, s, drawn uniformly for each message; messages may overtake others.
    pub jitter_s: f64,
    /// Share of streamed messages that are lost; others always arrive.
    pub loss: f64,
}

/// Messages on their way in one direction.
#[derive(Debug)]
pub struct Link<T> {
    settings: LinkSettings,
    seed: Seed,
    /// Number of messages so far.
    sent: u64,
    /// Messages with their time of arrival, s.
    under_way: Vec<(f64, T)>,
}

impl<T> Link<T> {
    /// Empty link.
    pub fn new(settings: LinkSettings, seed: Seed) -> Self {
        Self { settings, seed: seed.fork("link"), sent: 0, under_way: Vec::new() }
    }

    /// Sends a message at `now_s`; only a streamed one may be lost.
    pub fn send(&mut self, now_s: f64, message: T, is_streamed: bool) {
        let LinkSettings { latency_s, jitter_s, loss } = self.settings;
        self.sent += 1;
        let rng = &mut self.seed.fork_index(self.sent).rng();
        let is_lost = is_streamed && rng.random_range(0.0..1.0) < loss;
        let delay_s = latency_s + jitter_s * rng.random_range(-1.0..=1.0);
        if !is_lost {
            self.under_way.push((now_s + delay_s.max(0.0), message));
        }
    }

    /// Next message that has arrived at `now_s`, in the order of arrival; `None` without one.
    pub fn receive(&mut self, now_s: f64) -> Option<T> {
        let due = self.under_way.iter().enumerate().filter(|(_, (at_s, _))| *at_s <= now_s);
        let first = due.min_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b)).map(|(index, _)| index)?;
        Some(self.under_way.remove(first).1)
    }
}
