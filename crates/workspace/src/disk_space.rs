//! Free disk space, and an estimate of the space that a run needs.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use crate::documents;
use crate::error::WorkspaceError;
use crate::progress::Progress;

/// Number of finished attempts from which the disk space of the rest is estimated: one of each kind of task.
pub const SAMPLE: usize = 6;
/// Minimum number of attempts for which the estimate is reported. Chosen by hand: shorter runs end soon.
const TOLD: usize = 100;

/// Estimate of the disk space that a run needs, made once [`SAMPLE`] attempts are finished.
pub struct Estimate<'a> {
    folder: &'a Path,
    /// Number of attempts that the run makes.
    attempts: usize,
    /// Copies of an attempt's files that the finished run holds: 2 with a dataset, else 1.
    copies: u64,
    made: AtomicUsize,
    bytes: AtomicU64,
}

impl<'a> Estimate<'a> {
    /// Estimate for `attempts` attempts of the run in `folder`. With a data set (`has_dataset`) their images are stored
    /// twice.
    pub fn new(folder: &'a Path, attempts: usize, has_dataset: bool) -> Self {
        let copies = if has_dataset { 2 } else { 1 };
        Self { folder, attempts, copies, made: AtomicUsize::new(0), bytes: AtomicU64::new(0) }
    }

    /// Counts a finished attempt; its folder is measured only until the sample is complete.
    ///
    /// # Errors
    /// When the attempt completes the sample and the disk has too little space for the rest.
    pub fn add(&self, attempt: &Path, progress: &dyn Progress) -> Result<(), WorkspaceError> {
        if self.made.load(Ordering::Relaxed) >= SAMPLE {
            return Ok(());
        }
        self.add_bytes(bytes_below(attempt), progress)
    }

    fn add_bytes(&self, bytes: u64, progress: &dyn Progress) -> Result<(), WorkspaceError> {
        let bytes = self.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        let made = self.made.fetch_add(1, Ordering::Relaxed) + 1;
        if made != SAMPLE || made >= self.attempts {
            return Ok(());
        }
        let left = (self.attempts - made) as u64;
        // The sample's own files exist already; of these attempts only the copy in the data set is still to be written.
        let need = bytes / made as u64 * left * self.copies + bytes * (self.copies - 1);
        let Some(free) = free_mib(self.folder) else { return Ok(()) };
        let need = need >> 20;
        let told = format!("the {left} attempts left will take some {need} MiB, and the disk has {free} MiB");
        if need > free {
            let hint = "what was made is kept; make room, or choose another --out or fewer --episodes, and start again";
            return Err(WorkspaceError::input(format!("{told}: {}", self.folder.display())).with_hint(hint));
        }
        if self.attempts >= TOLD {
            progress.note(&told);
        }
        Ok(())
    }
}

/// Total size of all files below a folder, bytes.
pub fn bytes_below(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |entry: fs::DirEntry| match entry.file_type() {
        Ok(kind) if kind.is_dir() => bytes_below(&entry.path()),
        _ => entry.metadata().map_or(0, |about| about.len()),
    };
    entries.map(bytes).sum()
}

/// Free space on the file system of a folder or, if the folder does not exist, of its nearest existing parent, MiB;
/// `None` if the system does not report it.
#[cfg(unix)]
pub fn free_mib(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(&documents::nearest_folder(folder)?).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize) >> 20)
}

#[cfg(not(unix))]
pub fn free_mib(_folder: &Path) -> Option<u64> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::progress::NoProgress;

    #[test]
    fn what_will_not_fit_is_refused_once_the_sample_is_made() {
        let folder = tempfile::tempdir().unwrap();
        let check = |attempts: usize, bytes: u64, expected: Option<&str>| {
            let estimate = Estimate::new(folder.path(), attempts, true);
            let added: Vec<_> = (0..SAMPLE + 1).map(|_| estimate.add_bytes(bytes, &NoProgress)).collect();
            for (made, added) in added.into_iter().enumerate() {
                let error = added.err().map(|error| error.to_string());
                let expected = expected.filter(|_| made + 1 == SAMPLE);
                assert_eq!(error.is_some(), expected.is_some(), "{attempts} of {bytes}: {error:?}");
                assert!(error.unwrap_or_default().contains(expected.unwrap_or_default()));
            }
        };
        check(1_000, 1 << 10, None);
        // No disk has a pebibyte. Needed: 94 attempts twice, and the six of the sample once more.
        check(100, 1 << 50, Some("the 94 attempts left will take some 208305913856 MiB"));
        check(SAMPLE, 1 << 50, None);
    }

    #[test]
    fn the_room_of_a_folder_that_is_not_there_is_that_of_the_one_above() {
        let folder = tempfile::tempdir().unwrap();
        let (here, below) = (free_mib(folder.path()).unwrap(), free_mib(&folder.path().join("a/b")).unwrap());
        // Tolerance, since other programs write to the disk meanwhile.
        assert!(here > 0 && here.abs_diff(below) < here / 10 + 64, "{here} {below}");
    }
}
