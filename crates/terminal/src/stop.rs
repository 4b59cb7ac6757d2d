//! Ctrl-C: finish what is under way, keep what is finished.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that the first Ctrl-C raises; the second ends the program at once (nothing half-written is ever read).
pub fn on_interrupt() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    // Without a handler Ctrl-C simply ends the program, which is safe too.
    let _ = ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        use std::io::Write;
        let _ = writeln!(std::io::stderr(), "finishing the attempts under way; press Ctrl-C again to stop at once");
    });
    flag
}
