//! Skills from recorded episodes, and runs of episodes to which skills were transferred.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_assets::search::Filter;
use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Document, EpisodeResult, EpisodeSource, JointKind, ObjectCard, Seed, Task, hexadecimal};
use genmanip_data::EpisodeStore;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources, SkillFile, in_parallel};
use genmanip_rollout::expert::MoveSkills;
use genmanip_rollout::{RolloutError, Stage, run_episode};
use genmanip_skills::tasks::{place_task, state_task};
use genmanip_skills::{Skill, SkillSet, Transfer, TransferSettings, serves_task};
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::{Progress, WorkspaceError, documents, worlds};
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::folder::{Run, RunFolder};

/// Ending of the names of skill files.
pub const ENDING: &str = ".skill.json";
/// Most attempts per episode that is wanted, and per task, before a transfer ends.
const MAX_ATTEMPTS: usize = 4;
/// Most objects that a query selects.
const MAX_OBJECTS: usize = 200;

/// An episode and the skill cut from it.
#[derive(Clone, Debug, Serialize)]
pub struct RecordedSkill {
    /// Id of the episode.
    pub episode: String,
    /// Skill file; `None` if no skill could be cut.
    pub file: Option<PathBuf>,
    /// Reason why no skill could be cut; `None` for a skill.
    pub reason: Option<String>,
}

/// Cuts skills from episodes of a run folder or an episode store and writes them into a folder, one file each; without
/// `ids` from all successful episodes.
///
/// # Errors
/// If the episodes cannot be read, a scene cannot be opened, or a file cannot be written.
pub fn record(path: &Path, ids: &[String], out: &Path) -> Result<Vec<RecordedSkill>, WorkspaceError> {
    let store = open_store(path)?;
    let unread = |error| WorkspaceError::of_file("read", path, error);
    let known = store.ids().map_err(unread)?;
    if let Some(missing) = ids.iter().find(|id| !known.contains(id)) {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        return Err(WorkspaceError::unknown("episode", "episodes", missing, &known));
    }
    let mut rows = Vec::new();
    for id in known.iter().filter(|id| ids.is_empty() || ids.contains(id)) {
        let is_wanted = !ids.is_empty() || store.read_result(id).map_err(unread)?.success;
        if !is_wanted || !store.is_recorded(id).map_err(unread)? {
            continue;
        }
        let episode = store.read(id).map_err(unread)?;
        let robot = worlds::robot(&episode.scenario.world)?;
        let stage = Stage::open(Arc::new(episode.scenario.clone()), Catalogue::all(), &robot)
            .map_err(|error| WorkspaceError::broken(format!("the scene of episode {id} cannot be opened"), error))?;
        let hash = store.record_hash(id).map_err(unread)?;
        let row = match genmanip_skills::record(&stage, &episode, id, &hash) {
            Ok(skill) => {
                let file = out.join(format!("{id}{ENDING}"));
                documents::write_file(&file, skill.to_json().as_bytes())?;
                RecordedSkill { episode: id.clone(), file: Some(file), reason: None }
            }
            Err(error) => RecordedSkill { episode: id.clone(), file: None, reason: Some(error.to_string()) },
        };
        rows.push(row);
    }
    Ok(rows)
}

/// Episode store of a run folder, or a store itself.
fn open_store(path: &Path) -> Result<EpisodeStore, WorkspaceError> {
    let inner = path.join("episodes");
    let root = if inner.is_dir() { inner } else { path.to_owned() };
    EpisodeStore::open(&root)
        .map_err(|error| WorkspaceError::of_file("read", &root, error).or_hint("name a run folder or an episode store"))
}

/// Skill files of a run, from files and folders, in the order of their names.
///
/// # Errors
/// As [`read`].
pub fn files(paths: &[PathBuf]) -> Result<Vec<SkillFile>, WorkspaceError> {
    if paths.is_empty() {
        return Ok(Vec::new());
    }
    read(paths)?;
    let known = named(paths)?.into_iter().map(|file| {
        let sha256 = hexadecimal(&Sha256::digest(documents::read_bytes(&file, Skill::LIMIT)?));
        Ok(SkillFile { path: file.display().to_string(), sha256 })
    });
    known.collect()
}

