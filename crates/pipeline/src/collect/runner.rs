//! Execution of a run's attempts: a fixed number per task, or until a number of demonstrations are verified.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use genmanip_benchmark::Outcome;
use genmanip_core::{Document, EpisodeResult, NotRun, Seed};
use genmanip_data::EpisodeStore;
use genmanip_rollout::RolloutError;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources, complete, in_parallel};
use genmanip_workspace::disk_space::Estimate;
use genmanip_workspace::{Progress, Stopped, Tasks, WorkspaceError, documents};

use super::attempts::{Outcomes, Planned, left};
use super::options::CollectOptions;
use crate::folder::RunFolder;
use crate::index::{IndexedAttempt, Survey};
use crate::not_run::{Series, no_episode};
use crate::policies::mistaken;

/// Maximum number of attempts per wanted demonstration, and per task, before a run gives up. The expert usually
/// verifies
/// about 9 of 10 attempts.
const MAX_ATTEMPTS: usize = 20;

/// Resources and settings that the attempts of a run share.
pub(super) struct Runner<'a> {
    pub tasks: &'a Tasks,
    pub seed: Seed,
    pub settings: &'a PipelineSettings,
    pub resources: Resources<'a>,
    pub folder: &'a RunFolder,
    pub store: &'a EpisodeStore,
    pub options: CollectOptions,
    /// True if a dataset will be written, which needs further disk space.
    pub writes_dataset: bool,
    pub progress: &'a dyn Progress,
    pub stop: &'a AtomicBool,
}

/// Attempts of a run with their outcomes.
pub(super) struct Made {
    /// All attempts except damaged ones.
    pub attempts: Vec<Planned>,
    pub outcomes: Outcomes,
    /// Ids of damaged episodes, with a description of the damage.
    pub damaged: Vec<(String, String)>,
    /// Attempts that the policy to be corrected could not run (unreachable, or a mistake of it).
    pub not_run: Vec<NotRun>,
    /// True if this call made an attempt.
    pub has_made: bool,
    /// True if this call made or completed an attempt that the index does not know.
    pub has_changed: bool,
}

