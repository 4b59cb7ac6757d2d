//! Chunks of actions behind the bridge, of a policy whose answers come late: jumps where chunks join, and holds between
//! them.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::glam::DVec3;
use genmanip_core::{
    ActionChunk, ActionSpace, ActionSpec, DeltaFrom, EpisodeStart, GripperEncoding, Interpolation, Observation, Policy,
    PolicyError, PolicySpec, RobotModel, Seed,
};
use genmanip_pipeline::real::arm::{ArmSettings, RealArm};
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::rehearsal::Rehearsal;
use genmanip_pipeline::real::simulated::SimulatedArmSettings;
use genmanip_real::bridge::BridgeSettings;
use genmanip_real::bridge::client::{ArmClient, ClientSettings};
use genmanip_rollout::ahead::{ChunkReport, Delayed, run_ahead};
use genmanip_rollout::{RobotInterface, RolloutError, RolloutSettings, Stage};
use genmanip_workspace::{WorkspaceError, scenarios, worlds};
use rand::RngExt;
use serde::Serialize;

use super::LINK;

/// Time from a request to its answer, s.
const DELAY_S: f64 = 0.08;
/// Actions per second, of a chunk, and executed of it.
const RATE_HZ: f64 = 30.0;
const LENGTH: usize = 16;
const EXECUTED: usize = 8;
/// Duration of an episode, s.
const EPISODE_S: f64 = 8.0;
/// Largest jump of a sound path, mm.
const JUMP_MM: f64 = 1.0;
/// Largest turn of a joint, rad, and range of its frequency, Hz.
const TURN_RAD: f64 = 0.15;
const TURN_HZ: [f64; 2] = [0.1, 0.3];
/// Largest disagreement of two chunks about a joint, rad: a few millimetres at the tool.
const DISAGREEMENT_RAD: f64 = 0.005;
/// Time in which a chunk gets from where it thinks that the arm is to its path, s.
const RETURN_S: f64 = 0.3;

/// Chunks that were requested ahead.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Chunks {
    /// Time from a request to its answer, ms.
    pub delay_ms: f64,
    /// Results by action space.
    pub spaces: Vec<SpaceChunks>,
}

/// Chunks of one action space.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SpaceChunks {
    /// Action space and reference.
    pub space: String,
    /// Number of episodes.
    pub episodes: usize,
    /// Number of chunks.
    pub chunks: usize,
    /// Number of those that were joined to one under way.
    pub joined: usize,
    /// Number of times that the arm waited for a chunk.
    pub holds: usize,
    /// Duration of these, ms.
    pub held_ms: f64,
    /// Largest jump of the commanded tool where chunks join, mm: distance of a command from the straight continuation of
    /// the two before.
    pub jump_mm: f64,
    /// Largest such distance elsewhere, mm.
    pub elsewhere_mm: f64,
    /// Largest distance of the tool between two chunks for the same time, mm: the jump without smoothing.
    pub disagreement_mm: f64,
}

/// Episodes of every action space behind 20 ± 10 ms of delay to the arm and 80 ms to the policy.
///
/// # Errors
/// When an episode cannot be run.
pub fn measure(episodes: usize, seed: Seed) -> Result<Chunks, WorkspaceError> {
    let stage = scenarios::empty_stage(worlds::read_world(None)?)?;
    let seed = seed.fork("chunks");
    let spaces = [
        (ActionSpace::JointPosition, DeltaFrom::Command),
        (ActionSpace::JointDelta, DeltaFrom::ChunkStart),
        (ActionSpace::JointVelocity, DeltaFrom::Command),
        (ActionSpace::EePose, DeltaFrom::Command),
    ];
    let measured = spaces.iter().map(|&(space, delta_from)| {
        let action = ActionSpec {
            delta_from,
            between: Interpolation::Linear,
            ..ActionSpec::new(space, GripperEncoding::WidthM)
        };
        let mut found =
            SpaceChunks { space: format!("{space:?} from {delta_from:?}"), episodes, ..SpaceChunks::default() };
        for episode in 0..episodes as u64 {
            found.add(&stage, action, seed.fork_index(episode))?;
        }
        Ok(found)
    });
    let spaces = measured.collect::<Result<_, WorkspaceError>>()?;
    Ok(Chunks { delay_ms: 1e3 * DELAY_S, spaces })
}

