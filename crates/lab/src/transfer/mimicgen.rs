//! Comparison: transfer as published in MimicGen (Mandlekar et al., 2023), written from the description of its method.
//!
//! Its subtasks end at marks that are set once per source; each attempt moves a mark by a random number of steps. The
//! source is drawn once per episode from the three whose object pose is nearest, so that the hand does not change its grip
//! between two of them. A segment's target poses are moved with
//! the body of the object, reached in five interpolated steps from the last target, and executed as normalised deltas
//! with noise; the gripper follows by step number.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{
    ActionChunk, ActionFrame, ActionSpace, ActionSpec, EpisodeStart, GripperEncoding, GripperSpec, Interpolation,
    Observation, Policy, PolicyError, PolicySpec, Pose, PrivilegedState, Seed,
};
use genmanip_motion::Planner;
use genmanip_rollout::Stage;
use genmanip_rollout::go_to::free_path;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Rate of the published controller, Hz.
const RATE_HZ: f64 = 20.0;
/// Largest step of its controller: m, rad.
const MAX_STEP: [f64; 2] = [0.05, 0.5];
/// Standard deviation of the noise on normalised actions.
const NOISE: f64 = 0.05;
/// Interpolated steps before each segment.
const BRIDGE: usize = 5;
/// Sources among which one is drawn.
const NEAREST: usize = 3;
/// Range of steps by which a mark is moved.
const OFFSETS: [usize; 2] = [5, 10];
/// Weights of the distance (1/m) and the angle (1/rad) between object poses.
const WEIGHTS: [f64; 2] = [1.0, 1.0];

/// A source demonstration at the controller's rate.
#[derive(Clone, Debug)]
pub struct Source {
    /// `world_from_object` of each subtask's object at each step.
    pub objects: [Vec<Pose>; 2],
    /// Target pose of the tool, `world_from_tcp`, at each step.
    pub targets: Vec<Pose>,
    /// Commanded opening at each step, m.
    pub widths_m: Vec<f64>,
    /// Step after the last one of the first subtask.
    pub mark: usize,
}

/// Planner of the bridges, as in SkillGen (Garrett et al., 2024): free motions between the segments.
pub struct PlannedBridge {
    /// Planner of the robot.
    pub planner: Arc<Planner>,
    /// Scene of the episode.
    pub stage: Stage,
}

/// Share of the robot's velocity and acceleration limits in a planned bridge, as in transfers.
const BRIDGE_SPEED: f64 = 0.9;

impl PlannedBridge {
    /// Tool poses at the controller's rate from an arm configuration to a pose; `None` if there is no free motion. An
    /// object in the hand moves with it.
    fn poses(&self, truth: &PrivilegedState, arm: &[f64], width_m: f64, to: &Pose, seed: Seed) -> Option<Vec<Pose>> {
        let path = free_path(&self.stage, &self.planner, truth, (arm, width_m), to, seed).ok()?;
        let every = (self.stage.control_rate_hz() / RATE_HZ).round().max(1.0) as usize;
        let states = self.planner.time(&path, BRIDGE_SPEED).configs;
        Some(states.iter().skip(every - 1).step_by(every).map(|arm| self.planner.tcp_pose(arm)).collect())
    }
}

/// The published transfer as a policy. It reads object poses from the simulator, as the original does.
pub struct MimicGen {
    sources: Vec<Source>,
    /// Standard deviation of the noise on normalised actions.
    noise: f64,
    /// Planner of the bridges; `None` for the published interpolated steps.
    bridge: Option<PlannedBridge>,
    spec: PolicySpec,
    objects: [usize; 2],
    rng: ChaCha8Rng,
    /// Subtask that is executed; 2 after the last one.
    subtask: usize,
    /// Step after the first subtask of each source, moved for this episode.
    marks: Vec<usize>,
    /// Source of this episode; `None` before the first subtask.
    chosen: Option<usize>,
    /// Targets of the segment still to be executed, in reverse order: pose, opening, true if noise is added.
    left: Vec<(Pose, f64, bool)>,
    last: Option<Pose>,
}

impl Source {
    /// Source of an episode's frames; `objects` are the indices of each subtask's object, `target` gives the tool pose of a
    /// command, and `mark` is the control step at which the first subtask ends.
    pub fn of(
        frames: &[genmanip_core::Frame],
        control_rate_hz: f64,
        objects: [usize; 2],
        mark: usize,
        target: impl Fn(&[f32]) -> Pose,
    ) -> Self {
        let every = (control_rate_hz / RATE_HZ).round().max(1.0) as usize;
        let kept = || frames.iter().step_by(every);
        Self {
            objects: objects.map(|object| kept().map(|frame| frame.objects[object].pose).collect()),
            targets: kept().map(|frame| target(&frame.command)).collect(),
            widths_m: kept().map(|frame| frame.command.last().copied().unwrap_or_default().into()).collect(),
            mark: mark / every + 1,
        }
    }
}

impl MimicGen {
    /// Policy that moves as the sources do, relative to the object of each subtask, by its index.
    pub fn new(sources: Vec<Source>, objects: [usize; 2]) -> Self {
        let action = ActionSpec {
            space: ActionSpace::EePose,
            delta_from: Default::default(),
            frame: ActionFrame::World,
            rotation: Default::default(),
            gripper: GripperSpec { encoding: GripperEncoding::WidthM, binary_threshold: None },
            between: Interpolation::Linear,
        };
        let spec = PolicySpec { privileged: true, action, ..PolicySpec::native("mimicgen", RATE_HZ) };
        Self {
            sources,
            noise: NOISE,
            bridge: None,
            spec,
            objects,
            rng: Seed::new(0).rng(),
            subtask: 0,
            marks: Vec::new(),
            chosen: None,
            left: Vec::new(),
            last: None,
        }
    }

