//! The policy that transfers skills: the planner brings the hand to the start of the skill that fits best, the hand
//! follows it, and the gripper acts only once the hand has arrived.

mod active;
mod carry;

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{
    ActionChunk, EpisodeStart, Failure, FailureCause, Observation, Policy, PolicyError, PolicySpec, Pose,
    PrivilegedState, Seed,
};
use genmanip_layout::articulation::{JointChange, joint_changes};
use genmanip_layout::{Move, moves, obstacles};
use genmanip_motion::{AllowedCollisions, Path, Planner, PlanningScene, commands};
use genmanip_relations::{PosedScene, judge_atom};
use genmanip_rollout::Stage;

use self::active::{Active, Look, Phase};
use crate::TransferSettings;
use crate::fit::{Fit, fit_joint};
use crate::handle::verb;
use crate::skill::{Grip, Skill};
use crate::timing::{Pace, paced};

/// Policy that moves joints by skills that were cut from other episodes. It reads simulator truth.
pub struct Transfer {
    stage: Stage,
    planner: Arc<Planner>,
    skills: Arc<[Skill]>,
    settings: TransferSettings,
    seed: Seed,
    /// Moves of the goal's first alternative that a skill serves.
    plan: Vec<Move>,
    tries: usize,
    phase: Phase,
    last_failure: Option<Failure>,
    /// Name of the skill in use.
    used: Option<String>,
}

impl Transfer {
    /// Policy for the episodes of a stage, with skills to choose from.
    pub fn new(stage: &Stage, planner: &Arc<Planner>, skills: Arc<[Skill]>, settings: TransferSettings) -> Self {
        Self {
            stage: stage.clone(),
            planner: Arc::clone(planner),
            skills,
            settings,
            seed: Seed::new(0),
            plan: Vec::new(),
            tries: 0,
            phase: Phase::Free,
            last_failure: None,
            used: None,
        }
    }

    /// The policy for a single move, already reset; it need not be reset before an episode.
    #[must_use]
    pub fn of_move(self, step: Move, seed: Seed) -> Self {
        Self { plan: vec![step], seed, ..self }
    }

    /// Name of the skill that was used last in this episode; `None` before the first one.
    pub fn used(&self) -> Option<&str> {
        self.used.as_deref()
    }

    /// Starts the next move, or finishes.
    fn next(&mut self, scene: &PosedScene, arm: &[f64], width: f64) -> Result<ActionChunk, PolicyError> {
        let is_done = |step: &Move| step.atoms.iter().all(|atom| judge_atom(scene, atom, &self.stage.relations).holds);
        let Some(step) = self.plan.iter().find(|step| !is_done(step)).cloned() else {
            self.phase = Phase::Done;
            let actions = commands::wait(arm, width, self.settings.look_steps);
            return Ok(ActionChunk { actions, finished: true });
        };
        if self.tries >= self.settings.tries {
            return Err(self.give_up());
        }
        self.tries += 1;
        let started = match step.state() {
            None => self.start_carry(scene, &step, arm, width),
            Some(state) => match joint_changes(scene, step.object, state).first() {
                Some(change) => self.start(scene, change, arm, width),
                None => return Err(self.give_up()),
            },
        };
        match started {
            Ok((actions, active)) => {
                self.phase = Phase::Arriving(Box::new(active), 0, None);
                Ok(ActionChunk { actions, finished: false })
            }
            Err(failure) => {
                self.last_failure = Some(failure);
                Err(self.give_up())
            }
        }
    }

