//! Shards: parts of a run or of an evaluation, one per machine.
//!
//! Shard `index` of `count` processes work items `index`, `index + count`, `index + 2 count`, … The result of an item
//! depends on neither number.

use std::fmt;
use std::str::FromStr;

use genmanip_core::Document;
use serde::{Deserialize, Serialize};

use crate::error::WorkspaceError;

/// Maximum number of shards of a run: a folder with as many subfolders can still be listed quickly.
pub const MAX_SHARDS: usize = 100_000;

/// One of `count` shards of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// Shard `index` of `count`.
    ///
    /// # Errors
    /// Description of the invalid numbers.
    pub fn new(index: usize, count: usize) -> Result<Self, String> {
        match count {
            1..=MAX_SHARDS if index < count => Ok(Self { index, count }),
            1..=MAX_SHARDS => {
                Err(format!("there is no shard {index} of {count}: they are 0/{count} to {}/{count}", count - 1))
            }
            _ => Err(format!("expected 1 to {MAX_SHARDS} shards, got {count}")),
        }
    }

    /// Index of the shard, from 0.
    pub fn index(self) -> usize {
        self.index
    }

    /// Number of shards of the run.
    pub fn count(self) -> usize {
        self.count
    }

    /// True if the work item with index `piece` belongs to this shard.
    pub fn has(self, piece: usize) -> bool {
        piece % self.count == self.index
    }

    /// Name of the shard's folder, such as `shard-07-of-10`; zero-padded, so that names sort by index.
    pub fn name(self) -> String {
        let digits = (self.count - 1).to_string().len();
        format!("shard-{:0digits$}-of-{}", self.index, self.count)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "shard {} of {}", self.index, self.count)
    }
}

/// The user's choice of a shard: `2/10`, `auto` or `auto/10`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShardChoice {
    /// A shard given by index and number, as `2/10`.
    One(Shard),
    /// Index from the environment of a cluster job; number of shards from it too, unless given.
    Auto(Option<usize>),
}

impl FromStr for ShardChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<usize>().ok();
        match text.split_once('/') {
            None if text == "auto" => Ok(Self::Auto(None)),
            Some(("auto", count)) if number(count).is_some_and(|count| (1..=MAX_SHARDS).contains(&count)) => {
                Ok(Self::Auto(number(count)))
            }
            Some((index, count)) => match (number(index), number(count)) {
                (Some(index), Some(count)) => Ok(Self::One(Shard::new(index, count)?)),
                _ => Err(EXPECTED.into()),
            },
            None => Err(EXPECTED.into()),
        }
    }
}

const EXPECTED: &str = "expected I/N with I from 0 to N - 1, as 0/10, or auto, or auto/N";

impl ShardChoice {
    /// Returns the chosen shard; `variable` looks up environment variables.
    ///
    /// A Slurm job array sets both index and size; an indexed Kubernetes job sets the index only.
    ///
    /// # Errors
    /// When the variables are missing or invalid.
    pub fn resolve(self, variable: &dyn Fn(&str) -> Option<String>) -> Result<Shard, WorkspaceError> {
        let said = match self {
            Self::One(shard) => return Ok(shard),
            Self::Auto(said) => said,
        };
        let wrong = |what: String, hint: &str| WorkspaceError::input(what).with_hint(hint);
        let number = |name: &str| -> Result<Option<usize>, WorkspaceError> {
            let parsed = |text: String| {
                let unfit =
                    |_| wrong(format!("{name} is `{text}`, no number"), "say which shard it is with --shard I/N");
                text.trim().parse().map_err(unfit)
            };
            variable(name).map(parsed).transpose()
        };
        let slurm = number("SLURM_ARRAY_TASK_ID")?;
        let Some(index) = slurm.map_or_else(|| number("JOB_COMPLETION_INDEX"), |index| Ok(Some(index)))? else {
            let what = "--shard auto finds neither SLURM_ARRAY_TASK_ID nor JOB_COMPLETION_INDEX";
            return Err(wrong(what.into(), "start it in a job array, or say which shard it is with --shard I/N"));
        };
        let count = match (said, slurm) {
            (Some(count), _) => count,
            (None, Some(_)) => number("SLURM_ARRAY_TASK_COUNT")?.ok_or_else(|| {
                wrong("there is no SLURM_ARRAY_TASK_COUNT".into(), "say how many with --shard auto/N")
            })?,
            (None, None) => {
                let what = "JOB_COMPLETION_INDEX does not say how many shards there are";
                return Err(wrong(what.into(), "say it with --shard auto/N, N being the completions of the job"));
            }
        };
        // A job array with gaps, such as `--array=3,7`, states only the number of its own tasks.
        let last = if said.is_none() && slurm.is_some() { number("SLURM_ARRAY_TASK_MAX")? } else { None };
        if let Some(last) = last.filter(|last| last + 1 != count) {
            let what = format!("the array has {count} tasks and its last is {last}, not {}", count.saturating_sub(1));
            let hint = "number it from 0 without gaps (--array=0-9), or say how many shards there are: --shard auto/N";
            return Err(wrong(what, hint));
        }
        Shard::new(index, count)
            .map_err(|what| wrong(what, "number the array from 0: --array=0-9 with --shard auto/10"))
    }
}

