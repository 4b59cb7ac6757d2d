//! Bridge to an arm: random streams of commands against its limits, and policies behind it against direct simulation.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::statistics::{StatisticsSettings, paired_difference};
use genmanip_core::{Policy, Seed};
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::plan::{MotionRequest, Target, plan};
use genmanip_pipeline::policies::PolicyContext;
use genmanip_pipeline::real::arm::{ArmSettings, RealArm, SideChannel};
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::points::{PointJudge, PointVerdict, is_shown, moment};
use genmanip_pipeline::real::rehearsal::Rehearsal;
use genmanip_pipeline::real::simulated::{SimulatedArmSettings, bridge_robot};
use genmanip_real::bridge::client::{ArmClient, BridgeError, ClientSettings, SLOW, Tally, TcpConnection};
use genmanip_real::bridge::{
    Bridge, BridgeSettings, Command, JointState, LinkSettings, Motion, Orders, Reading, Reply, Request, State,
    StopReason,
};
use genmanip_relations::judge_goal;
use genmanip_rollout::collect::Resources;
use genmanip_rollout::evaluate::Case;
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, run_episode, run_policy};
use genmanip_workspace::{Progress, WorkspaceError, scenarios, worlds};
use rand::{Rng, RngExt};
use serde::Serialize;

use crate::Spread;
use crate::clock::cpu_clock;

/// Control periods of a stream.
const TICKS: usize = 400;
/// Connection between policy and bridge: 20 ± 10 ms, 1 % of the streamed messages lost.
pub(crate) const LINK: LinkSettings = LinkSettings { latency_s: 0.02, jitter_s: 0.01, loss: 0.01 };

/// Violations of limits, and times to stop, over random streams of commands.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Streams {
    /// Number of streams.
    pub count: usize,
    /// Largest velocity, acceleration and jerk of any setpoint, as shares of their limits.
    pub worst_share: [f64; 3],
    /// Number of stops because no command came in time, at full and at slow speed.
    pub deadlines: [usize; 2],
    /// Longest time from a deadline to the first control period of braking, s.
    pub braking_s: f64,
    /// Longest time from a deadline to standstill, s, at full and at slow speed.
    pub standing_s: [f64; 2],
    /// Largest step of the tool in the first control period after a start, mm.
    pub start_step_mm: f64,
    /// Number of starts.
    pub starts: usize,
    /// CPU time, s.
    pub cpu_s: f64,
}

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

/// Random streams of commands to the default robot's bridge: bursts, gaps, late and repeated numbers, jumps, NaN.
///
/// # Errors
/// If the built-in world cannot be read.
pub fn streams(count: usize, seed: Seed) -> Result<Streams, WorkspaceError> {
    let mut clock = cpu_clock();
    let robot = worlds::robot(&worlds::read_world(None)?)?;
    let robot = bridge_robot(&robot);
    let mut found = Streams { count, ..Streams::default() };
    for stream in 0..count {
        let rng = &mut seed.fork("streams").fork_index(stream as u64).rng();
        let slow = stream % 3 == 0;
        one_stream(&robot, slow, rng, &mut found);
    }
    found.cpu_s = clock();
    Ok(found)
}

