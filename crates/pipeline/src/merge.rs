//! Merging of a run's shards into the run that one machine would have collected.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use crate::collect::{CollectOptions, Collected, collect, share};
use crate::folder::{Run, RunFolder, difference};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::shard::{Manifest, Shard};

/// Maximum number of missing items in a message.
const NAMED: usize = 12;

/// Merges the shards of a run in a folder and writes its dataset. The bytes are those of a run without shards, except
/// for wall-clock figures.
///
/// `shards` are folders of shards, or folders that contain them. Episodes are hard-linked where the disk supports it
/// and copied otherwise; the shards are not changed. Attempts that no shard holds are an error, or are made here if
/// `finish` is true. [`CollectOptions::shard`] is ignored.
///
/// # Errors
/// When a folder is no shard or belongs to another run, when two shards are the same, or when attempts are missing.
pub fn merge(
    shards: &[PathBuf],
    out: &Path,
    finish: bool,
    options: CollectOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Collected, WorkspaceError> {
    let parts = open_all(shards)?;
    let Some(first) = parts.first() else {
        return Err(WorkspaceError::input("there is no shard to merge")
            .with_hint("name folders that `genmanip collect --shard` made, or the folder they lie in"));
    };
    let (_, run) = RunFolder::open(&first.path)?;
    let (engine, genmanip_version) = Run::versions();
    if (&genmanip_version, &engine) != (&run.genmanip_version, &run.engine) {
        let what = format!("the shards were made by version {} with {}", run.genmanip_version, run.engine);
        let hint = format!("merge them with that version; this is {genmanip_version} with {engine}");
        return Err(WorkspaceError::input(what).with_hint(hint));
    }
    let found = parts.iter().map(|part| part.look(&run)).collect::<Result<Vec<_>, _>>()?;
    let count = first.manifest.shard.count();
    let missing = missing(&run, count, &found);
    if !missing.is_empty() && !finish {
        let named: Vec<&str> = missing.iter().take(NAMED).map(String::as_str).collect();
        let more = missing.len().saturating_sub(NAMED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        return Err(WorkspaceError::input(format!("not all of the run is there: {}{more}", named.join("; ")))
            .with_hint("start those shards again to finish them, or make what is missing here with --finish"));
    }
    let folder = RunFolder::begin(out, &run)?;
    folder.claim(None)?;
    let store = folder.store()?;
    progress.begin("merging", found.iter().map(|part| part.sound.len()).sum());
    for part in &found {
        let from = part.folder.store()?;
        for id in &part.sound {
            store.take(&from, id).map_err(|error| {
                WorkspaceError::broken(format!("cannot take {id} of {}", part.shard), error)
                    .with_hint("what was merged is kept; start again to continue")
            })?;
            progress.advance();
        }
        let timings = part.folder.timings();
        timings.attempts.iter().for_each(|(id, seconds)| folder.set_attempt_time(id, *seconds));
    }
    progress.end();
    let seconds = |part: &Found| part.folder.timings().phases.get("collect").copied().unwrap_or(0.0);
    folder.set_phase_time("collect", found.iter().map(seconds).sum());
    folder.save_timings()?;
    collect(out, run, CollectOptions { shard: None, ..options }, progress, stop)
}

/// A shard's folder with its manifest.
struct Part {
    path: PathBuf,
    manifest: Manifest,
}

/// Finished attempts of a shard.
struct Found {
    shard: Shard,
    folder: RunFolder,
    /// Ids of the intact finished attempts.
    sound: Vec<String>,
    damaged: BTreeMap<String, String>,
}

impl Part {
    /// Lists the attempts of a shard; an attempt that belongs to another shard is an error.
    fn look(&self, run: &Run) -> Result<Found, WorkspaceError> {
        let shard = self.manifest.shard;
        let own: BTreeSet<String> = share(run, Some(shard)).collect();
        let folder = RunFolder::open_part(&self.path)?;
        let survey = folder.survey(&folder.store()?)?;
        if let Some(known) = survey.sound.iter().find(|known| !own.contains(&known.id)) {
            let what = format!("{} holds {}, which is no attempt of {shard}", self.path.display(), known.id);
            return Err(WorkspaceError::input(what).with_hint("move it away; nothing was merged"));
        }
        let sound = survey.sound.into_iter().filter(|known| known.is_settled()).map(|known| known.id).collect();
        Ok(Found { shard, folder, sound, damaged: survey.damaged.into_iter().collect() })
    }
}

/// All shards in these folders, ordered by index; each must occur once and all must belong to one run.
fn open_all(paths: &[PathBuf]) -> Result<Vec<Part>, WorkspaceError> {
    let mut parts = Vec::new();
    for path in paths {
        parts.extend(if path.join("run.json").exists() { vec![path.clone()] } else { folders_in(path)? });
    }
    let mut parts = parts.into_iter().map(open).collect::<Result<Vec<Part>, _>>()?;
    parts.sort_by(|a, b| (a.manifest.shard, &a.path).cmp(&(b.manifest.shard, &b.path)));
    for pair in parts.windows(2) {
        let [a, b] = [&pair[0], &pair[1]];
        let of_both = |what: String| format!("{} and {} {what}", a.path.display(), b.path.display());
        let refused = if a.manifest.run != b.manifest.run {
            let [known, other] = [RunFolder::open(&a.path)?.1, RunFolder::open(&b.path)?.1];
            of_both(format!("are shards of two runs ({} of the latter)", difference(&other, &known)?))
        } else if a.manifest.shard.count() != b.manifest.shard.count() {
            of_both(format!("cut the run differently: {}, {}", a.manifest.shard, b.manifest.shard))
        } else if a.manifest.shard == b.manifest.shard {
            of_both(format!("both say that they are {}", a.manifest.shard))
        } else {
            continue;
        };
        return Err(
            WorkspaceError::input(refused).with_hint("name the shards of one run, each once; nothing was merged")
        );
    }
    Ok(parts)
}

fn open(path: PathBuf) -> Result<Part, WorkspaceError> {
    let manifest = RunFolder::manifest(&path)?.ok_or_else(|| {
        let what = format!("{} is no shard of a run", path.display());
        WorkspaceError::input(what).with_hint("merge takes folders that `genmanip collect --shard I/N` made")
    })?;
    let record = path.join("run.json");
    if Run::hash_of(&record)? != manifest.run {
        let what = format!("{} is not the run that its shard.json names", record.display());
        return Err(WorkspaceError::input(what).with_hint("copy the shard again from where it was made"));
    }
    Ok(Part { path, manifest })
}

/// Paths of the shards directly inside a folder.
fn folders_in(path: &Path) -> Result<Vec<PathBuf>, WorkspaceError> {
    let entries = std::fs::read_dir(path).map_err(|error| WorkspaceError::file("list", path, error))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut shards: Vec<PathBuf> = paths.filter(|path| path.join("shard.json").exists()).collect();
    shards.sort();
    if shards.is_empty() {
        let what = format!("there is no shard in {}", path.display());
        return Err(
            WorkspaceError::input(what).with_hint("merge takes folders that `genmanip collect --shard I/N` made")
        );
    }
    Ok(shards)
}

/// Texts for a message: missing shards, then missing attempts of the shards found.
fn missing(run: &Run, count: usize, found: &[Found]) -> Vec<String> {
    let there: BTreeSet<usize> = found.iter().map(|part| part.shard.index()).collect();
    let absent = (0..count).filter(|index| !there.contains(index)).filter_map(|index| Shard::new(index, count).ok());
    // A shard without attempts need not exist.
    let absent = absent.filter(|shard| share(run, Some(*shard)).next().is_some());
    let mut words: Vec<String> = absent.map(|shard| shard.to_string()).collect();
    for part in found {
        let sound: BTreeSet<&str> = part.sound.iter().map(String::as_str).collect();
        for id in share(run, Some(part.shard)).filter(|id| !sound.contains(id.as_str())) {
            let why = part.damaged.get(&id).map_or_else(String::new, |why| format!(", damaged: {why}"));
            words.push(format!("{id} ({}{why})", part.shard));
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use genmanip_assets::Catalogue;
    use genmanip_core::{Document, Seed};
    use genmanip_rollout::collect::PipelineSettings;

    use super::*;
    use genmanip_workspace::NoProgress;
    use genmanip_workspace::task_files;
    use genmanip_workspace::task_spool::Tasks;

    /// Shards without episodes: errors are reported before anything is written.
    #[test]
    fn what_does_not_belong_together_is_told_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let settings = PipelineSettings::in_world((*genmanip_assets::worlds::default_world()).clone());
        let tasks = task_files::designed_tasks(3, 1, Catalogue::builtin()).unwrap();
        let run = Run::new(Tasks::spool(tasks, folder.path()).unwrap(), 2, settings, Seed::new(7));
        let other = Run { seed: Seed::new(8), ..run.clone() };
        let make = |name: &str, run: &Run, shard: Option<(usize, usize)>| {
            let path = folder.path().join(name);
            let made = RunFolder::begin(&path, run).unwrap();
            made.claim(shard.map(|(index, count)| Shard::new(index, count).unwrap())).unwrap();
            path
        };
        let [a, b, c] = [("a", 0), ("b", 1), ("c", 2)].map(|(name, index)| make(name, &run, Some((index, 3))));
        let again = make("again", &run, Some((1, 3)));
        let wider = make("wider", &run, Some((3, 4)));
        let foreign = make("foreign", &other, Some((1, 3)));
        let whole = make("whole", &run, None);
        let empty = folder.path().join("empty");
        std::fs::create_dir(&empty).unwrap();
        let options = CollectOptions { workers: 1, ..CollectOptions::default() };
        let out = folder.path().join("out");
        for (shards, expected) in [
            (vec![&a, &b, &c], "not all of the run is there"),
            (vec![&a, &c], "shard 1 of 3"),
            (vec![&a, &b, &again], "both say that they are shard 1 of 3"),
            (vec![&a, &b, &wider], "cut the run differently: shard 1 of 3, shard 3 of 4"),
            (vec![&a, &foreign, &c], "two runs (its seed is 8, not 7 of the latter)"),
            (vec![&a, &whole], "whole is no shard of a run"),
            (vec![&empty], "there is no shard in"),
        ] {
            let shards: Vec<PathBuf> = shards.into_iter().cloned().collect();
            let merged = merge(&shards, &out, false, options, &NoProgress, &AtomicBool::new(false));
            let error = merged.expect_err(expected);
            assert!(error.to_string().contains(expected) && error.hint().is_some(), "{expected} in {error}");
            assert!(!out.exists(), "{expected}: nothing may be made");
        }
        // A shard is not continued as the whole run, nor as another.
        for shard in [None, Some(Shard::new(0, 2).unwrap())] {
            let claimed = RunFolder::begin(&a, &run).unwrap().claim(shard);
            let error = claimed.unwrap_err().to_string();
            assert!(error.contains("it is shard 0 of 3"), "{error}");
        }
        let text = std::fs::read_to_string(a.join("shard.json")).unwrap();
        assert!(Manifest::from_json(&text.replace("\"index\": 0", "\"index\": 3")).is_err(), "{text}");
    }
}
