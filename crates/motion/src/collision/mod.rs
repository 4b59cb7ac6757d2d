//! Collision: named obstacles, the robot's exact pieces, a carried object, and rules about who may touch whom.

mod bodies;
pub(crate) mod checker;
pub(crate) mod convex;
mod cover;
mod edge;
mod fast;
mod lanes;
mod narrow;
mod pair_table;
mod polyline;
pub(crate) mod robot_shape;
#[cfg(test)]
mod tests;
pub(crate) mod world;

pub use checker::{Checker, CollisionReport};
pub use convex::GeometryError;
pub use robot_shape::{RobotError, RobotShape};
pub use world::{Allowed, Attached, Part, World};