impl Runner<'_> {
    /// Makes a fixed number of attempts per task, or those of a shard.
    ///
    /// # Errors
    /// When an episode raises an error or a file cannot be read or written; finished episodes are kept.
    pub fn fixed(&self, per_task: usize) -> Result<Made, WorkspaceError> {
        let mut attempts = Planned::all(self.tasks.entries(), per_task, self.options.shard);
        let (mut known, damaged) = self.known(self.folder.survey(self.store)?, &attempts)?;
        attempts.retain(|attempt| damaged.iter().all(|(id, _)| *id != attempt.id));
        let mut outcomes = Outcomes::new();
        let left = left(&attempts, &mut known, self.folder, self.store, self.settings, &mut outcomes);
        self.progress.begin("collecting", attempts.len());
        // Outcomes of earlier calls advance the progress, without being reported again.
        outcomes.iter().for_each(|_| self.progress.advance());
        let estimate = Estimate::new(self.folder.path(), left.len(), self.writes_dataset);
        let (has_made, not_run) = self.make(&left, &estimate, &mut outcomes, &|_| true)?;
        self.progress.end();
        Ok(Made { attempts, outcomes, damaged, not_run, has_made, has_changed: !left.is_empty() })
    }

    /// Makes attempts in rounds over all tasks, until exactly `count` are verified.
    ///
    /// Each parallel wave has as many attempts as verified demonstrations are missing, so that none is superfluous. The
    /// attempts therefore depend neither on the number of threads nor on interruptions. A larger `count` continues the
    /// same
    /// sequence.
    ///
    /// # Errors
    /// As [`Runner::fixed`]; also when the run already has more verified demonstrations, or damaged episodes, when an
    /// attempt could not be run (later ones depend on it), or when too many attempts fail.
    pub fn until_verified(&self, count: usize) -> Result<Made, WorkspaceError> {
        let tasks = self.tasks.entries();
        let survey = self.folder.survey(self.store)?;
        let verified = survey.sound.iter().filter(|known| known.outcome.success).count();
        if verified > count {
            let what = format!("the run has {verified} verified demonstrations already");
            return Err(
                WorkspaceError::input(what).with_hint("ask for at least as many, or choose another --out folder")
            );
        }
        let reach = survey.sound.len() + survey.damaged.len() + survey.strangers.len() + count;
        let (mut known, damaged) = self.known(survey, &Planned::round_robin(tasks, 0..reach))?;
        if let Some((id, why)) = damaged.first() {
            return Err(WorkspaceError::input(format!("episode {id} is damaged: {why}"))
                .with_hint("start again with --repair: damaged episodes are set aside and made anew"));
        }
        let (mut attempts, mut outcomes, mut has_made, mut has_changed) = (Vec::new(), Outcomes::new(), false, false);
        let successes = |outcomes: &Outcomes| outcomes.values().filter(|outcome| outcome.success).count();
        let estimate = Estimate::new(self.folder.path(), count - verified, self.writes_dataset);
        self.progress.begin("collecting verified demonstrations", count);
        loop {
            let missing = count - successes(&outcomes);
            if missing == 0 || self.stop.load(Ordering::Relaxed) {
                break;
            }
            if attempts.len() >= MAX_ATTEMPTS * (count + tasks.len()) {
                self.progress.end();
                let what = format!("{} of {count} verified after {} attempts", count - missing, attempts.len());
                return Err(WorkspaceError::input(what).with_hint("`genmanip report RUN` shows why attempts failed"));
            }
            let wave = Planned::round_robin(tasks, attempts.len()..attempts.len() + missing);
            let before = successes(&outcomes);
            let left = left(&wave, &mut known, self.folder, self.store, self.settings, &mut outcomes);
            (before..successes(&outcomes)).for_each(|_| self.progress.advance());
            has_changed |= !left.is_empty();
            let (made, not_run) = self.make(&left, &estimate, &mut outcomes, &|outcome| outcome.success)?;
            if let Some(first) = not_run.first() {
                self.progress.end();
                return Err(no_episode(self.settings.corrects.as_deref().unwrap_or_default(), first));
            }
            has_made |= made;
            attempts.extend(wave);
        }
        self.progress.end();
        Ok(Made { attempts, outcomes, damaged, not_run: Vec::new(), has_made, has_changed })
    }

    /// Intact episodes of the run by id, and damaged ones among `attempts`. With `repair`, damaged ones are set aside
    /// first.
    #[expect(clippy::type_complexity, reason = "two lists, taken apart at once")]
    fn known(
        &self,
        survey: Survey,
        attempts: &[Planned],
    ) -> Result<(BTreeMap<String, IndexedAttempt>, Vec<(String, String)>), WorkspaceError> {
        let damaged = damaged(self.folder, self.store, attempts, &survey, self.options.repair, self.progress)?;
        let survey = if self.options.repair { self.folder.survey(self.store)? } else { survey };
        Ok((survey.sound.into_iter().map(|known| (known.id.clone(), known)).collect(), damaged))
    }

    /// Makes attempts in parallel. Returns true if one was made, not only found, and the attempts that could not be
    /// run.
    /// `advances` decides which outcomes count as progress.
    fn make(
        &self,
        left: &[Planned],
        estimate: &Estimate,
        outcomes: &mut Outcomes,
        advances: &(dyn Fn(&Outcome) -> bool + Sync),
    ) -> Result<(bool, Vec<NotRun>), WorkspaceError> {
        let Self { folder, store, progress, .. } = self;
        let has_made = AtomicBool::new(false);
        let finished = |result: EpisodeResult, seconds: f64| -> Result<(String, Outcome), Stopped> {
            if seconds > 0.0 {
                has_made.store(true, Ordering::Relaxed);
                folder.set_attempt_time(&result.id, seconds);
            }
            if !result.scenario_id.is_empty() {
                write_scenario(folder, store, &result.id)?;
            }
            let outcome = Outcome::of(&result);
            if advances(&outcome) {
                progress.advance();
            }
            if let Some(failure) = outcome.failure() {
                progress.note(&format!("{}: {failure}", result.id));
            }
            Ok((result.id, outcome))
        };
        store.sweep_partial().map_err(|error| WorkspaceError::broken("cannot use the episodes", error))?;
        let series = Series::new(self.settings.corrects.as_deref().unwrap_or_default(), self.options.keep_going);
        let made = in_parallel(left, self.options.workers, self.stop, &|planned: &Planned| {
            let since = Instant::now();
            let task = self.tasks.read(planned.task).map_err(Stopped::Run)?;
            let attempt = Attempt::of(&task, planned.number, self.seed);
            let (result, was_there) = match complete(&attempt, self.resources, store, self.settings) {
                // Only with a policy to be corrected may an attempt not run; otherwise a service has failed, which ends
                // the run.
                Err(RolloutError::NotRun { reason, mistake, .. }) if self.settings.corrects.is_some() => {
                    let left = NotRun { id: attempt.id(), scenario_id: attempt.id(), reason, mistake };
                    series.was_not_run(&left).map_err(Stopped::Run)?;
                    return Ok(Err(left));
                }
                completed => completed?,
            };
            series.was_run();
            estimate.add(&store.root().join(&result.id), *progress).map_err(Stopped::Run)?;
            finished(result, if was_there { 0.0 } else { since.elapsed().as_secs_f64() }).map(Ok)
        });
        let made = made.map_err(|stopped| match stopped {
            Stopped::Run(error) => error,
            Stopped::Episode(error) => match error.unsupported() {
                Some(why) => mistaken("the policy to correct", &why.to_string()),
                None => WorkspaceError::broken("collecting stopped", error)
                    .with_hint("finished episodes are kept; start again to continue"),
            },
        })?;
        let mut not_run = Vec::new();
        for made in made {
            match made {
                Ok((id, outcome)) => drop(outcomes.insert(id, outcome)),
                Err(left) => not_run.push(left),
            }
        }
        Ok((has_made.into_inner(), not_run))
    }
}

