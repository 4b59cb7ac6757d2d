//! New data sets of the episodes of data sets that are there: merged, split, filtered, without some.
//!
//! Nothing is encoded again: rows are copied with new indices, pictures frame by frame as they are. Columns, the depth
//! sibling and the record in `extras/record` come along.

mod choose;
mod compose;
mod source;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use genmanip_core::Seed;
use genmanip_core::names::is_file_name;

use super::made::Made;
use super::{begin, begin_sibling, card, depth_path, writer::Finished};
use crate::DataError;
use crate::aside::Aside;
use crate::export::ExportReport;
use compose::Composer;
use source::Source;

pub use choose::{Condition, numbers};

/// Hears of each episode that was copied, and how many there are to copy; those of a depth sibling count too.
pub type Heard<'a> = &'a mut dyn FnMut(usize);

/// What stays together when a data set is split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// Episodes of one sentence, so that no part knows a task of another.
    Task,
    /// Nothing: each episode is drawn on its own.
    Episode,
}

/// Writes the episodes of several data sets, one after the other, as one at `out` (and `<out>-depth`).
///
/// Episodes of different runs that have the same `store_id` get another, with a number behind it.
///
/// # Errors
/// When there is none, one was not made by this program as LeRobot v3.0, they differ in what their columns are or mean,
/// an episode is in two of them, or a file cannot be read or written; nothing is then left at `out`.
pub fn merge(datasets: &[PathBuf], out: &Path, heard: Heard) -> Result<ExportReport, DataError> {
    let sources = Sources::open(datasets)?;
    let picks =
        sources.colors.iter().enumerate().flat_map(|(number, source)| {
            (0..source.episodes.len()).map(move |episode| Pick { source: number, episode })
        });
    sources.write(&picks.collect::<Vec<_>>(), out, heard)
}

/// Writes those episodes of a data set that fulfil every condition.
///
/// # Errors
/// As [`merge`]; when a condition names no column, or no episode is left.
pub fn filter(dataset: &Path, conditions: &[Condition], out: &Path, heard: Heard) -> Result<ExportReport, DataError> {
    let sources = Sources::open(&[dataset.to_owned()])?;
    let kept = sources.colors[0].matching(conditions)?;
    sources.write(&picks(kept), out, heard)
}

/// Writes a data set without some of its episodes, which are named by their indices.
///
/// # Errors
/// As [`merge`]; when an index is beyond the last, or no episode is left.
pub fn delete(dataset: &Path, episodes: &BTreeSet<usize>, out: &Path, heard: Heard) -> Result<ExportReport, DataError> {
    let sources = Sources::open(&[dataset.to_owned()])?;
    let count = sources.colors[0].episodes.len();
    if let Some(beyond) = episodes.range(count..).next() {
        let expected = format!("0 to {}", count.saturating_sub(1));
        return Err(DataError::mismatch(format!("episodes of {}", dataset.display()), expected, beyond));
    }
    let kept = (0..count).filter(|episode| !episodes.contains(episode)).collect();
    sources.write(&picks(kept), out, heard)
}

/// Divides a data set into parts in the folder `out`, which have these names and shares of the episodes.
///
/// Which episode goes where follows from the seed. Each part has at least one episode.
///
/// # Errors
/// As [`merge`]; when names are no names of folders or the shares do not add up to 1, or there is too little to divide.
pub fn split(
    dataset: &Path,
    parts: &[(String, f64)],
    by: By,
    seed: Seed,
    out: &Path,
    heard: Heard,
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
    // All targets are looked at before anything is written.
    for (name, _) in parts {
        super::check_free(&out.join(name))?;
    }
    parts.iter().zip(divided).map(|((name, _), kept)| sources.write(&picks(kept), &out.join(name), heard)).collect()
}

