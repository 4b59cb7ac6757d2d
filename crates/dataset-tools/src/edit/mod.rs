//! Editing of exported data sets: merge, split, filter, delete episodes.
//!
//! Nothing is re-encoded: rows are copied with new indices, video frames byte by byte. All columns, the depth sibling
//! and the native record in `extras/record` are kept.

mod compose;
mod episode_ref;
mod selection;
mod source;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use genmanip_core::Seed;
use genmanip_core::names::is_file_name;

use compose::Composer;
use episode_ref::EpisodeRef;
use genmanip_data::DataError;
use genmanip_data::atomic_write::AtomicFolder;
use genmanip_data::export::ExportReport;
use genmanip_data::lerobot::origin::Origin;
use genmanip_data::lerobot::{begin, begin_sibling, card, depth_path, writer::Finished};
use source::Source;

pub use selection::{Condition, numbers};

/// Progress callback, called after each copied episode with the total number; episodes of the depth sibling count too.
pub type Progress<'a> = &'a mut dyn FnMut(usize);

/// Unit that stays together in a split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// Episodes with the same instruction, so that the parts share no task.
    Task,
    /// Single episodes; the parts may share tasks.
    Episode,
}

/// Merges data sets, in the given order, to `out` (and `<out>-depth`).
///
/// Episodes of different runs with the same `store_id` are distinguished by a numeric suffix.
///
/// # Errors
/// If there is no data set, one is not a LeRobot v3.0 data set of this program, their columns differ in type or
/// meaning, an episode occurs twice, or a file cannot be read or written; `out` is then not created.
pub fn merge(datasets: &[PathBuf], out: &Path, progress: Progress) -> Result<ExportReport, DataError> {
    let sources = Sources::open(datasets)?;
    let picks = sources.colors.iter().enumerate().flat_map(|(number, source)| {
        (0..source.episodes.len()).map(move |episode| EpisodeRef { source: number, episode })
    });
    sources.write(&picks.collect::<Vec<_>>(), out, progress)
}

/// Copies the episodes of a data set that meet all conditions.
///
/// # Errors
/// As [`merge`]; if a condition names no column, or no episode remains.
pub fn filter(
    dataset: &Path,
    conditions: &[Condition],
    out: &Path,
    progress: Progress,
) -> Result<ExportReport, DataError> {
    let sources = Sources::open(&[dataset.to_owned()])?;
    let kept = sources.colors[0].matching(conditions)?;
    sources.write(&picks(kept), out, progress)
}

/// Copies a data set without the episodes of the given indices.
///
/// # Errors
/// As [`merge`]; if an index is out of range, or no episode remains.
pub fn delete(
    dataset: &Path,
    episodes: &BTreeSet<usize>,
    out: &Path,
    progress: Progress,
) -> Result<ExportReport, DataError> {
    let sources = Sources::open(&[dataset.to_owned()])?;
    let count = sources.colors[0].episodes.len();
    if let Some(beyond) = episodes.range(count..).next() {
        let expected = format!("0 to {}", count.saturating_sub(1));
        return Err(DataError::mismatch(format!("episodes of {}", dataset.display()), expected, beyond));
    }
    let kept = (0..count).filter(|episode| !episodes.contains(episode)).collect();
    sources.write(&picks(kept), out, progress)
}

/// Splits a data set into parts in the folder `out`, given by name and share of the episodes.
///
/// The assignment depends only on the seed. Each part has at least one episode.
///
/// # Errors
/// As [`merge`]; if names are not valid folder names, the shares do not add up to 1, or there are too few episodes.
pub fn split(
    dataset: &Path,
    parts: &[(String, f64)],
    by: By,
    seed: Seed,
    out: &Path,
    progress: Progress,
) -> Result<Vec<ExportReport>, DataError> {
    check_parts(parts)?;
    let sources = Sources::open(&[dataset.to_owned()])?;
    let shares: Vec<f64> = parts.iter().map(|(_, share)| *share).collect();
    let episodes = &sources.colors[0].episodes;
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (number, episode) in episodes.iter().enumerate() {
        let group = match by {
            By::Task => episode.sentence.trim().to_lowercase(),
            By::Episode => format!("{number}"),
        };
        groups.entry(group).or_default().push(number);
    }
    if groups.len() < parts.len() {
        let what = match by {
            By::Task => "different sentences",
            By::Episode => "episodes",
        };
        let what = format!("{what} in {}", dataset.display());
        return Err(DataError::mismatch(what, format!("at least {}, one per part", parts.len()), groups.len()));
    }
    let divided = divide(groups, &shares, seed);
    // Check all targets before writing anything.
    for (name, _) in parts {
        genmanip_data::lerobot::check_free(&out.join(name))?;
    }
    parts.iter().zip(divided).map(|((name, _), kept)| sources.write(&picks(kept), &out.join(name), progress)).collect()
}

