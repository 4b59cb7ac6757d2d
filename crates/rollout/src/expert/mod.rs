//! The expert: solves tasks by pick and place and by moving joints, from simulator ground truth.
//!
//! A privileged [`Policy`]: it reads the object poses but never changes them. Each call returns the commands of one
//! phase (pick; carry and place; joint motion; home), and the next call checks the outcome: an object that was not
//! lifted is picked again with another grasp, a condition that does not hold is retried, and when no options are left
//! the expert gives up with the cause and its evidence.

mod joint;
mod move_skills;
mod pick;
mod place;
mod seen;
mod settings;
mod skills;

pub use move_skills::MoveSkills;
pub use seen::{GraspProposer, ObservedObject};
pub use settings::ExpertSettings;

use std::sync::Arc;

use genmanip_assets::{AssetError, GraspLibrary};
use genmanip_core::glam::DQuat;
use genmanip_core::{
    Aabb, ActionChunk, EpisodeStart, ExpertStyle, Failure, FailureCause, Goal, Grasp, Observation, Policy, PolicyError,
    PolicySpec, Pose, PrivilegedState, Seed, VerifiedGrasp,
};
use genmanip_layout::{GoalOrder, GoalPose, GoalSearch, Move, moves, obstacles};
use genmanip_motion::commands;
use genmanip_motion::{AllowedCollisions, CollisionWorld, Path, PlaceGoal, Planner, PlanningScene};
use genmanip_relations::{PosedScene, judge_atom};

use rand::seq::SliceRandom;

use self::joint::Turning;
use self::pick::Pick;
use crate::Stage;

/// Joint step between the states of a path at which clearance for a wider gripper is tested, rad. Coarse, since the
/// test only decides whether the gripper opens during the motion or before.
const CLEARANCE_STEP_RAD: f64 = 0.05;

/// Solves tasks from simulator ground truth; its results are marked `oracle`.
pub struct Expert {
    stage: Stage,
    planner: Arc<Planner>,
    /// Precomputed grasps of each object.
    precomputed: Vec<Vec<VerifiedGrasp>>,
    /// Grasp proposals from images, instead of geometry. `None` for geometry.
    grasp_proposer: Option<Arc<dyn GraspProposer>>,
    /// Skills for the moves that they serve; `None` for the expert's own motions alone.
    skills: Option<Arc<dyn MoveSkills>>,
    /// True if a skill carried out a move in this episode.
    has_used_skill: bool,
    settings: ExpertSettings,
    seed: Seed,
    /// Remaining alternatives of the goal, the current one last.
    plans: Vec<Vec<Move>>,
    /// Number of picks so far; each has its own random stream.
    picks: u64,
    /// Number of picks so far for the current move.
    tries: usize,
    /// Number of waits for objects to come to rest since the last pick.
    waits: usize,
    phase: Phase,
    /// Initial orientation of each object, which placements preserve up to yaw.
    upright: Vec<DQuat>,
    last_failure: Option<Failure>,
}

enum Phase {
    /// No action was executed yet.
    Beginning,
    /// The gripper is empty, and the next move can begin.
    Free,
    /// A pick was executed; its success is not checked yet.
    Picked { step: Move, open_width: f64, hold_width: f64, taken_from: GoalPose },
    /// The gripper is moving a joint's link.
    Turning(Box<Turning>),
    /// A skill carries out the move.
    Skill(Box<dyn Policy>),
    /// The arm was sent home.
    Home,
}

/// Current activity of the expert, for policies that imitate the expert with injected mistakes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Activity {
    /// Reaching for and lifting an object.
    Picking,
    /// Moving a joint of an object.
    Turning,
    /// Carrying, placing or returning home.
    Other,
}

/// Current state of arm and gripper.
struct ArmState {
    arm: Vec<f64>,
    /// Current gripper opening, m.
    width: f64,
    /// Gripper opening for the release, m.
    open_width: f64,
    /// Gripper opening commanded while holding, m.
    hold_width: f64,
}

