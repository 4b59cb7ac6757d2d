//! Worker process: reads inputs one after the other until its CPU time is over, or until one ends the process.

use std::fs::{self, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;

use crate::Failure;
use crate::input::Input;
use crate::targets::Target;

/// Maximum CPU time of one input, s, and maximum time without an answer, s, for readers that wait.
pub const MAX_CPU_S: u64 = 10;
pub const MAX_WAIT_S: u64 = 120;
/// Exit code of a worker whose input takes too long.
pub const TIMED_OUT: i32 = 124;

/// Progress of a worker, kept in a file that survives its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Number of the current input.
    pub index: u64,
    /// CPU time used so far, ms.
    pub cpu_ms: u64,
    /// Accepted inputs.
    pub accepted: u64,
}

impl Progress {
    /// Reads the file of a worker that has ended.
    ///
    /// # Errors
    /// If the worker ended before its first input.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let bytes = fs::read(path)?;
        let number = |place: usize| -> Result<u64, Failure> {
            let word = bytes.get(8 * place..8 * place + 8).ok_or("the worker ended before its first input")?;
            Ok(u64::from_le_bytes(word.try_into()?))
        };
        Ok(Self { index: number(0)?, cpu_ms: number(1)?, accepted: number(2)? })
    }

    fn to_bytes(self) -> Vec<u8> {
        [self.index, self.cpu_ms, self.accepted].iter().flat_map(|number| number.to_le_bytes()).collect()
    }
}

/// Reads inputs from number `from` on for some CPU time.
///
/// # Errors
/// If the corpus or the progress file cannot be made.
pub fn run(target: &'static Target, budget_s: f64, seed: u64, from: u64, progress: &Path) -> Result<(), Failure> {
    let file = OpenOptions::new().write(true).create(true).truncate(true).open(progress)?;
    let mut opened = (target.open)(target.name, &crate::repository())?;
    let current = Arc::new(AtomicU64::new(from));
    watch(Arc::clone(&current));
    let start = ProcessTime::now();
    let mut done = Progress::default();
    for index in from.. {
        let elapsed = start.elapsed();
        done = Progress { index, cpu_ms: elapsed.as_millis() as u64, ..done };
        current.store(index, Ordering::Relaxed);
        file.write_all_at(&done.to_bytes(), 0)?;
        if elapsed.as_secs_f64() >= budget_s {
            break;
        }
        let input = Input::mutated(target, &opened.corpus, seed, index);
        done.accepted += u64::from((opened.read)(&input).is_ok());
    }
    Ok(())
}

/// Ends the process when one input takes too long.
fn watch(current: Arc<AtomicU64>) {
    std::thread::spawn(move || {
        let (mut index, mut cpu, mut wall) = (u64::MAX, ProcessTime::now(), Instant::now());
        loop {
            let now = current.load(Ordering::Relaxed);
            if now != index {
                (index, cpu, wall) = (now, ProcessTime::now(), Instant::now());
            } else if cpu.elapsed().as_secs() >= MAX_CPU_S || wall.elapsed().as_secs() >= MAX_WAIT_S {
                std::process::exit(TIMED_OUT);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    });
}
