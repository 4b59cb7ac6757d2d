//! Skills cut from a few takes and transferred to many scenes, against the analytic skills and MimicGen as published.
//!
//! Sources are takes of a scripted operator through the input path. All arms run on the same scenes, one object alone
//! on the table, and their episodes are judged after settling; MimicGen also by its own criterion, success at any step.

mod mimicgen;
mod report;
mod resets;
mod sources;
pub mod worth;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_core::{Atom, Episode, EpisodeSource, Frame, Policy, Pose, Seed};
use genmanip_data::EpisodeStore;
use genmanip_layout::articulation::joint_changes;
use genmanip_relations::judge_atom;
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::expert::Expert;
use genmanip_rollout::{Environment, RolloutError, RolloutSettings, Stage, replay, run_episode};
use genmanip_skills::handle::Handle;
use genmanip_skills::{Skill, Transfer, TransferSettings, Verb};
use genmanip_workspace::{Progress, worlds};

use self::mimicgen::{MimicGen, PlannedBridge, Source};
use self::report::ABLATIONS;
pub use self::report::{Details, Report, SkillReport, describe};
use self::resets::{RANGES, SkillCase, base, case_of, reset};
use self::sources::{Demonstration, demonstrations};
use crate::LabError;
use crate::clock::cpu_clock;

/// Time limit of a generated episode, s.
const HORIZON_S: f64 = 60.0;

/// Amounts, and kinds of manipulation.
#[derive(Clone, Debug)]
pub struct TransferArguments {
    /// Kinds of manipulation.
    pub skills: Vec<Verb>,
    /// Source demonstrations per skill.
    pub source_demos: usize,
    /// Scenes of the same instance, and as many of unseen instances.
    pub count: usize,
    /// True to measure the transfer without each of its ingredients.
    pub ablate: bool,
    /// Folder to keep takes and generated episodes in; `None` to remove them afterwards.
    pub out: Option<PathBuf>,
}

/// Limitations of the measurement, for people.
const NOTES: [&str; 5] = [
    "the operator is scripted: virtual devices with reaction time, tremor, overshoot and pauses; it reads poses from the simulator (oracle)",
    "all arms read object poses from the simulator (oracle)",
    "each scene has one object, alone on the table; pick_and_place has a plate, which moves by a quarter of the offsets",
    "mimicgen is written from the published description: marks from the segments of each source, two subtasks, body frame, 20 Hz",
    "the published noise meets stiff position control here; the original's controller is compliant",
];

/// Measures with one thread.
///
/// # Errors
/// If a scene cannot be made, an episode raises an error, or a file cannot be written.
pub fn measure(arguments: &TransferArguments, seed: Seed, progress: &dyn Progress) -> Result<Report, LabError> {
    let mut clock = cpu_clock();
    let mut settings = PipelineSettings::in_world((*default_world()).clone());
    settings.rollout.horizon_s = HORIZON_S;
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources { catalogue: Catalogue::full(), ..Resources::builtin(&planner) };
    let temporary = std::env::temp_dir().join(format!("genmanip-lab-transfer-{}", std::process::id()));
    let folder = arguments.out.as_ref().unwrap_or(&temporary);
    let store = EpisodeStore::create(folder).map_err(|error| LabError::broken("episodes cannot be stored", error))?;
    let (mut skills, mut details) = (BTreeMap::new(), BTreeMap::new());
    for verb in &arguments.skills {
        let case = case_of(*verb)?;
        let bench = Bench { case, resources, settings: &settings, store: &store, arguments };
        let (report, detail) = bench.measure(seed.fork(verb.name()), progress)?;
        skills.insert(verb.name(), report);
        details.insert(verb.name(), detail);
    }
    if arguments.out.is_none() {
        // Best effort: a folder that cannot be removed lies in the system's temporary folder.
        let _ = std::fs::remove_dir_all(&temporary);
    }
    Ok(Report { skills, details, resets: RANGES, notes: NOTES.to_vec(), cpu_s: clock() })
}

/// One skill and what it is measured with.
struct Bench<'a> {
    case: &'a SkillCase,
    resources: Resources<'a>,
    settings: &'a PipelineSettings,
    store: &'a EpisodeStore,
    arguments: &'a TransferArguments,
}

