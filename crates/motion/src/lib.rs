//! Robot arm motion: kinematics, collision checking, planning, time parametrisation, grasp sampling.
//!
//! Robot and world are arguments; this crate knows no simulator, catalogue or file. [`Planner`] is the main entry
//! point; the modules can also be used alone. Frames: world = robot base; tcp = midpoint between the pads, z =
//! approach, y = closing.

mod chain;
mod collision;
pub mod commands;
mod depth;
pub mod feasibility;
pub mod grasp;
mod hull;
mod ik;
mod linear;
mod path;
mod plan;
mod planner;
mod rigid;
mod timing;

#[cfg(test)]
mod test_robot;

pub use chain::{Chain, ModelError};
pub use collision::{
    AllowedCollisions, Attached, Checker, CollisionReport, CollisionWorld, GeometryError, MovingBody, RobotError,
    RobotShape, SurfaceError, always_near, triangulate,
};
pub use depth::{DepthError, DepthSettings};
pub use feasibility::{
    FeasibilitySettings, FeasibleGrasp, GraspRejection, GraspRejections, HalfTurn, PickMotions, PickQuery,
    PickedObject, PlaceGoal, PlaceQuery, Release,
};
pub use grasp::cloud::{CloudError, CloudGrasp, CloudSettings, CloudTarget};
pub use grasp::{GraspSettings, GraspTarget, GraspWeights, Gripper};
pub use ik::{IkSettings, InverseKinematics};
pub use path::Path;
pub use plan::{PlanError, PlanSettings, StraightSettings};
pub use planner::{Planner, PlannerSettings, PlanningScene};
pub use timing::{MotionLimits, TimingSettings, Trajectory, parametrize};
