//! How much room a disk has.

use std::path::Path;

/// Free space on the disk that a folder lies on or, when it is not there yet, would lie on, MiB; `None` where the system
/// does not tell.
#[cfg(unix)]
pub(super) fn free_mib(folder: &Path) -> Option<u64> {
    let whole = std::path::absolute(folder).ok()?;
    let there = whole.ancestors().find(|ancestor| ancestor.is_dir())?;
    let disk = rustix::fs::statvfs(there).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize) >> 20)
}

#[cfg(not(unix))]
pub(super) fn free_mib(_folder: &Path) -> Option<u64> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn the_room_of_a_folder_that_is_not_there_is_that_of_the_one_above() {
        let folder = tempfile::tempdir().unwrap();
        let (here, below) = (free_mib(folder.path()).unwrap(), free_mib(&folder.path().join("a/b")).unwrap());
        // Others write meanwhile.
        assert!(here > 0 && here.abs_diff(below) < here / 10 + 64, "{here} {below}");
    }
}
