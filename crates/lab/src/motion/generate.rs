//! Random motion problems: a table with objects, and motions typical of picking and placing.
//!
//! A chain of problems per scene: from home to a grasp, from there to a free place, from there to the next grasp. Hard
//! scenes have taller objects and a shelf, open towards the robot; every second goal lies in it.

use genmanip_core::glam::{DMat3, DQuat, DVec2, DVec3};
use genmanip_core::{Pose, Seed};
use genmanip_motion::{AllowedCollisions, Planner, PlanningScene};
use rand::{Rng, RngExt};

use super::OPEN;
use super::problems::{File, Form, Obstacle, Written, world};
use crate::LabError;

/// Position of the tool centre point (tcp) at home, gripper pointing down, m, base frame.
const READY: DVec3 = DVec3::new(0.307, 0.0, 0.487);
/// Area of the objects on the table: ranges of x and y, m, base frame.
const GROUND: [[f64; 2]; 2] = [[0.3, 0.75], [-0.5, 0.5]];
/// Distance between objects, measured between the circumscribed circles of their footprints, m.
const GAP: f64 = 0.01;
/// Range of the height of the tcp above an object to be grasped, m.
const ABOVE: [f64; 2] = [0.02, 0.08];
/// Largest tilt of the gripper from the vertical over the table, rad, and share of tilted poses.
const TILT: (f64, f64) = (0.5, 0.3);
/// Thickness of the shelf's boards and its depth, m.
const BOARD: f64 = 0.02;
const DEPTH: f64 = 0.22;
/// Maximum number of poses sampled for one goal before the chain ends, and of places sampled for one object before it
/// is
/// omitted.
const DRAWS: usize = 40;
/// Number of inverse kinematics solutions sampled per pose; the collision-free one closest to the start is the goal.
const SOLUTIONS: usize = 5;
/// Maximum number of scenes tried per requested problem.
const PATIENCE: usize = 20;

/// `count` problems for the planner's robot, with collision-free starts and goals.
pub fn generate(planner: &Planner, hard: bool, count: usize, seed: Seed) -> Result<File, LabError> {
    let mut problems = Vec::new();
    for index in 0..count * PATIENCE {
        let mut rng = seed.fork_index(index as u64).rng();
        let scene = Scene::draw(hard, &mut rng);
        chain(planner, &scene, &mut rng, &mut problems)?;
        if problems.len() >= count {
            problems.truncate(count);
            return Ok(File { problems });
        }
    }
    let (made, robot) = (problems.len(), &planner.robot().name);
    let tried = count * PATIENCE;
    Err(LabError::input(format!("got only {made} of {count} problems from {tried} random scenes: robot `{robot}` reaches too few places over the table"))
        .with_hint("expected an arm that reaches a table 0.3-0.75 m in front of its base; --tip names its tool frame"))
}

/// Obstacles of a scene; the first is the table top.
struct Scene {
    obstacles: Vec<Obstacle>,
    /// Range of the graspable objects' indices among the obstacles.
    objects: std::ops::Range<usize>,
    shelf: Option<Shelf>,
}

/// Shelf without a front, standing on the table. Its frame has the origin at the centre of the floor and x pointing
/// inwards, away from the opening.
struct Shelf {
    world_from_shelf: Pose,
    width: f64,
    height: f64,
}

/// Adds the problems of one scene; the chain ends when no goal is found.
fn chain(planner: &Planner, scene: &Scene, rng: &mut impl Rng, problems: &mut Vec<Written>) -> Result<(), LabError> {
    let world = world(&scene.obstacles).map_err(|error| LabError::broken("a scene cannot be built", error))?;
    let allowed = AllowedCollisions::none();
    let checker =
        planner.checker(&PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width: OPEN }, 0.0);
    let ready = Pose::new(READY, DQuat::from_rotation_x(std::f64::consts::PI));
    let is_free = |config: &Vec<f64>| checker.check(config).is_none();
    let Some(mut start) = planner.ik(&ready, &planner.robot().home).into_iter().find(is_free) else { return Ok(()) };
    for (kind, grasps) in [("home->grasp", true), ("prev->place", false), ("prev->grasp", true)] {
        let found = (0..DRAWS).find_map(|_| {
            let pose = scene.goal_pose(grasps, rng)?;
            let solutions = planner.ik(&pose, &start);
            let last = solutions.len().checked_sub(1)?;
            let mut chosen: Vec<&Vec<f64>> = (0..SOLUTIONS).map(|_| &solutions[rng.random_range(0..=last)]).collect();
            chosen.sort_by(|a, b| super::distance(&start, a).total_cmp(&super::distance(&start, b)));
            chosen.into_iter().find(|config| is_free(config)).cloned()
        });
        let Some(goal) = found else { return Ok(()) };
        let obstacles = scene.obstacles.clone();
        problems.push(Written { kind: kind.into(), start: start.clone(), goal: goal.clone(), obstacles });
        start = goal;
    }
    Ok(())
}

