//! Defects of the program: a panic in any thread becomes one message with its place.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{ExitStatus, Failed};

/// Place and message of the latest panic.
static LATEST: Mutex<Option<String>> = Mutex::new(None);

/// Runs the body of a program; a panic is its failure.
pub fn guarded(body: impl FnOnce() -> Result<ExitStatus, Failed>) -> Result<ExitStatus, Failed> {
    let usual: Arc<dyn Fn(&PanicHookInfo<'_>) + Send + Sync> = Arc::from(std::panic::take_hook());
    let is_detailed = std::env::var_os("RUST_BACKTRACE").is_some();
    let shown = Arc::clone(&usual);
    std::panic::set_hook(Box::new(move |panic| {
        keep(panic);
        if is_detailed {
            shown(panic);
        }
    }));
    let done = catch_unwind(AssertUnwindSafe(body));
    std::panic::set_hook(Box::new(move |panic| usual(panic)));
    done.unwrap_or_else(|_| {
        let place = LATEST.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default();
        Err(Failed::new(format!("a defect of this program: {place}"))
            .hint("please report it, with the command and its input; RUST_BACKTRACE=1 shows where it arose"))
    })
}

fn keep(panic: &PanicHookInfo<'_>) {
    let message = panic.payload_as_str().unwrap_or("no message");
    // The thread that waits for the one that panicked.
    if message == "a scoped thread panicked" {
        return;
    }
    let place = panic.location().map_or_else(String::new, |at| format!(" at {}:{}", at.file(), at.line()));
    *LATEST.lock().unwrap_or_else(PoisonError::into_inner) = Some(format!("{message}{place}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_a_worker_is_one_message() {
        let done = guarded(|| {
            std::thread::scope(|scope| {
                scope.spawn(|| panic!("no such corner"));
            });
            Ok(ExitStatus::Done)
        });
        let said = done.unwrap_err().to_string();
        assert!(
            said.starts_with("error: a defect of this program: no such corner at ") && said.contains("defect.rs"),
            "{said}"
        );
        assert!(guarded(|| Ok(ExitStatus::NotMet)).is_ok());
    }
}
