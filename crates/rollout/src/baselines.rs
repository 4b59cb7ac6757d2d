//! Baselines: policies that ignore the instruction or follow it badly, as lower bounds.

use genmanip_core::{
    ActionChunk, Atom, EpisodeStart, Goal, InstanceId, Observation, Policy, PolicyError, PolicySpec, Relation,
    RelationKind, Seed, Support,
};
use genmanip_motion::commands;
use rand::RngExt;

use crate::Stage;
use crate::expert::{Activity, Expert};

/// Control rate of the baselines, Hz.
const RATE_HZ: f64 = 60.0;
/// Duration of a random joint motion, s: long enough for a visible motion, short enough for many of them.
const MOTION_S: f64 = 0.5;
/// Maximum joint rotation per motion, rad: what the slowest joint of a Panda can do in that time.
const MAX_ROTATION_RAD: f64 = 0.5;
/// Goals sampled by [`Blind`]: enough that one of them is feasible.
const GOALS: usize = 12;

/// Rotation of the first joint by which [`Clumsy`] misses an object, rad. Chosen by hand: 2 to 6 cm at half a metre, so
/// that the fingers close beside small objects and push large ones.
const MISS_RAD: (f64, f64) = (0.04, 0.12);
/// Share of a motion after which [`Clumsy`] aborts it: neither near its start nor near its goal. Chosen by hand.
const ABORTED_AT: (f64, f64) = (0.25, 0.85);
/// Control steps in which the gripper opens to drop an object, a sixth of a second. Chosen by hand.
const OPENING_STEPS: usize = 10;

/// Moves joints and gripper randomly within the joint limits.
#[derive(Clone, Debug)]
pub struct RandomActions {
    /// Duration until the policy reports that it has finished, s.
    pub duration_s: f64,
    limits: Vec<(f64, f64)>,
    widest_m: f64,
    seed: Seed,
}

impl RandomActions {
    /// Baseline for the robot of a stage.
    pub fn new(stage: &Stage, duration_s: f64) -> Self {
        let limits = stage.robot.arm_joints().map(|joint| (joint.lower, joint.upper)).collect();
        Self { duration_s, limits, widest_m: stage.robot.gripper.max_width, seed: Seed::new(0) }
    }
}

impl Policy for RandomActions {
    fn spec(&self) -> PolicySpec {
        PolicySpec::native("random", RATE_HZ)
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.seed = start.seed.fork("random actions");
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let state = observation
            .state
            .get(Observation::STATE)
            .ok_or_else(|| PolicyError::Unsuited("`observation.state` is missing".into()))?;
        let mut rng = self.seed.rng();
        let mut arm: Vec<f64> = state.iter().take(self.limits.len()).copied().collect();
        let steps = (MOTION_S * RATE_HZ) as usize;
        let motions = (self.duration_s / MOTION_S).ceil() as usize;
        let mut actions = Vec::with_capacity(motions * steps);
        for _ in 0..motions {
            let turned = arm.iter().zip(&self.limits).map(|(&from, &(lower, upper))| {
                (from + rng.random_range(-MAX_ROTATION_RAD..=MAX_ROTATION_RAD)).clamp(lower, upper)
            });
            let to: Vec<f64> = turned.collect();
            let width = if rng.random_bool(0.5) { self.widest_m } else { 0.0 };
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let joints = arm.iter().zip(&to).map(|(&from, &to)| (from + share * (to - from)) as f32);
                actions.push(joints.chain([width as f32]).collect());
            }
            arm = to;
        }
        Ok(ActionChunk { actions, finished: true })
    }
}

/// Moves a random graspable object to a random place with the expert's skills, ignoring the instruction.
pub struct Blind {
    stage: Stage,
    expert: Expert,
}

impl Blind {
    /// Wraps an expert for the episodes of a stage.
    pub fn new(stage: &Stage, expert: Expert) -> Self {
        Self { stage: stage.clone(), expert }
    }

    /// Randomly sampled placements as alternatives; the expert takes the first feasible one.
    fn goal(&self, seed: Seed) -> Goal {
        let mut rng = seed.rng();
        let ids: Vec<&InstanceId> = self.stage.scenario.objects.iter().map(|object| &object.id).collect();
        let is_movable = |index: &usize| self.stage.models[*index].card.can_grasp;
        let movable: Vec<usize> = (0..ids.len()).filter(is_movable).collect();
        if movable.is_empty() || ids.len() < 2 {
            return Goal { alternatives: Vec::new() };
        }
        let is_single = |relation: &Relation| relation.kind() != RelationKind::Support(Support::OnOrIn);
        let relations: Vec<Relation> = Relation::OF_PAIRS.into_iter().filter(is_single).collect();
        let alternatives = (0..GOALS)
            .map(|_| {
                let subject = movable[rng.random_range(0..movable.len())];
                let reference = (subject + rng.random_range(1..ids.len())) % ids.len();
                let relation = relations[rng.random_range(0..relations.len())];
                let (subject, reference) = (ids[subject].clone(), ids[reference].clone().into());
                vec![Atom::Relation { subject, relation, reference, second_reference: None }]
            })
            .collect();
        Goal { alternatives }
    }
}

