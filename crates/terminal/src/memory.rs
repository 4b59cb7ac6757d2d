//! Which allocator the program takes its memory from.

/// jemalloc, which can ask the system for huge pages (2 MiB instead of 4 KiB).
///
/// The renderer goes through lists of 64 KiB to 4 MiB for every picture. With huge pages that takes 5 to 8 % less time.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

/// What jemalloc is told; it reads this before `main` (its manual calls it `malloc_conf`).
///
/// - `thp:always`: huge pages for all memory.
/// - `narenas:4`: four arenas rather than four per core, each of which keeps freed memory for itself.
/// - `dirty_decay_ms:1000`: freed memory goes back to the system within a second rather than ten.
///
/// The last two are for runs of many episodes at once, of which each needs 90 MB for a moment to take its pictures:
/// `genmanip-lab batch --seed 675801 --count 12` holds 530 MB instead of 740.
#[allow(unsafe_code)] // A name for the linker: there is no other way to set this from within the program.
#[unsafe(export_name = "malloc_conf")]
static SETTINGS: &u8 = &b"thp:always,narenas:4,dirty_decay_ms:1000\0"[0];
