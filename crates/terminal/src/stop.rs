//! Ctrl-C: work in progress is finished, and finished work is kept.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Flag set by the first Ctrl-C; the second one ends the process immediately with exit code 130, which may leave
/// partial files that no command reads.
pub fn on_interrupt() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    // If no handler can be installed, Ctrl-C simply ends the process, which is safe too.
    let _ = ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        use std::io::Write;
        let _ = writeln!(std::io::stderr(), "finishing the attempts in progress; press Ctrl-C again to stop at once");
    });
    flag
}