fn one_stream(robot: &genmanip_real::bridge::BridgeRobot, slow: bool, rng: &mut impl Rng, found: &mut Streams) {
    let tick_s = BridgeSettings::default().guard.tick_s;
    let limits = &robot.joints;
    let home: Vec<f64> = limits.iter().map(|it| rng.random_range(it.lower..it.upper)).collect();
    let reading = |positions: Vec<f64>| Reading { positions, ..Reading::default() };
    let Some(mut bridge) = Bridge::new(robot.clone(), BridgeSettings::default(), reading(home.clone())) else { return };
    let speed = if slow { SLOW } else { 1.0 };
    let Some(Reply::Lease { lease }) = bridge.handle(0.0, &Request::Acquire {}) else { return };
    let start = Request::Start { lease, dead_man: true, speed, workspace_m: None };
    let (mut now_s, mut silent_until_s, mut deadline_s, mut sequence) = (0.0, 0.0, f64::INFINITY, 10_u64);
    let mut last: Vec<JointState> = home.iter().copied().map(JointState::at_rest).collect();
    let mut targets = home;
    // Half of the streams keep their targets for a while, so that joints get up to speed.
    let change = if rng.random_bool(0.5) { 1.0 } else { 0.03 };
    let (mut has_started, mut is_stopping) = (false, false);
    for _ in 0..TICKS {
        if !has_started && bridge.is_at_rest() {
            bridge.handle(now_s, &start);
            deadline_s = now_s + BridgeSettings::default().guard.longest_validity_s;
            (has_started, is_stopping) = (true, false);
            found.starts += 1;
        }
        if now_s >= silent_until_s {
            for _ in 0..[0, 0, 1, 1, 5][rng.random_range(0..5)] {
                sequence = sequence.saturating_add_signed([1, 1, 1, 3, -2, 0][rng.random_range(0..6)]);
                if rng.random_bool(change) {
                    targets = limits.iter().map(|it| wild(it.lower, it.upper, rng)).collect();
                }
                let command = Command {
                    lease,
                    sequence,
                    valid_for_s: [0.1, 0.02, 0.05, f64::NAN, -1.0, 1e9][rng.random_range(0..6)],
                    dead_man: rng.random_bool(0.999),
                    positions: targets.clone(),
                    over_s: [0.0, 0.02, 0.05, f64::NAN][rng.random_range(0..4)],
                    width_m: None,
                };
                if bridge.handle(now_s, &Request::Command(command.clone())).is_none() {
                    deadline_s = now_s + command.valid_for_s;
                }
            }
            if rng.random_bool(0.02) {
                silent_until_s = now_s + rng.random_range(0.0..0.3);
            }
        }
        now_s += tick_s;
        let positions = last.iter().map(|joint| joint.position).collect();
        let Orders { setpoints, .. } = bridge.tick(now_s, reading(positions));
        for ((before, after), it) in last.iter().zip(&setpoints).zip(limits) {
            let velocity = after.velocity.abs().max((after.position - before.position).abs() / tick_s);
            let jerk = (after.acceleration - before.acceleration).abs() / tick_s;
            let shares = [velocity / (it.velocity * speed), after.acceleration.abs() / it.acceleration, jerk / it.jerk];
            found.worst_share.iter_mut().zip(shares).for_each(|(worst, share)| *worst = worst.max(share));
        }
        if has_started && last.iter().all(|joint| joint.velocity == 0.0 && joint.acceleration == 0.0) {
            let arm = |joints: &[JointState]| joints.iter().map(|joint| joint.position).collect::<Vec<_>>();
            let (from, to) = ((robot.tool)(&arm(&last)), (robot.tool)(&arm(&setpoints)));
            let step_m = from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            found.start_step_mm = found.start_step_mm.max(1e3 * step_m);
        }
        last = setpoints;
        let state = bridge.state(now_s);
        if state.reason == Some(StopReason::Deadline) && has_started {
            if !std::mem::replace(&mut is_stopping, true) {
                found.deadlines[usize::from(slow)] += 1;
                found.braking_s = found.braking_s.max(now_s - deadline_s);
            }
            if state.motion == Motion::Standing {
                let standing_s = &mut found.standing_s[usize::from(slow)];
                *standing_s = standing_s.max(now_s - deadline_s);
            }
        }
        has_started = has_started && state.motion != Motion::Standing;
    }
}

fn wild(lower: f64, upper: f64, rng: &mut impl Rng) -> f64 {
    match rng.random_range(0..40) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => 1e12,
        3 => lower - 1.0,
        _ => rng.random_range(lower..upper),
    }
}

/// A policy on the first `scenes` scenes of a suite, directly and behind the bridge with latency, jitter and loss.
///
/// Privileged policies read the truth over a side channel that a real bridge lacks.
///
/// # Errors
/// When an episode cannot be run.
pub fn paired(
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

/// Planned motions on the arm behind a bridge: where they end.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Motions {
    /// Name of the robot.
    pub robot: String,
    /// Number of motions.
    pub count: usize,
    /// Distance of the tool at the end from the planned end, mm.
    pub end_mm: Spread,
    /// Largest such distance, mm.
    pub worst_mm: f64,
    /// Largest angle of the tool at the end to the planned end, degrees.
    pub worst_deg: f64,
    /// Counts of commands, refusals and stops.
    pub tally: Tally,
}

impl Motions {
    /// Flaws in words; empty if every motion ended within 5 mm and 2 degrees of its plan, without a stop of the arm and
    /// without a refused command; one that a newer one has overtaken on its way is none.
    pub fn flaws(&self) -> Vec<String> {
        let ends = format!("motions end up to {:.2} mm and {:.2} degrees from the plan", self.worst_mm, self.worst_deg);
        let (stops, refused) = (self.tally.arm_stops, &self.tally.refused);
        let is_sound = stops == 0 && refused.keys().all(|word| word == "sequence");
        let checks = [
            (self.worst_mm <= 5.0 && self.worst_deg <= 2.0, format!("{ends}; expected 5 mm and 2 degrees")),
            (
                is_sound,
                format!("{stops} stops of the arm, refused commands: {refused:?}; expected none but overtaken ones"),
            ),
        ];
        checks.into_iter().filter(|(is_right, _)| !is_right).map(|(_, text)| text).collect()
    }
}

/// Ranges of the joints around the home position in which goals of motions are drawn, rad.
const GOAL_RANGE_RAD: f64 = 0.5;
/// Time for the arm to come to rest after a motion, s.
const REST_S: f64 = 0.7;

/// Longest time to wait beyond that until the arm is measured at rest, s.
const LONGEST_REST_S: f64 = 5.0;
/// Measured velocity of a joint that counts as rest, rad/s.
const REST_RAD_S: f64 = 2e-3;

/// True if the setpoints have reached an end of a motion and the arm is measured at rest.
fn is_at_rest(state: &State, end: &[f64]) -> bool {
    state.setpoints.iter().zip(end).all(|(at, end)| (at - end).abs() < 1e-6)
        && state.velocities.iter().all(|velocity| velocity.abs() < REST_RAD_S)
}