impl Expert {
    /// An expert for the episodes of one stage; `grasps` are tried before sampled ones.
    ///
    /// # Errors
    /// [`AssetError::StaleGrasps`] if the grasps of an object were computed with other physics.
    pub fn new(
        stage: &Stage,
        planner: &Arc<Planner>,
        grasps: &GraspLibrary,
        settings: ExpertSettings,
    ) -> Result<Self, AssetError> {
        let planner = Arc::clone(planner);
        let tried = stage.models.iter().map(|model| Ok(grasps.of(planner.robot(), model)?.to_vec()));
        Ok(Self {
            precomputed: tried.collect::<Result<_, AssetError>>()?,
            planner,
            grasp_proposer: None,
            skills: None,
            has_used_skill: false,
            stage: stage.clone(),
            settings,
            seed: Seed::new(0),
            plans: Vec::new(),
            picks: 0,
            tries: 0,
            waits: 0,
            phase: Phase::Free,
            upright: Vec::new(),
            last_failure: None,
        })
    }

    /// Takes grasps from images instead of precomputed ones and geometry. Handles of joints are still grasped by
    /// geometry.
    #[must_use]
    pub fn with_grasp_proposer(self, source: Arc<dyn GraspProposer>) -> Self {
        Self { grasp_proposer: Some(source), ..self }
    }

    /// Replaces the task's goal from the next reset on.
    pub(crate) fn set_goal(&mut self, goal: Goal) {
        self.stage.goal = Arc::new(goal);
    }

    /// Activity of the last returned commands.
    pub(crate) fn activity(&self) -> Activity {
        match self.phase {
            Phase::Picked { .. } => Activity::Picking,
            Phase::Turning(_) | Phase::Skill(_) => Activity::Turning,
            Phase::Beginning | Phase::Free | Phase::Home => Activity::Other,
        }
    }

    /// Grasps of an object proposed from images, in its own frame; `None` without a proposer.
    fn proposed_grasps(
        &self,
        observation: &Observation,
        scene: &PosedScene,
        object: usize,
    ) -> Result<Option<Vec<Grasp>>, PolicyError> {
        let Some(source) = &self.grasp_proposer else { return Ok(None) };
        let Some(posed) = scene.objects().nth(object) else { return Ok(None) };
        let table_height = scene.bounds(object).map_or(0.0, |bounds| bounds.min.z);
        let seen = seen::observe_object(observation, object, table_height);
        // Invisible objects are not sent to the proposer.
        if seen.points.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let object_from_world = posed.pose.inverse();
        let own = |grasp: Grasp| Grasp { pose: object_from_world * grasp.pose, ..grasp };
        Ok(Some(source.grasps(&seen)?.into_iter().map(own).collect()))
    }

    /// Precomputed grasps of an object.
    fn precomputed_grasps(&self, object: usize) -> &[VerifiedGrasp] {
        self.precomputed.get(object).map_or(&[], Vec::as_slice)
    }

    /// Goal poses of an object at which all conditions of its move hold and which `usable` accepts.
    fn goals(&self, scene: &PosedScene, step: &Move, usable: &dyn Fn(&Pose) -> bool, seed: Seed) -> Vec<GoalPose> {
        let search = GoalSearch {
            scene,
            upright: &self.upright,
            workspace: &self.stage.scenario.world.workspace,
            relations: &self.stage.relations,
            settings: &self.settings.goal_pose,
            order: match self.settings.style {
                ExpertStyle::Default => GoalOrder::Margin,
                ExpertStyle::Consistent => GoalOrder::Middle,
            },
        };
        let after = self.plans.last().into_iter().flatten().skip_while(|other| *other != step).skip(1);
        let later: Vec<Move> = after.filter(|other| !self.is_done(scene, other)).cloned().collect();
        search.goal_poses(step, &later, usable, seed.fork("goal"))
    }

