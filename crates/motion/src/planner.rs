//! The motion planner of one robot: facade over all modules.

use std::sync::Arc;

use genmanip_core::{Grasp, Pose, RgbdImage, RobotModel, Seed};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::collision::{
    AllowedCollisions, Attached, Checker, CollisionReport, CollisionWorld, GeometryError, RobotError, RobotShape,
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
    /// Point clouds from depth images.
    pub depth: DepthSettings,
    /// Search and ranking of IK solutions.
    pub ik: IkSettings,
    /// Search for collision-free joint-space paths, and their smoothing.
    pub plan: PlanSettings,
    /// Straight TCP motions.
    pub straight: StraightSettings,
    /// Time parametrisation of paths.
    pub timing: TimingSettings,
    /// Grasp candidates from object models.
    pub grasp: GraspSettings,
    /// Grasp candidates from point clouds.
    pub cloud: CloudSettings,
}

/// Context of a motion: obstacles, attached object, allowed contacts and gripper opening.
#[derive(Clone, Copy, Debug)]
pub struct PlanningScene<'a> {
    /// Obstacles by name.
    pub world: &'a CollisionWorld,
    /// The object held by the gripper; `None` if it is empty.
    pub attached: Option<&'a Attached>,
    /// Pairs of body and obstacle that may touch.
    pub allowed: &'a AllowedCollisions,
    /// Gripper opening (m).
    pub gripper_width: f64,
}

