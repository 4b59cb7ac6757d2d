//! Maximum sizes of input files, for every reader.
//!
//! Each limit is several times the largest useful file of its kind, and so small that reading takes at most 1 GB of
//! memory and 10 s, as measured by `genmanip-lab hostile`.

/// Maximum size of one kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// Kind of file, with its article: `a task`.
    pub what: &'static str,
    /// Limit, bytes.
    pub bytes: u64,
}

impl Limit {
    const fn kib(what: &'static str, kib: u64) -> Self {
        Self { what, bytes: kib << 10 }
    }

    const fn mib(what: &'static str, mib: u64) -> Self {
        Self::kib(what, mib << 10)
    }

    /// Human-readable size, e.g. `16 MiB`.
    pub fn human_readable(self) -> String {
        match self.bytes {
            0..=1023 => format!("{} bytes", self.bytes),
            1024..=0xf_ffff => format!("{} KiB", self.bytes >> 10),
            _ => format!("{} MiB", self.bytes >> 20),
        }
    }
}

/// A task document or a recorded answer; the examples are below 20 KiB.
pub const TASK: Limit = Limit::mib("a task or recorded answer", 4);
/// A scenario with its world; typically below 100 KiB.
pub const SCENARIO: Limit = Limit::mib("a scenario", 8);
/// The log of a scenario's edits: the scenario, and up to 10 KiB per edit.
pub const EDITS: Limit = Limit::mib("a log of edits", 192);
/// The log of reviews: up to 4 KiB per review.
pub const REVIEWS: Limit = Limit::mib("a log of reviews", 192);
/// A world, TOML or JSON, typically below 20 KiB; TOML tables take about 400 times their size in memory.
pub const WORLD: Limit = Limit::mib("a world", 2);
/// A file with cameras: a world or a scenario.
pub const WORLD_OR_SCENARIO: Limit = Limit::mib("a world or scenario", 8);
/// A list of cameras, JSON.
pub const CAMERAS: Limit = Limit::mib("a list of cameras", 1);
/// Settings of a language model, TOML.
pub const SETTINGS: Limit = Limit::mib("a settings file", 1);
/// A prompt for a language model, or a schema of its answers; the built-in ones are below 20 KiB.
pub const PROMPT: Limit = Limit::mib("a prompt", 1);
/// A recorded exchange with a model or service; images are stored as hashes.
pub const CASSETTE: Limit = Limit::mib("a cassette", 32);
/// `run.json`: all tasks of a run, 9 KiB each. It is streamed task by task at 64 MiB/s or faster, so a longer file
/// takes more time but no more memory.
pub const RUN: Limit = Limit::mib("the record of a run", 16 << 10);
/// Maximum number of tasks of a run; their names are held in memory, 100 bytes each.
pub const TASKS: usize = 1_000_000;
/// Maximum number of entries of any other streamed list, however small the entries are.
pub const ENTRIES: usize = 100_000;
/// `suite.json` and its review record, 10 KiB per scenario.
pub const SUITE: Limit = Limit::mib("the list of a suite", 192);
/// A chunk of a zarr array.
pub const CHUNK: Limit = Limit::mib("a chunk of an array", 192);
/// The ledger of finished work items of a command, 100 to 500 bytes each.
pub const LEDGER: Limit = Limit::mib("the list of what is finished", 192);
/// The index of a run's episodes, 500 bytes to 1 KiB each.
pub const INDEX: Limit = Limit::mib("the index of a run", 192);
/// `timings.json` of a run: two numbers per attempt.
pub const TIMINGS: Limit = Limit::mib("the timings of a run", 16);
/// A results file of an evaluation, 3 to 5 KiB per episode.
pub const EVALUATION: Limit = Limit::mib("an evaluation", 192);
/// A table of success rates in simulation and reality, CSV; a row is below 100 bytes.
pub const RATES: Limit = Limit::mib("a table of success rates", 4);
/// Views of a calibration board: 144 corners per view take 10 KiB.
pub const VIEWS: Limit = Limit::mib("a list of views of a calibration board", 64);
/// The file that identifies an evaluation in progress, so that only the same one is continued.
pub const IDENTITY: Limit = Limit::mib("the identity of an evaluation", 4);
/// Results of an evaluation in progress, one per line.
pub const RESULTS: Limit = Limit::mib("the results of an unfinished evaluation", 192);
/// Maximum length of a line of [`RESULTS`]; a result lists every condition of its goal.
pub const RESULT_LINE: Limit = Limit::mib("a result", 1);
/// Grasps with the results of their physics trials; those of the catalogue take 1 MiB.
pub const GRASPS: Limit = Limit::mib("a file of tried grasps", 16);
/// Motion problems, 500 bytes to 3 KiB each.
pub const PROBLEMS: Limit = Limit::mib("a file of motion problems", 16);
/// Recorded cases of spatial relations, JSON.
pub const CASES: Limit = Limit::mib("a file of recorded cases", 16);
/// Point clouds of the recorded cases of spatial relations, a NumPy archive.
pub const CLOUDS: Limit = Limit::mib("an archive of clouds", 64);
/// Physics trials of grasps, one per line.
pub const TRIALS: Limit = Limit::mib("a file of trials", 64);
/// Object families; the largest built-in file is 60 KiB.
pub const FAMILIES: Limit = Limit::mib("a file of families", 4);
/// A robot's URDF or SRDF text.
pub const ROBOT: Limit = Limit::mib("a robot description", 8);
/// A robot mesh, STL or OBJ.
pub const MESH: Limit = Limit::mib("a mesh", 32);
/// URDF or MJCF text of an object to import, or the material list of a GLB or OBJ.
pub const IMPORTED_DESCRIPTION: Limit = Limit::mib("a description of an object to import", 8);
/// A mesh to import: OBJ text takes 60 bytes per triangle, so this exceeds the limit of 400,000 triangles.
pub const IMPORTED_MESH: Limit = Limit::mib("a mesh to import", 64);
/// A texture to import, as an encoded image file.
pub const IMPORTED_PICTURE: Limit = Limit::mib("an image to import", 32);
/// The index of a pack of imported objects, 1 to 4 KiB per object.
pub const PACK: Limit = Limit::mib("the index of a pack", 64);
/// An imported object of a pack: at most 16 textures of 512 x 512 and 24,000 vertices.
pub const PACK_OBJECT: Limit = Limit::mib("an object of a pack", 32);
/// `NAME/assets/UID.json.gz` of a frozen suite.
pub const FROZEN_ASSET: Limit = Limit::mib("an object of a frozen suite", 8);
/// `store.json`, which marks a folder as an episode store.
pub const STORE_MARK: Limit = Limit::kib("the mark of an episode store", 64);
/// `episode.json` and `files.json` in a store.
pub const EPISODE_RECORD: Limit = Limit::mib("the record of an episode", 4);
/// The frames of an episode: 60 Hz, about 1 KiB per frame, ten minutes or more.
pub const FRAMES: Limit = Limit::mib("the frames of an episode", 128);
/// A physics state of an episode.
pub const STATE: Limit = Limit::mib("a physics state", 16);
/// A file attached to an episode, such as one camera's depth images: half an hour at 10 images of 512×288 per second,
/// split into images while the file is in memory.
pub const ATTACHMENT: Limit = Limit::mib("a file attached to an episode", 256);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_human_readable() {
        assert_eq!((TASK.human_readable().as_str(), STORE_MARK.human_readable().as_str()), ("4 MiB", "64 KiB"));
        assert_eq!(Limit { what: "a note", bytes: 7 }.human_readable(), "7 bytes");
    }
}