    /// True if the object has a cavity that objects can be dropped into.
    fn has_cavity(&self, object: usize) -> bool {
        self.stage.models.get(object).is_some_and(|model| model.is_hollow())
    }

    /// Converts a goal pose for the planner: objects are released from a height only above a cavity, and clear its rim.
    fn place_goal(&self, scene: &PosedScene, goal: &GoalPose) -> PlaceGoal {
        let rim = goal.support.and_then(|carrier| scene.bounds(carrier)).map_or(0.0, |bounds| bounds.max.z);
        let falls_into_cavity = goal.support.is_some_and(|carrier| self.has_cavity(carrier));
        PlaceGoal {
            world_from_object: goal.world_from_object,
            highest_release_m: if falls_into_cavity { f64::INFINITY } else { self.settings.max_open_release_m },
            clear_height_m: rim + self.settings.rim_clearance_m * self.stage.robot.reach_scale() - goal.bounds.min.z,
        }
    }

    /// True if all conditions of a move hold.
    fn is_done(&self, scene: &PosedScene, step: &Move) -> bool {
        step.atoms.iter().all(|atom| judge_atom(scene, atom, &self.stage.relations).holds)
    }

    /// The first unfinished move of the current alternative. `None` if all are finished.
    fn next_move(&self, scene: &PosedScene) -> Option<Move> {
        self.plans.last()?.iter().find(|step| !self.is_done(scene, step)).cloned()
    }

    /// Starts the next move; returns its first commands and the following phase.
    fn begin(
        &self,
        scene: &PosedScene,
        step: Move,
        (arm, width): (&[f64], f64),
        seen: Option<Vec<Grasp>>,
        seed: Seed,
    ) -> Result<(Vec<Vec<f32>>, Phase), Failure> {
        if step.state().is_some() {
            let (commands, turning) = joint::plan(self, scene, &step, arm, width, seed)?;
            return Ok((commands, Phase::Turning(Box::new(turning))));
        }
        let Pick { commands, open_width, hold_width } = pick::plan(self, scene, &step, (arm, width), seen, seed)?;
        let taken_from = self.taken_from(scene, step.object);
        Ok((commands, Phase::Picked { step, open_width, hold_width, taken_from }))
    }

    fn next(
        &mut self,
        observation: &Observation,
        scene: &PosedScene,
        arm: &[f64],
        width: f64,
    ) -> Result<ActionChunk, PolicyError> {
        loop {
            let Some(step) = self.next_move(scene) else {
                self.phase = Phase::Home;
                return Ok(ActionChunk { actions: self.go_home(scene, arm, width), finished: true });
            };
            self.picks += 1;
            self.waits = 0;
            self.tries += 1;
            let seed = self.seed.fork("pick").fork_index(self.picks);
            let failure = if self.tries > self.settings.tries_per_move {
                self.last_failure.clone()
            } else if let Some(skill) = self.skill_for(scene, &step, seed) {
                self.has_used_skill = true;
                return self.follow_skill(skill, observation, scene, (arm, width));
            } else {
                let seen =
                    if step.state().is_some() { None } else { self.proposed_grasps(observation, scene, step.object)? };
                match self.begin(scene, step, (arm, width), seen, seed) {
                    Ok((actions, phase)) => {
                        self.phase = phase;
                        return Ok(ActionChunk { actions, finished: false });
                    }
                    Err(failure) => {
                        self.last_failure = Some(failure);
                        continue;
                    }
                }
            };
            // No move of this alternative is left; start the next alternative.
            self.plans.pop();
            self.tries = 0;
            if self.plans.is_empty() {
                return Err(PolicyError::GaveUp(failure.unwrap_or_else(|| Failure {
                    cause: FailureCause::NoGoalPose,
                    evidence: "no alternative of the goal can be served".into(),
                })));
            }
        }
    }

