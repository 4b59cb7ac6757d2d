//! Temporary file names that identify the writing process, and detection of dead writers.
//!
//! Format: `.NAME.partial-HOST-BOOT-PID-START-NUMBER`. Several processes, threads and hosts may write into one folder,
//! also on a shared disk. Only files of processes on *this* host that are known to be dead are ever removed.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use genmanip_core::hexadecimal;
use sha2::{Digest, Sha256};

/// Separator of the target's name and the writer's id.
const MARK: &str = ".partial-";

/// A temporary name beside `target`, unique among all writers on all hosts.
pub fn temporary_path(target: &Path) -> PathBuf {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let name = target.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    // File names are limited to 255 bytes, some of which the suffix needs.
    let name: String = name.chars().take(200).collect();
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    target.with_file_name(format!(".{name}{MARK}{}-{number}", Writer::of_this_program().encode()))
}

/// True for a temporary name of any writer.
pub fn is_unfinished(name: &str) -> bool {
    name.starts_with('.') && name.rsplit_once(MARK).is_some_and(|(_, writer)| Writer::parse(writer).is_some())
}

/// True for a temporary name whose writer is known to be dead.
pub fn is_abandoned(name: &str) -> bool {
    let Some((_, writer)) = name.rsplit_once(MARK).filter(|_| name.starts_with('.')) else { return false };
    let Some(writer) = Writer::parse(writer) else { return false };
    writer.has_died(Writer::of_this_program(), &|pid| start_of(&pid.to_string()))
}

/// Identity of a process, as visible to other processes.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Writer {
    /// Hash of host name, machine id and PID namespace.
    host: String,
    /// Hash of the boot id.
    boot: String,
    pid: u32,
    /// Start time in clock ticks since boot; distinguishes processes that reuse a PID.
    start: u64,
}

impl Writer {
    fn of_this_program() -> &'static Self {
        static WRITER: OnceLock<Writer> = OnceLock::new();
        WRITER.get_or_init(|| {
            let text = |path: &str| fs::read_to_string(path).unwrap_or_default();
            let namespace = fs::read_link("/proc/self/ns/pid").unwrap_or_default();
            let host =
                format!("{}\n{}\n{}", text("/proc/sys/kernel/hostname"), text("/etc/machine-id"), namespace.display());
            let boot = text("/proc/sys/kernel/random/boot_id");
            Self {
                host: digits(&host),
                boot: digits(&boot),
                pid: std::process::id(),
                start: start_of("self").unwrap_or(0),
            }
        })
    }

    fn encode(&self) -> String {
        format!("{}-{}-{}-{}", self.host, self.boot, self.pid, self.start)
    }

    /// Parses a writer id followed by a counter. `None` for other texts.
    fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split('-');
        let (host, boot) = (parts.next()?.to_owned(), parts.next()?.to_owned());
        let (pid, start) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        parts.next()?.parse::<u64>().ok()?;
        parts.next().is_none().then_some(Self { host, boot, pid, start })
    }

    /// True if the process is known to be dead, judged from the process `here`; `start_of` returns the start time of a
    /// running process.
    fn has_died(&self, here: &Self, start_of: &dyn Fn(u32) -> Option<u64>) -> bool {
        // Without /proc, start times are unknown (0), and no process counts as dead.
        let knows = here.start > 0 && self.start > 0;
        knows && self.host == here.host && (self.boot != here.boot || start_of(self.pid) != Some(self.start))
    }
}

/// Start time of a process, clock ticks since boot; `None` if it does not exist.
fn start_of(pid: &str) -> Option<u64> {
    let stat = fs::read_to_string(Path::new("/proc").join(pid).join("stat")).ok()?;
    // Field 2 is the program's name in brackets and may contain spaces and brackets; the start time is field 22.
    stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
}

/// First eight hex digits of the SHA-256 of a text.
fn digits(text: &str) -> String {
    hexadecimal(&Sha256::digest(text.as_bytes())[..4])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_dead_processes_on_this_host_are_abandoned() {
        let here = Writer { host: "aa".into(), boot: "b1".into(), pid: 7, start: 70 };
        let running = |pid: u32| [(7, 70), (8, 80)].iter().find(|(known, _)| *known == pid).map(|(_, start)| *start);
        for (name, expected) in [
            ("aa-b1-7-70-0", false), // this process
            ("aa-b1-8-80-3", false), // another running process
            ("aa-b1-8-20-3", true),  // its PID has been reused
            ("aa-b1-9-90-3", true),  // ended
            ("aa-b0-8-80-3", true),  // before the last boot
            ("cc-b1-9-90-3", false), // another host, container or cluster node
            ("aa-b1-9-0-3", false),  // unknown start time
            ("4194999", false),      // format of an older version
            ("aa-b1-9-90", false),
            ("aa-b1-9-90-3-1", false),
        ] {
            let died = Writer::parse(name).is_some_and(|writer| writer.has_died(&here, &running));
            assert_eq!(died, expected, "{name}");
        }
    }

    #[test]
    fn names_are_hidden_different_and_short_enough() {
        let target = Path::new("somewhere").join("é".repeat(120));
        let (a, b) = (temporary_path(&target), temporary_path(&target));
        assert_ne!(a, b);
        for path in [a, b] {
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(name.starts_with('.') && name.len() <= 255 + 80, "{name}");
            assert!(is_unfinished(name) && !is_abandoned(name), "this process is running");
        }
    }
}