    /// Commands to the contact of the best skill that fits and can be approached.
    fn start(
        &mut self,
        scene: &PosedScene,
        change: &JointChange,
        arm: &[f64],
        width: f64,
    ) -> Result<(Vec<Vec<f32>>, Active), Failure> {
        let name = self.stage.name(change.object).to_owned();
        let model = &self.stage.models[change.object];
        let wanted = verb(model, change);
        let kind = model.links[change.link].joint.as_ref().map(|joint| joint.kind);
        let (indices, candidates): (Vec<usize>, Vec<_>) = self
            .skills
            .iter()
            .enumerate()
            .filter(|(_, skill)| skill.serves_joint(wanted, kind))
            .filter_map(|(index, skill)| Some((index, (skill.motion.as_ref()?, skill.grip))))
            .unzip();
        if candidates.is_empty() {
            let evidence = format!("no skill to {} the {} of {name}", wanted.name(), model.links[change.link].name);
            return Err(Failure { cause: FailureCause::Policy, evidence });
        }
        let home = &self.stage.robot.home;
        let (fits, misfits) = fit_joint(scene, change, &self.planner, &candidates, home, &self.settings.fit);
        if fits.is_empty() {
            let evidence = format!(
                "no skill fits {name} where it stands: {} contacts out of reach, {} blocked, {} arm postures could not \
                 follow, {} collide",
                misfits.out_of_reach, misfits.blocked, misfits.unfollowed, misfits.collides
            );
            return Err(Failure { cause: FailureCause::NoIk, evidence });
        }
        let tried = fits.len().min(self.settings.fits);
        // A later try begins with another fit.
        let order = (0..tried).map(|index| (index + self.tries - 1) % tried);
        for fit in order.map(|index| &fits[index]) {
            let Some(mut actions) = self.reach(scene, fit, arm, width) else { continue };
            let skill = &self.skills[indices[fit.skill]];
            self.used = Some(skill.name.clone());
            actions.extend(self.paced(&fit.approach, self.settings.retreat_m, fit.open_width_m));
            let commanded = fit.approach.last().cloned().unwrap_or_default();
            let held_m = fit.open_width_m;
            return Ok((
                actions,
                Active { object: change.object, fit: fit.clone(), grip: skill.grip, held_m, commanded, carry: None },
            ));
        }
        let evidence = format!("no free motion of the arm to any of {tried} skills that fit {name}");
        Err(Failure { cause: FailureCause::Planning, evidence })
    }

    /// Commands from the arm's configuration to the start of a skill's approach; `None` if the planner finds no way.
    fn reach(&self, scene: &PosedScene, fit: &Fit, arm: &[f64], width: f64) -> Option<Vec<Vec<f32>>> {
        let start = fit.approach.first()?;
        if !self.settings.plans_approach {
            let (from, to) = (self.planner.tcp_pose(arm), self.planner.tcp_pose(start));
            let poses =
                (1..=STRAIGHT_STEPS).map(|step| from.interpolate(&to, f64::from(step) / f64::from(STRAIGHT_STEPS)));
            let states = self.planner.follow(arm, poses, f64::INFINITY)?;
            return Some(states.iter().map(|state| commands::command(state, fit.open_width_m)).collect());
        }
        let world = obstacles::around(scene, None);
        let nothing = AllowedCollisions::none();
        let widest_m = width.max(fit.open_width_m);
        let around = PlanningScene { world: &world, attached: None, allowed: &nothing, gripper_width: widest_m };
        let seed = self.seed.fork("reach").fork_index(self.tries as u64);
        let path = self.planner.plan_joint(&around, arm, std::slice::from_ref(start), seed).ok()?;
        let change_m = (fit.open_width_m - width).abs();
        let steps = (change_m / self.settings.gripper_m_s * self.settings.rate_hz).ceil() as usize;
        let mut actions = commands::fingers(arm, width, fit.open_width_m, 2 * steps);
        actions.extend(commands::follow(&self.planner, &path, fit.open_width_m, self.settings.free_speed));
        Some(actions)
    }

    /// Commands along arm configurations at equal distances of a way of a length (m), from rest to rest.
    fn paced(&self, states: &[Vec<f64>], length_m: f64, width_m: f64) -> Vec<Vec<f32>> {
        let joints = self.stage.robot.arm_joints();
        let pace = Pace {
            rate_hz: self.settings.rate_hz,
            hand_m_s: self.settings.hand_m_s,
            joint_rad_s: joints.map(|joint| joint.max_velocity * self.settings.careful_speed).collect(),
        };
        paced(states, length_m, &pace).iter().map(|state| commands::command(state, width_m)).collect()
    }

    /// True if the hand is where it was sent and at rest.
    fn has_arrived(&self, active: &Active, arm: &[f64], before: Option<Pose>) -> bool {
        let (now, wanted) = (self.planner.tcp_pose(arm), self.planner.tcp_pose(&active.commanded));
        let is_there = now.position.distance(wanted.position) < self.settings.arrived_m;
        is_there && before.is_some_and(|before| now.position.distance(before.position) < self.settings.rest_m)
    }

    fn hold(&self, active: &Active) -> ActionChunk {
        let actions = commands::wait(&active.commanded, active.held_m, self.settings.look_steps);
        ActionChunk { actions, finished: false }
    }

