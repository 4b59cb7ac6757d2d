//! Test of failure attribution: one error is injected per episode, the analysis labels the failed episodes without
//! knowing the error, and each is repeated with only the blamed answer replaced.
//!
//! Episodes that fail without the error too are excluded, since their true cause is unknown.

use genmanip_workspace::worlds;
use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_agent::PathKind;
use genmanip_agent::ask::VisionModel;
use genmanip_agent::services::GraspSource;
use genmanip_agent_sim::{AgentChoice, ErrorInjection, ModelChoice};
use genmanip_benchmark::statistics::{StatisticsSettings, wilson_interval};
use genmanip_core::{FailureClass, Seed, Task, TaskKind, World};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::{Environment, RolloutError, Stage, resume_episode, run_episode, run_episode_with};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;
use serde::Serialize;

use crate::clock::cpu_clock;
use crate::{LabError, episodes};

/// Number of tasks designed per batch.
const BATCH: usize = 20;
/// Maximum number of episodes per wanted failed episode.
const MAX_PER_FAILURE: usize = 12;

/// Agent, tasks and errors of the measurement.
pub struct BlameArguments {
    /// The agent; its error injection is overwritten here.
    pub choice: AgentChoice,
    /// Kinds of tasks to use.
    pub kinds: Vec<TaskKind>,
    /// Classes of the injected errors.
    pub classes: Vec<FailureClass>,
    /// Wanted number of failed episodes per class.
    pub per_class: usize,
    /// Number of episodes without injected errors; failed ones are repeated too.
    pub natural: usize,
}

/// Accuracy of the failure attribution.
#[derive(Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts and episodes.
    pub seed: u64,
    /// Name of the agent.
    pub agent: String,
    /// Maximum number of decompositions per task, and of picks per sub-task; `[1, 1]` is open loop.
    pub rounds_and_picks: [usize; 2],
    /// Results by class of the injected error.
    pub injected: BTreeMap<&'static str, Injected>,
    /// Correct labels, among all episodes that failed because of an injected error.
    pub labels_right: Share,
    /// Repetitions of failed episodes without an injected error, by label.
    pub natural: BTreeMap<&'static str, Replaced>,
    /// Failed episodes, among those without an injected error.
    pub natural_failed: Share,
    /// CPU time of the measurement, s.
    pub cpu_s: f64,
}

/// Episodes with an injected error of one class.
#[derive(Default, Serialize)]
pub struct Injected {
    /// Number of episodes in which the error could be injected.
    pub episodes: usize,
    /// Number of these that succeeded in spite of it.
    pub recovered: usize,
    /// Episodes that fail without the error as well: `of` is their number, `count` those labelled with the class of the
    /// error.
    /// They are counted in no other field.
    pub fail_anyway: Share,
    /// Failed episodes labelled with the class of the error, among those that succeed without it.
    pub labelled: Share,
    /// Number of failed episodes by label.
    pub labels: BTreeMap<&'static str, usize>,
    /// Repetitions of the failed episodes with the blamed answer replaced.
    pub replaced: Replaced,
    /// Evidence of the mislabelled episodes, as text.
    pub mislabelled: Vec<String>,
}

/// Outcomes of failed episodes repeated with the blamed answer replaced by the oracle's.
#[derive(Default, Serialize)]
pub struct Replaced {
    /// Number of failed episodes.
    pub failed: usize,
    /// Number without a blamed answer, because the manipulation failed.
    pub no_answer: usize,
    /// Number in which the blamed answer already was the oracle's.
    pub same_answer: usize,
    /// Episodes that succeed after the replacement, among those that were repeated.
    pub flips: Share,
    /// For agents that use plain cell centres: episodes that succeed when repeated with cells snapped to the visible
    /// surface.
    pub snapped: Share,
}

/// A rate with its interval.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Share {
    /// Number of successes.
    pub count: usize,
    /// Number of trials.
    pub of: usize,
    /// Success rate, 0 to 1; 0 without trials.
    pub share: f64,
    /// 95 % Wilson interval.
    pub interval: [f64; 2],
}

