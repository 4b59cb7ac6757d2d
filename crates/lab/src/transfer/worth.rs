//! Policies trained on a few takes, on episodes transferred from them, and on as many of the analytic expert, compared
//! on the same unseen layouts.
//!
//! All three read the simulator's poses (preset `state`) and have the same number of training steps and the same seed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_benchmark::EvaluationReport;
use genmanip_benchmark::distributions::layout_hash;
use genmanip_benchmark::statistics::{Rate, StatisticsSettings, compare};
use genmanip_core::{Episode, EpisodeSource, ExpertStyle, Policy, Scenario, Seed};
use genmanip_data::EpisodeStore;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_pipeline::learn::{Head, Length, Preset, TrainOptions, Trained, train};
use genmanip_pipeline::{PolicyFactory, Run, RunFolder};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::expert::{Expert, ExpertSettings};
use genmanip_rollout::{Stage, run_episode};
use genmanip_skills::{Skill, Transfer, TransferSettings, Verb};
use genmanip_workspace::task_spool::Tasks;
use genmanip_workspace::{Progress, text_table, worlds};
use serde::Serialize;

use super::resets::{RANGES, SkillCase, base, case_of, reset};
use super::sources::{Takes, demonstrations};
use crate::LabError;
use crate::clock::process_clock;

/// Time limit of an episode, demonstrated or of a policy, s.
const HORIZON_S: f64 = 60.0;
/// Most scenes tried per demonstration.
const SCENES_PER_DEMONSTRATION: usize = 2;

/// Amounts, and kinds of manipulation.
#[derive(Clone, Debug)]
pub struct WorthArguments {
    /// Kinds of manipulation.
    pub skills: Vec<Verb>,
    /// Takes of the scripted operator per skill.
    pub source_demos: usize,
    /// Generated demonstrations, and as many of the analytic expert.
    pub count: usize,
    /// Unseen layouts on which the policies are evaluated.
    pub layouts: usize,
    /// Optimiser steps of each training.
    pub steps: u64,
}

/// Results by skill.
#[derive(Clone, Debug, Serialize)]
pub struct WorthReport {
    /// Results by the name of the skill.
    pub skills: BTreeMap<&'static str, Worth>,
    /// Optimiser steps of each training.
    pub steps: u64,
    /// Unseen layouts per skill.
    pub layouts: usize,
    /// Limitations of the measurement, for people.
    pub notes: [&'static str; 3],
}

/// Success of policies trained on the demonstrations of one skill.
#[derive(Clone, Debug, Serialize)]
pub struct Worth {
    /// Takes from which a skill was cut.
    pub source_demos: usize,
    /// Policy trained on these takes.
    pub sources: Learned,
    /// Policy trained on episodes transferred from them.
    pub generated: Learned,
    /// Policy trained on episodes of the analytic expert.
    pub analytic: Learned,
    /// Success of `generated` minus that of `sources` on the same layouts.
    pub generated_minus_sources: Points,
    /// Success of `generated` minus that of `analytic` on the same layouts.
    pub generated_minus_analytic: Points,
    /// Takes of the scripted operator.
    pub takes: Takes,
    /// CPU time of demonstrations, trainings and evaluations, s.
    pub cpu_s: f64,
}

/// A trained policy on the unseen layouts.
#[derive(Clone, Debug, Serialize)]
pub struct Learned {
    /// Demonstrations trained on.
    pub demonstrations: usize,
    /// Success rate at the end of the episode, 0 to 1.
    pub success: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end of its 95 % interval.
    pub high: f64,
    /// Mean L1 error of normalised actions on training samples after the last step.
    pub final_l1: f64,
}

/// Paired difference of success rates, percentage points.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Points {
    /// Difference.
    pub points: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end of its 95 % interval.
    pub high: f64,
}

/// Limitations of the measurement, for people.
const NOTES: [&str; 3] = [
    "the operator is scripted; operator, transfer, expert and policies read poses from the simulator (oracle)",
    "demonstrations and unseen layouts are of one instance, alone on the table, in the ranges D0, D1 and D2 in turn",
    "the expert demonstrates on the scenes of the generated demonstrations, and in the style `consistent`",
];