impl Scene {
    fn draw(hard: bool, rng: &mut impl Rng) -> Self {
        let mut obstacles = vec![Obstacle::cuboid([0.9, 1.6, 0.04], [0.65, 0.0, -0.02], 0.0)];
        if rng.random_bool(0.35) {
            obstacles.push(wall(rng));
        }
        let shelf = hard.then(|| Shelf::draw(rng));
        obstacles.extend(shelf.iter().flat_map(Shelf::boards));
        let first = obstacles.len();
        let (fewest, most, taller) = if hard { (9, 12, 1.5) } else { (5, 11, 1.0) };
        for _ in 0..rng.random_range(fewest..=most) {
            let free = (0..DRAWS)
                .map(|_| object(rng, taller))
                .find(|object| obstacles[1..].iter().all(|other| object.clears(other)));
            obstacles.extend(free);
        }
        Self { objects: first..obstacles.len(), obstacles, shelf }
    }

    /// Tcp pose to grasp an object, or to place one; `None` if the sample is invalid.
    fn goal_pose(&self, grasps: bool, rng: &mut impl Rng) -> Option<Pose> {
        if let Some(shelf) = self.shelf.as_ref().filter(|_| rng.random_bool(0.5)) {
            return Some(shelf.goal_pose(rng));
        }
        let position = if grasps {
            let object = &self.obstacles[rng.random_range(self.objects.clone())];
            let [x, y, z] = object.pos;
            DVec3::new(x, y, z + 0.5 * object.height() + within(rng, ABOVE))
        } else {
            let spot = ground(rng);
            let free = self.obstacles[1..].iter().all(|other| other.beside(spot) > 0.08);
            free.then(|| spot.extend(rng.random_range(0.05..0.14)))?
        };
        let tilt = if rng.random_bool(TILT.1) { rng.random_range(0.0..TILT.0) } else { 0.0 };
        let (toward, turn) = (angle(rng), angle(rng));
        let axis = DVec3::new(toward.cos(), toward.sin(), 0.0);
        let down = DQuat::from_rotation_z(turn) * DQuat::from_rotation_x(std::f64::consts::PI);
        Some(Pose::new(position, DQuat::from_axis_angle(axis, tilt) * down))
    }
}

impl Shelf {
    fn draw(rng: &mut impl Rng) -> Self {
        let yaw = rng.random_range(-0.35..0.35);
        let position = DVec3::new(rng.random_range(0.56..0.68), rng.random_range(-0.3..0.3), 0.0);
        let (width, height) = (rng.random_range(0.34..0.46), rng.random_range(0.24..0.35));
        Self { world_from_shelf: Pose::from_position_yaw(position, yaw), width, height }
    }

    /// Boards of the shelf: two sides, back and top.
    fn boards(&self) -> [Obstacle; 4] {
        let Self { width, height, .. } = *self;
        let board = |size: [f64; 3], middle: [f64; 3]| {
            let position = self.world_from_shelf.transform_point(DVec3::from_array(middle));
            Obstacle::cuboid(size, position.to_array(), self.world_from_shelf.yaw())
        };
        let side = |y: f64| board([DEPTH, BOARD, height], [0.0, y, 0.5 * height]);
        [
            side(0.5 * width),
            side(-0.5 * width),
            board([BOARD, width, height], [0.5 * DEPTH, 0.0, 0.5 * height]),
            board([DEPTH, width, BOARD], [0.0, 0.0, height + 0.5 * BOARD]),
        ]
    }