    fn arriving(&mut self, active: Box<Active>, looks: usize, before: Option<Pose>, arm: &[f64]) -> ActionChunk {
        let is_late = looks >= self.settings.max_looks;
        if self.settings.waits_for_hand && !is_late && !self.has_arrived(&active, arm, before) {
            let chunk = self.hold(&active);
            self.phase = Phase::Arriving(active, looks + 1, Some(self.planner.tcp_pose(arm)));
            return chunk;
        }
        match active.grip {
            Grip::Grasp { squeeze_m, .. } => {
                let opening_m = active.held_m;
                self.closing(active, (0, 0), squeeze_m, (opening_m, false))
            }
            Grip::Fixed { .. } => self.begin_moving(active),
        }
    }

    /// One control step of closing, by the rule of teleoperation: the command stays ahead of the opening by the source's
    /// squeeze. `steps` counts the control steps so far and those of pressing; `measured` is the opening (m), and true
    /// if both fingers press on the object.
    fn closing(
        &mut self,
        mut active: Box<Active>,
        (steps, pressed): (usize, usize),
        squeeze_m: f64,
        (opening_m, is_held): (f64, bool),
    ) -> ActionChunk {
        let most_m = self.settings.gripper_m_s / self.settings.rate_hz;
        active.held_m = match is_held {
            true => (opening_m - squeeze_m).max(0.0),
            false => (active.held_m - most_m).max((opening_m - squeeze_m.max(LEAST_SQUEEZE_M)).max(0.0)),
        };
        let pressed = if is_held { pressed + 1 } else { 0 };
        if pressed >= PRESS_STEPS {
            return self.begin_moving(active);
        }
        if steps >= CLOSING_STEPS {
            let evidence = format!("the fingers closed beside {}", self.stage.name(active.object));
            self.last_failure = Some(Failure { cause: FailureCause::Slipped, evidence });
            let chunk = self.hold(&active);
            self.phase = Phase::Stopping(active, 0, None);
            return chunk;
        }
        let actions = vec![commands::command(&active.commanded, active.held_m)];
        self.phase = Phase::Closing(active, steps + 1, pressed);
        ActionChunk { actions, finished: false }
    }

    fn begin_moving(&mut self, active: Box<Active>) -> ActionChunk {
        let commands = self.paced(&active.fit.along, active.fit.length_m, active.held_m);
        self.moving(active, commands, 0, None)
    }

    /// The next commands along the joint; `arm` is measured, or `None` at the beginning.
    fn moving(
        &mut self,
        mut active: Box<Active>,
        commands: Vec<Vec<f32>>,
        given: usize,
        arm: Option<&[f64]>,
    ) -> ActionChunk {
        let is_blocked = arm.is_some_and(|arm| {
            let (now, wanted) = (self.planner.tcp_pose(arm), self.planner.tcp_pose(&active.commanded));
            now.position.distance(wanted.position) > self.settings.lag_m
        });
        if is_blocked || given >= commands.len() {
            let chunk = self.hold(&active);
            self.phase = Phase::Stopping(active, 0, arm.map(|arm| self.planner.tcp_pose(arm)));
            return chunk;
        }
        let end = (given + 2 * self.settings.look_steps).min(commands.len());
        let actions = commands[given..end].to_vec();
        if let Some(last) = actions.last() {
            active.commanded = last[..active.commanded.len()].iter().copied().map(f64::from).collect();
        }
        self.phase = Phase::Moving(active, commands, end);
        ActionChunk { actions, finished: false }
    }

    fn stopping(
        &mut self,
        active: Box<Active>,
        looks: usize,
        before: Option<Pose>,
        look: Look,
        scene: &PosedScene,
    ) -> ActionChunk {
        let arm = look.arm;
        let is_late = looks >= self.settings.max_looks;
        let is_waiting = self.settings.waits_for_hand && !is_late && !self.has_arrived(&active, arm, before);
        // A hand that was blocked does not arrive, but comes to rest.
        let is_at_rest = before
            .is_some_and(|before| self.planner.tcp_pose(arm).position.distance(before.position) < self.settings.rest_m);
        if is_waiting && !is_at_rest {
            let chunk = self.hold(&active);
            self.phase = Phase::Stopping(active, looks + 1, Some(self.planner.tcp_pose(arm)));
            return chunk;
        }
        let mut active = active;
        if let Some(carry) = active.carry.take() {
            return self.place(active, &carry, look, scene);
        }
        let actions = self.release(&active, arm, scene);
        self.phase = Phase::Free;
        ActionChunk { actions, finished: false }
    }

