//! Cost of a measurement: CPU time and memory.

use cpu_time::{ProcessTime, ThreadTime};

/// CPU time of the calling thread, in seconds since this call; every call of the closure reads it.
pub fn cpu_clock() -> impl FnMut() -> f64 {
    let start = ThreadTime::now();
    move || start.elapsed().as_secs_f64()
}

/// Peak resident memory of this process, MiB; `None` where `/proc` does not tell it (Linux only).
pub(crate) fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kib: f64 =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

/// Resets the peak memory, so that [`peak_memory_mb`] counts from now on.
///
/// Returns true if the system supports it; Linux does.
pub(crate) fn forget_peak_memory() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// CPU time of all threads of this process, in seconds since this call; every call of the closure reads it.
pub(crate) fn process_clock() -> impl FnMut() -> f64 {
    let start = ProcessTime::now();
    move || start.elapsed().as_secs_f64()
}