/// Skills of a run; `None` without any.
///
/// # Errors
/// If a file cannot be read or has changed since the run began, or no skill serves a task of the run.
pub(crate) fn of_run(
    files: &[SkillFile],
    tasks: &Tasks,
    source: &dyn AssetSource,
) -> Result<Option<Arc<dyn MoveSkills>>, WorkspaceError> {
    if files.is_empty() {
        return Ok(None);
    }
    let paths: Vec<PathBuf> = files.iter().map(|file| PathBuf::from(&file.path)).collect();
    for (file, path) in files.iter().zip(&paths) {
        if hexadecimal(&Sha256::digest(documents::read_bytes(path, Skill::LIMIT)?)) != file.sha256 {
            return Err(WorkspaceError::input(format!("skill {} is not the one that the run began with", file.path))
                .with_hint("bring the file back, or begin a new run with another --out"));
        }
    }
    let skills = read(&paths)?;
    let mut is_served = false;
    for task in tasks.iter() {
        let task = task?;
        let model = |index: usize| source.model(&task.objects.get(index)?.asset).ok();
        is_served = skills.iter().any(|skill| serves_task(skill, &task, &model));
        if is_served {
            break;
        }
    }
    if !is_served {
        let served: BTreeSet<String> = skills.iter().map(served).collect();
        let served: Vec<&str> = served.iter().map(String::as_str).collect();
        return Err(WorkspaceError::input("no task has a change of state that a skill serves")
            .because(format!("the skills serve: {}", served.join(", ")))
            .with_hint("name skills of the kind that the tasks ask for, or leave --skill away"));
    }
    Ok(Some(Arc::new(SkillSet::new(skills))))
}

/// Changes that a skill serves, in words.
fn served(skill: &Skill) -> String {
    let along = match skill.motion.as_ref().map(|motion| motion.joint) {
        Some(JointKind::Prismatic) => "along a prismatic joint",
        Some(JointKind::Revolute) => "about a revolute joint",
        None => "objects, which the expert does itself",
    };
    format!("{} {along} ({})", skill.verb.name(), skill.name)
}

/// Skills of files and folders, in the order of their names.
///
/// # Errors
/// If there is none, a file cannot be read, or two skills have the same name.
pub fn read(paths: &[PathBuf]) -> Result<Vec<Skill>, WorkspaceError> {
    let files = named(paths)?;
    let skills = files
        .iter()
        .map(|file| documents::read_document::<Skill>(file, Skill::LIMIT))
        .collect::<Result<Vec<_>, _>>()?;
    if skills.is_empty() {
        return Err(WorkspaceError::input("there is no skill").with_hint(format!(
            "name files or folders of files NAME{ENDING}, as `genmanip skills record` writes them"
        )));
    }
    for (index, skill) in skills.iter().enumerate() {
        if skills[..index].iter().any(|other| other.name == skill.name) {
            return Err(WorkspaceError::input(format!("two skills have the name {}", skill.name)));
        }
    }
    Ok(skills)
}

/// Skill files among files and folders, in the order of their names.
fn named(paths: &[PathBuf]) -> Result<Vec<PathBuf>, WorkspaceError> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let names = genmanip_data::files::names(path).map_err(|error| WorkspaceError::of_file("read", path, error))?;
        files.extend(names.iter().filter(|name| name.ends_with(ENDING)).map(|name| path.join(name)));
    }
    files.sort();
    Ok(files)
}

/// Result of [`transfer`].
#[derive(Clone, Debug, Serialize)]
pub struct Transferred {
    /// Results of the episodes that were kept, in the order of their attempts.
    pub kept: Vec<KeptEpisode>,
    /// Number of attempts.
    pub attempts: usize,
    /// Reasons why other attempts were not kept, one each.
    pub failures: Vec<String>,
    /// True if interrupted.
    pub interrupted: bool,
}

/// An episode that was kept.
#[derive(Clone, Debug, Serialize)]
pub struct KeptEpisode {
    /// Id of the episode.
    pub episode: String,
    /// Skill that was used last.
    pub skill: String,
}

/// Request for episodes by transfer.
#[derive(Clone, Debug)]
pub struct TransferRequest {
    /// Skills to choose from.
    pub skills: Vec<Skill>,
    /// Objects, in the words of `genmanip assets search`.
    pub query: String,
    /// Number of episodes to keep.
    pub count: usize,
    /// Seed of the layouts.
    pub seed: Seed,
    /// Number of threads.
    pub workers: usize,
}

