//! Bounded reads and atomic writes of files of users and runs.
//!
//! Readers never block: anything but a regular file (a pipe, a device, a folder) is rejected before it is opened, and
//! no more is read than a [`Limit`] allows, regardless of the size the file reports.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use genmanip_core::limits::Limit;

use crate::DataError;
use crate::error::LFS;
use crate::partial::{self, is_abandoned, temporary_path};

/// Reads a file given by the user; symbolic links are followed.
///
/// # Errors
/// [`DataError::Io`], [`DataError::NotAFile`] and [`DataError::TooLarge`].
pub fn read(path: &Path, limit: Limit) -> Result<Vec<u8>, DataError> {
    let about = fs::metadata(path).map_err(DataError::io("read", path))?;
    read_checked(path, &about, limit)
}

/// Reads a file written by a run or a store; symbolic links are rejected.
///
/// # Errors
/// As [`read`].
pub fn read_no_follow(path: &Path, limit: Limit) -> Result<Vec<u8>, DataError> {
    let about = fs::symlink_metadata(path).map_err(DataError::io("read", path))?;
    read_checked(path, &about, limit)
}

/// Opens a file written by a run for streaming; the reader ends at the limit.
///
/// # Errors
/// As [`read_no_follow`].
pub fn open_no_follow(path: &Path, limit: Limit) -> Result<impl Read + use<>, DataError> {
    let about = fs::symlink_metadata(path).map_err(DataError::io("read", path))?;
    Ok(BufReader::with_capacity(BUFFER_BYTES, open_checked(path, &about, limit)?.take(limit.bytes)))
}

/// Opens a file given by the user for reading line by line; symbolic links are followed.
///
/// # Errors
/// [`DataError::Io`] and [`DataError::NotAFile`].
pub fn open_list(path: &Path) -> Result<impl BufRead + use<>, DataError> {
    Ok(BufReader::with_capacity(BUFFER_BYTES, open(path)?))
}

/// Buffer size for streaming, bytes. Chosen by hand.
const BUFFER_BYTES: usize = 256 << 10;

/// First bytes of what a repository holds in place of a large file that was not fetched, and (`LFS_BYTES`) the size that
/// such a pointer stays below.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";
const LFS_BYTES: u64 = 1024;

/// Opens a regular file for streaming; symbolic links are followed, pointers of Git LFS refused.
pub fn open(path: &Path) -> Result<File, DataError> {
    check_is_file(path, &fs::metadata(path).map_err(DataError::io("read", path))?)?;
    let mut file = File::open(path).map_err(DataError::io("read", path))?;
    // The file may have been replaced between the two calls.
    let about = file.metadata().map_err(DataError::io("read", path))?;
    check_is_file(path, &about)?;
    if (LFS_POINTER.len() as u64..LFS_BYTES).contains(&about.len()) {
        let mut start = [0; LFS_POINTER.len()];
        file.read_exact(&mut start).and_then(|()| file.rewind()).map_err(DataError::io("read", path))?;
        if start == LFS_POINTER {
            return Err(DataError::NotAFile { path: path.to_owned(), found: LFS });
        }
    }
    Ok(file)
}

/// Opens a regular file no larger than the limit.
fn open_checked(path: &Path, about: &Metadata, limit: Limit) -> Result<File, DataError> {
    check_is_file(path, about)?;
    if about.len() > limit.bytes {
        return Err(DataError::TooLarge { path: path.to_owned(), limit });
    }
    open(path)
}

fn read_checked(path: &Path, about: &Metadata, limit: Limit) -> Result<Vec<u8>, DataError> {
    let file = open_checked(path, about, limit)?;
    let mut bytes = Vec::with_capacity(usize::try_from(about.len()).unwrap_or(0));
    file.take(limit.bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(DataError::io("read", path))?;
    // The file may have grown meanwhile.
    if bytes.len() as u64 > limit.bytes {
        return Err(DataError::TooLarge { path: path.to_owned(), limit });
    }
    Ok(bytes)
}

fn check_is_file(path: &Path, about: &Metadata) -> Result<(), DataError> {
    if about.is_file() {
        return Ok(());
    }
    let kind = about.file_type();
    let found = if kind.is_dir() {
        "a folder"
    } else if kind.is_symlink() {
        "a symbolic link"
    } else {
        "a pipe or device"
    };
    Err(DataError::NotAFile { path: path.to_owned(), found })
}

/// True for a regular file; false for a link to one.
pub fn is_file_no_follow(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|about| about.is_file())
}

/// True for a folder; false for a link to one.
pub fn is_folder_no_follow(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|about| about.is_dir())
}

/// Writes a file atomically: to a temporary file, synced, then renamed over `path`; creates missing parent folders.
/// Devices and pipes with a reader are written to directly.
///
/// # Errors
/// [`DataError::Io`], with the action that failed; [`DataError::NotAFile`] for a folder or a pipe without a reader.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), DataError> {
    match fs::metadata(path) {
        Ok(about) if about.is_dir() => Err(DataError::NotAFile { path: path.to_owned(), found: "a folder" }),
        Ok(about) if !about.is_file() => {
            let mut device = open_device(path)?;
            device.write_all(bytes).and_then(|()| device.flush()).map_err(DataError::io("write", path))
        }
        _ => write_as_of(path, bytes, None),
    }
}

