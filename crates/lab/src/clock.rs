//! What a measurement costs: processor time and memory.

use cpu_time::{ProcessTime, ThreadTime};

/// A clock of this thread's processor time, in seconds since it was made.
pub fn cpu_clock() -> impl FnMut() -> f64 {
    let start = ThreadTime::now();
    move || start.elapsed().as_secs_f64()
}

/// Most memory that this process has held so far, MiB; known on Linux only.
pub(crate) fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kib: f64 =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

/// Forgets the most memory that this process has held so far, so that [`peak_memory_mb`] counts from now on.
///
/// Returns whether the system allows it; Linux does.
pub(crate) fn forget_peak_memory() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// A clock of the processor time of all threads, in seconds since it was made.
pub(crate) fn process_clock() -> impl FnMut() -> f64 {
    let start = ProcessTime::now();
    move || start.elapsed().as_secs_f64()
}
