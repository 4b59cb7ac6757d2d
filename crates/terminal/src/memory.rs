//! Memory allocator of the programs.

/// Jemalloc, which can request huge pages (2 MiB instead of 4 KiB) from the system.
///
/// The renderer scans buffers of 64 KiB to 4 MiB for every image; huge pages make that 5 to 8 % faster.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

/// Options of jemalloc, which reads them before `main` (`malloc_conf` in its manual).
///
/// - `thp:always`: huge pages for all memory.
/// - `narenas:4`: four arenas instead of four per core, each of which keeps freed memory.
/// - `dirty_decay_ms:1000`: freed memory is returned to the system within a second instead of ten.
///
/// The last two are for many concurrent episodes, each of which briefly needs 90 MB to render its images: `genmanip-lab
/// batch --seed 675801 --count 12` uses 530 MB instead of 740.
#[allow(unsafe_code)] // A name for the linker: there is no other way to set this from within the program.
#[unsafe(export_name = "malloc_conf")]
static SETTINGS: &u8 = &b"thp:always,narenas:4,dirty_decay_ms:1000\0"[0];
