//! Processor cores that many episodes share.
//!
//! An episode holds a core while it computes and lends it to the others while it waits for a service, so that more
//! episodes can be under way than there are cores.

use std::cell::Cell;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

thread_local! {
    /// Whether this thread holds a core, of whichever [`Cores`]: a thread works on one episode at a time.
    static HOLDS: Cell<bool> = const { Cell::new(false) };
}

/// A number of cores, given out in the order in which they were asked for.
///
/// ```
/// use genmanip_rollout::Cores;
/// let cores = Cores::new(1);
/// let core = cores.hold();
/// // While this thread waits for a service, another one may compute.
/// assert_eq!(cores.lend(|| "what the service said"), "what the service said");
/// ```
#[derive(Debug)]
pub struct Cores {
    state: Mutex<State>,
    freed: Condvar,
}

#[derive(Debug)]
struct State {
    free: usize,
    /// Tickets of the threads that wait, the next one first.
    waiting: VecDeque<u64>,
    next_ticket: u64,
}

/// Says that this thread holds a core; dropping it gives the core back.
#[derive(Debug)]
#[must_use]
pub struct HeldCore<'a>(&'a Cores);

impl Cores {
    /// `count` cores, at least one.
    pub fn new(count: usize) -> Self {
        let state = State { free: count.max(1), waiting: VecDeque::new(), next_ticket: 0 };
        Self { state: Mutex::new(state), freed: Condvar::new() }
    }

    /// Waits for a core; a thread holds at most one.
    pub fn hold(&self) -> HeldCore<'_> {
        self.take();
        HeldCore(self)
    }

    /// Gives this thread's core to others while `wait` runs, then waits for one again; a thread without a core just
    /// runs `wait`.
    pub fn lend<T>(&self, wait: impl FnOnce() -> T) -> T {
        if !HOLDS.get() {
            return wait();
        }
        self.give_back();
        // Taken again also when `wait` panics, since the held core is given back when it is dropped.
        let _again = TakeAgain(self);
        wait()
    }

    fn take(&self) {
        let mut state = self.lock();
        let ticket = state.next_ticket;
        state.next_ticket += 1;
        state.waiting.push_back(ticket);
        while state.free == 0 || state.waiting.front() != Some(&ticket) {
            state = self.freed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.waiting.pop_front();
        state.free -= 1;
        if state.free > 0 {
            self.freed.notify_all();
        }
        HOLDS.set(true);
    }

    fn give_back(&self) {
        HOLDS.set(false);
        self.lock().free += 1;
        self.freed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for HeldCore<'_> {
    fn drop(&mut self) {
        self.0.give_back();
    }
}

struct TakeAgain<'a>(&'a Cores);

impl Drop for TakeAgain<'_> {
    fn drop(&mut self) {
        self.0.take();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn no_more_compute_than_there_are_cores_and_waiting_takes_none() {
        let (cores, threads) = (Cores::new(2), 8);
        let (computing, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        // It opens only when all wait at the same time: with cores held while waiting, this would not end.
        let all_wait = Barrier::new(threads);
        let compute = || {
            let now = computing.fetch_add(1, Ordering::SeqCst) + 1;
            most.fetch_max(now, Ordering::SeqCst);
            std::thread::yield_now();
            computing.fetch_sub(1, Ordering::SeqCst);
        };
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    let _core = cores.hold();
                    compute();
                    cores.lend(|| all_wait.wait());
                    compute();
                });
            }
        });
        assert!((1..=2).contains(&most.load(Ordering::SeqCst)), "{most:?}");
        assert_eq!(cores.lock().free, 2);
    }

    #[test]
    fn a_panic_while_waiting_loses_no_core() {
        let cores = Cores::new(1);
        let waited = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _core = cores.hold();
            cores.lend(|| panic!("the service broke"));
        }));
        assert!(waited.is_err());
        drop(cores.hold());
        assert_eq!(cores.lock().free, 1);
    }
}
