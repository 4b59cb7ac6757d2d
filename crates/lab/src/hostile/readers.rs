//! Cost of every reader on files at its size limit.

use std::fs;

use genmanip_core::limits::{self, Limit};
use genmanip_data::EpisodeStore;
use serde::Serialize;

use super::child::{self, Limits};
use super::corpus::Corpus;
use super::{HostileArguments, Sandbox};
use crate::LabError;

/// Cost of a reader on a file at its size limit.
#[derive(Clone, Debug, Serialize)]
pub struct Reader {
    /// Call or file that is read.
    pub file: String,
    /// Size limit of the file, as text.
    pub limit: String,
    /// Description of the file's content.
    pub filled_with: String,
    /// Outcome: accepted, refused, or the violation.
    pub outcome: &'static str,
    /// CPU time of the call, s.
    pub cpu_s: f64,
    /// Peak resident memory of the call, MiB.
    pub peak_mib: u64,
}

/// Raised memory limit, to measure readers that exceed theirs.
const WIDE: Limits = Limits { memory_mib: 6144, cpu_s: 60, idle_s: 60 };
/// The call that reads the frames of an episode.
const FRAMES: &str = "replay long --strip film.jpg";
/// Maximum length of the reported content, characters. Chosen by hand.
const TOLD: usize = 40;

/// Measures every reader with each of its contents.
pub(super) fn measure(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    corpus: &Corpus,
) -> Result<Vec<Reader>, LabError> {
    let mut readers = Vec::new();
    for filling in corpus.fillings() {
        sandbox.fill(&corpus.filled(filling)?)?;
        let told: String = filling.unit.trim().chars().take(TOLD).collect();
        readers.push(call(arguments, sandbox, (&filling.file, filling.limit, told), filling.call)?);
    }
    let told = long_episode(sandbox, corpus)?;
    readers.push(call(arguments, sandbox, ("long/021_spatial-000/frames.parquet", limits::FRAMES, told), FRAMES)?);
    sandbox.clear()?;
    Ok(readers)
}

fn call(
    arguments: &HostileArguments,
    sandbox: &Sandbox,
    (file, limit, filled_with): (&str, Limit, String),
    words: &str,
) -> Result<Reader, LabError> {
    let words: Vec<String> = words.split(' ').map(String::from).collect();
    let ended = child::run(arguments, &words, sandbox, WIDE)?;
    let outcome = match ended.code {
        _ if ended.is_over_memory() => "needs more than 6 GiB",
        _ if ended.is_hanging() => "needs more than 60 s",
        _ if ended.has_panicked() => "panics",
        Some(0) => "taken",
        _ => "refused",
    };
    let (file, limit) = (file.to_owned(), limit.human_readable());
    Ok(Reader { file, limit, filled_with, outcome, cpu_s: ended.cpu_s, peak_mib: ended.peak_mib })
}

/// Writes an episode with motion and frames up to the size limit of frames; returns a description of it.
fn long_episode(sandbox: &Sandbox, corpus: &Corpus) -> Result<String, LabError> {
    sandbox.fill(&corpus.run_of_two()?)?;
    let broken = |error| LabError::broken("a long episode cannot be made", error);
    let id = "021_spatial-000";
    let mut episode =
        EpisodeStore::open(sandbox.work().join("run/episodes")).and_then(|s| s.read(id)).map_err(broken)?;
    let path = sandbox.work().join("run/episodes").join(id).join("frames.parquet");
    let bytes = fs::metadata(&path).map_err(|error| LabError::file("read", &path, error))?.len();
    // Compressed blocks differ in size, so the number of frames aims at 98 % of the limit.
    let count = (limits::FRAMES.bytes as f64 * 0.98 / bytes as f64 * episode.frames.len() as f64) as usize;
    episode.frames = episode.frames.iter().cycle().take(count).cloned().collect();
    episode.result.frames = count;
    let long = EpisodeStore::create(sandbox.work().join("long")).map_err(broken)?;
    long.write(&episode, &[]).map_err(broken)?;
    Ok(format!("{count} frames"))
}