/// Contents of `shard.json` in a run folder: the shard that the folder holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Index and number of the shard in the folder.
    #[serde(flatten)]
    pub shard: Shard,
    /// Hash of `run.json` in the same folder, which records the whole run.
    pub run: String,
}

impl Document for Manifest {
    const SCHEMA: &'static str = "genmanip.shard/1";

    fn check(&self) -> Result<(), genmanip_core::DocumentError> {
        let Shard { index, count } = self.shard;
        let invalid = |message| genmanip_core::DocumentError::Invalid { path: "$.index".into(), message };
        Shard::new(index, count).map(drop).map_err(invalid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_done_by_exactly_one_shard() {
        for count in [1, 3, 7, 12] {
            let shards: Vec<Shard> = (0..count).map(|index| Shard::new(index, count).unwrap()).collect();
            for piece in 0..40 {
                assert_eq!(shards.iter().filter(|shard| shard.has(piece)).count(), 1, "{piece} of {count}");
            }
            let names: Vec<String> = shards.iter().map(|shard| shard.name()).collect();
            assert!(names.is_sorted(), "{names:?}");
        }
    }

    #[test]
    fn a_shard_is_told_or_found_in_the_environment() {
        let check = |text: &str, environment: &[(&str, &str)], expected: Result<(usize, usize), &str>| {
            let variable =
                |name: &str| environment.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned());
            let resolve = |choice: ShardChoice| choice.resolve(&variable).map_err(|error| error.to_string());
            match (text.parse::<ShardChoice>().and_then(resolve), expected) {
                (Ok(shard), Ok(expected)) => assert_eq!((shard.index(), shard.count()), expected, "{text}"),
                (Err(error), Err(part)) => assert!(error.contains(part), "{part} in {error}"),
                (got, expected) => panic!("{text} with {environment:?}: {got:?}, expected {expected:?}"),
            }
        };
        let slurm = [("SLURM_ARRAY_TASK_ID", "3"), ("SLURM_ARRAY_TASK_COUNT", "10"), ("SLURM_ARRAY_TASK_MAX", "9")];
        check("2/10", &slurm, Ok((2, 10)));
        check("auto", &slurm, Ok((3, 10)));
        check("auto/8", &slurm, Ok((3, 8)));
        check("auto/8", &[("JOB_COMPLETION_INDEX", "7")], Ok((7, 8)));
        check("auto", &[("JOB_COMPLETION_INDEX", "7")], Err("how many shards there are"));
        check("auto", &[], Err("neither SLURM_ARRAY_TASK_ID nor"));
        check("auto", &[("SLURM_ARRAY_TASK_ID", "three")], Err("`three`, no number"));
        check("auto", &[slurm[0], slurm[1], ("SLURM_ARRAY_TASK_MAX", "10")], Err("its last is 10, not 9"));
        check("auto/3", &slurm, Err("0/3 to 2/3"));
        for text in ["", "1", "a/3", "-1/3", "1/0", "3/3", "0/200000", "auto/0", "auto/x", "1/2/3"] {
            assert!(text.parse::<ShardChoice>().is_err(), "{text}");
        }
    }
}