impl Share {
    fn add(&mut self, counts: bool) {
        self.count += usize::from(counts);
        self.of += 1;
        self.share = self.count as f64 / self.of as f64;
        self.interval = wilson_interval(self.count, self.of, StatisticsSettings::default().z);
    }
}

/// One episode, and its repetition if it failed.
struct Played {
    /// True if an error was injected.
    is_flawed: bool,
    /// Label, evidence, and outcome of the replacement; `None` for a success.
    failure: Option<(FailureClass, String, Outcome)>,
    /// True if the episode fails without the injected error as well.
    fails_anyway: bool,
    /// For an agent with plain cell centres: true if the failed episode succeeds with cells snapped to the surface.
    /// `None` for
    /// other agents.
    snapped: Option<bool>,
}

enum Outcome {
    NoAnswer,
    SameAnswer,
    Replaced { success: bool },
}

/// Injects errors of each class until enough episodes have failed; one thread.
///
/// # Errors
/// If an episode raises an error, or the model cannot be reached.
pub fn measure(
    arguments: &BlameArguments,
    world: &World,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let settings = PipelineSettings::in_world(world.clone());
    let planner = worlds::planner(world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    let mut clock = cpu_clock();
    let agent = &arguments.choice.settings;
    let mut measured = Measured {
        seed: seed.value(),
        agent: arguments.choice.name(),
        rounds_and_picks: [agent.rounds, agent.picks],
        injected: BTreeMap::new(),
        labels_right: Share::default(),
        natural: BTreeMap::new(),
        natural_failed: Share::default(),
        cpu_s: 0.0,
    };
    for &class in &arguments.classes {
        let mut injected = Injected::default();
        let choice = flawed(&arguments.choice, class);
        let kinds = kinds_for(class, &arguments.kinds);
        progress.begin(class.name(), arguments.per_class);
        let most = arguments.per_class * MAX_PER_FAILURE;
        let mut tried = 0;
        while injected.replaced.failed < arguments.per_class && tried < most {
            let batch = seed.fork(class.name()).fork_index(tried as u64);
            for task in episodes::tasks(&kinds, BATCH, batch)? {
                if injected.replaced.failed >= arguments.per_class {
                    break;
                }
                tried += 1;
                let Some(played) = play(&choice, &task, resources, (&settings, batch), progress)? else { continue };
                if !played.is_flawed {
                    continue;
                }
                injected.episodes += 1;
                injected.recovered += usize::from(played.failure.is_none());
                let Some((label, evidence, outcome)) = played.failure else { continue };
                let is_right = label == class;
                if played.fails_anyway {
                    injected.fail_anyway.add(is_right);
                    continue;
                }
                injected.labelled.add(is_right);
                measured.labels_right.add(is_right);
                *injected.labels.entry(label.name()).or_default() += 1;
                injected.replaced.add(&outcome);
                if !is_right {
                    let words = format!("{} {}: {evidence}", task.id, label.name());
                    progress.note(&format!("{} was labelled in {words}", class.name()));
                    injected.mislabelled.push(words);
                }
                progress.advance();
            }
        }
        progress.end();
        measured.injected.insert(class.name(), injected);
    }
    progress.begin("natural", arguments.natural);
    let natural = match arguments.natural {
        0 => Vec::new(),
        count => episodes::tasks(&arguments.kinds, count, seed.fork("natural"))?,
    };
    for task in natural {
        if let Some(played) = play(&arguments.choice, &task, resources, (&settings, seed.fork("natural")), progress)? {
            measured.natural_failed.add(played.failure.is_some());
            if let Some((label, _, outcome)) = &played.failure {
                let replaced = measured.natural.entry(label.name()).or_default();
                replaced.add(outcome);
                if let Some(success) = played.snapped {
                    replaced.snapped.add(success);
                }
            }
        }
        progress.advance();
    }
    progress.end();
    measured.cpu_s = clock();
    Ok(measured)
}

impl Replaced {
    fn add(&mut self, outcome: &Outcome) {
        self.failed += 1;
        match outcome {
            Outcome::NoAnswer => self.no_answer += 1,
            Outcome::SameAnswer => self.same_answer += 1,
            Outcome::Replaced { success } => self.flips.add(*success),
        }
    }
}

/// The agent with one error of the class injected per episode.
fn flawed(choice: &AgentChoice, class: FailureClass) -> AgentChoice {
    let mut choice =
        AgentChoice { dials: ErrorInjection { once: Some(class), ..ErrorInjection::default() }, ..choice.clone() };
    if class == FailureClass::PlanMotion {
        // Only paths over the grid have motion answers.
        choice.settings.path = PathKind::Grid;
    }
    choice
}

/// Kinds of tasks in which an error can be injected: a premature *finished* needs a second step to omit.
fn kinds_for(class: FailureClass, kinds: &[TaskKind]) -> Vec<TaskKind> {
    match class {
        FailureClass::Checker => vec![TaskKind::LongHorizon],
        _ => kinds.to_vec(),
    }
}

/// One episode with its label, repeated if it failed; `None` without a layout, or if the model cannot be reached.
fn play(
    choice: &AgentChoice,
    task: &Task,
    resources: Resources,
    (settings, seed): (&PipelineSettings, Seed),
    progress: &dyn Progress,
) -> Result<Option<Played>, LabError> {
    let broke = |error: RolloutError| LabError::broken(format!("episode {} broke", task.id), error);
    let stream = seed.fork("blame").fork(&task.id);
    let Some((attempt, scenario)) = episodes::laid_out(task, resources, settings, stream)? else { return Ok(None) };
    let stage = Stage::open(Arc::new(scenario), resources.catalogue, resources.planner.robot()).map_err(broke)?;
    let choice = AgentChoice { is_analysed: true, keeps_turns: true, ..choice.clone() };
    let truth = genmanip_agent_sim::GroundTruth::new(&stage);
    let oracle = Arc::new(choice.oracle_of(&truth, resources.planner, resources.grasps)?);
    let model = choice.answering(Some(Arc::clone(&oracle)), &stage.scenario, None)?;
    let mut made = choice.make_asking(Arc::clone(&model), truth.clone(), resources.planner)?;
    let mut moments = Vec::new();
    let mut watch = |environment: &Environment| {
        moments.push(environment.save()?);
        Ok(())
    };
    let id = attempt.id();
    let episode = run_episode_with(&stage, &mut made, &id, attempt.seed, &settings.rollout, &mut watch);
    let episode = match episode {
        Err(RolloutError::NotRun { reason, .. }) => {
            progress.note(&format!("{id} was not run: {reason}"));
            return Ok(None);
        }
        episode => episode.map_err(broke)?,
    };
    let is_flawed = !truth.injected().is_empty();
    if episode.result.success {
        return Ok(Some(Played { is_flawed, failure: None, fails_anyway: false, snapped: None }));
    }
    let blamed = episode.result.agent_failure;
    let blamed = blamed.ok_or_else(|| LabError::input("a failed episode was not analysed, which is a defect"))?;
    let class = blamed.class.ok_or_else(|| LabError::input("a failed episode has no class, which is a defect"))?;
    let honest = Arc::new(oracle.honest());
    // Recorded answers exist only for the unchanged episode; repetitions need a model that answers anew.
    let then = match &choice.model {
        ModelChoice::Oracle | ModelChoice::Recorded => Arc::clone(&honest) as Arc<dyn VisionModel>,
        ModelChoice::Chat(_) | ModelChoice::Random => model,
    };
    let source: Arc<dyn GraspSource> = choice.grasp_source(resources.planner);
    let outcome = match made.corrected(&blamed, &honest, then, source) {
        None => Outcome::NoAnswer,
        Some(mut counterfactual) => {
            let mut environment = Environment::new(settings.rollout.clone());
            let moment = moments.get(counterfactual.turn);
            let moment = moment.ok_or_else(|| LabError::input("a turn was not saved, which is a defect"))?;
            environment.restore(moment).map_err(broke)?;
            let again = resume_episode(&mut environment, &stage, &mut counterfactual.policy, &id).map_err(broke)?;
            match counterfactual.is_same() {
                true => Outcome::SameAnswer,
                false => Outcome::Replaced { success: again.result.success },
            }
        }
    };
    let succeeds = |other: &AgentChoice| -> Result<bool, LabError> {
        let mut made = other.make(&stage, resources.planner, resources.grasps, None)?;
        let again = run_episode(&stage, &mut made, &id, attempt.seed, &settings.rollout).map_err(broke)?;
        Ok(again.result.success)
    };
    let mut other = AgentChoice { dials: ErrorInjection::default(), keeps_turns: false, ..choice.clone() };
    let fails_anyway = is_flawed && !succeeds(&other)?;
    let mut snapped = None;
    if !is_flawed && !choice.settings.cells.snap {
        other.settings.cells.snap = true;
        snapped = Some(succeeds(&other)?);
    }
    let failure = Some((class, blamed.evidence, outcome));
    Ok(Some(Played { is_flawed, failure, fails_anyway, snapped }))
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let share = |share: &Share| match share.of {
        0 => "–".to_owned(),
        of => {
            let [low, high] = share.interval.map(|bound| 100.0 * bound);
            format!("{} of {of}, {:.0} % ({low:.0}–{high:.0})", share.count, 100.0 * share.share)
        }
    };
    let head = [
        "mistake",
        "episodes",
        "recovered",
        "fail anyway",
        "labelled so",
        "labelled otherwise",
        "succeed when replaced",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    for (class, injected) in &measured.injected {
        let others = injected.labels.iter().filter(|(label, _)| *label != class);
        let others: Vec<String> = others.map(|(label, count)| format!("{label} {count}")).collect();
        rows.push(vec![
            (*class).to_owned(),
            injected.episodes.to_string(),
            injected.recovered.to_string(),
            injected.fail_anyway.of.to_string(),
            share(&injected.labelled),
            others.join(", "),
            share(&injected.replaced.flips),
        ]);
    }
    let [rounds, picks] = measured.rounds_and_picks;
    let mut text = format!(
        "{} (oracle), {rounds} rounds, {picks} picks\n{}\nlabels right: {}\n",
        measured.agent,
        text_table(&rows),
        share(&measured.labels_right)
    );
    let head = [
        "natural failure",
        "failed",
        "no answer to blame",
        "oracle's already",
        "succeed when replaced",
        "succeed when cells snap",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    for (label, replaced) in &measured.natural {
        let Replaced { failed, no_answer, same_answer, flips, snapped } = replaced;
        rows.push(vec![
            (*label).to_owned(),
            failed.to_string(),
            no_answer.to_string(),
            same_answer.to_string(),
            share(flips),
            share(snapped),
        ]);
    }
    if measured.natural_failed.of > 0 {
        text += &format!("without an injected error {} failed\n{}", share(&measured.natural_failed), text_table(&rows));
    }
    text
}

#[cfg(test)]
mod tests {
    use genmanip_assets::worlds::default_world;
    use genmanip_workspace::NoProgress;

    use super::*;

    #[test]
    fn a_mistake_is_found_and_replacing_it_alone_saves_the_episode() {
        let mut choice = AgentChoice::named("oracle", "oracle", "p2p", "full").unwrap();
        choice.settings = choice.settings.open_loop();
        let classes = vec![FailureClass::GraspGrounding, FailureClass::GraspExecution, FailureClass::PlanLocation];
        let kinds = vec![TaskKind::Spatial];
        let arguments = BlameArguments { choice, kinds, classes, per_class: 1, natural: 0 };
        let measured = measure(&arguments, &default_world(), Seed::new(7), &NoProgress).unwrap();
        assert_eq!((measured.labels_right.count, measured.labels_right.of), (3, 3), "{}", describe(&measured));
        let outcome = |class: FailureClass| {
            let replaced = &measured.injected[class.name()].replaced;
            (replaced.no_answer, replaced.same_answer, replaced.flips.count)
        };
        assert_eq!(outcome(FailureClass::GraspGrounding), (0, 0, 1));
        assert_eq!(outcome(FailureClass::PlanLocation), (0, 0, 1));
        // Jammed fingers are not an answer.
        assert_eq!(outcome(FailureClass::GraspExecution), (1, 0, 0));
    }
}
