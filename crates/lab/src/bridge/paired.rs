//! Policies behind the bridge against direct simulation, on the same scenes.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{StatisticsSettings, paired_difference};
use genmanip_core::{Policy, Seed};
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::policies::PolicyContext;
use genmanip_pipeline::real::arm::{ArmSettings, RealArm, SideChannel};
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::points::{PointJudge, PointVerdict, is_shown, moment};
use genmanip_pipeline::real::rehearsal::Rehearsal;
use genmanip_pipeline::real::simulated::SimulatedArmSettings;
use genmanip_real::bridge::BridgeSettings;
use genmanip_real::bridge::client::{ArmClient, ClientSettings, Tally};
use genmanip_relations::judge_goal;
use genmanip_rollout::collect::Resources;
use genmanip_rollout::evaluate::Case;
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, run_episode, run_policy};
use genmanip_workspace::{Progress, WorkspaceError, worlds};
use serde::Serialize;

use super::LINK;
use crate::clock::cpu_clock;

/// Success of a policy behind the bridge and in direct simulation, on the same scenes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Paired {
    /// Policy.
    pub policy: String,
    /// Number of scenes.
    pub scenes: usize,
    /// Number of scenes solved directly, behind the bridge, and in both ways.
    pub solved: [usize; 3],
    /// Mean paired difference (behind the bridge minus direct) and its 95 % interval, percentage points.
    pub difference_points: [f64; 3],
    /// Counts of all episodes behind the bridge.
    pub tally: Tally,
    /// Ids of scenes that one of the two solved.
    pub different: Vec<String>,
    /// Verdicts on the images behind the bridge against simulator truth; `None` if they were not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsAgainstTruth>,
    /// CPU time, s.
    pub cpu_s: f64,
}

/// Verdicts of `real run --judge points` on the ends of episodes, against simulator truth.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PointsAgainstTruth {
    /// Number of episodes judged; goals about joint states are not.
    pub judged: usize,
    /// Number of episodes for which images and truth agree.
    pub agree: usize,
    /// Number of episodes with objects of the goal that the images did not show at the end.
    pub with_unseen: usize,
    /// Ids of scenes that only the images call done.
    pub only_images: Vec<String>,
    /// Ids of scenes that only the truth calls done, with what the images showed.
    pub only_truth: Vec<String>,
}

/// A policy on the first `scenes` scenes of a suite, directly and behind the bridge with latency, jitter and loss.
///
/// Privileged policies read the truth over a side channel that a real bridge lacks.
///
/// # Errors
/// When an episode cannot be run.
pub fn measure(
    suite: &Suite,
    policy: &PolicyFactory,
    scenes: usize,
    points: bool,
    progress: &dyn Progress,
) -> Result<Paired, WorkspaceError> {
    let mut clock = cpu_clock();
    let settings = &suite.settings;
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources { catalogue: suite.source(), ..Resources::builtin(&planner) };
    let points = points.then(PointsAgainstTruth::default);
    let mut found = Paired { policy: policy.label().into(), points, ..Paired::default() };
    let mut differences = Vec::new();
    let cases = &suite.cases[..scenes.min(suite.cases.len())];
    progress.begin("scenes", cases.len());
    for case in cases {
        let stage = Stage::open(Arc::clone(&case.scenario), resources.catalogue, planner.robot()).map_err(broken)?;
        let rollout = RolloutSettings {
            horizon_s: case.horizon_s.unwrap_or(settings.rollout.horizon_s),
            ..settings.rollout.clone()
        };
        let make = || -> Result<Box<dyn Policy>, WorkspaceError> {
            policy.make(&PolicyContext {
                stage: &stage,
                recorded: None,
                planner: &planner,
                grasps: resources.grasps,
                settings,
                cores: None,
            })
        };
        let direct = run_episode(&stage, make()?.as_mut(), &case.id, case.seed, &rollout).map_err(broken)?;
        let judged = found.points.as_mut().filter(|_| is_shown(&stage.goal));
        let (behind, tally, seen) = behind_bridge(&stage, make()?.as_mut(), case, &rollout, judged.is_some())?;
        judged.zip(seen).into_iter().for_each(|(points, seen)| points.add(&case.id, behind, &seen));
        found.scenes += 1;
        let solved = [direct.result.success, behind, direct.result.success && behind];
        found.solved.iter_mut().zip(solved).for_each(|(count, is_solved)| *count += usize::from(is_solved));
        if direct.result.success != behind {
            found.different.push(case.id.clone());
        }
        differences.push(vec![i8::from(behind) - i8::from(direct.result.success)]);
        add(&mut found.tally, &tally);
        progress.advance();
    }
    progress.end();
    let difference = paired_difference(&differences, &StatisticsSettings::default(), Seed::new(0));
    found.difference_points = [difference.value, difference.low, difference.high].map(|share| 100.0 * share);
    found.cpu_s = clock();
    Ok(found)
}

