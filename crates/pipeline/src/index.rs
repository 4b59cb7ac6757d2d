//! Index of a run's attempts, `index.jsonl`, which gives their outcomes without reading the episodes' files.
//!
//! A header, then a line per intact attempt, sorted by id. A line is valid while the attempt's files have the recorded
//! sizes and are older than the index; other attempts are inspected again, and the index is rewritten. Its content
//! depends on the attempts alone; the time to compare with is the file's modification time.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use genmanip_benchmark::Outcome;
use genmanip_core::{hexadecimal, limits};
use genmanip_data::{EpisodeStore, FileInventory, Inspected, files};
use genmanip_rollout::collect::in_parallel;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use genmanip_workspace::WorkspaceError;
use genmanip_workspace::workers;

/// File of the index in the folder of a run.
pub(crate) const INDEX: &str = "index.jsonl";

/// An attempt whose files are intact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IndexedAttempt {
    /// Id of the attempt.
    pub id: String,
    /// Id of the attempt's task.
    pub task_id: String,
    /// True if the frames of the episode were stored.
    pub recorded: bool,
    /// True if the attempt has a scenario file.
    pub has_scenario: bool,
    /// Outcome of the attempt.
    pub outcome: Outcome,
    /// Inventory of the attempt's files; `None` while there are unfinished files.
    parts: Option<FileInventory>,
}

impl IndexedAttempt {
    fn of(inspected: Inspected) -> Self {
        let Inspected { result, recorded, has_scenario, inventory: parts } = inspected;
        let outcome = Outcome::of(&result);
        Self { id: result.id, task_id: result.task_id, recorded, has_scenario, outcome, parts }
    }

    /// True if the attempt has no unfinished files.
    pub(crate) fn is_settled(&self) -> bool {
        self.parts.is_some()
    }
}

/// Attempts in a store, with damaged ones and foreign entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// Attempts whose files are intact as far as inspected, sorted by id.
    pub sound: Vec<IndexedAttempt>,
    /// Ids of damaged attempts, with a description of the damage.
    pub damaged: Vec<(String, String)>,
    /// Names of other entries of the store, which are ignored.
    pub strangers: Vec<String>,
    /// Number of attempts that were inspected because the index did not cover them.
    pub looked_at: usize,
}

impl Survey {
    /// Messages for the user about damaged attempts and foreign entries, one line each.
    pub fn notes(&self) -> Vec<String> {
        let stranger = |name: &String| format!("{name} in the episodes is no episode; it is ignored");
        let damaged = |(id, why): &(String, String)| format!("episode {id} is damaged and left out: {why}");
        self.strangers.iter().map(stranger).chain(self.damaged.iter().map(damaged)).collect()
    }

    /// Survey of the store of the run at `path`. It uses the run's index, and updates it where the folder is writable.
    ///
    /// # Errors
    /// When the store cannot be listed.
    pub(crate) fn of(path: &Path, store: &EpisodeStore) -> Result<Self, WorkspaceError> {
        // Files written from now on are younger than the index.
        let now = files::now_in(path).ok();
        let listing = store.list().map_err(|error| WorkspaceError::broken("cannot list the episodes", error))?;
        let file = path.join(INDEX);
        let Index { mut known, made } = Index::read(&file).unwrap_or_default();
        let looks = in_parallel(&listing.ids, workers::workers(None), &AtomicBool::new(false), &|id| {
            let parts = known.get(id).and_then(|known| known.parts.as_ref());
            if parts.is_some_and(|parts| store.is_unchanged(id, parts, made)) {
                return Ok::<_, WorkspaceError>(None);
            }
            Ok(Some(store.inspect(id).map(IndexedAttempt::of).map_err(|error| error.to_string())))
        })?;
        let mut survey = Self { strangers: listing.foreign, ..Self::default() };
        let mut is_current = true;
        for (id, look) in listing.ids.into_iter().zip(looks) {
            let before = known.remove(&id);
            survey.looked_at += usize::from(look.is_some());
            is_current &= look.as_ref().is_none_or(|look| look.is_err() && before.is_none());
            match look {
                None => survey.sound.extend(before),
                Some(Ok(known)) => survey.sound.push(known),
                Some(Err(why)) => survey.damaged.push((id, why)),
            }
        }
        if let (false, Some(now)) = (is_current && known.is_empty(), now) {
            // Without permission to write, the index remains stale, and the next survey inspects these attempts again.
            let _ = files::write_as_of(&file, &bytes(&survey.sound), Some(now));
        }
        Ok(survey)
    }
}

/// Header, the first line of the index.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Head {
    schema: String,
    genmanip_version: String,
    /// SHA-256 of all lines after the header, to detect changes by other programs.
    sha256: String,
}

impl Head {
    fn of(lines: &[u8]) -> Self {
        Self {
            schema: "genmanip.index/1".into(),
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
            sha256: hexadecimal(&Sha256::digest(lines)),
        }
    }
}

fn bytes(sound: &[IndexedAttempt]) -> Vec<u8> {
    let line = |known: &IndexedAttempt| serde_json::to_string(known).unwrap_or_default() + "\n";
    let lines: String = sound.iter().filter(|known| known.is_settled()).map(line).collect();
    let head = serde_json::to_string(&Head::of(lines.as_bytes())).unwrap_or_default();
    format!("{head}\n{lines}").into_bytes()
}

struct Index {
    known: BTreeMap<String, IndexedAttempt>,
    made: SystemTime,
}

impl Default for Index {
    fn default() -> Self {
        Self { known: BTreeMap::new(), made: SystemTime::UNIX_EPOCH }
    }
}

