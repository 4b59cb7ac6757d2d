//! Collision: named obstacles, the robot's exact pieces, a carried object, and rules about who may touch whom.

mod body;
pub(crate) mod checker;
pub(crate) mod convex;
mod cover;
mod edge;
mod fast;
mod fast_piece;
mod field;
mod lane_geometry;
pub(crate) mod lanes;
mod mesh;
mod narrow;
mod pair_table;
mod placed_obstacle;
mod points;
mod polyline;
mod probe;
pub(crate) mod robot_shape;
pub(crate) mod surface;
#[cfg(test)]
mod surface_tests;
#[cfg(test)]
mod tests;
mod triangle;
pub(crate) mod world;

pub use body::Part;
pub use checker::{Checker, CollisionReport};
pub use convex::GeometryError;
pub use mesh::triangulate;
pub use points::SurfaceError;
pub(crate) use probe::Solid;
pub use robot_shape::{RobotError, RobotShape};
pub use world::{Allowed, Attached, World};
