//! Files of users and runs: read within bounds, written whole or not at all.
//!
//! Readers never block: what is no file (a pipe, a device, a folder) is refused before it is opened, and no more is read
//! than a [`Limit`] allows, whatever a file says about its size.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use genmanip_core::limits::Limit;

use crate::DataError;
use crate::partial::{self, beside, is_abandoned};

/// A file that a person named; it may be reached through links.
///
/// # Errors
/// [`DataError::Io`], [`DataError::NotAFile`] and [`DataError::TooLarge`].
pub fn read(path: &Path, limit: Limit) -> Result<Vec<u8>, DataError> {
    let about = fs::metadata(path).map_err(DataError::io("read", path))?;
    read_checked(path, &about, limit)
}

/// A file that a run or a store wrote: a link there leads somewhere else and is refused.
///
/// # Errors
/// As [`read`].
pub fn read_own(path: &Path, limit: Limit) -> Result<Vec<u8>, DataError> {
    let about = fs::symlink_metadata(path).map_err(DataError::io("read", path))?;
    read_checked(path, &about, limit)
}

/// Opens a file that a run wrote, to be read piece by piece; no more is read than the limit allows.
///
/// # Errors
/// As [`read_own`].
pub fn open_own(path: &Path, limit: Limit) -> Result<impl Read + use<>, DataError> {
    let about = fs::symlink_metadata(path).map_err(DataError::io("read", path))?;
    Ok(BufReader::with_capacity(PIECE, open_checked(path, &about, limit)?.take(limit.bytes)))
}

/// Opens a list that a person named, to be read line by line; it may be reached through links.
///
/// # Errors
/// [`DataError::Io`] and [`DataError::NotAFile`].
pub fn open_list(path: &Path) -> Result<impl BufRead + use<>, DataError> {
    Ok(BufReader::with_capacity(PIECE, open(path)?))
}

/// Bytes that are read at once of a long file; chosen.
const PIECE: usize = 256 << 10;

/// Opens a file that is read piece by piece; it may be reached through links.
pub(crate) fn open(path: &Path) -> Result<File, DataError> {
    check_is_file(path, &fs::metadata(path).map_err(DataError::io("read", path))?)?;
    let file = File::open(path).map_err(DataError::io("read", path))?;
    // It may have become another between the two calls.
    check_is_file(path, &file.metadata().map_err(DataError::io("read", path))?)?;
    Ok(file)
}

/// Opens what is a file and no larger than the limit.
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
    // It may have grown meanwhile.
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

/// Whether something of a run is there as what it should be: a file, no link to one.
pub fn is_own_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|about| about.is_file())
}

/// Whether a folder of a run is there: a folder, no link to one.
pub fn is_own_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|about| about.is_dir())
}

/// Writes a file aside, flushes it and renames it into place, so that it is whole or not there; missing folders on the
/// way are made. What is there is replaced; a device, or a pipe that somebody reads, is written to as it is.
///
/// # Errors
/// [`DataError::Io`], with the action that failed; [`DataError::NotAFile`] for a folder and a pipe that nobody reads.
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

/// A device or pipe, opened for writing. Whoever opens a pipe that nobody reads would wait for ever.
fn open_device(path: &Path) -> Result<File, DataError> {
    let open = |flags| {
        use std::os::unix::fs::OpenOptionsExt;
        OpenOptions::new().write(true).custom_flags(flags).open(path)
    };
    // Kept until the pipe is open for good, so that its reader sees no end of it in between.
    let without_waiting = open(libc::O_NONBLOCK).map_err(|error| match error.raw_os_error() {
        Some(libc::ENXIO) => DataError::NotAFile { path: path.to_owned(), found: "a pipe that nobody reads" },
        _ => DataError::io("write", path)(error),
    })?;
    let device = open(0).map_err(DataError::io("write", path));
    drop(without_waiting);
    device
}

/// Writes a file as [`write()`] does; it says that it was written at `time`, if there is one.
///
/// # Errors
/// As [`write()`].
pub fn write_as_of(path: &Path, bytes: &[u8], time: Option<SystemTime>) -> Result<(), DataError> {
    let aside = written_aside(path, &mut |out| out.write_all(bytes))?;
    let dated = time.map_or(Ok(()), |time| File::options().write(true).open(&aside)?.set_modified(time));
    dated.and_then(|()| fs::rename(&aside, path)).map_err(|error| {
        let _ = fs::remove_file(&aside);
        DataError::io("write", path)(error)
    })
}

/// The time by the clock that dates the files of a folder, which may be another machine's.
///
/// # Errors
/// When nothing can be written there.
pub fn now_in(folder: &Path) -> Result<SystemTime, DataError> {
    let probe = beside(&folder.join("clock"));
    let dated = write_new(&probe, b"").and_then(|()| fs::metadata(&probe)?.modified());
    let _ = fs::remove_file(&probe);
    dated.map_err(DataError::io("write", &probe))
}

/// Writes a file as [`write()`] does, but only if there is none; `false` when there is one.
///
/// Of several programs that create one file at the same time, exactly one does, and all others find it whole.
///
/// # Errors
/// As [`write()`].
pub fn create(path: &Path, bytes: &[u8]) -> Result<bool, DataError> {
    create_with(path, &mut |out| out.write_all(bytes))
}

