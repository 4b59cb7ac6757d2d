//! Pick and place: grasp and lift of the take that fits best, a planned carry, lowering and retreat of the same take.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{ActionChunk, Failure, FailureCause, Pose};
use genmanip_layout::{GoalOrder, GoalPoseSettings, GoalSearch, Move};
use genmanip_motion::{AllowedCollisions, PlanningScene, commands};
use genmanip_relations::PosedScene;

use super::Transfer;
use super::active::{Active, Carry, Look, Phase};
use crate::carry::{Carrying, Lowering};
use crate::skill::{CarryMotion, Grip};

impl Transfer {
    /// Commands to the grasp of the best skill that fits the object and can be approached.
    pub(super) fn start_carry(
        &mut self,
        scene: &PosedScene,
        step: &Move,
        arm: &[f64],
        width: f64,
    ) -> Result<(Vec<Vec<f32>>, Active), Failure> {
        let name = self.stage.name(step.object).to_owned();
        let (indices, candidates): (Vec<usize>, Vec<(&CarryMotion, Grip)>) = self
            .skills
            .iter()
            .enumerate()
            .filter_map(|(index, skill)| Some((index, (skill.carry.as_ref()?, skill.grip))))
            .unzip();
        let goals = self.goals(scene, step);
        if goals.is_empty() {
            let evidence = format!("no free place for {name} where every condition on it holds");
            return Err(Failure { cause: FailureCause::NoGoalPose, evidence });
        }
        let carrying = Carrying::new(scene, step.object, &self.planner, &self.settings.fit);
        let (fits, misfits) = carrying
            .map_or_else(Default::default, |carrying| carrying.fits(&candidates, &goals, &self.stage.robot.home));
        if fits.is_empty() {
            let evidence = format!(
                "no skill fits {name} where it lies: {} grasps out of reach, {} blocked, {} arm postures could not \
                 follow, {} collide, {} of no use at {} goals",
                misfits.out_of_reach,
                misfits.blocked,
                misfits.unfollowed,
                misfits.collides,
                misfits.unplaced,
                goals.len()
            );
            return Err(Failure { cause: FailureCause::NoIk, evidence });
        }
        let tried = fits.len().min(self.settings.fits);
        // A later try begins with another fit.
        let order = (0..tried).map(|index| (index + self.tries - 1) % tried);
        for found in order.map(|index| &fits[index]) {
            let fit = &found.pick;
            let Some(mut actions) = self.reach(scene, fit, arm, width) else { continue };
            let index = indices[fit.skill];
            let skill = &self.skills[index];
            self.used = Some(skill.name.clone());
            actions.extend(self.paced(&fit.approach, self.settings.retreat_m, fit.open_width_m));
            let carry = Carry { skill: index, turned: found.turned, goals: found.goals.clone() };
            let active = Active {
                object: step.object,
                fit: fit.clone(),
                grip: skill.grip,
                held_m: fit.open_width_m,
                commanded: fit.approach.last().cloned().unwrap_or_default(),
                carry: Some(carry),
            };
            return Ok((actions, active));
        }
        let evidence = format!("no free motion to the grasps of {name}");
        Err(Failure { cause: FailureCause::Planning, evidence })
    }

    /// Goal poses of a move at which all its conditions hold.
    fn goals(&self, scene: &PosedScene, step: &Move) -> Vec<Pose> {
        let upright: Vec<DQuat> = self.stage.scenario.objects.iter().map(|placed| placed.pose.rotation).collect();
        let settings = GoalPoseSettings::default();
        let search = GoalSearch {
            scene,
            upright: &upright,
            workspace: &self.stage.scenario.world.workspace,
            relations: &self.stage.relations,
            settings: &settings,
            order: GoalOrder::Margin,
        };
        let later: Vec<Move> = self.plan.iter().skip_while(|other| *other != step).skip(1).cloned().collect();
        let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
        let usable = |goal: &Pose| self.planner.reaches_from_above(goal.position + DVec3::Z * height);
        let seed = self.seed.fork("goal").fork_index(self.tries as u64);
        search.goal_poses(step, &later, &usable, seed).into_iter().map(|goal| goal.world_from_object).collect()
    }

    /// Carries the object in the hand to the first goal that can be reached, or puts it back where it was.
    pub(super) fn place(
        &mut self,
        mut active: Box<Active>,
        carry: &Carry,
        look: Look,
        scene: &PosedScene,
    ) -> ActionChunk {
        let name = self.stage.name(active.object).to_owned();
        let failed = |cause, evidence| Some(Failure { cause, evidence });
        if look.grasped != Some(active.object) {
            self.last_failure = failed(FailureCause::Slipped, format!("{name} was not in the hand after lifting"));
            let actions = self.release(&active, look.arm, scene);
            self.phase = Phase::Free;
            return ActionChunk { actions, finished: false };
        }
        let found = self.carried(&active, carry, look, scene);
        let (mut actions, lowering) = found.unwrap_or_else(|| {
            self.last_failure =
                failed(FailureCause::Planning, format!("no free motion brings {name} to {} goals", carry.goals.len()));
            let back = |states: &[Vec<f64>]| states.iter().rev().cloned().collect::<Vec<_>>();
            let (lower, retreat) = (back(&active.fit.along), back(&active.fit.approach));
            let margin_rad = active.fit.margin_rad;
            (Vec::new(), Lowering { lower, length_m: active.fit.length_m, retreat, margin_rad })
        });
        let Lowering { lower, length_m, retreat, .. } = lowering;
        actions.extend(self.paced(&lower, length_m, active.held_m));
        active.commanded = lower.last().cloned().unwrap_or_default();
        (active.fit.along, active.fit.retreat) = (lower, retreat);
        self.phase = Phase::Stopping(active, 0, None);
        ActionChunk { actions, finished: false }
    }

    /// Commands to above the first goal that can be reached, and the motions from there on.
    fn carried(
        &self,
        active: &Active,
        carry: &Carry,
        look: Look,
        scene: &PosedScene,
    ) -> Option<(Vec<Vec<f32>>, Lowering)> {
        let (planner, settings) = (&self.planner, &self.settings);
        let carrying = Carrying::new(scene, active.object, planner, &settings.fit)?;
        let world_from_object = scene.objects().nth(active.object)?.pose;
        let tcp_from_object = planner.tcp_pose(look.arm).inverse() * world_from_object;
        let attached = carrying.attached(&tcp_from_object)?;
        let motion = self.skills.get(carry.skill)?.carry.as_ref()?;
        let nothing = AllowedCollisions::none();
        let around = PlanningScene {
            world: carrying.others(),
            attached: Some(&attached),
            allowed: &nothing,
            gripper_width: look.width,
        };
        let seed = self.seed.fork("carry").fork_index(self.tries as u64);
        carry.goals.iter().find_map(|goal| {
            let lowering = carrying.lowering(motion, goal, &tcp_from_object, carry.turned, &active.commanded)?;
            let above = lowering.lower.first()?.clone();
            let path = planner.plan_joint(&around, &active.commanded, &[above], seed).ok()?;
            Some((commands::follow(planner, &path, active.held_m, settings.careful_speed), lowering))
        })
    }
}