/// Demonstrates, trains and evaluates in a new folder, with one thread.
///
/// # Errors
/// If a stage fails, too few demonstrations succeed, or an unseen layout is one of the demonstrated ones.
pub fn measure(
    arguments: &WorthArguments,
    seed: Seed,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<WorthReport, LabError> {
    let mut settings = PipelineSettings::in_world((*default_world()).clone());
    settings.rollout.horizon_s = HORIZON_S;
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources { catalogue: Catalogue::full(), ..Resources::builtin(&planner) };
    let mut skills = BTreeMap::new();
    for verb in &arguments.skills {
        let (case, seed) = (case_of(*verb)?, seed.fork(verb.name()));
        let instance = case.instances.first().ok_or_else(|| LabError::input("no instance"))?;
        let base = base(case, *instance, resources, &settings)?;
        let course = Course {
            case,
            base,
            resources,
            settings: &settings,
            arguments,
            seed,
            folder: folder.join(verb.name()),
            progress,
        };
        skills.insert(verb.name(), course.measure()?);
    }
    Ok(WorthReport { skills, steps: arguments.steps, layouts: arguments.layouts, notes: NOTES })
}

/// A new policy for a scene.
type MakePolicy<'a> = dyn Fn(&Stage) -> Result<Box<dyn Policy>, LabError> + 'a;

/// One skill and what it is measured with.
struct Course<'a> {
    case: &'a SkillCase,
    base: Scenario,
    resources: Resources<'a>,
    settings: &'a PipelineSettings,
    arguments: &'a WorthArguments,
    seed: Seed,
    folder: PathBuf,
    progress: &'a dyn Progress,
}

impl Course<'_> {
    fn measure(&self) -> Result<Worth, LabError> {
        let mut clock = process_clock();
        let WorthArguments { source_demos, layouts, .. } = *self.arguments;
        let broke = |error| LabError::broken("takes cannot be stored", error);
        let store = EpisodeStore::create(self.folder.join("takes")).map_err(broke)?;
        let (found, takes) = demonstrations(self.case, &self.base, source_demos, self.seed, self.resources, &store)?;
        if found.len() < source_demos {
            let reasons = takes.refused.join("; ");
            return Err(LabError::input(format!("{} of {source_demos} takes gave a skill: {reasons}", found.len()))
                .with_hint("take another seed"));
        }
        let skills: Arc<[Skill]> = found.iter().map(|demonstration| demonstration.skill.clone()).collect();
        let mut seen: BTreeSet<String> =
            found.iter().map(|demonstration| layout_hash(&demonstration.stage.scenario)).collect();
        self.run("sources", found.iter().map(|demonstration| Ok(demonstration.episode.clone())))?;

        let planner = self.resources.planner;
        let expert = ExpertSettings { style: ExpertStyle::Consistent, ..self.settings.expert.clone() };
        let transferred = |stage: &Stage| -> Result<Box<dyn Policy>, LabError> {
            Ok(Box::new(Transfer::new(stage, planner, Arc::clone(&skills), TransferSettings::default())))
        };
        let demonstrated = |stage: &Stage| -> Result<Box<dyn Policy>, LabError> {
            let expert = Expert::new(stage, planner, self.resources.grasps, expert.clone());
            Ok(Box::new(expert.map_err(|error| LabError::broken("the expert cannot be made", error))?))
        };
        seen.extend(self.demonstrate("generated", Some(EpisodeSource::Transfer), &transferred)?);
        seen.extend(self.demonstrate("analytic", None, &demonstrated)?);

        let suite = self.unseen(layouts, &seen)?;
        let trained = ["sources", "generated", "analytic"].into_iter().map(|name| self.train(name));
        let trained = trained.collect::<Result<Vec<Trained>, LabError>>()?;
        let policies = trained.iter().map(|it| PolicyFactory::resolve(&format!("learned:{}", it.policy.display())));
        let policies = policies.collect::<Result<Vec<_>, _>>()?;
        let options = EvaluateOptions { workers: 1, ..EvaluateOptions::default() };
        let reports = evaluate(&suite, &policies, &options, self.progress, &AtomicBool::new(false))?;
        let [sources, generated, analytic] = reports.as_slice() else { return Err(stopped()) };
        Ok(Worth {
            source_demos: found.len(),
            sources: Learned::of(&trained[0], sources),
            generated: Learned::of(&trained[1], generated),
            analytic: Learned::of(&trained[2], analytic),
            generated_minus_sources: difference(generated, sources)?,
            generated_minus_analytic: difference(generated, analytic)?,
            takes,
            cpu_s: clock(),
        })
    }

    /// Scene of a stream by its number; ranges take turns.
    fn scene(&self, stream: &str, number: usize) -> Result<Stage, LabError> {
        let id = format!("{}-{stream}-{number:04}", self.case.verb.name());
        let seed = self.seed.fork(stream).fork_index(number as u64);
        reset(&self.base, self.case, &RANGES[number % RANGES.len()], id, seed, self.resources)
    }

    /// Stores a run of verified episodes.
    fn run(&self, name: &str, episodes: impl Iterator<Item = Result<Episode, LabError>>) -> Result<(), LabError> {
        let tasks = Tasks::spool([self.base.task.clone()], &self.folder)?;
        let run = Run::new(tasks, 0, self.settings.clone(), self.seed.fork(name));
        let store = RunFolder::begin(&self.folder.join(name), &run)?.store()?;
        for episode in episodes {
            let broke = |error| LabError::broken("a demonstration cannot be stored", error);
            store.write(&episode?, &[]).map_err(broke)?;
        }
        Ok(())
    }

    /// Stores a run of episodes whose goal holds after settling; returns the hashes of their layouts.
    fn demonstrate(
        &self,
        name: &str,
        source: Option<EpisodeSource>,
        policy: &MakePolicy<'_>,
    ) -> Result<Vec<String>, LabError> {
        let (count, mut hashes) = (self.arguments.count, Vec::new());
        self.progress.begin(&format!("demonstrating, {name}"), count);
        let attempts = (0..count * SCENES_PER_DEMONSTRATION).map(|number| -> Result<(String, Episode), LabError> {
            let stage = self.scene("scene", number)?;
            let (id, seed) = (stage.scenario.id.clone(), stage.scenario.seed);
            let mut episode = run_episode(&stage, policy(&stage)?.as_mut(), &id, seed, &self.settings.rollout)
                .map_err(|error| LabError::broken(format!("episode {id} broke"), error))?;
            episode.result.source = source;
            Ok((layout_hash(&stage.scenario), episode))
        });
        let is_kept = |attempt: &Result<(String, Episode), LabError>| {
            attempt.as_ref().map_or(true, |(_, episode)| episode.result.success)
        };
        let kept = attempts.filter(is_kept).take(count).map(|attempt| {
            let (hash, episode) = attempt?;
            hashes.push(hash);
            self.progress.advance();
            Ok(episode)
        });
        self.run(name, kept)?;
        self.progress.end();
        match hashes.len() == count {
            true => Ok(hashes),
            false => Err(LabError::input(format!("{} of {count} demonstrations, {name}", hashes.len()))
                .with_hint("ask for fewer, or take another seed")),
        }
    }

    /// Unseen layouts; none has the hash of a demonstrated one.
    fn unseen(&self, count: usize, seen: &BTreeSet<String>) -> Result<Suite, LabError> {
        let scenes = (0..count).map(|number| Ok(self.scene("unseen", number)?.scenario));
        let scenes = scenes.collect::<Result<Vec<Arc<Scenario>>, LabError>>()?;
        if let Some(known) = scenes.iter().find(|scene| seen.contains(&layout_hash(scene))) {
            return Err(LabError::input(format!("layout {} was demonstrated", known.id)).with_hint("take another seed"));
        }
        let mut suite = Suite::of_loaded(format!("{} unseen", self.case.verb.name()), scenes)?;
        suite.settings.rollout = self.settings.rollout.clone();
        Ok(suite)
    }

    /// Trains on the demonstrations of a run.
    fn train(&self, name: &str) -> Result<Trained, LabError> {
        let options = TrainOptions {
            run: self.folder.join(name),
            sources: Vec::new(),
            preset: Preset::State,
            head: Head::L1,
            length: Length::Steps(self.arguments.steps),
            seed: self.seed.fork("training"),
            labels: false,
            out: self.folder.join(format!("{name}-policy")),
            threads: 1,
        };
        train(&options, self.progress, &AtomicBool::new(false))?.ok_or_else(stopped)
    }
}

