//! Defects of the program: a panic in any thread becomes one message with its place.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{ExitStatus, Failed};

/// Place and message of the latest panic that nobody has seen.
static LATEST: Mutex<Option<String>> = Mutex::new(None);
/// Starts of the names of threads that answer requests: a server goes on after their panics, which are shown at once.
const SERVING: [&str; 2] = ["tokio", "serving"];

/// Runs the body of a program; a panic is its failure, also one in a thread whose end was not noticed.
pub fn guarded(body: impl FnOnce() -> Result<ExitStatus, Failed>) -> Result<ExitStatus, Failed> {
    let usual: Arc<dyn Fn(&PanicHookInfo<'_>) + Send + Sync> = Arc::from(std::panic::take_hook());
    let is_detailed = std::env::var_os("RUST_BACKTRACE").is_some();
    let shown = Arc::clone(&usual);
    std::panic::set_hook(Box::new(move |panic| {
        let thread = std::thread::current();
        let is_serving = thread.name().is_some_and(|name| SERVING.iter().any(|start| name.starts_with(start)));
        if is_serving || is_detailed {
            shown(panic);
        }
        if !is_serving {
            keep(panic);
        }
    }));
    let done = catch_unwind(AssertUnwindSafe(body));
    std::panic::set_hook(Box::new(move |panic| usual(panic)));
    let latest = LATEST.lock().unwrap_or_else(PoisonError::into_inner).take();
    let defect = |place: &str| {
        Err(Failed::new(format!("a defect of this program: {place}"))
            .hint("please report it, with the command and its input; RUST_BACKTRACE=1 shows where it arose"))
    };
    match (done, latest) {
        (Err(_), latest) => defect(&latest.unwrap_or_default()),
        (Ok(Ok(_)), Some(latest)) => defect(&latest),
        (Ok(done), _) => done,
    }
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
    fn a_panic_of_any_thread_is_one_message() {
        let waited = || {
            std::thread::scope(|scope| {
                scope.spawn(|| panic!("no such corner"));
            });
            Ok(ExitStatus::Done)
        };
        let unnoticed = || {
            drop(std::thread::spawn(|| panic!("no such corner")).join());
            Ok(ExitStatus::Done)
        };
        let own = || panic!("no such corner");
        for done in [guarded(waited), guarded(unnoticed), guarded(own)] {
            let said = done.unwrap_err().to_string();
            assert!(said.starts_with("error: a defect of this program: no such corner at "), "{said}");
            assert!(said.contains("defect.rs"), "{said}");
        }
        // One message per defect; servers go on.
        let serving = || {
            let thread = std::thread::Builder::new().name("serving".into());
            drop(thread.spawn(|| panic!("a request")).map(std::thread::JoinHandle::join));
            Ok(ExitStatus::NotMet)
        };
        assert!(matches!(guarded(serving), Ok(ExitStatus::NotMet)));
    }
}
