//! Controls: what policies reach that do not follow the instruction.

use genmanip_core::{
    ActionChunk, Atom, EpisodeStart, Goal, Observation, Policy, PolicyError, PolicySpec, Relation, Seed,
};
use rand::RngExt;

use crate::Stage;
use crate::expert::Expert;

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
