//! File format of motion problems.

use genmanip_workspace::documents;
use std::path::Path;

use genmanip_core::glam::DVec3;
use genmanip_core::limits;
use genmanip_core::{DocumentError, Piece, Pose, Shape, json};
use genmanip_motion::{CollisionWorld, GeometryError};
use serde::{Deserialize, Serialize};

use crate::LabError;
use genmanip_workspace::Cause;

/// Contents of the file.
#[derive(Serialize, Deserialize)]
pub struct File {
    pub problems: Vec<Written>,
}

/// A problem in the file.
#[derive(Serialize, Deserialize)]
pub struct Written {
    /// Purpose of the motion, informative only.
    #[serde(default)]
    pub kind: String,
    /// Initial joint positions of the arm, rad (prismatic joints: m).
    pub start: Vec<f64>,
    /// Final joint positions of the arm, rad (prismatic joints: m).
    pub goal: Vec<f64>,
    pub obstacles: Vec<Obstacle>,
}

/// An obstacle at rest.
#[derive(Clone, Serialize, Deserialize)]
pub struct Obstacle {
    #[serde(flatten)]
    pub shape: Form,
    /// Position of the centre in the robot's base frame, m.
    pub pos: [f64; 3],
    /// Rotation about the vertical axis, rad.
    #[serde(default)]
    pub yaw: f64,
}

/// Shape of an obstacle, m: full edge lengths of a box, radius and full length of a cylinder along z, radius of a
/// sphere.
#[derive(Clone, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Form {
    Box { size: [f64; 3] },
    Cylinder { radius: f64, length: f64 },
    Sphere { radius: f64 },
}

/// A problem as input of the planner.
pub struct Problem {
    pub start: Vec<f64>,
    pub goal: Vec<f64>,
    pub world: CollisionWorld,
    /// Only the tables: boxes with their top at z = 0.
    pub tables: CollisionWorld,
    /// All obstacles in the world.
    pub pieces: Vec<Piece>,
}

/// Maximum number of problems in a file, and of obstacles in a problem: ten times the useful amount. Chosen by hand.
const MAX_PROBLEMS: usize = 10_000;
const MAX_OBSTACLES: usize = 1_000;
/// Maximum absolute value of a size or coordinate of an obstacle, m, and of a joint position, rad or m.
const MAX_SIZE_M: f64 = 20.0;
const MAX_POSITION: f64 = 100.0;

/// The first `count` problems of a file for an arm of `dof` joints; all of them are validated.
pub fn read(path: &Path, dof: usize, count: usize) -> Result<Vec<Problem>, LabError> {
    let no_problems = |error: Cause| {
        LabError::input(format!("{} is not a file of motion problems", path.display())).because(error).with_hint(
            "expected {\"problems\": [{\"start\": [rad], \"goal\": [rad], \"obstacles\": [{\"type\": \"box\", \
             \"size\": [m], \"pos\": [m], \"yaw\": rad}]}]}",
        )
    };
    let text = documents::read_text(path, limits::PROBLEMS)?;
    // Parsed twice, since only the second pass knows the location of a value, and only the first detects duplicate
    // keys.
    json::parse(&text).map_err(|error| {
        let hint = if let DocumentError::NotJson { hint, .. } = &error { *hint } else { "" };
        no_problems(error.into()).with_hint(hint)
    })?;
    let mut file: File = serde_json::from_str(&text).map_err(|error| no_problems(error.into()))?;
    if let Some(fault) = file.fault(dof) {
        return Err(LabError::input(format!("{}: at $.{fault}", path.display()))
            .with_hint("lengths are metres, joint positions radians, one for each joint of the arm that moves"));
    }
    file.problems.truncate(count);
    file.compile().map_err(|error| no_problems(error.into()))
}

impl File {
    /// Description of the first field that is invalid for an arm with `dof` joints; `None` if all are valid.
    fn fault(&self, dof: usize) -> Option<String> {
        let within = |value: f64, most: f64| value.abs() <= most;
        if self.problems.len() > MAX_PROBLEMS {
            return Some(format!("problems: expected at most {MAX_PROBLEMS}, got {}", self.problems.len()));
        }
        for (index, problem) in self.problems.iter().enumerate() {
            for (name, config) in [("start", &problem.start), ("goal", &problem.goal)] {
                let place = format!("problems[{index}].{name}");
                if config.len() != dof {
                    return Some(format!("{place}: expected {dof} joint positions, got {}", config.len()));
                }
                if let Some(q) = config.iter().find(|q| !within(**q, MAX_POSITION)) {
                    return Some(format!(
                        "{place}: expected joint positions from -{MAX_POSITION} to {MAX_POSITION}, got {q}"
                    ));
                }
            }
            let count = problem.obstacles.len();
            if count > MAX_OBSTACLES {
                return Some(format!("problems[{index}].obstacles: expected at most {MAX_OBSTACLES}, got {count}"));
            }
            for (number, obstacle) in problem.obstacles.iter().enumerate() {
                let place = format!("problems[{index}].obstacles[{number}]");
                let sizes = match obstacle.shape {
                    Form::Box { size } => size.to_vec(),
                    Form::Cylinder { radius, length } => vec![radius, length],
                    Form::Sphere { radius } => vec![radius],
                };
                if let Some(size) = sizes.iter().find(|size| !(1e-6..=MAX_SIZE_M).contains(*size)) {
                    return Some(format!("{place}: expected sizes from 1e-6 to {MAX_SIZE_M} m, got {size}"));
                }
                if let Some(far) =
                    obstacle.pos.iter().chain([&obstacle.yaw]).find(|value| !within(**value, MAX_POSITION))
                {
                    return Some(format!(
                        "{place}: expected pos and yaw from -{MAX_POSITION} to {MAX_POSITION}, got {far}"
                    ));
                }
            }
        }
        None
    }

    /// The problems as input of the planner.
    pub fn compile(self) -> Result<Vec<Problem>, GeometryError> {
        let problem = |Written { start, goal, obstacles, .. }: Written| {
            let tables: Vec<Obstacle> = obstacles.iter().filter(|obstacle| obstacle.is_table()).cloned().collect();
            let pieces = obstacles.iter().map(Obstacle::piece).collect();
            Ok(Problem { start, goal, world: world(&obstacles)?, tables: world(&tables)?, pieces })
        };
        self.problems.into_iter().map(problem).collect()
    }
}

impl Obstacle {
    /// The obstacle as a collision shape in the robot's base frame.
    fn piece(&self) -> Piece {
        let shape = match self.shape {
            Form::Box { size } => Shape::Box { half_extents: DVec3::from_array(size) / 2.0 },
            Form::Cylinder { radius, length } => Shape::Cylinder { radius, half_height: length / 2.0 },
            Form::Sphere { radius } => Shape::Sphere { radius },
        };
        Piece { shape, link_from_piece: Pose::from_position_yaw(DVec3::from_array(self.pos), self.yaw) }
    }

    fn is_table(&self) -> bool {
        matches!(self.shape, Form::Box { size } if (self.pos[2] + size[2] / 2.0).abs() < 1e-6)
    }
}

/// Obstacles named by their index, in the robot's base frame.
pub fn world(obstacles: &[Obstacle]) -> Result<CollisionWorld, GeometryError> {
    let mut world = CollisionWorld::new();
    for (index, obstacle) in obstacles.iter().enumerate() {
        world.add(&format!("obstacle {index}"), &[obstacle.piece()], &Pose::IDENTITY)?;
    }
    Ok(world)
}