/// Opens a device or pipe for writing. A blocking open of a pipe without a reader would wait for ever, hence the probe.
fn open_device(path: &Path) -> Result<File, DataError> {
    let open = |flags| {
        use std::os::unix::fs::OpenOptionsExt;
        OpenOptions::new().write(true).custom_flags(flags).open(path)
    };
    // Stays open until the pipe is opened again, so that its reader sees no end of file in between.
    let non_blocking = open(libc::O_NONBLOCK).map_err(|error| match error.raw_os_error() {
        Some(libc::ENXIO) => DataError::NotAFile { path: path.to_owned(), found: "a pipe that nobody reads" },
        _ => DataError::io("write", path)(error),
    })?;
    let device = open(0).map_err(DataError::io("write", path));
    drop(non_blocking);
    device
}

/// As [`write()`], with the modification time set to `time` if given.
///
/// # Errors
/// As [`write()`].
pub fn write_as_of(path: &Path, bytes: &[u8], time: Option<SystemTime>) -> Result<(), DataError> {
    let temporary = write_temporary(path, &mut |out| out.write_all(bytes))?;
    let dated = time.map_or(Ok(()), |time| File::options().write(true).open(&temporary)?.set_modified(time));
    dated.and_then(|()| fs::rename(&temporary, path)).map_err(|error| {
        let _ = fs::remove_file(&temporary);
        DataError::io("write", path)(error)
    })
}

/// Current time according to the file system of a folder, whose server may have a different clock.
///
/// # Errors
/// If no file can be written there.
pub fn now_in(folder: &Path) -> Result<SystemTime, DataError> {
    let probe = temporary_path(&folder.join("clock"));
    let dated = write_new(&probe, b"").and_then(|()| fs::metadata(&probe)?.modified());
    let _ = fs::remove_file(&probe);
    dated.map_err(DataError::io("write", &probe))
}

/// As [`write()`], but only if the file does not exist; returns `false` if it does.
///
/// If several programs create the same file at the same time, exactly one succeeds and the others find a complete file.
///
/// # Errors
/// As [`write()`].
pub fn create(path: &Path, bytes: &[u8]) -> Result<bool, DataError> {
    create_with(path, &mut |out| out.write_all(bytes))
}

/// As [`create`], with the contents streamed by `write`.
///
/// # Errors
/// As [`write()`], and those of `write`.
pub fn create_with(path: &Path, write: &mut WritePieces) -> Result<bool, DataError> {
    let temporary = write_temporary(path, write)?;
    // Unlike a rename, a hard link never replaces an existing file.
    let linked = fs::hard_link(&temporary, path);
    let created = match linked {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
        // Some file systems do not support hard links; there the last step is not atomic.
        Err(error) if matches!(error.kind(), ErrorKind::Unsupported | ErrorKind::PermissionDenied) => {
            match OpenOptions::new().write(true).create_new(true).open(path) {
                Ok(mut file) => File::open(&temporary)
                    .and_then(|mut temporary| std::io::copy(&mut temporary, &mut file))
                    .and_then(|_| file.sync_all())
                    .map(|()| true),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
                Err(error) => Err(error),
            }
        }
        Err(error) => Err(error),
    };
    let _ = fs::remove_file(&temporary);
    created.map_err(DataError::io("write", path))
}

/// Callback that streams the contents of a file to a writer.
pub type WritePieces<'a> = dyn FnMut(&mut dyn Write) -> std::io::Result<()> + 'a;

fn write_temporary(path: &Path, write: &mut WritePieces) -> Result<PathBuf, DataError> {
    if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
    }
    let temporary = temporary_path(path);
    let written = write_new_with(&temporary, write);
    written.map(|()| temporary.clone()).map_err(|error| {
        let _ = fs::remove_file(&temporary);
        DataError::io("write", path)(error)
    })
}

/// True if the name marks an unfinished file or folder: still being written, or left by a program that died.
pub fn is_unfinished(name: &str) -> bool {
    partial::is_unfinished(name)
}

/// Atomic streaming writer: replaces the target when finished; dropped before, it leaves nothing behind.
#[derive(Debug)]
pub struct Writing {
    target: PathBuf,
    temporary: PathBuf,
    file: File,
    is_finished: bool,
}

impl Writing {
    /// Starts a file to be published at `target`; creates missing parent folders.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn begin(target: &Path) -> Result<Self, DataError> {
        if let Some(parent) = target.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        let temporary = temporary_path(target);
        let file = OpenOptions::new().write(true).create_new(true).open(&temporary);
        let file = file.map_err(DataError::io("write", &temporary))?;
        Ok(Self { target: target.to_owned(), temporary, file, is_finished: false })
    }

    /// Syncs the file and renames it to its target.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn finish(mut self) -> Result<(), DataError> {
        let finished = self.file.sync_all().and_then(|()| fs::rename(&self.temporary, &self.target));
        self.is_finished = finished.is_ok();
        finished.map_err(DataError::io("write", &self.target))
    }
}