/// Kinematics, planning, timing and grasping for one robot; immutable and shareable between threads.
///
/// ```no_run
/// # use genmanip_core::{Pose, RobotModel, Seed};
/// # use genmanip_motion::{AllowedCollisions, Planner, PlannerSettings, PlanningScene, CollisionWorld};
/// # fn go(robot: std::sync::Arc<RobotModel>, world: CollisionWorld, tcp: Pose) -> Result<(), Box<dyn std::error::Error>> {
/// let planner = Planner::new(robot.clone(), PlannerSettings::default())?;
/// let around = PlanningScene { world: &world, attached: None, allowed: &AllowedCollisions::none(), gripper_width: 0.08 };
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
    /// Compiles the robot; fails if its kinematics or collision pieces are invalid.
    pub fn new(robot: Arc<RobotModel>, settings: PlannerSettings) -> Result<Self, RobotError> {
        let shape = RobotShape::new(&robot)?;
        let ik = InverseKinematics::new(shape.chain().clone(), settings.ik.clone());
        let gripper = Gripper::of(&robot, &shape);
        Ok(Self { robot, settings, shape, ik, gripper })
    }

    /// Copy with other depth settings, without recompiling the robot.
    #[must_use]
    pub fn with_depth(&self, depth: DepthSettings) -> Self {
        let mut other = self.clone();
        other.settings.depth = depth;
        other
    }

    /// Copy with another limit of search iterations, without recompiling the robot.
    #[must_use]
    pub fn with_search(&self, max_iterations: usize) -> Self {
        let mut other = self.clone();
        other.settings.plan.max_iterations = max_iterations;
        other
    }

    /// Robot model for which the planner was compiled.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    /// Settings of all algorithms.
    pub fn settings(&self) -> &PlannerSettings {
        &self.settings
    }

    /// The gripper geometry used by the grasp samplers.
    pub fn gripper(&self) -> &Gripper {
        &self.gripper
    }

    /// `world_from_tcp` at a configuration.
    pub fn tcp_pose(&self, config: &[f64]) -> Pose {
        self.shape.chain().tcp_pose(config)
    }

    /// Number of degrees of freedom that move the tool; with fewer than six, IK meets positions, and orientations within
    /// 3.4 degrees.
    pub fn tool_dof(&self) -> usize {
        self.shape.chain().tool_dof()
    }

    /// Range per joint that contains all IK solutions: the limits less a margin, or one turn of a continuous joint.
    pub fn ranges(&self) -> Vec<std::ops::RangeInclusive<f64>> {
        self.ik.solved_ranges()
    }

    /// IK solutions for a TCP pose, best first; empty if it is unreachable.
    pub fn ik(&self, world_from_tcp: &Pose, reference: &[f64]) -> Vec<Vec<f64>> {
        self.ik.solve(world_from_tcp, reference)
    }

    /// Lazy version of [`Planner::ik`].
    pub fn ik_each(&self, world_from_tcp: &Pose, reference: &[f64]) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.ik.solutions(world_from_tcp, reference)
    }

    /// Like [`Planner::ik_each`] without the fine search at the reach limit: for many poses of which any will do, most
    /// of them unreachable.
    pub fn ik_coarse(&self, world_from_tcp: &Pose, reference: &[f64]) -> impl Iterator<Item = Vec<f64>> + use<'_> {
        self.ik.coarse_solutions(world_from_tcp, reference)
    }

    /// IK solution nearest to `previous`, on the same branch; `None` if a joint would move by more than `max_step`.
    pub fn ik_near(&self, world_from_tcp: &Pose, previous: &[f64], max_step: f64) -> Option<Vec<f64>> {
        self.ik.continue_from(world_from_tcp, previous, max_step)
    }

    /// Like [`Planner::ik_near`] at the end of a straight line: an arm with fewer than six joints may turn the tool by up
    /// to [`StraightSettings::max_turn`].
    pub fn ik_along_line(&self, world_from_tcp: &Pose, previous: &[f64], max_step: f64) -> Option<Vec<f64>> {
        self.ik.continue_line(world_from_tcp, previous, max_step, self.settings.straight.max_turn)
    }

    /// Heading (rad) of a point from the axis of the first joint, which is taken to be vertical.
    pub fn heading(&self, point: DVec3) -> f64 {
        let axis = self.shape.chain().moving().first().map_or(DVec3::ZERO, |joint| joint.parent_from_joint.translation);
        (point.y - axis.y).atan2(point.x - axis.x)
    }

    /// IK solutions along a pose sequence, each nearest to the previous one and the first nearest to `from`; `None` if
    /// a joint would move by more than `max_step` (rad) between two of them.
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

    /// Collision checker with a clearance of `padding` (m); 0 reports contacts only.
    pub fn checker<'a>(&'a self, around: &PlanningScene<'a>, padding: f64) -> Checker<'a> {
        Checker::new(&self.shape, around.world, around.attached, around.allowed, around.gripper_width, padding)
    }

    /// Collision pair with the smallest distance at a configuration, without padding; `None` if nothing touches.
    pub fn check(&self, around: &PlanningScene, config: &[f64]) -> Option<CollisionReport> {
        self.checker(around, 0.0).check(config)
    }

    /// The world of `around` plus the remaining points of depth images as a point cloud called `name`.
    ///
    /// Filters pixels on the robot at `config`, on the attached object and on the obstacles of `around`: add the table
    /// as a box, and the target of a grasp under its own name. Space that no camera sees counts as free.
    ///
    /// # Errors
    /// Fails if an image is invalid or no pixel has a depth.
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

    /// Points of depth images, world frame, that belong neither to the robot at `config`, nor to the attached object,
    /// nor to the obstacles of `around`; voxel-downsampled, in pixel order.
    ///
    /// # Errors
    /// Fails if an image is invalid or no pixel has a depth.
    pub fn points_seen(
        &self,
        around: &PlanningScene,
        config: &[f64],
        images: &[RgbdImage],
    ) -> Result<Vec<DVec3>, DepthError> {
        depth::unknown_points(&self.checker(around, 0.0), config, images, &self.settings.depth)
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

    /// Plans a straight TCP motion (linear position, shortest rotation) to `world_from_goal`.
    ///
    /// Pairs closer than the padding at `start` may stay as close; all others keep the padding to the end. For a motion
    /// that ends in contact, plan from the contact and reverse the path.
    pub fn straight(&self, around: &PlanningScene, start: &[f64], world_from_goal: &Pose) -> Result<Path, PlanError> {
        let mut checker = self.checker(around, self.settings.plan.padding);
        let settings = &self.settings;
        plan::straight_line(&mut checker, &self.ik, &settings.straight, &settings.plan, start, world_from_goal)
    }

    /// Fastest smooth trajectory along a path; `speed` in [0, 1] scales velocities (accelerations by its square).
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

    /// Samples grasps on an object, best first, object frame.
    ///
    /// # Errors
    /// Fails if a collision piece is not finite or has no volume.
    pub fn grasps(&self, target: &GraspTarget, seed: Seed) -> Result<Vec<Grasp>, GeometryError> {
        grasp::candidates(target, &self.gripper, &self.settings.grasp, seed)
    }

    /// Known grasps (object frame) that fit at the object's pose, in their order.
    ///
    /// # Errors
    /// Fails if a collision piece is not finite or has no size.
    pub fn fitting_grasps<'a>(
        &self,
        target: &GraspTarget,
        known: impl Iterator<Item = &'a Grasp>,
    ) -> Result<Vec<Grasp>, GeometryError> {
        grasp::fitting(target, &self.gripper, &self.settings.grasp, known)
    }

    /// Grasps (object frame) on a round object turned about the vertical as near to a tool orientation (world frame) as
    /// possible; other grasps unchanged.
    ///
    /// # Errors
    /// Fails if a collision piece has no volume.
    pub fn grasps_towards(
        &self,
        target: &GraspTarget,
        grasps: Vec<Grasp>,
        world_from_tcp: DQuat,
    ) -> Result<Vec<Grasp>, GeometryError> {
        grasp::align::turned_towards(target, grasps, world_from_tcp)
    }

    /// Samples grasps from a point cloud, world frame, best first.
    ///
    /// # Errors
    /// Fails if the cloud is invalid.
    pub fn cloud_grasps(&self, target: &CloudTarget) -> Result<Vec<CloudGrasp>, CloudError> {
        grasp::cloud::cloud_grasps(target, &self.gripper, &self.settings.grasp, &self.settings.cloud)
    }

    /// Gripper opening for the approach to a grasp (m).
    pub fn opening(&self, grasp: &Grasp) -> f64 {
        self.gripper.opening_for(grasp, self.settings.grasp.opening_clearance)
    }
}