impl Bench<'_> {
    fn measure(&self, seed: Seed, progress: &dyn Progress) -> Result<(SkillReport, Details), LabError> {
        let verb = self.case.verb.name();
        let mut detail = Details::default();
        let of = |instance: u32| base(self.case, instance, self.resources, self.settings);
        let (own, others) = self.case.instances.split_first().ok_or_else(|| LabError::input("no instance"))?;
        let own = of(*own)?;
        let others = others.iter().map(|instance| of(*instance)).collect::<Result<Vec<_>, _>>()?;
        let wanted = self.arguments.source_demos;
        let (found, takes) = demonstrations(self.case, &own, wanted, seed, self.resources, self.store)?;
        detail.takes = takes;
        if found.is_empty() {
            return Err(LabError::input(format!("no take of {verb} gave a skill: {:?}", detail.takes)));
        }
        let skills: Arc<[Skill]> = found.iter().map(|demonstration| demonstration.skill.clone()).collect();
        let sources: Vec<Source> = found.iter().map(|demonstration| self.source(demonstration)).collect();

        let count = self.arguments.count;
        let [mut same, mut unseen, mut analytic] = [0; 3];
        let mut ablated = [0; ABLATIONS.len()];
        progress.begin("transferring", 2 * count);
        for number in 0..2 * count {
            let is_same = number < count;
            let base = if is_same { &own } else { &others[number % others.len()] };
            let range = &RANGES[number % RANGES.len()];
            let own_seed = seed.fork("scene").fork_index(number as u64);
            let id = format!("{verb}-{}-{number:03}", if is_same { "same" } else { "unseen" });
            let mut clock = cpu_clock();
            let stage = reset(base, self.case, range, id.clone(), own_seed, self.resources)?;
            let settings = TransferSettings::default();
            let mut policy = Transfer::new(&stage, self.resources.planner, Arc::clone(&skills), settings);
            let mut episode = self.run(&stage, &mut policy, &id, own_seed)?;
            episode.result.source = Some(EpisodeSource::Transfer);

            detail.transfer_cpu_s += clock();
            let is_kept = episode.result.success;
            let by_range = if is_same { &mut detail.same_by_range } else { &mut detail.unseen_by_range };
            let counts = by_range.entry(range.name).or_default();
            counts[0] += usize::from(is_kept);
            counts[1] += 1;
            if is_kept {
                same += usize::from(is_same);
                unseen += usize::from(!is_same);
                *detail.used.entry(policy.used().unwrap_or_default().to_owned()).or_default() += 1;
                self.keep(&stage, &episode, &mut detail)?;
            } else {
                let failure = episode.result.failure();
                let reason = failure.map_or_else(String::new, |failure| format!("{id}: {}", failure.evidence));
                *detail.failures.entry(reason).or_default() += 1;
            }
            if self.arguments.ablate {
                self.ablate(&stage, &found, &episode, own_seed, &mut ablated)?;
            }
            if self.arguments.ablate {
                let mut calm = MimicGen::new(sources.clone(), self.objects()).without_noise();
                let calm = self.run(&stage, &mut calm, &format!("{id}-calm"), own_seed)?;
                detail.without_noise_settled_and_any_step[0] += usize::from(calm.result.success);
                detail.without_noise_settled_and_any_step[1] += usize::from(self.held_at_any_step(&stage, &calm));
                let bridge = PlannedBridge { planner: Arc::clone(self.resources.planner), stage: stage.clone() };
                let mut planned = MimicGen::new(sources.clone(), self.objects()).with_planned_bridges(bridge);
                let planned = self.run(&stage, &mut planned, &format!("{id}-skillgen"), own_seed)?;
                let any_step = self.held_at_any_step(&stage, &planned);
                detail.skillgen_settled_and_any_step[0] += usize::from(planned.result.success);
                detail.skillgen_settled_and_any_step[1] += usize::from(any_step);
            }
            let mut published = MimicGen::new(sources.clone(), self.objects());
            let published = self.run(&stage, &mut published, &format!("{id}-mimicgen"), own_seed)?;
            let any_step = self.held_at_any_step(&stage, &published);
            if let Some(failure) = published.result.failure() {
                *detail.mimicgen_failures.entry(format!("{id}: {}", failure.evidence)).or_default() += 1;
            }
            detail.mimicgen_settled_and_any_step[0] += usize::from(published.result.success);
            detail.mimicgen_settled_and_any_step[1] += usize::from(any_step);
            tally(&mut detail.transfer_only_and_mimicgen_only, is_kept, any_step);
            let grasps = self.resources.grasps;
            let mut expert = Expert::new(&stage, self.resources.planner, grasps, self.settings.expert.clone())
                .map_err(|error| LabError::broken("the expert cannot be made", error))?;
            let solved = self.run(&stage, &mut expert, &format!("{id}-analytic"), own_seed)?.result.success;
            analytic += usize::from(solved);
            tally(&mut detail.transfer_only_and_analytic_only, is_kept, solved);
            progress.advance();
        }
        progress.end();
        detail.scenes = 2 * count;
        let [kept, failed_again] = detail.kept_and_failed_again;
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        if self.arguments.ablate {
            detail.ablations =
                ABLATIONS.into_iter().zip(ablated.map(|successes| share(successes, 2 * count))).collect();
        }
        let report = SkillReport {
            source_demos: found.len(),
            generation_rate: share(same + unseen, 2 * count),
            same_instance: share(same, count),
            unseen_instances: share(unseen, count),
            kept_after_settling: share(kept - failed_again, kept),
            per_core_hour: kept as f64 / (detail.transfer_cpu_s / 3600.0),
            analytic: share(analytic, 2 * count),
            mimicgen: share(detail.mimicgen_settled_and_any_step[1], 2 * count),
        };
        Ok((report, detail))
    }

    fn run(&self, stage: &Stage, policy: &mut dyn Policy, id: &str, seed: Seed) -> Result<Episode, LabError> {
        run_episode(stage, policy, id, seed, &self.settings.rollout)
            .map_err(|error| LabError::broken(format!("episode {id} broke"), error))
    }

    /// Indices of the objects of MimicGen's subtasks.
    fn objects(&self) -> [usize; 2] {
        if self.case.under.is_empty() { [0, 0] } else { [0, 1] }
    }

    /// A demonstration as a source of MimicGen.
    fn source(&self, demonstration: &Demonstration) -> Source {
        let Demonstration { stage, episode, skill } = demonstration;
        let target = |command: &[f32]| {
            let arm: Vec<f64> = command[..stage.robot.arm_dof()].iter().copied().map(f64::from).collect();
            self.resources.planner.tcp_pose(&arm)
        };
        let mark = skill.segments.manipulate[0];
        Source::of(&episode.frames, episode.result.control_rate_hz, self.objects(), mark, target)
    }

    /// Transfers without each ingredient, in the order of [`ABLATIONS`]; `whole` is the episode with all of them.
    fn ablate(
        &self,
        stage: &Stage,
        found: &[Demonstration],
        whole: &Episode,
        seed: Seed,
        successes: &mut [usize; ABLATIONS.len()],
    ) -> Result<(), LabError> {
        let own: Arc<[Skill]> = found.iter().map(|demonstration| demonstration.skill.clone()).collect();
        let body: Arc<[Skill]> = found.iter().filter_map(|source| in_body_frame(source, stage)).collect();
        let all = TransferSettings::default;
        let arms = [
            (Arc::clone(&own), TransferSettings { plans_approach: false, ..all() }),
            (body, all()),
            (own, TransferSettings { waits_for_hand: false, ..all() }),
        ];
        for (index, (skills, settings)) in arms.into_iter().enumerate() {
            let mut policy = Transfer::new(stage, self.resources.planner, skills, settings);
            let id = format!("{}-{index}", whole.result.id);
            successes[index] += usize::from(self.run(stage, &mut policy, &id, seed)?.result.success);
        }
        successes[3] += usize::from(self.held_at_any_step(stage, whole));
        Ok(())
    }

    /// Stores a kept episode, replays it and judges it again.
    fn keep(&self, stage: &Stage, episode: &Episode, detail: &mut Details) -> Result<(), LabError> {
        let id = &episode.result.id;
        self.store.write(episode, &[]).map_err(|error| LabError::broken("an episode cannot be stored", error))?;
        let broke = |error: RolloutError| LabError::broken(format!("the replay of episode {id} broke"), error);
        detail.kept_and_failed_again[0] += 1;
        detail.replay_equal += usize::from(replay::check(stage, episode).map_err(broke)?.identical);
        detail.kept_and_failed_again[1] +=
            usize::from(!holds_again(stage, episode, &self.settings.rollout).map_err(broke)?);
        Ok(())
    }

    /// True if the goal held at any step (of a relation, at 20 Hz), whatever moved or was held.
    fn held_at_any_step(&self, stage: &Stage, episode: &Episode) -> bool {
        if !self.case.under.is_empty() {
            let holds = |frame: &Frame| {
                let scene = stage.posed(&frame.objects);
                let is_met =
                    |atoms: &Vec<Atom>| atoms.iter().all(|atom| judge_atom(&scene, atom, &stage.relations).holds);
                stage.goal.alternatives.iter().any(is_met)
            };
            return episode.frames.iter().step_by(3).any(holds);
        }
        let model = &stage.models[0];
        let Some(wanted) = model.joint_states.iter().find(|state| state.name == self.case.states[1]) else {
            return false;
        };
        let links: Vec<&str> =
            model.links.iter().filter(|link| link.joint.is_some()).map(|link| link.name.as_str()).collect();
        episode.frames.iter().any(|frame| {
            wanted.intervals.iter().all(|(name, [low, high])| {
                let joint = links.iter().position(|link| link == name);
                joint.is_some_and(|joint| (*low..=*high).contains(&frame.objects[0].joint_positions[joint]))
            })
        })
    }
}

