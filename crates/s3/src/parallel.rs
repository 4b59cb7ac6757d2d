//! Some files at once.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::S3Error;

/// Does something to each item on some threads; how many were done, and the first error, after which no more are begun.
pub(crate) fn each<T: Sync>(
    items: &[T],
    at_once: usize,
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
        for _ in 0..at_once.clamp(1, items.len().max(1)) {
            scope.spawn(run);
        }
    });
    (done.into_inner(), failed.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()))
}