    /// Current pose of an object, as a goal for putting it back.
    fn taken_from(&self, scene: &PosedScene, object: usize) -> GoalPose {
        let world_from_object = scene.objects().nth(object).map_or(Pose::IDENTITY, |object| object.pose);
        let bounds = scene.bounds(object).unwrap_or(Aabb::EMPTY);
        GoalPose { world_from_object, support: None, bounds }
    }

    /// Initial phase: an earlier policy may have left an object in the gripper. The expert places it if the next move
    /// concerns it, otherwise it puts it back at its initial pose.
    fn take_over(&mut self, scene: &PosedScene, truth: &PrivilegedState, width: f64) -> Phase {
        let Some(held) = truth.grasped else { return Phase::Free };
        let step = self.next_move(scene).filter(|step| step.object == held && step.state().is_none());
        let start = self.stage.start();
        let taken_from = self.taken_from(start, held);
        let step = step.unwrap_or_else(|| Move { object: held, atoms: Vec::new() });
        let hold_width = (width - self.settings.squeeze_m).max(0.0);
        Phase::Picked { step, open_width: self.stage.robot.gripper.max_width, hold_width, taken_from }
    }

    fn place(
        &mut self,
        scene: &PosedScene,
        truth: &PrivilegedState,
        hand: &ArmState,
        step: &Move,
        taken_from: &GoalPose,
    ) -> Result<ActionChunk, PolicyError> {
        if truth.grasped != Some(step.object) {
            let name = self.stage.name(step.object);
            self.last_failure = Some(Failure {
                cause: FailureCause::Slipped,
                evidence: format!("{name} was not in the hand after lifting (pick {})", self.picks),
            });
            let actions = commands::fingers(&hand.arm, hand.hold_width, hand.open_width, self.settings.open_steps);
            return Ok(ActionChunk { actions, finished: false });
        }
        let seed = self.seed.fork("place").fork_index(self.picks);
        let planned = if step.atoms.is_empty() {
            place::put_back(self, scene, step.object, taken_from, hand, seed)
        } else {
            place::plan(self, scene, step, hand, seed).or_else(|failure| {
                // Put the object back rather than drop it, and retry.
                self.last_failure = Some(failure);
                place::put_back(self, scene, step.object, taken_from, hand, seed)
            })
        };
        match planned {
            Ok(actions) => Ok(ActionChunk { actions, finished: false }),
            // After a takeover in a pose from which nothing can be planned: drop the object and pick it up where it
            // then lies.
            Err(_) if self.picks == 0 => {
                let actions = commands::fingers(&hand.arm, hand.hold_width, hand.open_width, self.settings.open_steps);
                Ok(ActionChunk { actions, finished: false })
            }
            Err(failure) => Err(PolicyError::GaveUp(self.last_failure.clone().unwrap_or(failure))),
        }
    }

    fn go_home(&self, scene: &PosedScene, arm: &[f64], width: f64) -> Vec<Vec<f32>> {
        let world = obstacles::around(scene, None);
        let open = self.stage.robot.gripper.max_width;
        // The gripper opens at the home configuration, where it has clearance.
        let around =
            PlanningScene { world: &world, attached: None, allowed: &AllowedCollisions::none(), gripper_width: width };
        let home = std::slice::from_ref(&self.stage.robot.home);
        match self.planner.plan_joint(&around, arm, home, self.seed.fork("home")) {
            Ok(path) => {
                let mut commands = commands::follow(&self.planner, &path, width, self.settings.empty_speed);
                commands.extend(commands::fingers(path.goal(), width, open, self.settings.open_steps));
                commands
            }
            Err(_) => commands::wait(arm, width, self.settings.rest_steps),
        }
    }

