//! Control steps by the wall clock.

use std::time::{Duration, Instant};

/// Times at which control steps are due. A late step moves all later ones: none is skipped or made up for.
#[derive(Clone, Debug)]
pub struct Pace {
    period: Duration,
    due: Instant,
    late: usize,
}

impl Pace {
    /// A first step that is due now.
    pub fn new(rate_hz: f64, now: Instant) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / rate_hz), due: now, late: 0 }
    }

    /// Time to wait for the next step, once the one before has been computed.
    pub fn next(&mut self, now: Instant) -> Duration {
        let wait = self.due.saturating_duration_since(now);
        if now > self.due + self.period / 10 {
            self.late += 1;
            self.due = now;
        }
        self.due += self.period;
        wait
    }

    /// Goes on after a pause.
    pub fn resume(&mut self, now: Instant) {
        self.due = now;
    }

    /// Steps that began late, because the one before took longer than it lasts.
    pub fn late(&self) -> usize {
        self.late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_steps_are_counted_and_not_made_up_for() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let wait = |ms: u64| Duration::from_millis(ms);
        let mut pace = Pace::new(100.0, start);
        assert_eq!((pace.next(start), pace.late()), (wait(0), 0));
        assert_eq!((pace.next(at(4)), pace.late()), (wait(6), 0));
        // Due at 20 ms.
        assert_eq!((pace.next(at(35)), pace.late()), (wait(0), 1));
        assert_eq!((pace.next(at(36)), pace.late()), (wait(9), 1));
        pace.resume(at(1000));
        assert_eq!((pace.next(at(1000)), pace.late()), (wait(0), 1));
    }
}