    /// A reach into the shelf, horizontal or slightly downwards, the fingers closing sideways or vertically.
    fn goal_pose(&self, rng: &mut impl Rng) -> Pose {
        let room = 0.5 * self.width - 0.1;
        let (x, y) = (rng.random_range(-0.08..0.04), rng.random_range(-room..room));
        let position = DVec3::new(x, y, rng.random_range(0.07..0.6 * self.height));
        let (dip, turn) = (rng.random_range(0.0..0.3_f64), rng.random_range(-0.3..0.3));
        let ahead = DVec3::new(dip.cos(), 0.0, -dip.sin());
        let level = DQuat::from_mat3(&DMat3::from_cols(DVec3::Y.cross(ahead), DVec3::Y, ahead));
        let roll = std::f64::consts::FRAC_PI_2 * f64::from(rng.random_range(-1..=2));
        let rotation = DQuat::from_rotation_z(turn) * level * DQuat::from_rotation_z(roll);
        let pose = Pose::new(position, rotation);
        Pose::new(self.world_from_shelf.transform_point(pose.position), self.world_from_shelf.rotation * pose.rotation)
    }
}

impl Obstacle {
    fn cuboid(size: [f64; 3], pos: [f64; 3], yaw: f64) -> Self {
        Self { shape: Form::Box { size }, pos, yaw }
    }

    fn height(&self) -> f64 {
        match self.shape {
            Form::Box { size } => size[2],
            Form::Cylinder { length, .. } => length,
            Form::Sphere { radius } => 2.0 * radius,
        }
    }

    /// Radius of the circumscribed circle of the footprint, m.
    fn foot(&self) -> f64 {
        match self.shape {
            Form::Box { size } => 0.5 * size[0].hypot(size[1]),
            Form::Cylinder { radius, .. } | Form::Sphere { radius } => radius,
        }
    }

    /// Horizontal distance from a point to the footprint, m.
    fn beside(&self, point: DVec2) -> f64 {
        let middle = DVec2::new(self.pos[0], self.pos[1]);
        match self.shape {
            Form::Box { size } => {
                let local = DVec2::from_angle(-self.yaw).rotate(point - middle).abs();
                (local - 0.5 * DVec2::new(size[0], size[1])).max(DVec2::ZERO).length()
            }
            Form::Cylinder { radius, .. } | Form::Sphere { radius } => (point.distance(middle) - radius).max(0.0),
        }
    }

    fn clears(&self, other: &Self) -> bool {
        other.beside(DVec2::new(self.pos[0], self.pos[1])) > self.foot() + GAP
    }
}

fn wall(rng: &mut impl Rng) -> Obstacle {
    let size = [rng.random_range(0.25..0.4), 0.03, rng.random_range(0.2..0.32)];
    let spot = [rng.random_range(0.4..0.6), rng.random_range(-0.35..0.35), 0.5 * size[2]];
    Obstacle::cuboid(size, spot, rng.random_range(-0.3..0.3))
}

/// Random box or cylinder standing on the table; the height of a box is multiplied by `taller`.
fn object(rng: &mut impl Rng, taller: f64) -> Obstacle {
    let DVec2 { x, y } = ground(rng);
    if rng.random_bool(0.5) {
        let mut side = || rng.random_range(0.03..0.11);
        let size = [side(), side(), taller * rng.random_range(0.04..0.22)];
        Obstacle::cuboid(size, [x, y, 0.5 * size[2]], angle(rng))
    } else {
        let (radius, length) = (rng.random_range(0.02..0.045), rng.random_range(0.05..0.2));
        Obstacle { shape: Form::Cylinder { radius, length }, pos: [x, y, 0.5 * length], yaw: 0.0 }
    }
}

fn ground(rng: &mut impl Rng) -> DVec2 {
    DVec2::from_array(GROUND.map(|range| within(rng, range)))
}

fn angle(rng: &mut impl Rng) -> f64 {
    within(rng, [-std::f64::consts::PI, std::f64::consts::PI])
}

fn within(rng: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    rng.random_range(low..high)
}
