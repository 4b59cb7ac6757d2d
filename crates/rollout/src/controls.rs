//! Controls: what policies reach that do not follow the instruction, or follow it badly.

use genmanip_core::{
    ActionChunk, Atom, EpisodeStart, Goal, Observation, Policy, PolicyError, PolicySpec, Relation, Seed,
};
use genmanip_motion::commands;
use rand::RngExt;

use crate::Stage;
use crate::expert::{Doing, Expert};

/// Control rate at which [`RandomActions`] are given, Hz.
const RATE_HZ: f64 = 60.0;
/// How long it takes from one random posture to the next, s: long enough to get somewhere, short enough to try many.
const LEG_S: f64 = 0.5;
/// Most that a joint turns on the way to the next posture, rad: what the slowest joint of a Panda does in that time.
const LARGEST_TURN_RAD: f64 = 0.5;
/// Goals that [`Blind`] draws: so many that one of them can be reached.
const GOALS: usize = 12;
/// Places that [`Blind`] may ask for.
const RELATIONS: [Relation; 7] =
    [Relation::Front, Relation::Back, Relation::Left, Relation::Right, Relation::Near, Relation::On, Relation::In];

/// How far the arm reaches beside a thing that [`Clumsy`] misses, as turn of its first joint, rad; chosen: 2 to 6 cm
/// half a metre away, so the fingers close beside small things and push large ones.
const MISSED_BY_RAD: (f64, f64) = (0.04, 0.12);
/// Share of a motion after which [`Clumsy`] breaks it off; chosen: the hand has left and has not arrived.
const BROKEN_OFF_AT: (f64, f64) = (0.25, 0.85);
/// Control steps in which its fingers open; chosen, a sixth of a second.
const DROPPING_STEPS: usize = 10;

/// Moves the joints and the fingers at random, within the joints' limits.
#[derive(Clone, Debug)]
pub struct RandomActions {
    /// Seconds it moves before it says it is finished.
    pub duration_s: f64,
    limits: Vec<(f64, f64)>,
    widest_m: f64,
    seed: Seed,
}

impl RandomActions {
    /// For the robot of a stage.
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
        let steps = (LEG_S * RATE_HZ) as usize;
        let legs = (self.duration_s / LEG_S).ceil() as usize;
        let mut actions = Vec::with_capacity(legs * steps);
        for _ in 0..legs {
            let turned = arm.iter().zip(&self.limits).map(|(&from, &(lower, upper))| {
                (from + rng.random_range(-LARGEST_TURN_RAD..=LARGEST_TURN_RAD)).clamp(lower, upper)
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

/// Takes a random movable thing to a random place, as the expert does: skilled, but blind to the instruction.
pub struct Blind {
    stage: Stage,
    expert: Expert,
}

impl Blind {
    /// From an expert for the episodes of a stage.
    pub fn new(stage: &Stage, expert: Expert) -> Self {
        Self { stage: stage.clone(), expert }
    }

    /// Places drawn by chance, each an alternative; the first that can be served is what the expert does.
    fn goal(&self, seed: Seed) -> Goal {
        let mut rng = seed.rng();
        let ids: Vec<&str> = self.stage.scenario.objects.iter().map(|object| object.id.as_str()).collect();
        let is_movable = |index: &usize| self.stage.models[*index].card.can_grasp;
        let movable: Vec<usize> = (0..ids.len()).filter(is_movable).collect();
        if movable.is_empty() || ids.len() < 2 {
            return Goal { alternatives: Vec::new() };
        }
        let alternatives = (0..GOALS)
            .map(|_| {
                let subject = movable[rng.random_range(0..movable.len())];
                let reference = (subject + rng.random_range(1..ids.len())) % ids.len();
                let relation = RELATIONS[rng.random_range(0..RELATIONS.len())];
                let (subject, reference) = (ids[subject].to_owned(), ids[reference].to_owned());
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
        self.expert.aim_at(self.goal(start.seed.fork("blind goal")));
        self.expert.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.expert.act(observation)
    }
}

/// What [`Clumsy`] does wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mistake {
    /// Reaches beside the thing.
    Misses,
    /// Lets go of it on the way.
    Drops,
    /// Stops on the way.
    Stops,
}

/// Sets out as the expert does and makes one mistake at its first thing: it misses it, drops it or stops on the way.
///
/// The mistake follows from the seed. A joint that is to be moved is left half-way.
pub struct Clumsy {
    stage: Stage,
    expert: Expert,
    seed: Seed,
}

impl Clumsy {
    /// From an expert for the episodes of a stage.
    pub fn new(stage: &Stage, expert: Expert) -> Self {
        Self { stage: stage.clone(), expert, seed: Seed::new(0) }
    }

    fn mistake(&self) -> Mistake {
        let mistakes = [Mistake::Misses, Mistake::Drops, Mistake::Stops];
        mistakes[self.seed.fork("mistake").rng().random_range(0..mistakes.len())]
    }

    /// The approach turned aside: the arm ends beside the thing and closes its fingers there.
    fn missed(&self, mut actions: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
        let mut rng = self.seed.fork("miss").rng();
        let aside = rng.random_range(MISSED_BY_RAD.0..=MISSED_BY_RAD.1) * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let limits = self.stage.robot.arm_joints().next().map_or((0.0, 0.0), |joint| (joint.lower, joint.upper));
        let until = (BROKEN_OFF_AT.0 * actions.len() as f64).max(1.0);
        for (step, action) in actions.iter_mut().enumerate() {
            let share = (step as f64 / until).min(1.0);
            if let Some(first) = action.first_mut() {
                *first = (f64::from(*first) + share * aside).clamp(limits.0, limits.1) as f32;
            }
        }
        actions
    }

    /// A motion broken off on the way; with `open`, its fingers then open.
    fn broken_off(&self, mut actions: Vec<Vec<f32>>, open: bool) -> Vec<Vec<f32>> {
        let width = |action: &Vec<f32>| action.last().copied().unwrap_or_default();
        // After it let go by itself, nothing can be dropped.
        let held = actions.first().map(width).unwrap_or_default();
        let carried = actions.iter().take_while(|action| width(action) <= held).count();
        let share = self.seed.fork("broken off").rng().random_range(BROKEN_OFF_AT.0..=BROKEN_OFF_AT.1);
        actions.truncate(((carried as f64 * share) as usize).max(1));
        if open && let Some((_, arm)) = actions.last().and_then(|last| last.split_last()) {
            let arm: Vec<f64> = arm.iter().map(|&joint| f64::from(joint)).collect();
            let (held, widest) = (f64::from(held), self.stage.robot.gripper.max_width);
            actions.extend((1..=DROPPING_STEPS).map(|step| {
                let share = step as f64 / DROPPING_STEPS as f64;
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
        let before = self.expert.doing();
        let ActionChunk { actions, finished } = self.expert.act(observation)?;
        let mistake = self.mistake();
        let actions = match (before, self.expert.doing()) {
            (_, Doing::Picking) if mistake == Mistake::Misses => self.missed(actions),
            (Doing::Picking, _) => self.broken_off(actions, mistake == Mistake::Drops),
            // The first motion leads to the joint.
            (Doing::Turning, Doing::Turning) => self.broken_off(actions, false),
            _ => return Ok(ActionChunk { actions, finished }),
        };
        Ok(ActionChunk { actions, finished: true })
    }
}