/// Transfers skills to objects that match a query, each laid out anew for every attempt, until enough episodes succeed.
/// These alone are kept, as a run folder.
///
/// # Errors
/// If no skill serves an object of the query, the folder holds another run, or an episode raises an error.
pub fn transfer(
    request: &TransferRequest,
    settings: PipelineSettings,
    out: &Path,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Transferred, WorkspaceError> {
    let tasks = tasks(&request.skills, &request.query)?;
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources { catalogue: Catalogue::all(), ..Resources::builtin(&planner) };
    let nearest = documents::nearest_folder(out).unwrap_or_else(|| ".".into());
    let run = Run::new(Tasks::spool(tasks.iter().cloned(), &nearest)?, 0, settings.clone(), request.seed);
    let folder = RunFolder::begin(out, &run)?;
    let store = folder.store()?;
    let skills: Arc<[Skill]> = request.skills.clone().into();
    let attempt = |number: &usize| -> Result<(Option<KeptEpisode>, String), RolloutError> {
        let (task, round) = (&tasks[number % tasks.len()], number / tasks.len());
        let attempt = Attempt::of(task, round as u64, request.seed);
        let id = attempt.id();
        let scenario = match attempt.scenario(resources, &settings.world, &settings.layout) {
            Ok(scenario) => scenario,
            Err(error) if error.is_defect() => return Err(error.into()),
            Err(error) => return Ok((None, format!("{id}: {error}"))),
        };
        let stage = Stage::open(Arc::new(scenario), resources.catalogue, planner.robot())?;
        let mut policy = Transfer::new(&stage, &planner, Arc::clone(&skills), TransferSettings::default());
        let mut episode = run_episode(&stage, &mut policy, &id, attempt.seed, &settings.rollout)?;
        episode.result.source = Some(EpisodeSource::Transfer);
        if !episode.result.success {
            return Ok((None, format!("{id}: {}", reason(&episode.result))));
        }
        if !store.contains(&id) {
            store.write(&episode, &[])?;
        }
        let skill = policy.used().unwrap_or_default().to_owned();
        Ok((Some(KeptEpisode { episode: id, skill }), String::new()))
    };
    let mut made = Transferred { kept: Vec::new(), attempts: 0, failures: Vec::new(), interrupted: false };
    progress.begin("transferring", request.count);
    while made.kept.len() < request.count && made.attempts < MAX_ATTEMPTS * (request.count + tasks.len()) {
        // As many attempts as episodes are missing, so that none is superfluous, whatever the number of threads.
        let wave: Vec<usize> = (made.attempts..made.attempts + request.count - made.kept.len()).collect();
        let results = in_parallel(&wave, request.workers, stop, &attempt)
            .map_err(|error| WorkspaceError::broken("the transfer stopped", error))?;
        made.interrupted = results.len() < wave.len();
        made.attempts += results.len();
        for (kept, failure) in results {
            match kept {
                Some(kept) => {
                    progress.advance();
                    made.kept.push(kept);
                }
                None => made.failures.push(failure),
            }
        }
        if made.interrupted {
            break;
        }
    }
    progress.end();
    for kept in &made.kept {
        let path = folder.join("scenarios").join(format!("{}.json", kept.episode));
        let scenario = store.read_scenario(&kept.episode);
        let scenario = scenario.map_err(|error| WorkspaceError::broken("an episode cannot be read back", error))?;
        if let Some(scenario) = scenario {
            documents::write_file(&path, scenario.to_json().as_bytes())?;
        }
    }
    folder.survey(&store)?;
    Ok(made)
}

fn reason(result: &EpisodeResult) -> String {
    result.failure().map_or_else(String::new, |failure| failure.evidence)
}

/// Tasks on the objects of a query that a skill can serve: those with the initial and the goal state of its source and
/// the same kind of manipulation, or a place on or in the object that was beneath in its source.
fn tasks(skills: &[Skill], query: &str) -> Result<Vec<Task>, WorkspaceError> {
    let index = Catalogue::all().index();
    let found = index.search(query, &Filter::default(), MAX_OBJECTS);
    let cards: Vec<&ObjectCard> = found.iter().map(|result| result.card).collect();
    let mut tasks: Vec<Task> = Vec::new();
    for card in &cards {
        let model = Catalogue::all()
            .model(&card.asset)
            .map_err(|error| WorkspaceError::broken(format!("{} cannot be built", card.uid), error))?;
        for skill in skills {
            let task = match (&skill.motion, &skill.carry) {
                (Some(motion), _) => {
                    let [from, to] = &motion.states;
                    let is_served = card.is_articulated && genmanip_skills::serves(skill, &model, from, to);
                    is_served.then(|| state_task(card, from, to))
                }
                (None, Some(carry)) => {
                    let reference = Catalogue::all().cards().iter().find(|known| known.asset == carry.reference);
                    let is_free = card.can_grasp && !card.is_articulated && card.asset != carry.reference;
                    reference.filter(|_| is_free).map(|reference| place_task(card, carry.relation, reference))
                }
                (None, None) => None,
            };
            if let Some(task) = task.filter(|task| tasks.iter().all(|known| known.id != task.id)) {
                tasks.push(Task { source: format!("skills, first {}", skill.name), ..task });
            }
        }
    }
    if tasks.is_empty() {
        let verbs: Vec<&str> = skills.iter().map(|skill| skill.verb.name()).collect();
        let what = format!("no skill ({}) serves an object of \"{query}\"", verbs.join(", "));
        return Err(WorkspaceError::input(what)
            .because(format!("{} objects match the query", cards.len()))
            .with_hint("`genmanip assets search QUERY` shows what matches; skills serve their own kind and states"));
    }
    Ok(tasks)
}