impl Policy for Blind {
    fn spec(&self) -> PolicySpec {
        PolicySpec { privileged: true, ..PolicySpec::native("blind", RATE_HZ) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.expert.set_goal(self.goal(start.seed.fork("blind goal")));
        self.expert.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.expert.act(observation)
    }
}

/// Kind of mistake that [`Clumsy`] makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mistake {
    /// Closes the gripper beside the object.
    Misses,
    /// Releases the object during transport.
    Drops,
    /// Stops during a motion.
    Stops,
}

/// Follows the expert but makes one mistake with the first object: misses it, drops it, or stops during a motion.
///
/// The mistake depends only on the seed. A joint to be moved stops half-way.
pub struct Clumsy {
    stage: Stage,
    expert: Expert,
    seed: Seed,
}

impl Clumsy {
    /// Wraps an expert for the episodes of a stage.
    pub fn new(stage: &Stage, expert: Expert) -> Self {
        Self { stage: stage.clone(), expert, seed: Seed::new(0) }
    }

    fn mistake(&self) -> Mistake {
        let mistakes = [Mistake::Misses, Mistake::Drops, Mistake::Stops];
        mistakes[self.seed.fork("mistake").rng().random_range(0..mistakes.len())]
    }

    /// The approach, rotated about the first joint so that the gripper closes beside the object.
    fn missed(&self, mut actions: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        let mut rng = self.seed.fork("miss").rng();
        let rotation_rad = rng.random_range(MISS_RAD.0..=MISS_RAD.1) * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let limits = self.stage.robot.arm_joints().next().map_or((0.0, 0.0), |joint| (joint.lower, joint.upper));
        let until = (ABORTED_AT.0 * actions.len() as f64).max(1.0);
        for (step, action) in actions.iter_mut().enumerate() {
            let share = (step as f64 / until).min(1.0);
            if let Some(first) = action.first_mut() {
                *first = (f64::from(*first) + share * rotation_rad).clamp(limits.0, limits.1) as f32;
            }
        }
        actions
    }

    /// The motion aborted on the way; with `open`, the gripper then opens.
    fn aborted(&self, mut actions: Vec<Vec<f32>>, open: bool) -> Vec<Vec<f32>> {
        let width = |action: &Vec<f32>| action.last().copied().unwrap_or_default();
        // After the planned release, there is nothing to drop.
        let held = actions.first().map(width).unwrap_or_default();
        let carried = actions.iter().take_while(|action| width(action) <= held).count();
        let share = self.seed.fork("broken off").rng().random_range(ABORTED_AT.0..=ABORTED_AT.1);
        actions.truncate(((carried as f64 * share) as usize).max(1));
        if open && let Some((_, arm)) = actions.last().and_then(|last| last.split_last()) {
            let arm: Vec<f64> = arm.iter().map(|&joint| f64::from(joint)).collect();
            let (held, widest) = (f64::from(held), self.stage.robot.gripper.max_width);
            actions.extend((1..=OPENING_STEPS).map(|step| {
                let share = step as f64 / OPENING_STEPS as f64;
                commands::command(&arm, held + share * (widest - held))
            }));
        }
        actions
    }
}

impl Policy for Clumsy {
    fn spec(&self) -> PolicySpec {
        PolicySpec { privileged: true, ..PolicySpec::native("clumsy", RATE_HZ) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.seed = start.seed.fork("clumsy");
        self.expert.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let before = self.expert.activity();
        let ActionChunk { actions, finished } = self.expert.act(observation)?;
        let mistake = self.mistake();
        let actions = match (before, self.expert.activity()) {
            (_, Activity::Picking) if mistake == Mistake::Misses => self.missed(actions),
            (Activity::Picking, _) => self.aborted(actions, mistake == Mistake::Drops),
            // The first motion is the approach to the joint's handle.
            (Activity::Turning, Activity::Turning) => self.aborted(actions, false),
            _ => return Ok(ActionChunk { actions, finished }),
        };
        Ok(ActionChunk { actions, finished: true })
    }
}