    /// The same without noise on its actions.
    #[must_use]
    pub fn without_noise(self) -> Self {
        Self { noise: 0.0, ..self }
    }

    /// The same with planned motions between the segments.
    #[must_use]
    pub fn with_planned_bridges(self, bridge: PlannedBridge) -> Self {
        Self { bridge: Some(bridge), ..self }
    }

    /// Fills `left` with the next subtask's segment, from the source whose object pose is near that of now.
    fn begin(&mut self, truth: &PrivilegedState, state: &[f64], tool: &Pose) {
        let world_from_object = &truth.objects[self.objects[self.subtask]].pose;
        let subtask = self.subtask;
        self.subtask += 1;
        if subtask == 0 {
            let mark = |source: &Source| {
                (source.mark + self.rng.random_range(OFFSETS[0]..=OFFSETS[1])).min(source.targets.len() - 1)
            };
            self.marks = self.sources.iter().map(mark).collect();
        }
        let marks = &self.marks;
        let start = |index: usize| if subtask == 0 { 0 } else { marks[index] };
        let distance = |index: usize| {
            let pose = &self.sources[index].objects[subtask][start(index)];
            WEIGHTS[0] * pose.position.distance(world_from_object.position)
                + WEIGHTS[1] * pose.angle_to(world_from_object)
        };
        let mut order: Vec<usize> = (0..self.sources.len()).collect();
        order.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        let drawn = order[self.rng.random_range(0..order.len().min(NEAREST))];
        let chosen = *self.chosen.get_or_insert(drawn);
        let source = &self.sources[chosen];
        let (from, to) = (start(chosen), if subtask == 0 { marks[chosen] } else { source.targets.len() });
        let moved = *world_from_object * source.objects[subtask][from].inverse();
        let segment: Vec<(Pose, f64, bool)> =
            (from..to).map(|step| (moved * source.targets[step], source.widths_m[step], true)).collect();
        let Some((first, width_m, _)) = segment.first().copied() else { return };
        let last = self.last.unwrap_or(*tool);
        let planned = self.bridge.as_ref().and_then(|bridge| {
            let (arm, width) = state.split_at(bridge.stage.robot.arm_dof().min(state.len()));
            bridge.poses(truth, arm, width.iter().sum(), &first, Seed::new(subtask as u64))
        });
        let steps = || (1..=BRIDGE).map(|step| last.interpolate(&first, step as f64 / BRIDGE as f64)).collect();
        let bridge: Vec<Pose> = planned.unwrap_or_else(steps);
        let mut left: Vec<_> = bridge.into_iter().map(|pose| (pose, width_m, false)).chain(segment).collect();
        self.last = left.last().map(|(pose, ..)| *pose);
        left.reverse();
        self.left = left;
    }

    /// A target as the controller's step from the measured tool: clipped, with noise.
    fn stepped(&mut self, tool: &Pose, target: &Pose, is_noisy: bool) -> Pose {
        let turn = target.rotation * tool.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
        let noise = self.noise;
        let mut normal = || {
            let (u, v): (f64, f64) = (self.rng.random_range(f64::MIN_POSITIVE..1.0), self.rng.random_range(0.0..1.0));
            (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
        };
        let mut step = |delta: DVec3, most: f64| {
            let mut share = delta / most;
            if is_noisy {
                share += DVec3::new(normal(), normal(), normal()) * noise;
            }
            share.clamp(DVec3::NEG_ONE, DVec3::ONE) * most
        };
        let way = step(target.position - tool.position, MAX_STEP[0]);
        let turn = step(turn, MAX_STEP[1]);
        Pose::new(tool.position + way, DQuat::from_scaled_axis(turn) * tool.rotation)
    }
}

impl Policy for MimicGen {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.rng = start.seed.fork("mimicgen").rng();
        (self.subtask, self.last, self.chosen) = (0, None, None);
        self.left.clear();
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let unsuited = |what: &str| PolicyError::Unsuited(format!("needs {what}"));
        let tool = observation.state.get(Observation::TOOL).map(Vec::as_slice);
        let Some(&[x, y, z, qw, qx, qy, qz]) = tool else { return Err(unsuited("the pose of the tool")) };
        let tool = Pose::from_wxyz_array([x, y, z], [qw, qx, qy, qz]);
        if self.left.is_empty() && self.subtask < 2 {
            let truth = observation.privileged.as_ref().ok_or_else(|| unsuited("simulator truth"))?;
            let state = observation.state.get(Observation::STATE).cloned().unwrap_or_default();
            self.begin(truth, &state, &tool);
        }
        let Some((target, width_m, is_noisy)) = self.left.pop() else {
            return Ok(ActionChunk { actions: Vec::new(), finished: true });
        };
        let pose = self.stepped(&tool, &target, is_noisy);
        let action = pose.to_row().into_iter().chain([width_m]).map(|number| number as f32).collect();
        let finished = self.left.is_empty() && self.subtask >= 2;
        Ok(ActionChunk { actions: vec![action], finished })
    }
}
