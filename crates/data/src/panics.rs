//! Turns panics of decoding libraries on damaged files into errors.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;

use crate::DataError;

thread_local! {
    /// True while a panic of this thread is caught and must not be printed.
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}
static QUIET: Once = Once::new();

/// Runs a decoder on a file; a panic is reported as a damaged file.
///
/// Needed for parquet 60.1, which panics e.g. on pages that lack their dictionary (found by fuzzing).
///
/// # Errors
/// If the decoder panics.
pub fn catch_panics<T>(path: &Path, read: impl FnOnce() -> T) -> Result<T, DataError> {
    caught(read).map_err(|message| DataError::table(path, format!("damaged, cannot be decoded ({message})")))
}

/// Runs a decoder; a panic is not printed.
///
/// # Errors
/// The message of a panic.
pub fn caught<T>(read: impl FnOnce() -> T) -> Result<T, String> {
    QUIET.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                previous(panic);
            }
        }));
    });
    let is_outer = IS_GUARDED.replace(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(read));
    IS_GUARDED.set(is_outer);
    outcome.map_err(|panic| {
        let texts = (panic.downcast_ref::<&str>().copied(), panic.downcast_ref::<String>());
        texts.0.or(texts.1.map(String::as_str)).unwrap_or("no reason").to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_that_names_the_file() {
        let path = Path::new("episodes/frames.parquet");
        assert_eq!(catch_panics(path, || 7).unwrap(), 7);
        let count = [1, 2, 3].len();
        let error =
            catch_panics(path, || assert!(count == 4, "no dictionary for page {count}")).unwrap_err().to_string();
        assert!(error.contains("frames.parquet") && error.contains("no dictionary for page 3"), "{error}");
        // The guard has ended: other panics are printed as usual.
        assert!(panic::catch_unwind(|| assert!(count == 4)).is_err());
    }
}