fn check_parts(parts: &[(String, f64)]) -> Result<(), DataError> {
    for (index, (name, share)) in parts.iter().enumerate() {
        let is_twin = parts[..index].iter().any(|(other, _)| other == name);
        if !is_file_name(name) || is_twin {
            return Err(DataError::mismatch("name of a part", "a valid and unique folder name", format!("`{name}`")));
        }
        if !(share.is_finite() && *share > 0.0) {
            return Err(DataError::mismatch(format!("share of {name}"), "more than 0", share));
        }
    }
    let sum: f64 = parts.iter().map(|(_, share)| share).sum();
    if parts.is_empty() || (sum - 1.0).abs() > 1e-6 {
        return Err(DataError::mismatch("sum of the shares", 1, sum));
    }
    Ok(())
}

/// Assigns the groups, in random order, each to the part that lacks most of its share; every part gets at least one
/// group.
fn divide(groups: BTreeMap<String, Vec<usize>>, shares: &[f64], seed: Seed) -> Vec<Vec<usize>> {
    let total: usize = groups.values().map(Vec::len).sum();
    let mut groups: Vec<(u64, String, Vec<usize>)> =
        groups.into_iter().map(|(name, members)| (seed.fork(&name).value(), name, members)).collect();
    groups.sort();
    let mut parts: Vec<Vec<usize>> = vec![Vec::new(); shares.len()];
    for left in (1..=groups.len()).rev() {
        let Some((_, _, members)) = groups.pop() else { break };
        let empty = parts.iter().filter(|part| part.is_empty()).count();
        let lacks = |part: usize| shares[part] * total as f64 - parts[part].len() as f64;
        let may_have = |part: &usize| empty < left || parts[*part].is_empty();
        let wanted = (0..parts.len()).filter(may_have).max_by(|a, b| lacks(*a).total_cmp(&lacks(*b)));
        if let Some(part) = wanted {
            parts[part].extend(members);
        }
    }
    parts.iter_mut().for_each(|part| part.sort_unstable());
    parts
}

fn picks(episodes: Vec<usize>) -> Vec<EpisodeRef> {
    episodes.into_iter().map(|episode| EpisodeRef { source: 0, episode }).collect()
}

/// Compatible data sets with their depth siblings.
struct Sources {
    colors: Vec<Source>,
    /// Depth sibling of each data set; empty if none has one.
    depths: Vec<Source>,
    origin: Origin,
}

impl Sources {
    fn open(datasets: &[PathBuf]) -> Result<Self, DataError> {
        let colors = datasets.iter().map(|root| Source::open(root)).collect::<Result<Vec<_>, _>>()?;
        let Some(first) = colors.first() else {
            return Err(DataError::mismatch("data sets", "at least one", 0));
        };
        let origin = first.origin.clone().without_run();
        let mut depths = Vec::new();
        if origin.has_depth() {
            depths = datasets.iter().map(|root| Source::open(&depth_path(root))).collect::<Result<Vec<_>, _>>()?;
        }
        for all in [&colors, &depths] {
            for source in all.iter().skip(1) {
                source.check_fits(&all[0])?;
            }
        }
        for (color, depth) in colors.iter().zip(&depths) {
            let named = |source: &Source| -> Vec<String> {
                source.episodes.iter().map(|episode| episode.store_id.clone()).collect()
            };
            if named(color) != named(depth) {
                let what = format!("episodes of {}", depth.root.display());
                return Err(DataError::mismatch(what, format!("those of {}", color.root.display()), "others"));
            }
        }
        Ok(Self { colors, depths, origin })
    }