    /// Opens the gripper and leaves: as in the source if the hand is at the end of the skill and its way is free, else
    /// straight back.
    fn release(&self, active: &Active, arm: &[f64], scene: &PosedScene) -> Vec<Vec<f32>> {
        let settings = &self.settings;
        let open_m = active.fit.open_width_m;
        let steps = ((open_m - active.held_m).abs() / settings.gripper_m_s * settings.rate_hz).ceil() as usize;
        let mut actions = commands::fingers(&active.commanded, active.held_m, open_m, 2 * steps);
        let is_at_end = active.fit.along.last().is_some_and(|end| close(end, &active.commanded));
        if is_at_end && active.fit.retreat.len() > 1 {
            actions.extend(self.paced(&active.fit.retreat, settings.retreat_m, open_m));
            return actions;
        }
        let tcp = self.planner.tcp_pose(arm);
        let back = tcp.transform_vector(DVec3::NEG_Z);
        let world = obstacles::around(scene, None);
        let nothing = AllowedCollisions::none();
        let around = PlanningScene { world: &world, attached: None, allowed: &nothing, gripper_width: open_m };
        let path =
            [back, (back + DVec3::Z).normalize_or(DVec3::Z), DVec3::Z, DVec3::NEG_X].into_iter().find_map(|way| {
                let goal = Pose { position: tcp.position + way * settings.retreat_m, ..tcp };
                self.planner.straight(&around, arm, &goal).ok()
            });
        let path = path.unwrap_or_else(|| Path::polyline(vec![arm.to_vec()]));
        actions.extend(commands::follow(&self.planner, &path, open_m, settings.careful_speed));
        actions.extend(commands::wait(path.goal(), open_m, settings.look_steps));
        actions
    }

    fn give_up(&self) -> PolicyError {
        PolicyError::GaveUp(self.last_failure.clone().unwrap_or_else(|| Failure {
            cause: FailureCause::Policy,
            evidence: format!("the goal does not hold after {} transfers", self.tries),
        }))
    }
}

/// Interpolated steps of a motion without planner, whatever its length.
const STRAIGHT_STEPS: u8 = 5;
/// Control steps for which closed fingers press before the hand moves on: a fifth of a second.
const PRESS_STEPS: usize = 12;
/// Control steps after which fingers that do not press have missed: twice what they need for their whole way.
const CLOSING_STEPS: usize = 120;
/// Smallest difference between measured and commanded opening while closing, m: below it the fingers do not follow.
const LEAST_SQUEEZE_M: f64 = 0.004;

/// True if two configurations are equal up to the rounding of commands, rad.
fn close(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5)
}

impl Policy for Transfer {
    fn spec(&self) -> PolicySpec {
        PolicySpec { privileged: true, ..PolicySpec::native("transfer", self.settings.rate_hz) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.seed = start.seed;
        let carries = self.skills.iter().any(|skill| skill.carry.is_some());
        let served = |alternative: &Vec<Move>| alternative.iter().all(|step| carries || step.state().is_some());
        let plan = moves(&self.stage.goal, self.stage.start()).into_iter().find(served);
        self.plan = plan.ok_or_else(|| PolicyError::Unsuited("no skill serves the kind of its goal".into()))?;
        (self.tries, self.phase, self.last_failure, self.used) = (0, Phase::Free, None, None);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let truth: &PrivilegedState =
            observation.privileged.as_ref().ok_or_else(|| PolicyError::Unsuited("needs simulator truth".into()))?;
        let state = observation.state.get(Observation::STATE);
        let state = state.ok_or_else(|| PolicyError::Unsuited("needs `observation.state`".into()))?;
        let (arm, width) = state.split_at(self.stage.robot.arm_dof().min(state.len()));
        let width: f64 = width.iter().sum();
        Ok(match std::mem::replace(&mut self.phase, Phase::Free) {
            Phase::Free => return self.next(&self.stage.posed(&truth.objects), arm, width),
            Phase::Arriving(active, looks, before) => self.arriving(active, looks, before, arm),
            Phase::Closing(active, steps, pressed) => {
                let is_held = truth.grasped == Some(active.object);
                let squeeze_m = match active.grip {
                    Grip::Grasp { squeeze_m, .. } => squeeze_m,
                    Grip::Fixed { .. } => 0.0,
                };
                self.closing(active, (steps, pressed), squeeze_m, (width, is_held))
            }
            Phase::Moving(active, commands, given) => self.moving(active, commands, given, Some(arm)),
            Phase::Stopping(active, looks, before) => {
                let look = Look { arm, width, grasped: truth.grasped };
                self.stopping(active, looks, before, look, &self.stage.posed(&truth.objects))
            }
            Phase::Done => ActionChunk { actions: Vec::new(), finished: true },
        })
    }
}
