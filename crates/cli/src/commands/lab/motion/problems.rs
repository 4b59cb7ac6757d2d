//! The file of motion problems.

use std::path::Path;

use genmanip_core::glam::DVec3;
use genmanip_core::{Piece, Pose, Shape};
use genmanip_motion::{GeometryError, World};
use serde::Deserialize;

use crate::error::Failed;
use crate::inputs;

/// Largest file of problems, bytes.
const MAX_BYTES: u64 = 256 << 20;

#[derive(Deserialize)]
struct File {
    problems: Vec<Written>,
}

#[derive(Deserialize)]
struct Written {
    start: Vec<f64>,
    goal: Vec<f64>,
    obstacles: Vec<Obstacle>,
}

#[derive(Deserialize)]
struct Obstacle {
    #[serde(flatten)]
    shape: Form,
    pos: [f64; 3],
    #[serde(default)]
    yaw: f64,
}

/// Sizes are full extents, m.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum Form {
    Box { size: [f64; 3] },
    Cylinder { radius: f64, length: f64 },
    Sphere { radius: f64 },
}

/// Joint positions and what must not be touched.
pub struct Problem {
    pub start: Vec<f64>,
    pub goal: Vec<f64>,
    pub world: World,
    /// Only the tables: boxes whose top is the plane z = 0.
    pub tables: World,
    /// All obstacles, placed in the world.
    pub pieces: Vec<Piece>,
}

pub fn read(path: &Path) -> Result<Vec<Problem>, Failed> {
    let no_problems = |error: &dyn std::error::Error| {
        Failed::because(format!("{} is no file of motion problems", path.display()), error).hint(
            "expected {\"problems\": [{\"start\": [rad], \"goal\": [rad], \"obstacles\": [{\"type\": \"box\", \
             \"size\": [m], \"pos\": [m], \"yaw\": rad}]}]}",
        )
    };
    let text = inputs::read_text(path, MAX_BYTES)?;
    let file: File = serde_json::from_str(&text).map_err(|error| no_problems(&error))?;
    let problem = |Written { start, goal, obstacles }: Written| {
        let mut problem = Problem { start, goal, world: World::new(), tables: World::new(), pieces: Vec::new() };
        for (index, obstacle) in obstacles.iter().enumerate() {
            let shape = match &obstacle.shape {
                Form::Box { size } => Shape::Box { half_extents: DVec3::from_array(*size) / 2.0 },
                Form::Cylinder { radius, length } => Shape::Cylinder { radius: *radius, half_height: length / 2.0 },
                Form::Sphere { radius } => Shape::Sphere { radius: *radius },
            };
            let pose = Pose::from_position_yaw(DVec3::from_array(obstacle.pos), obstacle.yaw);
            let is_table =
                matches!(&shape, Shape::Box { half_extents } if (pose.position.z + half_extents.z).abs() < 1e-6);
            let piece = Piece { shape, link_from_piece: pose };
            let name = format!("obstacle {index}");
            for world in [Some(&mut problem.world), is_table.then_some(&mut problem.tables)].into_iter().flatten() {
                world.add(&name, std::slice::from_ref(&piece), &Pose::IDENTITY)?;
            }
            problem.pieces.push(piece);
        }
        Ok(problem)
    };
    let refused = |error: GeometryError| no_problems(&error);
    file.problems.into_iter().map(|written| problem(written).map_err(refused)).collect()
}
