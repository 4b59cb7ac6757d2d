//! Damaged files on which a library panics instead of saying what is wrong.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::Once;

use crate::DataError;

thread_local! {
    /// Whether a panic of this thread is an answer to be read, and not to be printed.
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}
static QUIET: Once = Once::new();

/// Lets a library read something of a file; a panic there means that the file is damaged.
///
/// For parquet 60.1, which panics on pages that lack their dictionary, among others (found by `lab hostile`).
pub(crate) fn guarded<T>(path: &Path, read: impl FnOnce() -> T) -> Result<T, DataError> {
    QUIET.call_once(|| {
        let told = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                told(panic);
            }
        }));
    });
    IS_GUARDED.set(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(read));
    IS_GUARDED.set(false);
    outcome.map_err(|panic| {
        let texts = (panic.downcast_ref::<&str>().copied(), panic.downcast_ref::<String>());
        let said = texts.0.or(texts.1.map(String::as_str)).unwrap_or("no reason");
        DataError::table(path, format!("damaged, so that it cannot be decoded ({said})"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_that_names_the_file() {
        let path = Path::new("episodes/frames.parquet");
        assert_eq!(guarded(path, || 7).unwrap(), 7);
        let count = [1, 2, 3].len();
        let error = guarded(path, || assert!(count == 4, "no dictionary for page {count}")).unwrap_err().to_string();
        assert!(error.contains("frames.parquet") && error.contains("no dictionary for page 3"), "{error}");
        // Panics elsewhere are told as ever.
        assert!(panic::catch_unwind(|| assert!(count == 4)).is_err());
    }
}
