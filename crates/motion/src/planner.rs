//! Everything motion, for one robot.

use std::sync::Arc;

use genmanip_core::{Grasp, Pose, RgbdImage, RobotModel, Seed};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::collision::{
    Allowed, Attached, Checker, CollisionReport, CollisionWorld, GeometryError, RobotError, RobotShape,
};
use crate::depth::{self, DepthError, DepthSettings};
use crate::grasp::cloud::{CloudError, CloudGrasp, CloudSettings, CloudTarget};
use crate::grasp::{self, GraspSettings, GraspTarget, Gripper};
use crate::ik::{IkSettings, InverseKinematics};
use crate::path::Path;
use crate::plan::{self, PlanError, PlanSettings, StraightSettings};
use crate::timing::{self, MotionLimits, TimingSettings, Trajectory};

/// Settings of all algorithms of a [`Planner`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlannerSettings {
    /// Clouds from depth images.
    pub depth: DepthSettings,
    /// Inverse kinematics.
    pub ik: IkSettings,
    /// Joint-space planning.
    pub plan: PlanSettings,
    /// Straight lines of the tcp.
    pub straight: StraightSettings,
    /// Timing.
    pub timing: TimingSettings,
    /// Grasp candidates.
    pub grasp: GraspSettings,
    /// Grasp candidates from points.
    pub cloud: CloudSettings,
}

/// What surrounds one motion: the world, what is carried, what may touch, and how far the gripper is open.
#[derive(Clone, Copy, Debug)]
pub struct PlanningScene<'a> {
    /// Obstacles.
    pub world: &'a CollisionWorld,
    /// The object held by the gripper.
    pub attached: Option<&'a Attached>,
    /// Pairs that may touch.
    pub allowed: &'a Allowed,
    /// Opening between the pads, m.
    pub gripper_width: f64,
}

/// Kinematics, planning, timing and grasping for one robot; immutable, to be shared between threads.
///
/// ```no_run
/// # use genmanip_core::{Pose, RobotModel, Seed};
/// # use genmanip_motion::{Allowed, Planner, PlannerSettings, PlanningScene, CollisionWorld};
/// # fn go(robot: std::sync::Arc<RobotModel>, world: CollisionWorld, tcp: Pose) -> Result<(), Box<dyn std::error::Error>> {
/// let planner = Planner::new(robot.clone(), PlannerSettings::default())?;
/// let around = PlanningScene { world: &world, attached: None, allowed: &Allowed::none(), gripper_width: 0.08 };
/// let goals = planner.ik(&tcp, &robot.home);
/// let path = planner.plan_joint(&around, &robot.home, &goals, Seed::new(1))?;
/// let trajectory = planner.time(&path, 1.0);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug)]
pub struct Planner {
    robot: Arc<RobotModel>,
    settings: PlannerSettings,
    shape: RobotShape,
    ik: InverseKinematics,
    gripper: Gripper,
}

impl Planner {
    /// Compiles the robot; fails when its kinematics or collision pieces are broken.
    pub fn new(robot: Arc<RobotModel>, settings: PlannerSettings) -> Result<Self, RobotError> {
        let shape = RobotShape::new(&robot)?;
        let ik = InverseKinematics::new(shape.chain().clone(), settings.ik.clone());
        let gripper = Gripper::of(&robot, &shape);
        Ok(Self { robot, settings, shape, ik, gripper })
    }

    /// The same planner, which looks at depth images in another way; nothing is compiled again.
    #[must_use]
    pub fn with_depth(&self, depth: DepthSettings) -> Self {
        let mut other = self.clone();
        other.settings.depth = depth;
        other
    }

    /// The same planner, whose searches give up after so many nodes; nothing is compiled again.
    #[must_use]
    pub fn with_search(&self, max_iterations: usize) -> Self {
        let mut other = self.clone();
        other.settings.plan.max_iterations = max_iterations;
        other
    }

    /// The robot.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    /// The settings in force.
    pub fn settings(&self) -> &PlannerSettings {
        &self.settings
    }

    /// The gripper as the grasp generators see it.
    pub fn gripper(&self) -> &Gripper {
        &self.gripper
    }

    /// `world_from_tcp` at a configuration.
    pub fn tcp_pose(&self, config: &[f64]) -> Pose {
        self.shape.chain().tcp_pose(config)
    }

    /// Configurations that bring the tcp to `world_from_tcp`, best first; empty when it is out of reach.
    pub fn ik(&self, world_from_tcp: &Pose, reference: &[f64]) -> Vec<Vec<f64>> {
        self.ik.solve(world_from_tcp, reference)
    }