    /// Writes episodes to a data set, and their depth images to its sibling, which is published first.
    fn write(&self, picks: &[EpisodeRef], out: &Path, progress: Progress) -> Result<ExportReport, DataError> {
        if picks.is_empty() {
            let what = format!("remaining episodes of {}", self.colors[0].root.display());
            return Err(DataError::mismatch(what, "at least one", 0));
        }
        let names = self.names(picks)?;
        let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let depths = match self.depths.is_empty() {
            true => None,
            false => {
                let per_file = self.origin.episodes_per_depth_file();
                let card = card::depth(&name);
                let staging = begin_sibling(out)?;
                Some(self.compose(&self.depths, (picks, &names), staging, per_file, &card, progress)?.0)
            }
        };
        let (per_file, card) = (self.origin.episodes_per_file(), self.origin.card(&name, "v3.0"));
        let (colors, frames) =
            self.compose(&self.colors, (picks, &names), begin(out, None)?, per_file, &card, progress)?;
        let depth_dataset = depths.is_some().then(|| depth_path(out));
        if let Some(depths) = depths {
            depths.publish()?;
        }
        colors.publish()?;
        Ok(ExportReport { dataset: out.into(), depth_dataset, episodes: picks.len(), frames, left_out: Vec::new() })
    }

    fn compose(
        &self,
        sources: &[Source],
        (picks, names): (&[EpisodeRef], &[Option<String>]),
        staging: AtomicFolder,
        per_file: usize,
        card: &str,
        progress: Progress,
    ) -> Result<(Finished, usize), DataError> {
        let mut composer = Composer::new(staging, sources, per_file)?;
        for (pick, name) in picks.iter().zip(names) {
            composer.push(*pick, name.as_deref())?;
            progress(picks.len() * (1 + usize::from(!self.depths.is_empty())));
        }
        composer.finish(card, &self.origin)
    }

    /// New name of each picked episode whose name is used by an episode of another run; `None` for the others.
    fn names(&self, picks: &[EpisodeRef]) -> Result<Vec<Option<String>>, DataError> {
        let listed = |pick: &EpisodeRef| &self.colors[pick.source].episodes[pick.episode];
        let mut taken: BTreeSet<String> = picks.iter().map(|pick| listed(pick).store_id.clone()).collect();
        let mut known: BTreeMap<&str, Vec<(&str, usize)>> = BTreeMap::new();
        let mut names = Vec::new();
        for pick in picks {
            let episode = listed(pick);
            let twins = known.entry(&episode.store_id).or_default();
            if let Some((_, source)) = twins.iter().find(|(origin, _)| *origin == episode.origin) {
                let [a, b] = [*source, pick.source].map(|source| self.colors[source].root.display());
                let what = format!("episode {} of {b}", episode.store_id);
                return Err(DataError::mismatch(what, "each episode only once", format!("the same one in {a}")));
            }
            let free = |number: usize| format!("{}.{number}", episode.store_id);
            let name = (!twins.is_empty()).then(|| (2..).map(free).find(|name| !taken.contains(name))).flatten();
            taken.extend(name.clone());
            twins.push((&episode.origin, pick.source));
            names.push(name);
        }
        Ok(names)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_their_shares_and_groups_stay_together() {
        let groups: BTreeMap<String, Vec<usize>> =
            (0..50).map(|group| (format!("sentence {group}"), (group * 6..group * 6 + 6).collect())).collect();
        let shares = [0.8, 0.1, 0.1];
        let divided = divide(groups.clone(), &shares, Seed::new(7));
        let mut all: Vec<usize> = divided.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..300).collect::<Vec<_>>());
        for (part, share) in divided.iter().zip(shares) {
            assert!((part.len() as f64 - share * 300.0).abs() <= 6.0, "{} of {share}", part.len());
            let torn = groups.values().find(|group| {
                let inside = group.iter().filter(|member| part.contains(member)).count();
                inside != 0 && inside != group.len()
            });
            assert_eq!(torn, None);
        }
        assert_eq!(divided, divide(groups.clone(), &shares, Seed::new(7)));
        assert_ne!(divided, divide(groups, &shares, Seed::new(8)));
        // No part remains empty, however small its share.
        let few: BTreeMap<String, Vec<usize>> = (0..3).map(|group| (format!("{group}"), vec![group])).collect();
        let parts = divide(few, &[0.98, 0.01, 0.01], Seed::new(1));
        assert!(parts.iter().all(|part| part.len() == 1), "{parts:?}");
    }
}