impl Write for Writing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Drop for Writing {
    fn drop(&mut self) {
        if !self.is_finished {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Writes and syncs a new file; the path must not exist, and links are not followed.
pub fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    write_new_with(path, &mut |out| out.write_all(bytes))
}

fn write_new_with(path: &Path, write: &mut WritePieces) -> std::io::Result<()> {
    let mut out = BufWriter::new(OpenOptions::new().write(true).create_new(true).open(path)?);
    write(&mut out)?;
    out.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()
}

/// Hard-links a file, or copies it if the file system does not support that; `to` must not exist.
pub fn link_or_copy(from: &Path, to: &Path) -> Result<(), DataError> {
    if fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    let copied = File::open(from).and_then(|mut from| {
        let mut to = OpenOptions::new().write(true).create_new(true).open(to)?;
        std::io::copy(&mut from, &mut to)?;
        to.sync_all()
    });
    copied.map_err(DataError::io("write", to))
}

/// Removes the unfinished files and folders in a folder whose writers are known to be dead on this host; returns their
/// names, sorted.
///
/// # Errors
/// If the folder cannot be listed or an entry cannot be removed.
pub fn sweep(folder: &Path) -> Result<Vec<String>, DataError> {
    let mut removed = Vec::new();
    for name in names(folder)? {
        if is_abandoned(&name) {
            remove(&folder.join(&name))?;
            removed.push(name);
        }
    }
    Ok(removed)
}

/// Sorted names of the entries of a folder; names that are not UTF-8 are skipped.
pub fn names(folder: &Path) -> Result<Vec<String>, DataError> {
    let entries = fs::read_dir(folder).map_err(DataError::io("list", folder))?;
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(DataError::io("list", folder))?;
        if let Ok(name) = entry.file_name().into_string() {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Removes a file, a link or a folder tree; links are not followed.
pub fn remove(path: &Path) -> Result<(), DataError> {
    let removed = if is_folder_no_follow(path) { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match removed {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(DataError::io("remove", path)(error)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: Limit = Limit { what: "a test", bytes: 8 };

    #[test]
    fn only_regular_files_within_the_limit_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), b"12345678").unwrap();
        fs::write(at("large"), b"123456789").unwrap();
        fs::create_dir(at("folder")).unwrap();
        std::os::unix::fs::symlink(at("file"), at("link")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("fifo")).status().unwrap().success());
        assert_eq!(read(&at("file"), SMALL).unwrap(), b"12345678");
        assert_eq!(read(&at("link"), SMALL).unwrap(), b"12345678");
        for (path, expected) in [
            (at("large"), "too large"),
            (at("folder"), "found a folder"),
            (at("fifo"), "found a pipe or device"),
            ("/dev/zero".into(), "found a pipe or device"),
            (at("gone"), "cannot read"),
        ] {
            let error = read(&path, SMALL).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(read_no_follow(&at("link"), SMALL).unwrap_err().to_string().contains("found a symbolic link"));
    }

    #[test]
    fn exactly_one_of_concurrent_writers_creates_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("inside/run.json");
        let created: Vec<bool> = std::thread::scope(|scope| {
            let start = |number: u8| {
                let path = &path;
                scope.spawn(move || create(path, &[number; 4096]).unwrap())
            };
            (0..8).map(start).collect::<Vec<_>>().into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert_eq!(created.iter().filter(|created| **created).count(), 1);
        let bytes = fs::read(&path).unwrap();
        assert!(bytes.len() == 4096 && bytes.iter().all(|byte| *byte == bytes[0]));
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no temporary file remains");
    }

    #[test]
    fn links_are_replaced_and_devices_stay() {
        let folder = tempfile::tempdir().unwrap();
        let (outside, link) = (folder.path().join("outside"), folder.path().join("link"));
        fs::write(&outside, b"mine").unwrap();
        std::os::unix::fs::symlink(&outside, &link).unwrap();
        write(&link, b"new").unwrap();
        assert_eq!((fs::read(&outside).unwrap(), fs::read(&link).unwrap()), (b"mine".to_vec(), b"new".to_vec()));
        write(Path::new("/dev/null"), b"gone").unwrap();
        assert!(!is_file_no_follow(Path::new("/dev/null")), "it is still a device");
        let error = write(Path::new("/dev/full"), b"gone").unwrap_err();
        assert!(error.to_string().contains("cannot write"), "{error}");

        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let error = write(&pipe, b"gone").unwrap_err().to_string();
        assert!(error.contains("a pipe that nobody reads"), "{error}");
        let reader = std::process::Command::new("cat").arg(&pipe).stdout(std::process::Stdio::piped()).spawn().unwrap();
        // The reader needs a moment to open the pipe.
        while write(&pipe, b"told").is_err() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert_eq!(reader.wait_with_output().unwrap().stdout, b"told");
    }
}
