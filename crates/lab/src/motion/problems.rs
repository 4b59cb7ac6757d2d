//! The file of motion problems.

use std::path::Path;

use genmanip_core::glam::DVec3;
use genmanip_core::{Piece, Pose, Shape};
use genmanip_motion::{CollisionWorld, GeometryError};
use serde::{Deserialize, Serialize};

use crate::LabError;
use genmanip_run::{Cause, inputs};

/// Largest file of problems, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// What such a file holds.
#[derive(Serialize, Deserialize)]
pub struct File {
    pub problems: Vec<Written>,
}

/// A problem as it is written.
#[derive(Serialize, Deserialize)]
pub struct Written {
    /// What the motion is for; only for the reader.
    #[serde(default)]
    pub kind: String,
    pub start: Vec<f64>,
    pub goal: Vec<f64>,
    pub obstacles: Vec<Obstacle>,
}

#[derive(Clone, Serialize, Deserialize)]
pub struct Obstacle {
    #[serde(flatten)]
    pub shape: Form,
    pub pos: [f64; 3],
    #[serde(default)]
    pub yaw: f64,
}

/// Sizes are full extents, m.
#[derive(Clone, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Form {
    Box { size: [f64; 3] },
    Cylinder { radius: f64, length: f64 },
    Sphere { radius: f64 },
}

/// Joint positions and what must not be touched.
pub struct Problem {
    pub start: Vec<f64>,
    pub goal: Vec<f64>,
    pub world: CollisionWorld,
    /// Only the tables: boxes whose top is the plane z = 0.
    pub tables: CollisionWorld,
    /// All obstacles, placed in the world.
    pub pieces: Vec<Piece>,
}

pub fn read(path: &Path) -> Result<Vec<Problem>, LabError> {
    let no_problems = |error: Cause| {
        LabError::input(format!("{} is no file of motion problems", path.display())).because(error).with_hint(
            "expected {\"problems\": [{\"start\": [rad], \"goal\": [rad], \"obstacles\": [{\"type\": \"box\", \
             \"size\": [m], \"pos\": [m], \"yaw\": rad}]}]}",
        )
    };
    let text = inputs::read_text(path, MAX_BYTES)?;
    let file: File = serde_json::from_str(&text).map_err(|error| no_problems(error.into()))?;
    file.compile().map_err(|error| no_problems(error.into()))
}

impl File {
    /// The problems in the form the planner takes.
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
    /// In the robot's base frame.
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
