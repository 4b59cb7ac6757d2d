//! How freed memory goes back to the system.

/// Blocks of this size and more are given back as soon as they are freed, bytes.
///
/// A picture of three cameras needs some 90 MB for a moment. The C library keeps such blocks for later, in as many as
/// eight arenas per core, once it has seen one: twelve episodes at once then hold 760 MB instead of 370
/// (`genmanip lab batch --seed 675801 --count 12`).
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE_BYTES: libc::c_int = 1 << 20;

/// Free memory at the end of an arena that is kept for what comes next, bytes: the buffers of a few pictures.
///
/// With the C library's 128 KiB each picture's buffers go back to the system and are cleared anew page by page: a fiftieth
/// of the time that `collect` takes.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT_BYTES: libc::c_int = 16 << 20;

/// Lets the C library keep no large blocks, in an arena per core.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)] // The one foreign call outside of `sim`: there is no other way to say this before memory is used.
pub fn keep_little() {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    // SAFETY: mallopt takes two numbers and touches nothing but the allocator's settings, before other threads exist.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE_BYTES);
        libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT_BYTES);
        libc::mallopt(libc::M_ARENA_MAX, libc::c_int::try_from(cores).unwrap_or(1));
    }
}

/// Elsewhere the allocator is left as it is.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn keep_little() {}
