//! Number of worker threads.

/// Requested number of worker threads, or the number of cores; at least 1.
pub fn workers(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)).max(1)
}