/// As [`create`], of what `write` writes piece by piece.
///
/// # Errors
/// As [`write()`], and those of `write`.
pub fn create_with(path: &Path, write: &mut WritePieces) -> Result<bool, DataError> {
    let aside = written_aside(path, write)?;
    // Unlike a rename, a link never replaces.
    let linked = fs::hard_link(&aside, path);
    let created = match linked {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
        // Some file systems know no links; there the last step is not atomic.
        Err(error) if matches!(error.kind(), ErrorKind::Unsupported | ErrorKind::PermissionDenied) => {
            match OpenOptions::new().write(true).create_new(true).open(path) {
                Ok(mut file) => File::open(&aside)
                    .and_then(|mut aside| std::io::copy(&mut aside, &mut file))
                    .and_then(|_| file.sync_all())
                    .map(|()| true),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
                Err(error) => Err(error),
            }
        }
        Err(error) => Err(error),
    };
    let _ = fs::remove_file(&aside);
    created.map_err(DataError::io("write", path))
}

/// Writes to what it is given.
pub type WritePieces<'a> = dyn FnMut(&mut dyn Write) -> std::io::Result<()> + 'a;

fn written_aside(path: &Path, write: &mut WritePieces) -> Result<PathBuf, DataError> {
    if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
    }
    let aside = beside(path);
    let written = write_new_with(&aside, write);
    written.map(|()| aside.clone()).map_err(|error| {
        let _ = fs::remove_file(&aside);
        DataError::io("write", path)(error)
    })
}

/// Whether a name marks a file or folder that is still being written, or that a program left so.
pub fn is_unfinished(name: &str) -> bool {
    partial::is_unfinished(name)
}

/// A file that is written piece by piece and replaces what is there when it is whole; dropped before, nothing is left.
#[derive(Debug)]
pub struct Writing {
    target: PathBuf,
    aside: PathBuf,
    file: File,
    is_finished: bool,
}

impl Writing {
    /// Begins a file that shall appear at `target`; missing folders on the way are made.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn begin(target: &Path) -> Result<Self, DataError> {
        if let Some(parent) = target.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
        }
        let aside = beside(target);
        let file = OpenOptions::new().write(true).create_new(true).open(&aside);
        let file = file.map_err(DataError::io("write", &aside))?;
        Ok(Self { target: target.to_owned(), aside, file, is_finished: false })
    }

    /// Flushes it to the disk and puts it into its place.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn finish(mut self) -> Result<(), DataError> {
        let finished = self.file.sync_all().and_then(|()| fs::rename(&self.aside, &self.target));
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
            let _ = fs::remove_file(&self.aside);
        }
    }
}

/// Writes a file that must not be there yet, so that it is on the disk when this returns; a link is never followed.
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    write_new_with(path, &mut |out| out.write_all(bytes))
}

fn write_new_with(path: &Path, write: &mut WritePieces) -> std::io::Result<()> {
    let mut out = BufWriter::new(OpenOptions::new().write(true).create_new(true).open(path)?);
    write(&mut out)?;
    out.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()
}

/// Gives a file a second name, or copies it where the disk refuses that; there must be none of that name.
pub(crate) fn link_or_copy(from: &Path, to: &Path) -> Result<(), DataError> {
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

/// Removes unfinished files and folders in a folder whose writers certainly died on this host; returns their names,
/// sorted.
///
/// # Errors
/// When the folder cannot be listed, or a leftover cannot be removed.
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

/// Sorted names of the entries of a folder; those that are no UTF-8 are nobody's and left out.
pub(crate) fn names(folder: &Path) -> Result<Vec<String>, DataError> {
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

/// Removes a file, a link or a folder with all it holds; nothing behind a link is touched.
pub(crate) fn remove(path: &Path) -> Result<(), DataError> {
    let removed = if is_own_folder(path) { fs::remove_dir_all(path) } else { fs::remove_file(path) };
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
    fn only_files_within_their_bound_are_read() {
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
            (at("large"), "larger than"),
            (at("folder"), "found a folder"),
            (at("fifo"), "found a pipe or device"),
            ("/dev/zero".into(), "found a pipe or device"),
            (at("gone"), "cannot read"),
        ] {
            let error = read(&path, SMALL).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(read_own(&at("link"), SMALL).unwrap_err().to_string().contains("found a symbolic link"));
    }

    #[test]
    fn one_of_many_creates() {
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
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "nothing else is left");
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
        assert!(!is_own_file(Path::new("/dev/null")), "it is still a device");
        let error = write(Path::new("/dev/full"), b"gone").unwrap_err();
        assert!(error.to_string().contains("cannot write"), "{error}");

        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let error = write(&pipe, b"gone").unwrap_err().to_string();
        assert!(error.contains("a pipe that nobody reads"), "{error}");
        let reader = std::process::Command::new("cat").arg(&pipe).stdout(std::process::Stdio::piped()).spawn().unwrap();
        // The reader needs a moment to open it.
        while write(&pipe, b"told").is_err() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert_eq!(reader.wait_with_output().unwrap().stdout, b"told");
    }
}