impl Learned {
    fn of(trained: &Trained, report: &EvaluationReport) -> Self {
        let successes = report.results.iter().map(|result| result.success);
        let Rate { value, low, high, .. } = Rate::of(successes, &StatisticsSettings::default());
        let Trained { demonstrations, final_l1, .. } = *trained;
        Self { demonstrations, success: value, low, high, final_l1 }
    }
}

fn stopped() -> LabError {
    LabError::input("the measurement was stopped")
}

/// Success of the first minus that of the second on the same layouts.
fn difference(first: &EvaluationReport, second: &EvaluationReport) -> Result<Points, LabError> {
    let compared = compare(&first.results, &second.results, &StatisticsSettings::default());
    let difference = compared.map_err(|error| LabError::broken("results cannot be compared", error))?.difference;
    let [points, low, high] = [difference.value, difference.low, difference.high].map(|share| 100.0 * share);
    Ok(Points { points, low, high })
}

/// Text summary.
pub fn describe(report: &WorthReport) -> String {
    let percent = |it: &Learned| format!("{:.1} % ({:.1}–{:.1})", 100.0 * it.success, 100.0 * it.low, 100.0 * it.high);
    let points = |it: &Points| format!("{:+.1} ({:+.1} to {:+.1})", it.points, it.low, it.high);
    let header = ["skill", "sources", "generated", "analytic", "generated − sources", "generated − analytic"];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(report.skills.iter().map(|(name, worth)| {
        let learned = [&worth.sources, &worth.generated, &worth.analytic].map(percent);
        let differences = [&worth.generated_minus_sources, &worth.generated_minus_analytic].map(points);
        std::iter::once((*name).to_owned()).chain(learned).chain(differences).collect()
    }));
    let notes: String = report.notes.iter().map(|note| format!("\n{note}")).collect();
    format!("{}{notes}", text_table(&rows))
}