impl Index {
    /// Content of an index file; `None` if it is missing, of another version, or was changed.
    fn read(path: &Path) -> Option<Self> {
        let made = std::fs::symlink_metadata(path).ok()?.modified().ok()?;
        let bytes = files::read_no_follow(path, limits::INDEX).ok()?;
        let end = bytes.iter().position(|byte| *byte == b'\n')?;
        let (head, lines) = (&bytes[..end], &bytes[end + 1..]);
        if serde_json::from_slice::<Head>(head).ok()? != Head::of(lines) {
            return None;
        }
        let lines = lines.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
        let known = lines
            .map(|line| serde_json::from_slice::<IndexedAttempt>(line).ok().map(|known| (known.id.clone(), known)));
        Some(Self { known: known.collect::<Option<_>>()?, made })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::Duration;

    use genmanip_core::{Document, EpisodeResult};

    use super::*;

    /// A run of four attempts, last written a minute ago, and how many of them a survey looks at.
    struct Made(tempfile::TempDir);

    impl Made {
        fn new() -> Self {
            let made = Self(tempfile::tempdir().unwrap());
            let result = EpisodeResult::from_json(include_str!("../../core/testdata/result_1.json")).unwrap();
            for id in ["a", "b", "c", "d"] {
                made.store().write_result_only(&EpisodeResult { id: id.into(), ..result.clone() }, None).unwrap();
                made.attach(id);
                made.age(id);
            }
            made
        }

        fn store(&self) -> EpisodeStore {
            EpisodeStore::create(self.0.path().join("episodes")).unwrap()
        }

        fn at(&self, name: &str) -> std::path::PathBuf {
            self.0.path().join("episodes").join(name)
        }

        fn attach(&self, id: &str) {
            let file = genmanip_data::Attachment { name: "notes".into(), bytes: b"hello".to_vec() };
            self.store().attach(id, "group", &[file]).unwrap();
        }

        /// Makes an attempt a minute older than it is.
        fn age(&self, id: &str) {
            let then = SystemTime::now() - Duration::from_secs(60);
            for name in ["", "episode.json", "group", "group/notes", "group/files.json"] {
                fs::File::open(self.at(id).join(name)).unwrap().set_modified(then).unwrap();
            }
        }

        fn survey(&self) -> Survey {
            Survey::of(self.0.path(), &self.store()).unwrap()
        }

        fn index(&self) -> Vec<u8> {
            fs::read(self.0.path().join(INDEX)).unwrap()
        }
    }

    #[test]
    fn only_what_changed_is_looked_at_again() {
        let made = Made::new();
        let first = made.survey();
        assert_eq!((first.looked_at, first.sound.len(), first.damaged.len()), (4, 4, 0), "there was no index");
        let bytes = made.index();
        let again = made.survey();
        assert_eq!((again.looked_at, &again.sound), (0, &first.sound));

        // Each of these is noticed without reading anything but what changed.
        let record = made.at("b/episode.json");
        let text = fs::read_to_string(&record).unwrap();
        let renamed = text.replacen("mujoco", "mujocO", 1);
        assert!(renamed != text && renamed.len() == text.len());
        for (what, change, looked_at, sound) in [
            ("a shorter file", &(|| fs::write(made.at("a/group/notes"), b"hell").unwrap()) as &dyn Fn(), 1, 3),
            ("the file again", &(|| fs::write(made.at("a/group/notes"), b"hello").unwrap()), 1, 4),
            ("a record of the same size", &(|| fs::write(&record, &renamed).unwrap()), 1, 4),
            ("another group", &(|| fs::create_dir(made.at("c/other")).unwrap()), 1, 3),
            ("no other group", &(|| fs::remove_dir(made.at("c/other")).unwrap()), 1, 4),
            ("an attempt less", &(|| fs::remove_dir_all(made.at("d")).unwrap()), 0, 3),
        ] {
            change();
            let survey = made.survey();
            assert_eq!((survey.looked_at, survey.sound.len()), (looked_at, sound), "{what}");
            ["a", "b", "c"].into_iter().for_each(|id| made.age(id));
            // Damaged attempts are inspected each time.
            assert_eq!(made.survey().looked_at, survey.damaged.len(), "{what}, once more");
        }
        let ids: Vec<String> = made.survey().sound.into_iter().map(|known| known.id).collect();
        assert_eq!(ids, ["a", "b", "c"]);
        assert_ne!(made.index(), bytes);
    }

    #[test]
    fn an_index_that_is_not_as_it_was_written_is_made_anew() {
        let made = Made::new();
        let sound = made.survey().sound;
        let (path, bytes) = (made.0.path().join(INDEX), made.index());
        let text = String::from_utf8(bytes.clone()).unwrap();
        for damage in [
            String::new(),
            text.replacen("\"task_id\":\"", "\"task_id\":\"x", 1),
            text.replacen("index/1", "index/0", 1),
            text[..text.len() / 2].to_owned(),
            "\u{0}".into(),
        ] {
            assert_ne!(damage, text);
            fs::write(&path, damage).unwrap();
            assert_eq!((made.survey().looked_at, made.index()), (4, bytes.clone()));
        }
        // One that is older than the attempts knows nothing of them.
        fs::File::open(&path).unwrap().set_modified(SystemTime::now() - Duration::from_secs(120)).unwrap();
        let survey = made.survey();
        assert_eq!((survey.looked_at, &survey.sound, made.index()), (4, &sound, bytes));
        // Unfinished results do not count.
        fs::write(made.at("a/.group.partial-cc-b1-9-90-3"), b"").unwrap();
        assert_eq!((made.survey().looked_at, made.survey().looked_at), (1, 1));
        assert!(!made.survey().sound[0].is_settled());
    }
}