fn check_parts(parts: &[(String, f64)]) -> Result<(), DataError> {
    for (index, (name, share)) in parts.iter().enumerate() {
        let is_twin = parts[..index].iter().any(|(other, _)| other == name);
        if !is_file_name(name) || is_twin {
            return Err(DataError::mismatch("name of a part", "the name of a folder, each once", format!("`{name}`")));
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

/// Gives every group to the part that is farthest from its share, in an order drawn by chance; parts with nothing first.
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

/// An episode of one of several data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pick {
    source: usize,
    episode: usize,
}

fn picks(episodes: Vec<usize>) -> Vec<Pick> {
    episodes.into_iter().map(|episode| Pick { source: 0, episode }).collect()
}

/// Data sets whose episodes fit into one, with their depth siblings.
struct Sources {
    colors: Vec<Source>,
    /// As many, or none.
    depths: Vec<Source>,
    made: Made,
}

impl Sources {
    fn open(datasets: &[PathBuf]) -> Result<Self, DataError> {
        let colors = datasets.iter().map(|root| Source::open(root)).collect::<Result<Vec<_>, _>>()?;
        let Some(first) = colors.first() else {
            return Err(DataError::mismatch("data sets", "at least one", 0));
        };
        let made = first.made.clone().without_run();
        let mut depths = Vec::new();
        if made.has_depth() {
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
        Ok(Self { colors, depths, made })
    }

    /// Writes episodes as a data set, and their depth pictures as its sibling, which becomes visible first.
    fn write(&self, picks: &[Pick], out: &Path, heard: Heard) -> Result<ExportReport, DataError> {
        if picks.is_empty() {
            let what = format!("episodes that are left of {}", self.colors[0].root.display());
            return Err(DataError::mismatch(what, "at least one", 0));
        }
        let names = self.names(picks)?;
        let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let depths = match self.depths.is_empty() {
            true => None,
            false => {
                let per_file = self.made.episodes_per_depth_file();
                let card = card::depth(&name);
                let aside = begin_sibling(out)?;
                Some(self.compose(&self.depths, (picks, &names), aside, per_file, &card, heard)?.0)
            }
        };
        let (per_file, card) = (self.made.episodes_per_file(), self.made.card(&name, "v3.0"));
        let (colors, frames) =
            self.compose(&self.colors, (picks, &names), begin(out, None)?, per_file, &card, heard)?;
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
        (picks, names): (&[Pick], &[Option<String>]),
        aside: Aside,
        per_file: usize,
        card: &str,
        heard: Heard,
    ) -> Result<(Finished, usize), DataError> {
        let mut composer = Composer::new(aside, sources, per_file)?;
        for (pick, name) in picks.iter().zip(names) {
            composer.push(*pick, name.as_deref())?;
            heard(picks.len() * (1 + usize::from(!self.depths.is_empty())));
        }
        composer.finish(card, &self.made)
    }

    /// The names that episodes get which another of a different run has already.
    fn names(&self, picks: &[Pick]) -> Result<Vec<Option<String>>, DataError> {
        let listed = |pick: &Pick| &self.colors[pick.source].episodes[pick.episode];
        let mut taken: BTreeSet<String> = picks.iter().map(|pick| listed(pick).store_id.clone()).collect();
        let mut known: BTreeMap<&str, Vec<(&str, usize)>> = BTreeMap::new();
        let mut names = Vec::new();
        for pick in picks {
            let episode = listed(pick);
            let twins = known.entry(&episode.store_id).or_default();
            if let Some((_, source)) = twins.iter().find(|(origin, _)| *origin == episode.origin) {
                let [a, b] = [*source, pick.source].map(|source| self.colors[source].root.display());
                let what = format!("episode {} of {b}", episode.store_id);
                return Err(DataError::mismatch(what, "each episode once", format!("the same one in {a}")));
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
    fn parts_have_their_shares_and_no_group_is_torn() {
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
        // Nobody is left with nothing, however small a share is.
        let few: BTreeMap<String, Vec<usize>> = (0..3).map(|group| (format!("{group}"), vec![group])).collect();
        let parts = divide(few, &[0.98, 0.01, 0.01], Seed::new(1));
        assert!(parts.iter().all(|part| part.len() == 1), "{parts:?}");
    }
}