/// A skill as if it were relative to the body of the object: its poses for a scene, written in the frame of that scene's
/// handle. `None` if nothing is to be moved.
fn in_body_frame(source: &Demonstration, stage: &Stage) -> Option<Skill> {
    // The frame of a carried object is that of its body.
    let Some(moved) = &source.skill.motion else { return Some(source.skill.clone()) };
    let goal = &moved.states[1];
    let there = joint_changes(source.stage.start(), 0, goal).into_iter().next()?;
    let here = joint_changes(stage.start(), 0, goal).into_iter().next()?;
    let (model, own_model) = (&source.stage.models[0], &stage.models[0]);
    let handle = Handle::of(model, there.link, there.joint)?;
    let own = Handle::of(own_model, here.link, here.joint)?;
    let object_from_handle = |position: f64| {
        handle.world_pose(model, &Pose::IDENTITY, &source.stage.scenario.objects[0].joint_positions, position)
    };
    let handle_from_object = |position: f64| {
        let positions = &stage.scenario.objects[0].joint_positions;
        own.world_pose(own_model, &Pose::IDENTITY, positions, position).inverse()
    };
    let mut skill = source.skill.clone();
    let motion = skill.motion.as_mut()?;
    let [from, to] = motion.from_to;
    let end = here.from + (here.targets.first()? - here.from) * motion.travelled();
    let moved = |poses: &mut [Pose], share: &dyn Fn(usize) -> f64| {
        for (index, pose) in poses.iter_mut().enumerate() {
            let (was, is) = (from + (to - from) * share(index), here.from + (end - here.from) * share(index));
            *pose = handle_from_object(is) * object_from_handle(was) * *pose;
        }
    };
    let last = motion.along.len() - 1;
    moved(&mut motion.approach, &|_| 0.0);
    moved(&mut motion.along, &|index| index as f64 / last as f64);
    moved(&mut motion.retreat, &|_| 1.0);
    motion.handle_half_m = own.half_m;
    Some(skill)
}

/// Counts a scene in which one of two arms succeeded.
fn tally(only: &mut [usize; 2], first: bool, second: bool) {
    only[0] += usize::from(first && !second);
    only[1] += usize::from(second && !first);
}

/// True if the goal of an episode holds after its commands, and the last one held for the settling time once more.
fn holds_again(stage: &Stage, episode: &Episode, settings: &RolloutSettings) -> Result<bool, RolloutError> {
    let settings = RolloutSettings { horizon_s: f64::INFINITY, ..settings.clone() };
    let mut environment = Environment::new(settings);
    environment.reset(stage, episode.result.seed);
    for frame in &episode.frames {
        environment.step(&frame.command)?;
    }
    Ok(environment.settle()?.verdict.is_some_and(|verdict| verdict.success))
}