/// Damaged attempts of the run; with `repair` they are set aside, so that none remain.
fn damaged(
    folder: &RunFolder,
    store: &EpisodeStore,
    attempts: &[Planned],
    survey: &Survey,
    repair: bool,
    progress: &dyn Progress,
) -> Result<Vec<(String, String)>, WorkspaceError> {
    let looks_sound: BTreeSet<&str> = survey.sound.iter().map(|known| known.id.as_str()).collect();
    let mut damaged = Vec::new();
    for Planned { id, .. } in attempts.iter().filter(|known| repair || !looks_sound.contains(known.id.as_str())) {
        if !store.has_folder(id) {
            continue;
        }
        // With `repair`, contents are verified; otherwise only file sizes, so that damaged contents are detected when
        // they are
        // read.
        let looked_at = if repair { store.verify(id) } else { store.inspect(id).map(drop) };
        let Err(error) = looked_at else { continue };
        if !repair {
            progress.note(&format!("episode {id} is damaged and left out: {error}"));
            damaged.push((id.clone(), error.to_string()));
            continue;
        }
        let aside =
            (0..).map(|number| folder.join("damaged").join(format!("{id}.{number}"))).find(|path| !path.exists());
        let aside = aside.unwrap_or_default();
        store.move_out(id, &aside).map_err(|error| WorkspaceError::broken(format!("cannot set {id} aside"), error))?;
        progress.note(&format!("episode {id} is damaged, set aside as {} and made anew: {error}", aside.display()));
    }
    let own: BTreeSet<&str> = attempts.iter().map(|known| known.id.as_str()).collect();
    for name in survey.strangers.iter().filter(|name| !own.contains(name.as_str())) {
        progress.note(&format!("{name} in the episodes is no episode; it is ignored"));
    }
    Ok(damaged)
}

fn write_scenario(folder: &RunFolder, store: &EpisodeStore, id: &str) -> Result<(), WorkspaceError> {
    let path = folder.join("scenarios").join(format!("{id}.json"));
    if path.exists() {
        return Ok(());
    }
    let scenario =
        store.read_scenario(id).map_err(|error| WorkspaceError::broken(format!("cannot read episode {id}"), error))?;
    scenario.map_or(Ok(()), |scenario| documents::write_file(&path, scenario.to_json().as_bytes()))
}