    /// Free motion of the empty gripper during which its opening changes; it changes before the motion if there is no
    /// clearance.
    fn reach(&self, world: &CollisionWorld, path: &Path, from: f64, to: f64) -> Vec<Vec<f32>> {
        let nothing = AllowedCollisions::none();
        let has_clearance = |width: f64| {
            let around = PlanningScene { world, attached: None, allowed: &nothing, gripper_width: width };
            let checker = self.planner.checker(&around, 0.0);
            path.states(CLEARANCE_STEP_RAD).iter().all(|state| checker.is_free(state))
        };
        let steps = ((from - to).abs() / self.settings.fingers_m_s * self.stage.control_rate_hz()).ceil() as usize;
        let mut commands = Vec::new();
        if steps > 1 && !(has_clearance(from) && has_clearance(0.5 * (from + to))) {
            commands.extend(commands::fingers(path.start(), from, to, 2 * steps));
        }
        commands.extend(commands::follow(&self.planner, path, to, self.settings.empty_speed));
        commands.extend(commands::wait(path.goal(), to, steps.saturating_sub(commands.len())));
        commands
    }
}

impl Policy for Expert {
    fn spec(&self) -> PolicySpec {
        let cameras = self.grasp_proposer.as_ref().map_or_else(Vec::new, |_| seen::cameras(&self.stage.scenario));
        PolicySpec { privileged: true, cameras, ..PolicySpec::native("expert", 60.0) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let scenario = start.scenario.as_ref().ok_or_else(|| PolicyError::Unsuited("needs the scenario".into()))?;
        self.seed = start.seed;
        self.plans = moves(&self.stage.goal, self.stage.start());
        match self.settings.style {
            // Random order, so that demonstrations of a disjunction cover all its alternatives.
            ExpertStyle::Default => self.plans.shuffle(&mut start.seed.fork("alternative").rng()),
            // Alternatives are popped from the end.
            ExpertStyle::Consistent => self.plans.reverse(),
        }
        self.upright = scenario.objects.iter().map(|object| object.pose.rotation).collect();
        (self.picks, self.tries, self.waits, self.phase, self.last_failure) = (0, 0, 0, Phase::Beginning, None);
        self.has_used_skill = false;
        if self.plans.is_empty() {
            return Err(PolicyError::Unsuited("no alternative of the goal can be served".into()));
        }
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let truth = observation
            .privileged
            .as_ref()
            .ok_or_else(|| PolicyError::Unsuited("needs simulator truth".into()))?
            .clone();
        let state = observation
            .state
            .get(Observation::STATE)
            .ok_or_else(|| PolicyError::Unsuited("needs `observation.state`".into()))?;
        let (arm, width) = state.split_at(self.stage.robot.arm_dof().min(state.len()));
        let width: f64 = width.iter().sum();
        let scene = self.stage.posed(&truth.objects);
        let moving = truth.objects.iter().any(|object| object.speed > self.settings.rest_speed);
        let phase = std::mem::replace(&mut self.phase, Phase::Free);
        let phase = if matches!(phase, Phase::Beginning) { self.take_over(&scene, &truth, width) } else { phase };
        match phase {
            // Wait for objects that roll or rock.
            Phase::Beginning | Phase::Free if moving && self.waits < self.settings.longest_wait => {
                self.waits += 1;
                let width = self.stage.robot.gripper.max_width.min(width);
                Ok(ActionChunk { actions: commands::wait(arm, width, self.settings.rest_steps), finished: false })
            }
            Phase::Beginning | Phase::Free => self.next(observation, &scene, arm, width),
            Phase::Picked { step, open_width, hold_width, taken_from } => {
                let hand = ArmState { arm: arm.to_vec(), width, open_width, hold_width };
                self.place(&scene, &truth, &hand, &step, &taken_from)
            }
            Phase::Skill(skill) => self.follow_skill(skill, observation, &scene, (arm, width)),
            Phase::Turning(mut turning) => {
                let actions = joint::next(self, &mut turning, arm);
                let finished = false;
                if let Some(actions) = actions {
                    self.phase = Phase::Turning(turning);
                    return Ok(ActionChunk { actions, finished });
                }
                Ok(ActionChunk { actions: joint::release(self, &scene, &turning, arm), finished })
            }
            Phase::Home => Ok(ActionChunk { actions: Vec::new(), finished: true }),
        }
    }
}
