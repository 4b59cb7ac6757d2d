//! Parallel processing of files.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::S3Error;

/// Applies `work` to each item on up to `jobs` threads. No item is started after an error. Returns the number of
/// successful items, and the first error if any.
pub(crate) fn each<T: Sync>(
    items: &[T],
    jobs: usize,
    work: &(dyn Fn(&T) -> Result<(), S3Error> + Sync),
) -> (usize, Option<S3Error>) {
    let (next, done, failed) = (AtomicUsize::new(0), AtomicUsize::new(0), Mutex::new(None));
    let run = || {
        while let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed)) {
            match work(item) {
                Ok(()) => {
                    done.fetch_add(1, Ordering::Relaxed);
                }
                Err(error) => {
                    next.store(items.len(), Ordering::Relaxed);
                    failed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).get_or_insert(error);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, items.len().max(1)) {
            scope.spawn(run);
        }
    });
    (done.into_inner(), failed.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()))
}