    /// What [`Planner::ik`] returns, one after the other: for those who need only the first few.
    pub fn ik_each(&self, world_from_tcp: &Pose, reference: &[f64]) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.ik.solutions(world_from_tcp, reference)
    }

    /// As [`Planner::ik_each`], without those that only a fine search at the edge of reach would find: for many poses of
    /// which any will do, most of them out of reach.
    pub fn ik_coarse(&self, world_from_tcp: &Pose, reference: &[f64]) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.ik.coarse_solutions(world_from_tcp, reference)
    }

    /// The configuration nearest to `previous` that brings the tcp to `world_from_tcp`, on the same branch;
    /// `None` when a joint would have to move by more than `max_step`.
    pub fn ik_near(&self, world_from_tcp: &Pose, previous: &[f64], max_step: f64) -> Option<Vec<f64>> {
        self.ik.continue_from(world_from_tcp, previous, max_step)
    }

    /// Configurations that bring the tcp to one pose after the other, each the nearest to the one before and the first
    /// the nearest to `from`; `None` when a joint would have to move by more than `max_step` rad between two of them.
    pub fn follow(
        &self,
        from: &[f64],
        world_from_tcp: impl Iterator<Item = Pose>,
        max_step: f64,
    ) -> Option<Vec<Vec<f64>>> {
        let mut previous = from.to_vec();
        world_from_tcp
            .map(|pose| {
                previous = self.ik_near(&pose, &previous, max_step)?;
                Some(previous.clone())
            })
            .collect()
    }

    /// Collision tests at a distance of `padding` metres (0: contact only).
    pub fn checker<'a>(&'a self, around: &PlanningScene<'a>, padding: f64) -> Checker<'a> {
        Checker::new(&self.shape, around.world, around.attached, around.allowed, around.gripper_width, padding)
    }

    /// The worst contact or penetration at a configuration, if any.
    pub fn check(&self, around: &PlanningScene, config: &[f64]) -> Option<CollisionReport> {
        self.checker(around, 0.0).check(config)
    }

    /// The world of `around` with everything else that depth cameras see added as a cloud called `name`.
    ///
    /// Pixels on the robot (which stood at `config`), on what it carries and on the obstacles of `around` are left
    /// out: put the table in as a box, and the target of a grasp under its own name.
    /// What no camera sees counts as free.
    ///
    /// # Errors
    /// Images that cannot be used, or that see nothing at all.
    pub fn world_seen(
        &self,
        around: &PlanningScene,
        config: &[f64],
        name: &str,
        images: &[RgbdImage],
    ) -> Result<CollisionWorld, DepthError> {
        let points = self.points_seen(around, config, images)?;
        let mut world = around.world.clone();
        if !points.is_empty() {
            world.add_points(name, &points, self.settings.depth.radius_m)?;
        }
        Ok(world)
    }

    /// Points in the world that depth images see and nothing known explains, neither the robot at `config`, nor what
    /// it carries, nor the obstacles of `around`; thinned, in the order of the pixels.
    ///
    /// # Errors
    /// Images that cannot be used, or that see nothing at all.
    pub fn points_seen(
        &self,
        around: &PlanningScene,
        config: &[f64],
        images: &[RgbdImage],
    ) -> Result<Vec<DVec3>, DepthError> {
        depth::unexplained_points(&self.checker(around, 0.0), config, images, &self.settings.depth)
    }

    /// A short, smooth, collision-free path from `start` to one of `goals`.
    pub fn plan_joint(
        &self,
        around: &PlanningScene,
        start: &[f64],
        goals: &[Vec<f64>],
        seed: Seed,
    ) -> Result<Path, PlanError> {
        let mut checker = self.checker(around, self.settings.plan.padding);
        plan::plan(&mut checker, &self.settings.plan, start, goals, seed.fork("plan"))
    }

    /// A path that moves the tcp straight (position linearly, rotation along the shortest turn) to `world_from_goal`.
    ///
    /// What the robot is close to at `start` it may stay close to; from everything else it keeps the padding, to the
    /// end: plan from the contact away, and reverse the path for a motion that ends there.
    pub fn straight(&self, around: &PlanningScene, start: &[f64], world_from_goal: &Pose) -> Result<Path, PlanError> {
        let mut checker = self.checker(around, self.settings.plan.padding);
        let settings = &self.settings;
        plan::straight_line(&mut checker, &self.ik, &settings.straight, &settings.plan, start, world_from_goal)
    }

    /// The fastest smooth trajectory along a path; `speed` in 0-1 scales the velocities (accelerations by its square).
    pub fn time(&self, path: &Path, speed: f64) -> Trajectory {
        let speed = if speed.is_finite() { speed.clamp(0.01, 1.0) } else { 1.0 };
        let settings = &self.settings.timing;
        let joints = || self.robot.arm_joints();
        let limits = MotionLimits {
            velocity: joints().map(|joint| joint.max_velocity * settings.velocity_fraction * speed).collect(),
            acceleration: joints()
                .map(|joint| joint.max_acceleration * settings.acceleration_fraction * speed * speed)
                .collect(),
        };
        timing::parametrize(path, &limits, settings)
    }

    /// Grasp candidates on an object, best first, in the object's frame.
    ///
    /// # Errors
    /// A piece of the object that is not finite or has no volume.
    pub fn grasps(&self, target: &GraspTarget, seed: Seed) -> Result<Vec<Grasp>, GeometryError> {
        grasp::candidates(target, &self.gripper, &self.settings.grasp, seed)
    }

    /// Those of known grasps (object frame) that fit where the object is, in their order.
    ///
    /// # Errors
    /// A piece of the object that is not finite or has no size.
    pub fn fitting_grasps<'a>(
        &self,
        target: &GraspTarget,
        known: impl Iterator<Item = &'a Grasp>,
    ) -> Result<Vec<Grasp>, GeometryError> {
        grasp::fitting(target, &self.gripper, &self.settings.grasp, known)
    }

    /// Grasp candidates from points alone, in the world, best first.
    ///
    /// # Errors
    /// A cloud that cannot be worked with.
    pub fn cloud_grasps(&self, target: &CloudTarget) -> Result<Vec<CloudGrasp>, CloudError> {
        grasp::cloud::cloud_grasps(target, &self.gripper, &self.settings.grasp, &self.settings.cloud)
    }

    /// Opening with which a grasp is approached, m.
    pub fn opening(&self, grasp: &Grasp) -> f64 {
        self.gripper.opening_for(grasp, self.settings.grasp.opening_clearance)
    }
}
