//! Processor cores shared by many episodes.
//!
//! An episode holds a core while it computes and lends it to others while it waits for a service, so that more episodes
//! can run than there are cores.

use std::cell::Cell;
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

thread_local! {
    /// Length of the episode for which this thread holds a core of any [`Cores`]; `None` if it holds none. A thread
    /// works on one episode at a time.
    static HOLDS: Cell<Option<usize>> = const { Cell::new(None) };
}

/// Fixed number of cores. A free core goes to the waiting thread with the longest episode, among equals to the first.
///
/// A long episode waits for its service many times in sequence. If it also waited for cores, it would still be running,
/// alone, after all others have ended.
///
/// ```
/// use genmanip_rollout::Cores;
/// let cores = Cores::new(1);
/// let steps = 3;
/// let core = cores.hold(steps);
/// // While this thread waits for a service, another one may compute.
/// assert_eq!(cores.lend(|| "response"), "response");
/// ```
#[derive(Debug)]
pub struct Cores {
    state: Mutex<State>,
    freed: Condvar,
}

#[derive(Debug)]
struct State {
    free: usize,
    /// Waiting threads in order: episode length and ticket.
    waiting: BTreeSet<(Reverse<usize>, u64)>,
    next_ticket: u64,
}

/// Guard of a held core; dropping it returns the core.
#[derive(Debug)]
#[must_use]
pub struct HeldCore<'a>(&'a Cores);

impl Cores {
    /// Creates `count` cores, at least one.
    pub fn new(count: usize) -> Self {
        let state = State { free: count.max(1), waiting: BTreeSet::new(), next_ticket: 0 };
        Self { state: Mutex::new(state), freed: Condvar::new() }
    }

    /// Waits for a core for an episode of `length` steps (any measure of length); a thread holds at most one.
    pub fn hold(&self, length: usize) -> HeldCore<'_> {
        self.take(length);
        HeldCore(self)
    }

    /// Lends this thread's core to others while `wait` runs, then waits for one again; without a core, just runs
    /// `wait`.
    pub fn lend<T>(&self, wait: impl FnOnce() -> T) -> T {
        let Some(length) = HOLDS.get() else {
            return wait();
        };
        self.give_back();
        // Reacquired even if `wait` panics, because the guard of the held core returns it when dropped.
        let _reacquire = Reacquire(self, length);
        wait()
    }

    fn take(&self, length: usize) {
        let mut state = self.lock();
        let ticket = (Reverse(length), state.next_ticket);
        state.next_ticket += 1;
        state.waiting.insert(ticket);
        while state.free == 0 || state.waiting.first() != Some(&ticket) {
            state = self.freed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.waiting.remove(&ticket);
        state.free -= 1;
        if state.free > 0 {
            self.freed.notify_all();
        }
        HOLDS.set(Some(length));
    }

    fn give_back(&self) {
        HOLDS.set(None);
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

struct Reacquire<'a>(&'a Cores, usize);

impl Drop for Reacquire<'_> {
    fn drop(&mut self) {
        self.0.take(self.1);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn computing_is_limited_to_the_cores_and_waiting_needs_none() {
        let (cores, threads) = (Cores::new(2), 8);
        let (computing, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        // Opens only when all threads wait at the same time; with cores held while waiting, the test would not end.
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
                    let _core = cores.hold(1);
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
    fn the_longest_episode_goes_first() {
        let cores = Cores::new(1);
        let order = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            let first = cores.hold(1);
            for (nth, length) in [1, 3, 2, 3].into_iter().enumerate() {
                let (cores, order) = (&cores, &order);
                scope.spawn(move || {
                    let _core = cores.hold(length);
                    order.lock().unwrap().push((length, nth));
                });
                while cores.lock().waiting.len() <= nth {
                    std::thread::yield_now();
                }
            }
            drop(first);
        });
        assert_eq!(*order.lock().unwrap(), [(3, 1), (3, 3), (2, 2), (1, 0)]);
    }

    #[test]
    fn a_panic_while_waiting_loses_no_core() {
        let cores = Cores::new(1);
        let waited = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _core = cores.hold(1);
            cores.lend(|| panic!("the service broke"));
        }));
        assert!(waited.is_err());
        drop(cores.hold(1));
        assert_eq!(cores.lock().free, 1);
    }
}