/// Streams planned motions between random joint positions to the bridge at an address.
///
/// # Errors
/// If the bridge cannot be reached, or its robot is not known.
pub fn motions(url: &str, count: usize, seed: Seed) -> Result<Motions, WorkspaceError> {
    let failed = |error: BridgeError| WorkspaceError::input(error.to_string());
    let held = Arc::new(AtomicBool::new(true));
    let connection = TcpConnection::open(url).map_err(failed)?;
    let mut client = ArmClient::connect(connection, ClientSettings::default(), held).map_err(failed)?;
    let robot = client.welcome().robot.clone();
    let stage = scenarios::empty_stage(worlds::read_world_with(None, Some(&robot))?)?;
    let planner = worlds::planner(&stage.scenario.world, &PlannerSettings::default())?;
    let width_m = stage.robot.gripper.max_width;
    let rng = &mut seed.fork("motions").rng();
    let (mut found, mut ends_mm) = (Motions { robot, ..Motions::default() }, Vec::new());
    // Goals that the planner refuses, such as in the table, are drawn again.
    for attempt in 0..4 * count as u64 {
        if ends_mm.len() == count {
            break;
        }
        let near = |q: &f64| q + rng.random_range(-GOAL_RANGE_RAD..GOAL_RANGE_RAD);
        let goal: Vec<f64> = stage.robot.home.iter().map(near).collect();
        let from = Some(client.state().positions.clone());
        let request = MotionRequest { target: Target::Joints(goal), from, gripper_width_m: width_m };
        let motion = plan(&stage, &planner, &request, seed.fork_index(attempt), &mut cpu_clock())?;
        let Some(end) = motion.trajectory.last().filter(|_| motion.solved) else { continue };
        let mut next_s = client.now_s();
        let hold = std::iter::repeat_n(end, (REST_S / motion.dt_s) as usize);
        for positions in motion.trajectory.iter().chain(hold) {
            client.command(positions, width_m).map_err(failed)?;
            next_s += motion.dt_s;
            client.wait(next_s).map_err(failed)?;
        }
        // An arm whose clock is slower than ours, as a simulated one's on a busy machine, comes to rest later.
        let until_s = client.now_s() + LONGEST_REST_S;
        while !is_at_rest(client.state(), end) && client.now_s() < until_s {
            client.command(end, width_m).map_err(failed)?;
            client.wait(client.now_s() + motion.dt_s).map_err(failed)?;
        }
        let (wanted, got) = (stage.robot.tcp_pose(end), stage.robot.tcp_pose(&client.state().positions));
        ends_mm.push(1e3 * wanted.position.distance(got.position));
        found.worst_deg = found.worst_deg.max(wanted.rotation.angle_between(got.rotation).to_degrees());
    }
    client.release().map_err(failed)?;
    found.count = ends_mm.len();
    found.worst_mm = ends_mm.iter().copied().fold(0.0, f64::max);
    found.end_mm = Spread::of(ends_mm);
    found.tally = client.tally().clone();
    Ok(found)
}

/// Text of the measurements.
pub fn describe(streams: Option<&Streams>, paired: &[Paired], motions: Option<&Motions>) -> String {
    let mut text = String::new();
    if let Some(found) = motions {
        text += &format!(
            "{} motions of {}: they end {} mm from the plan (median / 95th percentile), {:.2} mm and {:.2} degrees at \
             most; {} stops of the arm, {} refused commands\n",
            found.count,
            found.robot,
            found.end_mm.text(1.0),
            found.worst_mm,
            found.worst_deg,
            found.tally.arm_stops,
            found.tally.refused.values().sum::<usize>()
        );
    }
    if let Some(found) = streams {
        let [velocity, acceleration, jerk] = found.worst_share;
        text += &format!(
            "{} streams: velocity {velocity:.5}, acceleration {acceleration:.5}, jerk {jerk:.5} of the limits\n\
             {} stops at the deadline: braking after {:.1} ms at most, standing after {:.0} ms; {} in slow mode, standing \
             after {:.0} ms\n{} starts: the tool steps by {:.4} mm at most\n",
            found.count,
            found.deadlines[0],
            1e3 * found.braking_s,
            1e3 * found.standing_s[0],
            found.deadlines[1],
            1e3 * found.standing_s[1],
            found.starts,
            found.start_step_mm
        );
    }
    for found in paired {
        let [direct, behind, both] = found.solved;
        let [mean, low, high] = found.difference_points;
        text += &format!(
            "{}: {} scenes, {direct} solved directly, {behind} behind the bridge, {both} both; difference {mean:.1} points \
             ({low:.1} to {high:.1}), {} stops of the arm\n",
            found.policy, found.scenes, found.tally.arm_stops
        );
        if let Some(points) = &found.points {
            text += &format!(
                "  verdicts on images: {} of {} as the truth; {} with objects not seen, {} only by images, {} only by truth\n",
                points.agree,
                points.judged,
                points.with_unseen,
                points.only_images.len(),
                points.only_truth.len()
            );
        }
    }
    text
}