/// Success of an episode behind the bridge, judged by simulator truth after settling, its counts, and the verdict on its
/// images if asked for.
fn behind_bridge(
    stage: &Stage,
    policy: &mut dyn Policy,
    case: &Case,
    rollout: &RolloutSettings,
    points: bool,
) -> Result<(bool, Tally, Option<PointVerdict>), WorkspaceError> {
    let arm = SimulatedArmSettings::default();
    let rehearsal = Rehearsal::new(stage, BridgeSettings::default(), arm, LINK, case.seed)?;
    let held = Arc::new(AtomicBool::new(true));
    let client = ArmClient::connect(rehearsal, ClientSettings::default(), held)
        .map_err(|error| WorkspaceError::broken("the rehearsal", error))?;
    let settings = ArmSettings { horizon_s: rollout.horizon_s, dry_run: false };
    let mut robot = RealArm::new(client, stage, settings, Rig::default()).map_err(broken)?.with_truth();
    let begin = |robot: &mut RealArm<Rehearsal>| PointJudge::begin(stage, moment(robot, stage)?);
    let judge = points.then(|| begin(&mut robot).map_err(broken)).transpose()?;
    match run_policy(&mut robot, stage, policy, case.seed, rollout) {
        // The policy could not even begin, such as one that asks for more than a real camera shows.
        Err(error @ RolloutError::Robot(_)) if robot.client().tally().commands == 0 => return Err(broken(error)),
        // The arm was stopped for good, by itself: the episode has failed.
        Ok(_) | Err(RolloutError::Robot(_)) => {}
        Err(error) => return Err(broken(error)),
    }
    // A robot that was stopped cannot hold either.
    let _ = robot.hold(rollout.settle_s);
    let truth = robot.client().connection().truth();
    let rest = Stage::rest(&truth.objects, truth.grasped, rollout);
    let verdict = judge_goal(&stage.posed(&truth.objects), &stage.goal, &rest, &stage.relations);
    let seen =
        judge.map(|judge| moment(&mut robot, stage).map(|last| judge.judge(last)).map_err(broken)).transpose()?;
    Ok((verdict.success, robot.client().tally().clone(), seen))
}

impl PointsAgainstTruth {
    fn add(&mut self, id: &str, truth: bool, seen: &PointVerdict) {
        self.judged += 1;
        self.agree += usize::from(seen.verdict.success == truth);
        self.with_unseen += usize::from(!seen.verdict.unseen.is_empty());
        match (seen.verdict.success, truth) {
            (true, false) => self.only_images.push(id.into()),
            (false, true) => self.only_truth.push(format!("{id}: {}", seen.text())),
            _ => {}
        }
    }
}

fn add(sum: &mut Tally, tally: &Tally) {
    sum.commands += tally.commands;
    sum.starts += tally.starts;
    sum.arm_stops += tally.arm_stops;
    for (map, more) in [(&mut sum.refused, &tally.refused), (&mut sum.errors, &tally.errors)] {
        more.iter().for_each(|(word, count)| *map.entry(word.clone()).or_default() += count);
    }
}

fn broken(error: RolloutError) -> WorkspaceError {
    WorkspaceError::broken("an episode behind the bridge", error)
}

impl Paired {
    /// The measurement in words.
    pub fn text(&self) -> String {
        let [direct, behind, both] = self.solved;
        let [mean, low, high] = self.difference_points;
        let mut text = format!(
            "{}: {} scenes, {direct} solved directly, {behind} behind the bridge, {both} both; difference {mean:.1} points \
             ({low:.1} to {high:.1}), {} stops of the arm\n",
            self.policy, self.scenes, self.tally.arm_stops
        );
        if let Some(points) = &self.points {
            text += &format!(
                "  verdicts on images: {} of {} as the truth; {} with objects not seen, {} only by images, {} only by truth\n",
                points.agree,
                points.judged,
                points.with_unseen,
                points.only_images.len(),
                points.only_truth.len()
            );
        }
        text
    }
}