impl SpaceChunks {
    fn add(&mut self, stage: &Stage, action: ActionSpec, seed: Seed) -> Result<(), WorkspaceError> {
        let broken = |error: RolloutError| WorkspaceError::broken("an episode behind the bridge", error);
        let arm = SimulatedArmSettings::default();
        let rehearsal = Rehearsal::new(stage, BridgeSettings::default(), arm, LINK, seed)?;
        let held = Arc::new(AtomicBool::new(true));
        let client = ArmClient::connect(rehearsal, ClientSettings::default(), held)
            .map_err(|error| WorkspaceError::broken("the rehearsal", error))?;
        let settings = ArmSettings { horizon_s: EPISODE_S, dry_run: false };
        let mut robot = RealArm::new(client, stage, settings, Rig::default()).map_err(broken)?;
        let mut wanderer = Wanderer::new(action, &stage.robot, seed);
        let (spec, mut report) = (wanderer.spec(), ChunkReport::default());
        let mut policy = Delayed::new(&mut wanderer, DELAY_S);
        run_ahead(&mut robot, stage, &spec, &mut policy, seed, &RolloutSettings::default(), &mut report)
            .map_err(broken)?;
        self.chunks += report.chunks;
        self.joined += report.joined;
        self.holds += report.holds;
        self.held_ms += 1e3 * report.held_s;
        self.disagreement_mm = self.disagreement_mm.max(1e3 * report.largest_seam_m);
        let tool = |command: &[f32]| {
            let arm: Vec<f64> = command[..stage.robot.arm_dof()].iter().copied().map(f64::from).collect();
            stage.robot.tcp_pose(&arm).position
        };
        let path: Vec<DVec3> = robot.frames().iter().map(|frame| tool(&frame.command)).collect();
        for (step, at) in path.windows(3).enumerate() {
            let jump_mm = 1e3 * (at[2] - 2.0 * at[1] + at[0]).length();
            // `at[2]` is the command of step + 2; an action takes two control steps.
            let is_seam = report.seams.iter().any(|seam| (*seam..*seam + 3).contains(&(step + 2)));
            let worst = if is_seam { &mut self.jump_mm } else { &mut self.elsewhere_mm };
            *worst = worst.max(jump_mm);
        }
        Ok(())
    }
}

impl Chunks {
    /// Flaws in words; empty if no path jumps and no arm waits.
    pub fn flaws(&self) -> Vec<String> {
        let flawed = self.spaces.iter().filter(|it| it.jump_mm > JUMP_MM || it.holds > 0 || it.joined == 0);
        let text = |it: &SpaceChunks| {
            let SpaceChunks { space, jump_mm, holds, joined, .. } = it;
            format!(
                "{space}: {joined} chunks joined, jumps up to {jump_mm:.2} mm, {holds} holds; expected {JUMP_MM} mm, none"
            )
        };
        flawed.map(text).collect()
    }

    /// Text of the measurements.
    pub fn text(&self) -> String {
        let line = |it: &SpaceChunks| {
            format!(
                "chunks after {:.0} ms, {}: {} chunks, {} joined on the way, {} holds ({:.0} ms); the tool jumps by {:.2} mm at \
                 most where they join (chunks up to {:.1} mm apart), {:.2} mm elsewhere\n",
                self.delay_ms,
                it.space,
                it.chunks,
                it.joined,
                it.holds,
                it.held_ms,
                it.jump_mm,
                it.disagreement_mm,
                it.elsewhere_mm
            )
        };
        self.spaces.iter().map(line).collect()
    }
}

/// Policy that moves every joint back and forth. As learned ones, each chunk begins where the arm was measured, and disagrees
/// with the one before.
struct Wanderer {
    spec: PolicySpec,
    robot: Arc<RobotModel>,
    /// Turn, rad, and frequency, Hz, of each joint.
    waves: Vec<[f64; 2]>,
    seed: Seed,
    asked: u64,
}

impl Wanderer {
    fn new(action: ActionSpec, robot: &Arc<RobotModel>, seed: Seed) -> Self {
        let spec = PolicySpec { action, execute_steps: EXECUTED, ..PolicySpec::native("wanderer", RATE_HZ) };
        let rng = &mut seed.fork("waves").rng();
        let wave = |_| [rng.random_range(-TURN_RAD..TURN_RAD), rng.random_range(TURN_HZ[0]..TURN_HZ[1])];
        let waves = (0..robot.arm_dof()).map(wave).collect();
        Self { spec, robot: Arc::clone(robot), waves, seed: seed.fork("disagreement"), asked: 0 }
    }

    fn path(&self, time_s: f64) -> Vec<f64> {
        let turned = |(home, [turn, hz]): (&f64, &[f64; 2])| home + turn * (1.0 - (TAU * hz * time_s).cos());
        self.robot.home.iter().zip(&self.waves).map(turned).collect()
    }
}

impl Policy for Wanderer {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.asked += 1;
        let rng = &mut self.seed.fork_index(self.asked).rng();
        let measured = &observation.state[Observation::STATE][..self.waves.len()];
        let now = self.path(observation.time_s);
        let off =
            |(measured, now): (&f64, &f64)| measured - now + rng.random_range(-DISAGREEMENT_RAD..DISAGREEMENT_RAD);
        let off: Vec<f64> = measured.iter().zip(&now).map(off).collect();
        let after = |actions: usize| -> Vec<f64> {
            let later_s = actions as f64 / RATE_HZ;
            let share = (-later_s / RETURN_S).exp();
            self.path(observation.time_s + later_s).iter().zip(&off).map(|(at, off)| at + share * off).collect()
        };
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let motion = |action: usize| match self.spec.action.space {
            ActionSpace::JointDelta => difference(&after(action + 1), measured),
            ActionSpace::JointVelocity => {
                difference(&after(action + 1), &after(action)).iter().map(|step| step * RATE_HZ).collect()
            }
            ActionSpace::EePose => self.robot.tcp_pose(&after(action + 1)).to_row().to_vec(),
            _ => after(action + 1),
        };
        let row = |action: usize| -> Vec<f32> {
            motion(action).into_iter().chain([self.robot.gripper.max_width]).map(|value| value as f32).collect()
        };
        Ok(ActionChunk { actions: (0..LENGTH).map(row).collect(), finished: false })
    }
}
